"""The master: it enables the drives of an arm, runs a scenario's controller over the bus, and brings the arm to rest.

    SYNC k ─→ positions and torques of tick k ─→ the controller ─→ torques, in force from SYNC k + 1

In lock-step the next SYNC waits for the controller, so that a run against the twin is exact however slow a machine is. In real
time SYNC comes at its time, and what is late or missing is counted.

A drive's state is what its answer in this very cycle says. One missing answer is bridged by the last measurement; several in a
row, a heartbeat that ends, a node that starts anew and a second device with its number are troubles, which end a run.
"""

from __future__ import annotations

import contextlib
import functools
import os
import threading
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import BusError, RunStopped
from armwright.reading import read_file
from armwright.twin import clock, objects as od
from armwright.twin.bus import LOOK, bus_errors, check_bus, node_numbers, open_bus
from armwright.twin.cycles import Cycles
from armwright.twin.faults import TEXT
from armwright.twin.objects import dictionary, eds_text
from armwright.twin.rehearsal import Rehearsal
from armwright.twin.safety import joints_without_brake
from armwright.twin.state_machine import HELD, State
from armwright.twin.twin import SYNC

if TYPE_CHECKING:
    import canopen

TORQUE_MODE = 10  # cyclic synchronous torque: target torque 0, and the offset of the LWA 4P's mapping
SHUTDOWN, SWITCH_ON, ENABLE, QUICK_STOP, DISABLE, RESET = 0x06, 0x07, 0x0F, 0x02, 0x00, 0x80
UP = {State.SWITCH_ON_DISABLED: SHUTDOWN, State.READY: SWITCH_ON, State.SWITCHED_ON: SWITCH_ON, State.FAULT: RESET}
UP |= {State.QUICK_STOP: QUICK_STOP}  # held since the last run: enabled from there, so that its arm does not fall
MASK = 0x6F  # bits of the statusword that are the state
PATIENCE = 10.0  # [s] that lock-step waits for an answer
ANSWERED = 0.9  # of a period: how long answers are waited for in real time
ANSWER = 2.0  # [s] that a node has to answer when an object is read or written
ECHO = 0.05  # [s] in which a second device answers what the first has answered
REST, UNHEARD = 3.0, 0.5  # [s] of a quick stop, at most; and at least if a node may hear that cannot answer
SLOW = 0.005  # of the speed limit: slower than that over `LOOKED` cycles a joint stands still
LOOKED = 10  # cycles
TRIES = 20  # cycles to bring all drives to the state before operation enabled
MASTER = 1  # number of the master, whose heartbeat nodes listen to
HEARTBEAT, BEATS = 0.1, 3  # [s] from beat to beat, and beats after which the drives stop, and the master
MISSING = 2  # answers in a row that a lost node has missed
FROZEN, FEWEST = 0.02, 5  # [s] and cycles that an answer repeats itself,
CHANGED = 20  # [thousandths] while the command changes by more: it is no measurement
OPERATIONAL = 5  # state of network management that a heartbeat shows
STRANGER, STRANGERS = "another master is on the bus", 2  # its SYNCs that are no proof yet
ECHOING = "udp_multicast"  # the interface that brings back what this process sends
ROUNDING = 1.5  # counts between where the scenario starts and where the arm stands
DRIVE = "a drive by CiA 402"
STAYS, DISABLES = 6, 2  # object 605A: after the ramp of a quick stop hold the joint, or disable the drive


@dataclass(frozen=True)
class Identity:
    """Identity of a node, object 1018: vendor, product, serial number."""

    vendor: int
    product: int
    serial: int

    @property
    def is_twin(self) -> bool:
        """True for a simulated drive of this package."""
        return (self.vendor, self.product) == (od.TWIN_VENDOR, od.TWIN_PRODUCT)


@dataclass(frozen=True)
class Trouble:
    """The cause that ends a run.

    Attributes:
        joint: its index; None of the bus itself.   what: the problem.   expected: in its place.
        faulted: True if the drive reports a fault.   believed: False if its node's answers are none, or implausible.
    """

    joint: int | None
    what: str
    expected: str
    faulted: bool = False
    believed: bool = True


