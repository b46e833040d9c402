"""The names of this room and where each lives: for type checkers, and for `armwright.lazy`."""

from armwright.pictures.live import LiveArm as LiveArm
from armwright.pictures.show import Shown as Shown
from armwright.pictures.workspace_maps import draw_workspace as draw_workspace
