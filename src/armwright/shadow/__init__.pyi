"""The names of this room and where each lives: for type checkers, and for `armwright.lazy`."""

from armwright.shadow.alarms import ShadowAlarm as ShadowAlarm
from armwright.shadow.observer import Residuals as Residuals, ShadowBandwidths as ShadowBandwidths
from armwright.shadow.rows import ShadowEvent as ShadowEvent
from armwright.shadow.shadow import ArmShadow as ArmShadow, Shadow as Shadow, shadow_log as shadow_log
from armwright.shadow.verdict import Judged as Judged
