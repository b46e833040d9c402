"""A CANopen node with a drive behind it: objects, process data, heartbeats, emergencies. [CiA2011]"""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from armwright.twin import faults, objects as od
from armwright.twin.drive import TwinDrive
from armwright.twin.objects import ENTRIES, Key, dictionary, eds_text
from armwright.twin.state_machine import POWERED

if TYPE_CHECKING:
    import canopen

OPERATIONAL = 5  # state of network management in which process data flows
STOPPED, RESET, RESET_COMMUNICATION = 2, 129, 130  # commands of network management
NOT_MAPPABLE, TOO_LONG, OUT_OF_RANGE = 0x0604_0041, 0x0604_0042, 0x0609_0030  # SDO abort codes
RECEIVE, TRANSMIT = 0x1400, 0x1800  # first parameters of process data; mappings are 0x200 behind


@dataclass(frozen=True)
class Map:
    """Mapping of process data: identifier, transmission type, entries and their packing."""

    cob: int
    kind: int
    keys: tuple[Key, ...]
    packing: struct.Struct


class TwinNode:
    """A node with its drive.

    Attributes:
        number: of the node.   drive: behind it.   eds: text of its data sheet.   local: canopen's node.
    """

    def __init__(self, number: int, name: str, drive: TwinDrive, defaults: Mapping[Key, int], lock: threading.RLock):
        """A node that is not yet on a bus.

        Args:
            number: of the node.   name: of the product.   drive: behind it.   defaults: values of objects that are its own.
            lock: held while the drive changes, since a second thread brings it to rest where the master is gone.
        """
        import canopen

        self.number, self.drive, self._lock = number, drive, lock
        self._network: Any = None
        self.eds = eds_text(number, name, defaults)
        self.local = canopen.LocalNode(number, dictionary(self.eds, number))
        self.local.add_read_callback(self._read)
        self.local.add_write_callback(self._written)
        self.received = False  # process data since the last SYNC
        self._pending: dict[Key, int] = {}
        self._maps: dict[int, list[Map]] | None = None
        self._heard: set[int] = set()  # identifiers that it listens to
        self._cycle = 0  # SYNCs
        self._sent: dict[int, bytes] = {}
        self._last_heartbeat: float | None = None  # when the master's heart beat last; None: not yet

    # Connection.

    def connect(self, network: canopen.Network) -> None:
        """Joins a network: boot-up, then pre-operational."""
        self._network = network
        network[self.number] = self.local
        network.subscribe(0, self._managed)
        self._listen()
        self._boot()

    def disconnect(self) -> None:
        """Ends the node's heartbeat."""
        self.local.nmt.stop_heartbeat()

    def _boot(self) -> None:
        self.local.nmt.state = "INITIALISING"
        self.local.nmt.state = "PRE-OPERATIONAL"

    @property
    def operational(self) -> bool:
        """True while process data are exchanged."""
        return self.local.nmt.state == "OPERATIONAL"

    def _managed(self, can_id: int, data: Any, timestamp: float) -> None:
        """Network management: a node that is stopped or reset has lost its master."""
        command, number = struct.unpack_from("BB", data)
        if number not in (0, self.number):
            return
        if command in (STOPPED, RESET, RESET_COMMUNICATION) and self.drive.state in POWERED:
            with self._lock:
                self.drive.abort_connection(faults.HEARTBEAT)
        if command in (RESET, RESET_COMMUNICATION):
            self._boot()

    # Objects.

    def _read(self, index: int, subindex: int, **rest: Any) -> int | None:
        return self.drive.read((index, subindex))

    def _written(self, index: int, subindex: int, data: bytes, **rest: Any) -> None:
        key = (index, subindex)
        if key not in ENTRIES:
            return
        (value,) = struct.unpack(f"<{ENTRIES[key].kind.packed}", data)
        self._check(key, value)
        with self._lock:
            self.drive.values[key] = value
            if key == od.CONTROLWORD:
                self.drive.command(value)
        if RECEIVE <= index < TRANSMIT + 0x400:
            self._maps = None
            self._listen()
        if index == od.CONSUMER[0]:
            self._last_heartbeat = None
            self._listen()

    def _check(self, key: Key, value: int) -> None:
        from canopen import SdoAbortedError

        index, subindex = key
        mapped = subindex > 0 and any(first <= index < first + 2 for first in (RECEIVE + 0x200, TRANSMIT + 0x200))
        if mapped and value:
            entry = ENTRIES.get((value >> 16, value >> 8 & 0xFF))
            if entry is None or not entry.mapped or entry.kind.bits != value & 0xFF:
                raise SdoAbortedError(NOT_MAPPABLE)
            bits = sum(self.drive.values[index, sub] & 0xFF for sub in range(1, subindex))
            if bits + entry.kind.bits > 64:
                raise SdoAbortedError(TOO_LONG)
        beyond = key == od.MAX_TORQUE and value > 1000
        if beyond or value not in od.CHOICES.get(key, (value,)) or (key in od.ABOVE_ZERO and value == 0):
            raise SdoAbortedError(OUT_OF_RANGE)

    def maps(self, first: int) -> list[Map]:
        """Valid process data, to the drive (`RECEIVE`) or from it (`TRANSMIT`)."""
        if self._maps is None:
            self._maps = {each: [m for k in range(2) if (m := self._map(each + k))] for each in (RECEIVE, TRANSMIT)}
        return self._maps[first]

    def _map(self, parameter: int) -> Map | None:
        values = self.drive.values
        cob = self._cob(parameter)
        count = values[parameter + 0x200, 0]
        if cob & od.INVALID or not 0 < count <= 8:
            return None
        entries = [values[parameter + 0x200, sub] for sub in range(1, count + 1)]
        keys = tuple((each >> 16, each >> 8 & 0xFF) for each in entries)
        if any(key not in ENTRIES for key in keys):
            return None
        return Map(cob & 0x7FF, values[parameter, 2], keys, od.packing(keys))

    def _cob(self, parameter: int) -> int:
        """COB-ID of process data: as written, else of the data sheet."""
        written = self.drive.values.get((parameter, 1))
        if written is not None:
            return written
        described: Any = self.local.object_dictionary[parameter]
        return int(described[1].default)

    # Process data.

    def _listen(self) -> None:
        """Subscribes to the identifiers that its objects name."""
        for cob in self._heard:
            self._network.unsubscribe(cob, self._take)
        self._heard = {each.cob for each in self.maps(RECEIVE)}
        for cob in self._heard:
            self._network.subscribe(cob, self._take)
        master = self.drive.values[od.CONSUMER] >> 16 & 0x7F
        if master:
            self._network.subscribe(0x700 + master, self._heartbeat_received)

    def _take(self, can_id: int, data: Any, timestamp: float) -> None:
        """Keeps process data for the next SYNC."""
        if not self.operational:
            return
        for each in self.maps(RECEIVE):
            if each.cob == can_id and len(data) >= each.packing.size:
                self._pending |= zip(each.keys, each.packing.unpack_from(data), strict=True)

    def latch(self, *, lost: bool = False) -> None:
        """Puts the data received since the last SYNC into effect.

        Args:
            lost: True for a frame that does not arrive.
        """
        pending, self._pending = {} if lost else self._pending, {}
        self.received = bool(pending)
        self.drive.values |= pending
        if od.CONTROLWORD in pending:
            self.drive.command(pending[od.CONTROLWORD])

    def send(self) -> None:
        """Sends process data and emergencies, at a SYNC."""
        self._cycle += 1
        for code, register in self.drive.emergencies:
            self.local.emcy.send(code, register)
        self.drive.emergencies.clear()
        if not self.operational:
            return
        for each in self.maps(TRANSMIT):
            data = each.packing.pack(*[self.drive.read(key) for key in each.keys])
            cyclic = 1 <= each.kind <= 240
            if (cyclic and self._cycle % each.kind) or (not cyclic and self._sent.get(each.cob) == data):
                continue
            self._sent[each.cob] = data
            self._network.send_message(each.cob, data)

    # Heartbeat of the master.

    def _heartbeat_received(self, can_id: int, data: Any, timestamp: float) -> None:
        self._last_heartbeat = time.monotonic()

    def excuse(self, seconds: float) -> None:
        """Subtracts time [s] in which this process could not listen from the heartbeat's timeout."""
        if self._last_heartbeat is not None:
            self._last_heartbeat += seconds

    def watch(self) -> bool:
        """Checks the master's heartbeat; True if it was lost just now, and the drive reacts as object 6007 says."""
        limit = self.drive.values[od.CONSUMER] & 0xFFFF  # [ms]
        if not limit or self._last_heartbeat is None or time.monotonic() - self._last_heartbeat <= 1e-3 * limit:
            return False
        self._last_heartbeat = None
        if self.drive.state in POWERED:
            self.drive.abort_connection(faults.HEARTBEAT)
        return True