@dataclass(frozen=True)
class Ending:
    """State of the drives after a quick stop.

    Attributes:
        still: names of the joints that stand still.   moving: of those that still moved after `seconds`.
        unknown: of those whose drives gave no answer that is plausible.
        held: True if the drives hold the arm, those of `limp` aside; False if they are disabled.
        limp: names of the joints whose drives have no torque, such as after a fault, though they are to hold the arm.
        lifted: names of the joints that gravity moves and that have no brake.   seconds: the quick stop took.
    """

    still: tuple[str, ...]
    moving: tuple[str, ...]
    unknown: tuple[str, ...]
    held: bool
    lifted: tuple[str, ...]
    seconds: float
    limp: tuple[str, ...] = ()

    def __str__(self) -> str:
        ways = {"at rest": self.still, "still moving": self.moving, "unknown, for want of answers": self.unknown}
        states = [(way, names) for way, names in ways.items() if names]
        parts = [f"{'all joints' if len(states) == 1 else ', '.join(names)} {way}" for way, names in states]
        text = f"after a quick stop of {self.seconds:.2g} s: {', '.join(parts)}"
        if not self.still and not self.moving:
            return text
        if not self.held:
            return f"{text}; the drives are disabled"
        lifted, limp = ", ".join(self.lifted), ", ".join(self.limp)
        if set(self.limp) >= {*self.still, *self.moving}:
            return f"{text}; no drive{' that answers' if self.unknown else ''} has torque, and no brake holds {lifted}"
        but = f" but for {limp}, where the drive has no torque" if limp else ""
        return f"{text}; the drives hold the arm{but}, until you release them (--release): no brake holds {lifted}"


