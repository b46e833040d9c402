"""The names of this room and where each lives: for type checkers, and for `armwright.lazy`."""

from armwright.twin.faults import Fault as Fault
from armwright.twin.listen import BusListener as BusListener, bus_recording as bus_recording, shadow_bus as shadow_bus
from armwright.twin.on_bus import scenario_on_bus as scenario_on_bus
from armwright.twin.rehearsal import Rehearsal as Rehearsal, rehearse as rehearse
from armwright.twin.run import BusRun as BusRun, release_drives as release_drives, run_controller as run_controller
from armwright.twin.safety import Permission as Permission
from armwright.twin.twin import Twin as Twin
