"""The master: it enables the drives of an arm, runs a scenario's controller over the bus, and brings the arm to rest.

    SYNC k ─→ positions and torques of tick k ─→ the controller ─→ torques, in force from SYNC k + 1

In lock-step the next SYNC waits for the controller, so that a run against the twin is exact however slow a machine is. In real
time SYNC comes at its time, and what is late or missing is counted.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import BusError
from armwright.twin import objects as od
from armwright.twin.bus import LOOK, node_numbers, open_bus
from armwright.twin.cycles import Cycles
from armwright.twin.faults import TEXT
from armwright.twin.objects import dictionary, eds_text
from armwright.twin.rehearsal import Rehearsal
from armwright.twin.state_machine import POWERED, State
from armwright.twin.twin import SYNC

if TYPE_CHECKING:
    import canopen

TORQUE_MODE = 10  # cyclic synchronous torque: target torque 0, and the offset of the LWA 4P's mapping
WORDS = ((0x06, State.READY), (0x07, State.SWITCHED_ON), (0x0F, State.ENABLED))  # the way up
ENABLE, QUICK_STOP, DISABLE, RESET = 0x0F, 0x02, 0x00, 0x80
MASK = 0x6F  # bits of the statusword that are the state
PATIENCE = 10.0  # [s] that lock-step waits for an answer
ANSWER = 2.0  # [s] that a node has to answer when an object is read or written
CYCLES_TO_REST = 500  # of a quick stop, at most
MASTER = 1  # number of the master, whose heartbeat nodes listen to
HEARTBEAT, BEATS = 0.1, 3  # [s] from beat to beat, and beats after which the drives stop
ROUNDING = 1.5  # counts between where the scenario starts and where the arm stands


class Master:
    """A master on a bus; a context manager, which finally brings the drives to rest and closes the bus.

    Args:
        rehearsal: of the run.   bus: by name.   nodes: of the joints; default: from 3.   eds: paths of the nodes' data sheets;
            default: the twin's.
    """

    def __init__(
        self, rehearsal: Rehearsal, bus: str, *, nodes: Sequence[int] | None = None, eds: Sequence[str] | None = None
    ):
        arm = rehearsal.scenario.arm
        self.rehearsal, self.bus, self.numbers = rehearsal, bus, node_numbers(nodes, arm.n)
        self.names, self.units, self.period = arm.names, rehearsal.units, rehearsal.stages.period
        self._dictionaries = [_dictionary(number, eds, k) for k, number in enumerate(self.numbers)]
        self._network: Any = None
        self._heart: Any = None
        self.nodes: list[canopen.RemoteNode] = []
        self.status = np.zeros(arm.n, dtype=int)
        self.torque, self.counts = np.zeros(arm.n), np.zeros(arm.n)
        self.cycles = Cycles(self.period)
        self._came = np.zeros(arm.n, dtype=bool)
        self._all = threading.Condition()
        self._sent, self._received = od.packing(od.RECEIVED), od.packing(od.SENT)
        self._moves = False

    def __enter__(self) -> Master:
        import canopen

        network = canopen.Network(open_bus(self.bus))
        network.NOTIFIER_CYCLE = LOOK  # type: ignore[misc]
        self._network = network
        try:
            network.connect()
            for joint, number in enumerate(self.numbers):
                self.nodes.append(network.add_node(number, self._dictionaries[joint]))
                self.nodes[-1].sdo.RESPONSE_TIMEOUT = ANSWER
                network.subscribe(0x180 + number, lambda cob, data, stamp, joint=joint: self._take(joint, data))
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(self, *exception: object) -> None:
        try:
            if self._moves:
                self.stop()
        finally:
            self._close()

    def _close(self) -> None:
        network, self._network = self._network, None
        if network is None:
            return
        bus = network.bus
        if self._heart is not None:
            self._heart.stop()
        try:
            network.disconnect()
        finally:
            if network.bus is not None:
                bus.shutdown()

    # Before anything moves.

    def configure(self, heartbeat: float | None) -> None:
        """Sets up every node and checks its identity; nothing moves.

        Args:
            heartbeat: [s] from beat to beat; the drives stop where three are missing. None: no heartbeat.
        Raises:
            BusError: a node that does not answer, is none of CiA 402, or lacks the mode or the mapping.
        """
        most = np.rint(self.rehearsal.stages.limits / self.units.thousandth)
        for node, name, torque in zip(self.nodes, self.names, most, strict=True):
            node.nmt.state = "PRE-OPERATIONAL"
            self._check(node, name)
            self._put(node, od.MAX_TORQUE, int(min(torque, 1000)))
            self._put(node, od.MODE, TORQUE_MODE)
            self._put(node, od.TARGET_TORQUE, 0)
            value, power = self.rehearsal.load.interpolation()
            self._put(node, od.INTERPOLATION, value)
            self._put(node, od.INTERPOLATION_POWER, power)
            if heartbeat is not None:
                self._put(node, od.CONSUMER, MASTER << 16 | round(1e3 * BEATS * heartbeat))
                self._put(node, od.ABORT_OPTION, 3)
        if heartbeat is not None:
            self._heart = self._network.send_periodic(0x700 + MASTER, [5], heartbeat)
        self._network.send_message(0, [1, 0])  # all nodes: operational

    def _check(self, node: canopen.RemoteNode, name: str) -> None:
        device = self.get(node, (0x1000, 0))
        if device & 0xFFFF != od.DEVICE_TYPE & 0xFFFF:
            what = f"node {node.id} of {name} has device type 0x{device:08X}"
            raise BusError(what, place="nodes", value=node.id, expected="a drive by CiA 402, type 0x…0192")
        if not self.get(node, od.SUPPORTED_MODES) >> (TORQUE_MODE - 1) & 1:
            what = f"node {node.id} of {name} has no cyclic synchronous torque mode"
            raise BusError(what, place="nodes", value=node.id, expected="mode 10 in object 6502")
        for first, keys in ((0x1600, od.RECEIVED), (0x1A00, od.SENT)):
            count = self.get(node, (first, 0))
            found = [self.get(node, (first, sub)) for sub in range(1, count + 1)]
            if found != od.mapping(keys):
                names = ", ".join(f"{each >> 16:04X}:{each >> 8 & 0xFF}" for each in found)
                wanted = ", ".join(f"{index:04X}:{sub}" for index, sub in keys)
                what = f"node {node.id} of {name} maps {names or 'nothing'}"
                raise BusError(what, place=f"object {first:04X}", expected=wanted)

    def get(self, node: canopen.RemoteNode, key: od.Key) -> int:
        """Value of an object of a node.

        Raises:
            BusError: the node does not answer, or does not have it.
        """
        import canopen

        index, sub = key
        try:
            return int.from_bytes(node.sdo.upload(index, sub), "little")
        except canopen.SdoCommunicationError:
            expected = f"the joints' nodes, {', '.join(map(str, self.numbers))} by --nodes, on a bus that is up"
            what = f"node {node.id} does not answer on {self.bus}"
            raise BusError(what, place="nodes", value=node.id, expected=expected) from None
        except canopen.SdoAbortedError as error:
            what = f"node {node.id} refuses to read object {index:04X}:{sub}: {error}"
            raise BusError(what, place="nodes", value=node.id, expected="a drive by CiA 402") from None

    def _put(self, node: canopen.RemoteNode, key: od.Key, value: int) -> None:
        import canopen

        index, sub = key
        data = value.to_bytes(od.ENTRIES[key].kind.bits // 8, "little", signed=value < 0)
        try:
            node.sdo.download(index, sub, data)
        except (canopen.SdoCommunicationError, canopen.SdoAbortedError) as error:
            what = f"node {node.id} refuses {value} for object {index:04X}:{sub}: {error}"
            raise BusError(what, place="nodes", value=node.id, expected="a drive by CiA 402") from None
        if self.get(node, key) != int.from_bytes(data, "little"):
            what = f"node {node.id} does not keep {value} in object {index:04X}:{sub}"
            raise BusError(what, place="nodes", value=node.id, expected="a drive by CiA 402")

    # A cycle.

    def _take(self, joint: int, data: Any) -> None:
        """Process data of a node."""
        if len(data) != self._received.size:
            return
        status, torque, counts = self._received.unpack(data)
        with self._all:
            self.status[joint], self.torque[joint], self.counts[joint] = status, torque, counts
            self._came[joint] = True
            if self._came.all():
                self._all.notify()

    def cycle(self, until: float | None = None) -> bool:
        """Sends a SYNC and waits for all answers; True if all came.

        Args:
            until: time of `perf_counter` to wait to; None: for long, and not to have them is an error.
        """
        with self._all:
            self._came[:] = False
        self.cycles.began()
        self._network.send_message(SYNC, [])
        with self._all:
            timeout = PATIENCE if until is None else max(until - time.perf_counter(), 0.0)
            complete = self._all.wait_for(self._came.all, timeout)
            self.cycles.received(len(self._came), int(self._came.sum()))
            if not complete and until is None:
                joint = int(np.argmin(self._came))
                what = f"node {self.numbers[joint]} of {self.names[joint]} sent no process data after SYNC"
                raise BusError(what, place="nodes", value=self.numbers[joint], expected="nodes that are operational")
            return bool(complete)

    def send(self, word: int, thousandths: np.ndarray) -> None:
        """Sends controlword and torques to all nodes; they take effect at the next SYNC."""
        for number, torque, counts in zip(self.numbers, thousandths, self.counts, strict=True):
            self._network.send_message(0x200 + number, self._sent.pack(word, int(torque), int(counts)))

    @property
    def q(self) -> np.ndarray:
        """(n,) measured positions [rad | m]."""
        return np.asarray(self.units.position(self.counts))

    @property
    def applied(self) -> np.ndarray:
        """(n,) measured output of the drives [A | N m | N]."""
        return np.asarray(self.units.command(self.torque))

    def states(self) -> list[State | None]:
        """State of every drive, by its statusword."""
        return [next((each for each in State if _matches(int(word), each)), None) for word in self.status]

    def enable(self) -> np.ndarray:
        """Enables all drives at one SYNC; returns the measurement at the SYNC before, with the arm at rest.

        Raises:
            BusError: a drive that does not go into the next state; names it and its fault.
        """
        self.cycle()
        for _ in range(2):
            if State.FAULT in self.states():
                self.send(RESET, self.torque)
                self.cycle()
                self.send(DISABLE, self.torque)
                self.cycle()
        start = np.concatenate([self.q, self.applied])
        for word, state in WORDS:
            start = np.concatenate([self.q, self.applied])
            self._moves = word == ENABLE
            self.send(word, self.torque)
            self.cycle()
            self.expect(state)
        return start

    def expect(self, state: State) -> None:
        """Refuses to continue if a drive is in another state.

        Raises:
            BusError: names the joint, its state, and its fault.
        """
        for joint, found in enumerate(self.states()):
            if found is not state:
                raise self._wrong(joint, found, state)

    def _wrong(self, joint: int, found: State | None, state: State) -> BusError:
        what = f"node {self.numbers[joint]} of {self.names[joint]} is in state {_name(found)}"
        if found in (State.FAULT, State.REACTION):
            code = self.get(self.nodes[joint], od.ERROR_CODE)
            what += f", error 0x{code:04X}: {TEXT.get(code, 'see the manual of the drive')}"
        return BusError(what, place=f"joint {self.names[joint]!r}", expected=f"{_name(state)}; all drives were stopped")

    def stop(self) -> None:
        """Brings all drives to rest by a quick stop, then disables their voltage; nodes that do not answer are left alone."""
        self._moves = False
        clock, nothing = time.perf_counter(), np.zeros(len(self.numbers))
        for k in range(CYCLES_TO_REST):
            self.send(QUICK_STOP, nothing)
            if self._heart is not None:  # in real time
                time.sleep(max(clock + k * self.period - time.perf_counter(), 0.0))
            answered = self.cycle(time.perf_counter() + ANSWER)
            if not answered or not any(state in POWERED for state in self.states()):
                break
        self.send(DISABLE, nothing)
        self.cycle(time.perf_counter() + ANSWER)


def _name(state: State | None) -> str:
    return "unknown" if state is None else state.name.lower().replace("_", " ")


def _matches(word: int, state: State) -> bool:
    mask = 0x4F if state in (State.NOT_READY, State.SWITCH_ON_DISABLED, State.REACTION, State.FAULT) else MASK
    return (word & mask) == state.value


def _dictionary(number: int, eds: Sequence[str] | None, k: int) -> Any:
    """The object dictionary of a node: of a file, else the twin's."""
    if not eds:
        return dictionary(eds_text(number, "", {}), number)
    path = eds[k if len(eds) > 1 else 0]
    try:
        from canopen.objectdictionary.eds import import_eds

        found = import_eds(path, number)
    except OSError as error:
        raise BusError(f"cannot be read: {error.strerror}", file=path, expected="an EDS file") from None
    except Exception as error:  # noqa: BLE001  the importer raises whatever a foreign file makes it raise
        raise BusError(f"no EDS: {type(error).__name__}: {error}", file=path, expected="an EDS file") from None
    wanted = (*od.RECEIVED, *od.SENT, od.MODE, od.SUPPORTED_MODES, od.ABORT_OPTION)
    lacking = sorted({f"{index:04X}" for index, _ in wanted if index not in found})
    if lacking:
        raise BusError(f"lacks the objects {', '.join(lacking)}", file=path, expected="the EDS of a drive by CiA 402")
    return found
