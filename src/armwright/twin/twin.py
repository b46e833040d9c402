"""The twin: the simulated arm as CiA 402 drives on a bus, one node for each joint, with time counted in SYNCs.

At every SYNC, in this order:

    1. the process data that came since the last one is taken into force
    2. if the arm moves, the simulation does the tick that ends here, with the commands of 1
    3. positions and torques are measured, and sent with the statuswords

The arm stands, held by its brakes, until a drive is enabled: that SYNC is tick 0 of the scenario, whose schedules, grips and
faults are counted from it. It stands again when no motor has torque and nothing moves; the next drive that is enabled begins
the scenario anew, from where the arm then stands.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Any, Self

import numpy as np

from armwright.errors import ArmwrightError, BusError
from armwright.simulation.checks import is_whole
from armwright.simulation.scenario import Scenario
from armwright.simulation.simulation import Simulation
from armwright.twin import objects as od
from armwright.twin.bus import BITRATE, LOOK, BusLoad, node_numbers, open_bus, require_twin
from armwright.twin.cycles import Cycles
from armwright.twin.drive import SetPoint, TwinDrive
from armwright.twin.faults import LATE_SYNC, Fault
from armwright.twin.node import TwinNode
from armwright.twin.objects import Key
from armwright.twin.on_bus import plant_on_bus
from armwright.twin.profile import Servo
from armwright.twin.state_machine import State
from armwright.twin.units import BusUnits

SYNC = 0x80
RAMP, QUICK_RAMP = 0.25, 0.1  # [s] from rest to the largest speed, and from there to rest in a quick stop
WINDOW, REACHED = 5.0, 0.1  # [degrees | mm] of the following error, and of a target that is reached
STILL = 50  # ticks without torque and motion after which the arm stands
WATCH = 0.01  # [s] between two looks for the master's heartbeat
PAUSED = 0.05  # [s] between two looks of a process that was stopped in between


class Twin:
    """The simulated arm of a scenario as drives on a bus; a context manager, which closes the bus at its end.

    Args:
        scenario: whose arm, start, sensors, timing and inputs it has; its controller runs at the master.
        bus: "virtual", "socketcan:can0" or "udp_multicast:ADDRESS".
        nodes: numbers of the joints' nodes; default: from 3.   serial: number that object 1018 shows.
        faults: to be injected.   bitrate: [bit/s] for the time that frames take.

    Attributes:
        nodes: by joint.   drives: by joint.   units: of the bus.   simulation: of the arm.   cycles: what was counted.
        load: of the bus.   failure: the error that ended the simulation; None while it goes on.
    Raises:
        BusError: no such bus, node or serial numbers that are none, or an arm that cannot be driven over a bus.
    Example:
        >>> from dataclasses import replace
        >>> scenario = aw.read_scenario("examples/bus-8ms.scenario.toml")
        >>> scenario = replace(scenario, lanes=None, vary={}, duration=0.2)
        >>> with aw.bus.Twin(scenario) as twin:
        ...     len(twin.nodes)
        6
    """

    def __init__(
        self,
        scenario: Scenario,
        bus: str = "virtual",
        *,
        nodes: Sequence[int] | None = None,
        serial: int = 1,
        faults: Sequence[Fault] = (),
        bitrate: int = BITRATE,
    ):
        require_twin()
        if not is_whole(serial, 0) or serial >= 2**32:
            raise BusError(place="serial", value=serial, expected="a whole number of 32 bits, 0 to 4294967295")
        self.scenario = plant_on_bus(scenario, bitrate=bitrate)
        self.bus, self.period = bus, self.scenario.tick
        self.units = BusUnits.of(self.scenario)
        self.simulation = Simulation(self.scenario)
        if not isinstance(faults, (list, tuple)) or not all(isinstance(fault, Fault) for fault in faults):
            raise BusError(place="faults", value=faults, expected="a list of faults")
        self.arm, self.faults = self.scenario.arm, tuple(faults)
        self._lock, self._ended = threading.RLock(), threading.Event()
        self.load = load = BusLoad(self.arm.n, self.period, bitrate)
        numbers = node_numbers(nodes, self.arm.n)
        self.drives: list[TwinDrive] = []
        self.nodes: list[TwinNode] = []
        for joint, (number, name) in enumerate(zip(numbers, self.arm.names, strict=True)):
            defaults = self._defaults(joint, load) | {od.SERIAL: serial}
            self.drives.append(TwinDrive(name, defaults, self.period))
            self.nodes.append(TwinNode(number, f"{self.arm.name} {name}", self.drives[-1], defaults, self._lock))
        self.cycles = Cycles(self.period)
        self.failure: ArmwrightError | None = None
        q = self.simulation.scenario.initial_state[0, : self.arm.n]
        self._servo = Servo(self.arm, self.units, np.asarray(q, dtype=float), self.period)
        self._follows = np.zeros(self.arm.n, dtype=bool)  # joints that the servo moves
        self._runs, self._began, self._rests, self._still = False, False, True, 0
        lanes = self.simulation.lanes(1)
        y = self.simulation.controller.y
        self._first = y.parts(self.simulation.initial_blocks(lanes)["y"][0])  # before tick 0
        self._network: Any = None
        self._coasts = False
        self._watcher = threading.Thread(target=self._watch, name="twin", daemon=True)
        self._measure()

    def _defaults(self, joint: int, load: BusLoad) -> dict[Key, int]:
        """Values of a drive's objects that follow from the record."""
        body, count = self.arm.coordinates[joint], float(self.units.count[joint])
        unit = 1e-3 if body.kind.units.linear else np.deg2rad(1.0)
        low, high = body.limits.position
        speed = int(body.limits.velocity / count)
        value, power = load.interpolation()
        turn = body.kind.units.whole
        rated, constant = float(self.units.limit[joint] * self.units.torque[joint]), body.drive.torque_constant
        return {
            od.CYCLE: round(1e6 * self.period),
            od.INTERPOLATION: value,
            od.INTERPOLATION_POWER: power,
            od.LOWEST: int(np.ceil(low / count)),
            od.HIGHEST: int(np.floor(high / count)),
            od.MAX_SPEED: speed,
            od.PROFILE_SPEED: speed // 2,
            od.ACCELERATION: round(speed / RAMP),
            od.DECELERATION: round(speed / RAMP),
            od.STOP_DECELERATION: round(speed / QUICK_RAMP),
            od.WINDOW: round(WINDOW * unit / count),
            od.REACHED: round(REACHED * unit / count),
            od.RATED_TORQUE: round(1e3 * rated),
            od.RATED_CURRENT: round(1e3 * rated / abs(body.drive.gear_ratio * constant)) if constant else 0,
            od.SEARCH_SPEED: speed // 10,
            od.HOME_SPEED: speed // 100,
            od.HOMING_ACCELERATION: round(speed / RAMP),
            (0x608F, 1): round(turn / count),
        }

    # Connection.

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def open(self) -> None:
        """Joins the bus: every node boots up.

        Raises:
            BusError: no such bus.
        """
        import canopen

        network = canopen.Network(open_bus(self.bus))
        network.NOTIFIER_CYCLE = LOOK  # type: ignore[misc]
        self._network = network
        try:
            network.connect()
            for node in self.nodes:
                node.connect(network)
            network.subscribe(SYNC, self._synchronised)
            self._watcher.start()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Leaves the bus, and closes it."""
        network, self._network = self._network, None
        self._ended.set()
        if self._watcher.is_alive():
            self._watcher.join()
        if network is None:
            return
        bus = network.bus
        try:
            for node in self.nodes:
                node.disconnect()
            network.disconnect()
        finally:
            if network.bus is not None:
                bus.shutdown()

    # A cycle.

    def _synchronised(self, can_id: int, data: Any, timestamp: float) -> None:
        """SYNC."""
        with self._lock:
            self._coasts = False
            self.cycles.began()
            self._cycle()
            self.cycles.ended()

    def _cycle(self) -> None:
        """Work of one SYNC."""
        if self.failure is not None:
            return
        try:
            self._latch()
            self._move()
        except ArmwrightError as error:
            self.failure = error
            return
        self._measure()
        for node in self.nodes:
            node.send()

    def _latch(self) -> None:
        """Takes process data into force, but for what injected faults take away."""
        active = [fault for fault in self.faults if self._runs and self._active(fault)]
        for node, drive in zip(self.nodes, self.drives, strict=True):
            of_drive = {fault.kind for fault in active if fault.joint in (None, drive.name)}
            drive.stuck = "stuck-encoder" in of_drive
            drive.hot, drive.sagging = "over-temperature" in of_drive, "supply-sag" in of_drive
            node.latch(lost="lost-frames" in of_drive)
            if any(f.kind == "late-sync" and f.size >= self.period and f.joint in (None, drive.name) for f in active):
                drive.fail(LATE_SYNC)
        expected = [n for n in self.nodes if n.drive.state is State.ENABLED and n.drive.mode in od.CYCLIC]
        self.cycles.received(len(expected), sum(node.received for node in expected))

    def _active(self, fault: Fault) -> bool:
        first, behind = fault.ticks(self.period)
        return first <= self.simulation.tick < behind

    def _move(self) -> None:
        """One tick of the simulation, if the arm moves."""
        points = [drive.tick(received=node.received) for drive, node in zip(self.drives, self.nodes, strict=True)]
        # drives that hold the arm after a quick stop rest as well: what enables them begins the scenario
        rested, self._rests = self._rests, not any(d.state is State.ENABLED or d.demand_speed for d in self.drives)
        if self._runs:
            self._step(points)
        if rested and any(drive.state is State.ENABLED for drive in self.drives):
            self._begin()

    def _begin(self) -> None:
        """Tick 0 of the scenario, with the arm as it stands."""
        if self.simulation.tick > 0:
            self.simulation.restore(self.simulation.state.at_tick(0))
        self._runs, self._began, self._still = True, True, 0

    def _step(self, points: Sequence[SetPoint]) -> None:
        """One tick of the simulation with the set-points of the drives."""
        units = self.units
        torque = np.array([np.nan if point.torque is None else point.torque for point in points])
        u, follows = units.command(np.nan_to_num(torque)), np.isnan(torque)
        if np.any(follows):
            for joint in map(int, np.flatnonzero(follows & ~self._follows)):
                self._servo.begin(joint, float(self._applied[joint]))
            wanted = units.position(np.array([point.position for point in points]))
            speed = units.position(np.array([point.speed for point in points]))
            enabled = np.array([drive.state is State.ENABLED for drive in self.drives])
            seen = np.where(enabled, [drive.encoder for drive in self.drives], [drive.true for drive in self.drives])
            seen_speed = np.where(enabled, [d.speed for d in self.drives], [d.true_speed for d in self.drives])
            most = np.array([drive.values[od.MAX_TORQUE] for drive in self.drives])
            limit = units.command(np.where(enabled, most, 1000.0))
            more = units.command(np.array([point.feedforward for point in points]))
            asked = self._servo.command(wanted, speed, units.position(seen), units.position(seen_speed), limit, more)
            u = np.where(follows, asked, u)
        self._follows = follows
        for joint, drive in enumerate(self.drives):
            drive.values[od.TORQUE_DEMAND] = int(units.thousandths(u)[joint])
        self.simulation.step(np.clip(u, -units.limit, units.limit))
        quiet = not any(drive.moves or abs(drive.true_speed) * self.period > 1.0 for drive in self.drives)
        self._still = self._still + 1 if quiet else 0
        if self._still > STILL:
            self._runs, self._still = False, 0

    @property
    def _measurement(self) -> dict[str, np.ndarray]:
        """Measured positions, and commands that the drives follow; before tick 0 without noise."""
        if self._began:
            y, n = self.simulation.measurement, self.arm.n  # of one lane, with or without an axis for it
            return {"q": np.reshape(y.q, n), "applied": np.reshape(y.applied, n)}
        return self._first

    def _measure(self) -> None:
        """Positions and torques as the drives see them."""
        y = self._measurement
        self._applied = y["applied"]
        sent, torque = self.units.counts(y["q"]), self.units.thousandths(y["applied"])
        true = self.units.counts(np.reshape(self.simulation.plant_state.q, self.arm.n))
        for drive, *values in zip(self.drives, sent.tolist(), torque.tolist(), true.tolist(), strict=True):
            drive.measured(*map(int, values))

    # Without a master.

    def _watch(self) -> None:
        """Looks for the master's heartbeat; without it the drives come to rest by themselves, since no SYNC comes any more."""
        looked = time.monotonic()
        while not self._ended.wait(self.period if self._coasts else WATCH):
            with self._lock:
                paused, looked = time.monotonic() - looked, time.monotonic()
                if paused > PAUSED:  # the whole process stood still, and beats wait in its queue
                    for node in self.nodes:
                        node.excuse(paused)
                lost = [node.watch() for node in self.nodes]
                self._coasts = (self._coasts or any(lost)) and self._runs
                if self._coasts:
                    self._cycle()
