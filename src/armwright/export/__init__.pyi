"""The names of this room and where each lives: for type checkers, and for `armwright.lazy`."""

from armwright.export.actuator_fit import ActuatorFit as ActuatorFit, fit_actuators as fit_actuators
from armwright.export.controller.write import (
    ExportedController as ExportedController,
    export_controller as export_controller,
)
from armwright.export.fmu.write import ExportedFmu as ExportedFmu, export_fmu as export_fmu
from armwright.export.ros2 import Ros2Export as Ros2Export, export_ros2 as export_ros2