class Master:
    """A master on a bus; a context manager, which finally brings the drives to rest and closes the bus.

    Args:
        rehearsal: of the run.   bus: by name.   nodes: of the joints; default: from 3.   eds: paths of the nodes' data sheets;
            default: the twin's.   missing: answers that a node misses in a row before it counts as lost.
    """

    def __init__(
        self,
        rehearsal: Rehearsal,
        bus: str,
        *,
        nodes: Sequence[int] | None = None,
        eds: Sequence[str] | None = None,
        missing: int = MISSING,
    ):
        arm = rehearsal.scenario.arm
        self.rehearsal, self.bus, self.numbers = rehearsal, bus, node_numbers(nodes, arm.n)
        self.names, self.units, self.period = arm.names, rehearsal.units, rehearsal.stages.period
        self.missing, self.lifted = missing, joints_without_brake(arm)
        self._dictionaries = [_dictionary(number, eds, k) for k, number in enumerate(self.numbers)]
        self._network: Any = None
        self._heart: Any = None
        self._heartbeat: float | None = None
        self.nodes: list[canopen.RemoteNode] = []
        self.status = np.zeros(arm.n, dtype=int)
        self.torque, self.counts = np.zeros(arm.n), np.zeros(arm.n)
        self.cycles = Cycles(self.period)
        self._cycle = 0  # since the drives were enabled
        self._heard = [0] * arm.n  # cycle of the last answer
        self._last_heartbeat = np.full(arm.n, -np.inf)  # of the last heartbeat [s]
        self._missed, self._doubled, self._repeated = ([0] * arm.n for _ in range(3))  # cycles in a row
        self._answers: list[list[bytes]] = [[] for _ in range(arm.n)]  # to this SYNC
        self._last: list[bytes] = [b""] * arm.n
        self._least, self._most = [np.inf] * arm.n, [-np.inf] * arm.n  # commands since an answer changed [thousandths]
        self._booted = np.zeros(arm.n, dtype=bool)
        self._replies: dict[tuple[int, int, int], int] = {}  # to requests of an object: node, index, subindex
        self._masters = {SYNC: 0, 0x700 + MASTER: 0}  # frames of a master, less the echoes of our own
        self._echo = int(check_bus(bus)[0] == ECHOING)
        self._broken = ""
        self._all = threading.Condition()
        self._sent, self._received = od.packing(od.RECEIVED), od.packing(od.SENT)
        self._moves = False
        self.enabled = False  # were the drives, in this run

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
                network.subscribe(0x580 + number, lambda cob, data, stamp, number=number: self._reply(number, data))
                network.subscribe(
                    0x700 + number, lambda cob, data, stamp, joint=joint: self._heartbeat_received(joint, data)
                )
            network.subscribe(SYNC, lambda *frame: self._heard_master(SYNC))
            network.subscribe(0x700 + MASTER, lambda *frame: self._heard_master(0x700 + MASTER))
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
            with contextlib.suppress(*bus_errors()):  # of a bus that is gone already
                network.disconnect()
        finally:
            if network.bus is not None:
                bus.shutdown()

    # Before anything moves.

    def identify(self) -> list[Identity]:
        """Identity of every node; nothing is written.

        Raises:
            BusError: a node that does not answer, is none of CiA 402, lacks the mode or the mapping, or is enabled; two devices
                with one number; another master.
        """
        found = []
        for node, name in zip(self.nodes, self.names, strict=True):
            found.append(self._identity(node))
            self._check(node, name)
        clock.sleep_until(clock.now() + max(ECHO, 2.0 * self.period))
        for node, identity in zip(self.nodes, found, strict=True):
            if self._identity(node) != identity:
                raise _two_devices(node.id or 0)
        self._check_replies()
        if max(self._masters.values()) > 0:
            raise BusError(STRANGER, place="bus", value=self.bus, expected="one master")
        return found

    def _identity(self, node: canopen.RemoteNode) -> Identity:
        return Identity(*(self.get(node, key) for key in (od.VENDOR, od.PRODUCT, od.SERIAL)))

    def _check_replies(self) -> None:
        """Refuses two devices with one number, which answer a request twice."""
        for (number, _, _), left in self._replies.items():
            if left > 0:
                raise _two_devices(number)

    def configure(self, heartbeat: float | None) -> None:
        """Sets up every node; nothing moves.

        Args:
            heartbeat: [s] from beat to beat, of the master and of the nodes; the drives stop where three of the master's are
                missing, and the master stops them where three of a node's are. None: no heartbeat.
        Raises:
            BusError: a node that refuses a value.
        """
        most = np.rint(self.rehearsal.stages.limits / self.units.thousandth)
        stop = STAYS if self.lifted else DISABLES
        for node, torque in zip(self.nodes, most, strict=True):
            node.nmt.state = "PRE-OPERATIONAL"
            self._put(node, od.MAX_TORQUE, int(min(torque, 1000)))
            self._put(node, od.MODE, TORQUE_MODE)
            self._put(node, od.TARGET_TORQUE, 0)
            self._put(node, od.QUICK_STOP_OPTION, stop)
            value, power = self.rehearsal.load.interpolation()
            self._put(node, od.INTERPOLATION, value)
            self._put(node, od.INTERPOLATION_POWER, power)
            if heartbeat is not None:
                self._put(node, od.PRODUCER, round(1e3 * heartbeat))
                self._put(node, od.CONSUMER, MASTER << 16 | round(1e3 * BEATS * heartbeat))
                self._put(node, od.ABORT_OPTION, 3)
        self._heartbeat = heartbeat
        if heartbeat is not None:
            self._heart = self._network.send_periodic(0x700 + MASTER, [OPERATIONAL], heartbeat)
        self._network.send_message(0, [1, 0])  # all nodes: operational
        clock.sleep_until(clock.now() + ECHO)
        self._check_replies()

    def release(self) -> None:
        """Disables the voltage of all drives; those that held the arm hold it no longer."""
        for node in self.nodes:
            self._put(node, od.CONTROLWORD, DISABLE, kept=False)

    def _check(self, node: canopen.RemoteNode, name: str) -> None:
        device = self.get(node, (0x1000, 0))
        if device & 0xFFFF != od.DEVICE_TYPE & 0xFFFF:
            raise _refused(node, f"of {name} has device type 0x{device:08X}", f"{DRIVE}, type 0x…0192")
        if not self.get(node, od.SUPPORTED_MODES) >> (TORQUE_MODE - 1) & 1:
            raise _refused(node, f"of {name} has no cyclic synchronous torque mode", "mode 10 in object 6502")
        for first, keys in ((0x1600, od.RECEIVED), (0x1A00, od.SENT)):
            count = self.get(node, (first, 0))
            found = [self.get(node, (first, sub)) for sub in range(1, count + 1)]
            if found != od.mapping(keys):
                names = ", ".join(f"{each >> 16:04X}:{each >> 8 & 0xFF}" for each in found)
                wanted = ", ".join(f"{index:04X}:{sub}" for index, sub in keys)
                what = f"node {node.id} of {name} maps {names or 'nothing'}"
                raise BusError(what, place=f"object {first:04X}", expected=wanted)
        if _state(self.get(node, od.STATUSWORD)) is State.ENABLED:
            what = f"of {name} is in operation enabled: another master drives it"
            raise _refused(node, what, "drives that nobody has enabled")

    def get(self, node: canopen.RemoteNode, key: od.Key) -> int:
        """Value of an object of a node.

        Raises:
            BusError: the node does not answer, or does not have it.
        """
        with self._asking(node, key, "to read"):
            return int.from_bytes(node.sdo.upload(*key), "little")

    def _put(self, node: canopen.RemoteNode, key: od.Key, value: int, *, kept: bool = True) -> None:
        data, expected = value.to_bytes(od.ENTRIES[key].kind.bits // 8, "little", signed=value < 0), DRIVE
        if key == od.QUICK_STOP_OPTION and self.lifted:
            lifted = ", ".join(self.lifted)
            expected = f"a drive that holds its joint after a quick stop, or a brake in the record at {lifted}"
        with self._asking(node, key, f"{value} for", expected):
            node.sdo.download(*key, data)
        if kept and self.get(node, key) != int.from_bytes(data, "little"):
            raise _refused(node, f"does not keep {value} in object {key[0]:04X}:{key[1]}", DRIVE)

    @contextlib.contextmanager
    def _asking(self, node: canopen.RemoteNode, key: od.Key, what: str, expected: str = DRIVE) -> Iterator[None]:
        """A request for an object of a node, to which one reply is expected.

        Args:
            node, key: of the object.   what: is asked, where the node refuses it.   expected: where it refuses it.
        Raises:
            BusError: no answer, two answers, or a refusal.
        """
        import canopen

        assert node.id is not None
        asked = (node.id, *key)
        self._replies[asked] = self._replies.get(asked, 0) - 1
        try:
            yield
        except canopen.SdoCommunicationError:
            self._check_replies()
            nodes = f"the joints' nodes, {', '.join(map(str, self.numbers))} by --nodes, on a bus that is up"
            raise _refused(node, f"does not answer on {self.bus}", nodes) from None
        except canopen.SdoAbortedError as error:
            raise _refused(node, f"refuses {what} object {key[0]:04X}:{key[1]}: {error}", expected) from None

    def _reply(self, number: int, data: Any) -> None:
        """Counts a reply that names its object; the segments of a long value do not."""
        if len(data) == 8 and data[0] >> 5 in (2, 3, 4):
            key = (number, data[1] | data[2] << 8, data[3])
            self._replies[key] = self._replies.get(key, 0) + 1

    # A cycle.

    def _take(self, joint: int, data: Any) -> None:
        """Process data of a node."""
        if len(data) != self._received.size:
            return
        with self._all:
            if data not in self._answers[joint]:  # a frame that came twice is one answer
                self._answers[joint].append(bytes(data))
            self.status[joint], self.torque[joint], self.counts[joint] = self._received.unpack(data)
            if self._complete():
                self._all.notify()

    def _heartbeat_received(self, joint: int, data: Any) -> None:
        """Heartbeat of a node, whose first is its boot-up."""
        self._last_heartbeat[joint] = clock.now()
        if len(data) == 1 and data[0] & 0x7F != OPERATIONAL:
            self._booted[joint] = True

    def _heard_master(self, can_id: int) -> None:
        """Counts a frame that a master sends."""
        self._masters[can_id] += 1

    def _complete(self) -> bool:
        """True if all nodes have answered this SYNC but those that count as lost."""
        return all(self._answers[k] or self._missed[k] >= self.missing for k in range(len(self.numbers)))

    def cycle(self, until: float | None = None) -> bool:
        """Sends a SYNC and waits for all answers; True if all came.

        Args:
            until: time of `clock.now` to wait to; None: for long.
        """
        with self._all:
            for joint, answers in enumerate(self._answers):
                self._doubled[joint] = self._doubled[joint] + 1 if len(answers) > 1 else 0
                if answers and answers[-1] != self._last[joint]:
                    self._last[joint], self._repeated[joint] = answers[-1], 0
                    self._least[joint], self._most[joint] = np.inf, -np.inf
                else:
                    self._repeated[joint] += 1
                answers.clear()
        self.cycles.began()
        self._masters[SYNC] -= self._echo
        self._transmit(SYNC, b"")
        with self._all:
            clock.wait(self._all, self._complete, clock.now() + PATIENCE if until is None else until)
            came = [bool(each) for each in self._answers]
            for joint, each in enumerate(came):
                self._missed[joint] = 0 if each else self._missed[joint] + 1
                if each:
                    self._heard[joint] = self._cycle
            self._cycle += 1
            self.cycles.received(len(came), sum(came))
            return all(came)

    @property
    def _until(self) -> float:
        """Time of `clock.now` to which answers to a SYNC that is sent now are waited for, but for lock-step's controller."""
        return clock.now() + (ANSWER if self._heart is None else ANSWERED * self.period)

    def _transmit(self, can_id: int, data: bytes) -> None:
        try:
            self._network.send_message(can_id, data)
        except bus_errors() as error:
            self._broken = str(error) or type(error).__name__

    def send(self, word: int | Sequence[int], thousandths: np.ndarray) -> None:
        """Sends controlwords and torques to all nodes; they take effect at the next SYNC."""
        words = [word] * len(self.numbers) if isinstance(word, int) else word
        # plain numbers, which Python handles faster than entries of arrays
        rows = zip(self.numbers, words, np.asarray(thousandths).tolist(), self.counts.tolist(), strict=True)
        for joint, (number, each, torque, counts) in enumerate(rows):
            self._least[joint], self._most[joint] = min(self._least[joint], torque), max(self._most[joint], torque)
            self._transmit(0x200 + number, self._sent.pack(each, int(torque), int(counts)))

    @property
    def q(self) -> np.ndarray:
        """(n,) measured positions [rad | m]; the last one of a node whose answer is missing."""
        return np.asarray(self.units.position(self.counts))

    @property
    def applied(self) -> np.ndarray:
        """(n,) measured output of the drives [A | N m | N]."""
        return np.asarray(self.units.command(self.torque))

    def states(self) -> list[State | None]:
        """State of every drive, by the statusword of this cycle; None of one that has not answered in it."""
        return [_state(int(word)) if came else None for word, came in zip(self.status, self._answers, strict=True)]

    @property
    def lost(self) -> bool:
        """True if a node counts as lost."""
        return max(self._missed) >= self.missing

    def heard(self) -> None:
        """Sends SYNCs until all nodes have answered one, or one counts as lost.

        Raises:
            BusError: a node that does not answer; names it.
        """
        for _ in range(self.missing):
            if self.cycle(clock.now() + ANSWER):
                return
        if self.lost:
            joint = int(np.argmax(self._missed))
            raise BusError.of(*self.error(self._wrong(joint, None, State.SWITCH_ON_DISABLED)).problems)

    def trouble(self, state: State) -> Trouble | None:
        """The cause to end a run after a cycle: a node that is lost, doubled or in another state; None if there is none."""
        if self._broken:
            return Trouble(None, f"{self.bus} failed: {self._broken}", "a bus that carries frames")
        if self._masters[SYNC] > STRANGERS:
            return Trouble(None, STRANGER, "one master")
        doubts, states = self._doubts(), self.states()
        doubted = np.any(doubts, axis=0)
        if not np.any(doubted) and all(found is state for found in states):
            return None
        for joint, found in enumerate(states):
            if found is not None and found is not state:
                return self._wrong(joint, found, state)
            if doubted[joint]:
                what, expected = self._doubt(joint, int(doubts[:, joint].argmax()))
                return Trouble(joint, what, expected, believed=False)
        return None

    def _doubts(self) -> np.ndarray:
        """(reasons, n) which reasons there are not to believe in the nodes' answers."""
        beat, most = self._heartbeat, max(FROZEN / self.period, FEWEST)
        changed = [high - low > CHANGED for low, high in zip(self._least, self._most, strict=True)]
        silent = [beat is not None and clock.now() - last > BEATS * beat for last in self._last_heartbeat]
        lost = [missed >= self.missing for missed in self._missed]
        doubled = [count >= max(self.missing, 2) for count in self._doubled]
        repeated = [count >= most and change for count, change in zip(self._repeated, changed, strict=True)]
        return np.array([self._booted, lost, doubled, silent, repeated])

    def _doubt(self, joint: int, reason: int) -> tuple[str, str]:
        """A row of `_doubts` in words: the problem, and what was expected."""
        number, one = self.numbers[joint], "one device for each number"
        node = f"node {number} of {self.names[joint]}"
        since = f"since {self._heard[joint] * self.period:.4g} s ({self._missed[joint]} cycles)"
        return (
            (f"{node} has started anew", f"nodes that stay operational, {one}"),
            (f"{node} has not answered {since}", f"fewer than {self.missing} missing answers in a row (--missing)"),
            (f"two devices have number {number}", one),
            (f"{node} sends no heartbeat", f"one every {self._heartbeat} s"),
            (f"{node} repeats its answer while its command changes", "measurements"),
        )[reason]

    def _wrong(self, joint: int, found: State | None, state: State) -> Trouble:
        """The trouble of a drive that is not in a state; None: it has not answered."""
        node = f"node {self.numbers[joint]} of {self.names[joint]}"
        what = "does not answer" if found is None else f"is in state {_name(found)}"
        return Trouble(joint, f"{node} {what}", _name(state), found in (State.FAULT, State.REACTION))

    def enable(self) -> np.ndarray:
        """Enables all drives at one SYNC; returns the measurement at the SYNC before, with the arm at rest.

        Raises:
            BusError: a drive that does not go into the next state; names it and its fault.
        """
        ready, found = (State.SWITCHED_ON, State.QUICK_STOP), self.states()
        for _ in range(TRIES):
            self.cycle(clock.now() + ANSWER)  # brakes or the drives still hold the arm
            found = self.states()
            if all(state in ready for state in found):
                break
            # a fault is reset by a rising edge: every other word is without it
            words = [QUICK_STOP if state is None else UP.get(state, SHUTDOWN) for state in found]
            self.send(words, self.torque)
            if RESET in words:
                self.cycle(clock.now() + ANSWER)
                self.send([DISABLE if word == RESET else word for word in words], self.torque)
        else:
            joint = next(k for k, state in enumerate(found) if state not in ready)
            raise BusError.of(*self.error(self._wrong(joint, found[joint], State.SWITCHED_ON)).problems)
        start = np.concatenate([self.q, self.applied])
        self._moves = True
        self._booted[:], self._last_heartbeat[:] = False, clock.now()
        self._cycle, self._heard = 0, [0] * len(self.numbers)
        self.enabled = True
        self.send(ENABLE, self.torque)
        self.cycle(self._until)
        return start

    def error(self, trouble: Trouble, ending: Ending | None = None) -> RunStopped:
        """The error of a trouble, with the code of a drive's fault and the state of the other drives."""
        what = trouble.what
        if trouble.joint is not None and trouble.faulted:
            code = self._error_code(trouble.joint)
            what += f", error 0x{code:04X}: {TEXT.get(code, 'see the manual of the drive')}"
        what = what if ending is None else f"{what}; {ending}"
        place = "bus" if trouble.joint is None else f"joint {self.names[trouble.joint]!r}"
        return RunStopped(what, place=place, expected=trouble.expected)

    def _error_code(self, joint: int) -> int:
        """The error that a drive reports; 0 if it does not say."""
        with contextlib.suppress(BusError, *bus_errors()):
            return self.get(self.nodes[joint], od.ERROR_CODE)
        return 0

    def stop(self, trouble: Trouble | None = None) -> Ending:
        """Brings all drives to rest by a quick stop. Then they hold the arm; they are disabled where brakes do.

        Args:
            trouble: the cause, whose node is not waited for if its answers are implausible.
        """
        self._moves = False
        n = len(self.numbers)
        begun, nothing, seen = clock.now(), np.zeros(n), []
        still, unpowered, heard, doubted, silent = (np.zeros(n, dtype=bool) for _ in range(5))
        if trouble is not None and trouble.joint is not None:
            doubted[trouble.joint] = not trouble.believed
        limits = np.array([body.limits.velocity for body in self.rehearsal.scenario.arm.coordinates])
        slow = SLOW * limits * LOOKED * self.period + 2.0 * self.units.count
        for k in range(max(round(REST / self.period), 2 * LOOKED)):
            self.send(QUICK_STOP, nothing)
            if self._heart is not None:  # in real time
                clock.sleep_until(begun + k * self.period)
            self.cycle(self._until)
            states = self.states()
            heard |= np.array([state is not None for state in states])
            seen.append(self.q)
            unpowered = np.array([state in HELD for state in states])
            slowed = len(seen) > LOOKED and np.abs(seen[-1] - seen[-1 - LOOKED]) < slow
            stopping = np.array([state is State.QUICK_STOP for state in states])
            still = slowed & (unpowered | stopping)
            silent = np.array(self._missed) >= LOOKED
            unheard = doubted | silent
            if np.all(still | unheard) and (k * self.period >= UNHEARD or not np.any(unheard)):
                break
        seconds, lost = clock.now() - begun, ~heard | doubted | silent
        held = bool(self.lifted)
        if not held:
            self.send(DISABLE, nothing)
            self.cycle(self._until)
        which = {"still": still & ~lost, "moving": ~still & ~lost, "unknown": lost, "limp": held & unpowered & ~lost}
        joints = {name: tuple(np.array(self.names)[chosen].tolist()) for name, chosen in which.items()}
        return Ending(**joints, held=held, lifted=self.lifted, seconds=seconds)


def _refused(node: canopen.RemoteNode, what: str, expected: str) -> BusError:
    return BusError(f"node {node.id} {what}", place="nodes", value=node.id, expected=expected)


def _two_devices(number: int) -> BusError:
    return BusError(
        f"two devices have number {number}", place="nodes", value=number, expected="one device for each number"
    )


@functools.cache
def _state(word: int) -> State | None:
    """The state that a statusword shows; None if it shows none."""
    return next((each for each in State if _matches(word, each)), None)


def _name(state: State) -> str:
    return state.name.lower().replace("_", " ")


def _matches(word: int, state: State) -> bool:
    mask = 0x4F if state in (State.NOT_READY, State.SWITCH_ON_DISABLED, State.REACTION, State.FAULT) else MASK
    return (word & mask) == state.value


def _dictionary(number: int, eds: Sequence[str] | None, k: int) -> Any:
    """The object dictionary of a node: of a file, else the twin's."""
    if eds is not None and not (isinstance(eds, (list, tuple)) and all(isinstance(p, (str, os.PathLike)) for p in eds)):
        raise BusError(place="eds", value=eds, expected="a list of paths, one for all nodes or one for each")
    if not eds:
        return dictionary(eds_text(number, "", {}), number)
    if len(eds) > 1 and k >= len(eds):
        raise BusError(f"{len(eds)} files", place="eds", expected="one for all nodes or one for each")
    path = eds[k if len(eds) > 1 else 0]
    text = read_file(path, "an EDS file", BusError).decode("utf-8-sig", "replace")
    try:
        with warnings.catch_warnings():  # canopen's own, of how it logs
            warnings.simplefilter("ignore", DeprecationWarning)
            found = dictionary(text, number)
    except Exception as error:  # noqa: BLE001  the importer raises whatever a foreign file makes it raise
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise BusError(f"no EDS: {reason}", file=path, expected="an EDS file") from None
    wanted = (*od.RECEIVED, *od.SENT, od.MODE, od.SUPPORTED_MODES, od.ABORT_OPTION)
    lacking = sorted({f"{index:04X}" for index, _ in wanted if index not in found})
    if lacking:
        raise BusError(f"lacks the objects {', '.join(lacking)}", file=path, expected="the EDS of a drive by CiA 402")
    return found
