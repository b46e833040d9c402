"""The names of this room and where each lives: for type checkers, and for `armwright.lazy`."""

from armwright.collision.capsules import Capsule as Capsule, link_capsules as link_capsules
from armwright.collision.clearance import Clearance as Clearance, Nearest as Nearest, clearance as clearance
from armwright.collision.obstacles import (
    BoxObstacle as BoxObstacle,
    PlaneObstacle as PlaneObstacle,
    SphereObstacle as SphereObstacle,
)
