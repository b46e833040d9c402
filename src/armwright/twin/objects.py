"""The object dictionary of a drive, as a table, and the electronic data sheet (EDS) made from it. [CiA2011] [CiA2005] [IEC2015]

The mapping of process data is that of the LWA 4P in interpolated mode: controlword, torque offset and set-point to the drive;
statusword, actual torque and actual position from it. Either is full: 64 bits.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from armwright.errors import BusError

if TYPE_CHECKING:
    import canopen

Key = tuple[int, int]  # index and subindex

CONTROLWORD, STATUSWORD, ERROR_CODE = (0x6040, 0), (0x6041, 0), (0x603F, 0)
MODE, MODE_DISPLAY, SUPPORTED_MODES = (0x6060, 0), (0x6061, 0), (0x6502, 0)
ABORT_OPTION, QUICK_STOP_OPTION, SHUTDOWN_OPTION = (0x6007, 0), (0x605A, 0), (0x605B, 0)
DISABLE_OPTION, HALT_OPTION, REACTION_OPTION = (0x605C, 0), (0x605D, 0), (0x605E, 0)
POSITION, POSITION_DEMAND, VELOCITY = (0x6064, 0), (0x6062, 0), (0x606C, 0)
WINDOW, WINDOW_TIME, FOLLOWING_ERROR, REACHED = (0x6065, 0), (0x6066, 0), (0x60F4, 0), (0x6067, 0)
TARGET_POSITION, TARGET_VELOCITY, TARGET_TORQUE = (0x607A, 0), (0x60FF, 0), (0x6071, 0)
SET_POINT, POSITION_OFFSET, VELOCITY_OFFSET, TORQUE_OFFSET = (0x60C1, 1), (0x60B0, 0), (0x60B1, 0), (0x60B2, 0)
CURRENT, RATED_CURRENT, INPUTS = (0x6078, 0), (0x6075, 0), (0x60FD, 0)
OUTPUT, OUTPUT_MASK = (0x60FE, 1), (0x60FE, 2)
TORQUE, MAX_TORQUE, RATED_TORQUE, TORQUE_DEMAND = (0x6077, 0), (0x6072, 0), (0x6076, 0), (0x6074, 0)
LOWEST, HIGHEST, MAX_SPEED = (0x607D, 1), (0x607D, 2), (0x607F, 0)
PROFILE_SPEED, ACCELERATION, DECELERATION, STOP_DECELERATION = (0x6081, 0), (0x6083, 0), (0x6084, 0), (0x6085, 0)
HOMING_METHOD, HOME_OFFSET = (0x6098, 0), (0x607C, 0)
SEARCH_SPEED, HOME_SPEED, HOMING_ACCELERATION = (0x6099, 1), (0x6099, 2), (0x609A, 0)
SUPPLY, SERIAL, VENDOR, PRODUCT = (0x6079, 0), (0x1018, 4), (0x1018, 1), (0x1018, 2)
ERROR_REGISTER, CONSUMER, PRODUCER = (0x1001, 0), (0x1016, 1), (0x1017, 0)
CYCLE, INTERPOLATION, INTERPOLATION_POWER = (0x1006, 0), (0x60C2, 1), (0x60C2, 2)
TIMEOUT = (0x1400, 5)  # [ms] without process data, in a cyclic mode, that is a fault; 0: never

MODES = {1: "profile position", 6: "homing", 7: "interpolated position", 8: "cyclic synchronous position"}
MODES |= {9: "cyclic synchronous velocity", 10: "cyclic synchronous torque"}
CYCLIC = (7, 8, 9, 10)  # modes whose set-points come with every SYNC
BRAKE = 1  # bit of 60FE: sets the brake
NEGATIVE, POSITIVE, HOME = 1, 2, 4  # bits of 60FD: limit switches, home switch
HERE = (35, 37)  # methods of homing: the present position is home
# methods that search: (way at the end, switch, its level from there on), where home is the edge of the switch
SEARCHES = {17: (1, NEGATIVE, False), 18: (-1, POSITIVE, False), 19: (-1, HOME, False), 20: (1, HOME, True)}
# values that the twin carries out; 4 and 8 would brake at a limit of voltage, which its drives do not have
CHOICES: dict[Key, tuple[int, ...]] = {
    ABORT_OPTION: (0, 1, 2, 3),
    QUICK_STOP_OPTION: (0, 1, 2, 3, 5, 6, 7),
    SHUTDOWN_OPTION: (0, 1),
    DISABLE_OPTION: (0, 1),
    HALT_OPTION: (1, 2, 3),
    REACTION_OPTION: (0, 1, 2, 3),
    MODE: (0, *MODES),
    HOMING_METHOD: (*SEARCHES, *HERE),
    OUTPUT: (0, BRAKE),
    OUTPUT_MASK: (0, BRAKE),
}
ABOVE_ZERO = (ACCELERATION, DECELERATION, STOP_DECELERATION, SEARCH_SPEED, HOME_SPEED, HOMING_ACCELERATION)
DEVICE_TYPE = 0x0002_0192  # a servo drive by CiA 402
TWIN_VENDOR, TWIN_PRODUCT = 0, 0x4157_5457  # no vendor's number; "AWTW": a twin, not a real drive
INVALID = 0x8000_0000  # of a COB-ID: no such process data

# what crosses the bus with every SYNC, in the order of its bytes
RECEIVED = (CONTROLWORD, TORQUE_OFFSET, SET_POINT)
SENT = (STATUSWORD, TORQUE, POSITION)


@dataclass(frozen=True)
class NumberType:
    """A type of number: its code in an EDS, how `struct` packs it, and its bits."""

    code: int
    packed: str

    @property
    def bits(self) -> int:
        """Bits of a value."""
        return 8 * struct.calcsize(f"<{self.packed}")


I8, I16, I32 = NumberType(2, "b"), NumberType(3, "h"), NumberType(4, "i")
U8, U16, U32 = NumberType(5, "B"), NumberType(6, "H"), NumberType(7, "I")
TEXT = NumberType(9, "s")


@dataclass(frozen=True)
class ObjectEntry:
    """One row of the dictionary.

    Attributes:
        name: of the object or of its part.   kind: of its value.   access: "ro", "rw" or "const".
        default: a number, a text, or an expression with $NODEID.   mapped: True if process data may hold it.
    """

    name: str
    kind: NumberType
    access: str = "rw"
    default: int | str = 0
    mapped: bool = False


ENTRIES: dict[Key, ObjectEntry] = {  # but for the description of process data, which follows below
    (0x1000, 0): ObjectEntry("Device type", U32, "ro", DEVICE_TYPE),
    ERROR_REGISTER: ObjectEntry("Error register", U8, "ro"),
    (0x1005, 0): ObjectEntry("COB-ID SYNC", U32, "rw", 0x80),
    CYCLE: ObjectEntry("Communication cycle period", U32),
    (0x1008, 0): ObjectEntry("Manufacturer device name", TEXT, "const", "Armwright twin"),
    (0x1014, 0): ObjectEntry("COB-ID EMCY", U32, "ro", "$NODEID+0x80"),
    CONSUMER: ObjectEntry("Consumer heartbeat time", U32),
    PRODUCER: ObjectEntry("Producer heartbeat time", U16),
    VENDOR: ObjectEntry("Vendor-ID", U32, "ro", TWIN_VENDOR),
    PRODUCT: ObjectEntry("Product code", U32, "ro", TWIN_PRODUCT),
    (0x1018, 3): ObjectEntry("Revision number", U32, "ro", 1),
    SERIAL: ObjectEntry("Serial number", U32, "ro"),
    ABORT_OPTION: ObjectEntry("Abort connection option code", I16, "rw", 3),
    ERROR_CODE: ObjectEntry("Error code", U16, "ro", mapped=True),
    CONTROLWORD: ObjectEntry("Controlword", U16, mapped=True),
    STATUSWORD: ObjectEntry("Statusword", U16, "ro", mapped=True),
    QUICK_STOP_OPTION: ObjectEntry("Quick stop option code", I16, "rw", 2),
    SHUTDOWN_OPTION: ObjectEntry("Shutdown option code", I16),
    DISABLE_OPTION: ObjectEntry("Disable operation option code", I16, "rw", 1),
    HALT_OPTION: ObjectEntry("Halt option code", I16, "rw", 1),
    REACTION_OPTION: ObjectEntry("Fault reaction option code", I16, "rw", 2),
    MODE: ObjectEntry("Modes of operation", I8, mapped=True),
    MODE_DISPLAY: ObjectEntry("Modes of operation display", I8, "ro", mapped=True),
    POSITION_DEMAND: ObjectEntry("Position demand value", I32, "ro", mapped=True),
    POSITION: ObjectEntry("Position actual value", I32, "ro", mapped=True),
    WINDOW: ObjectEntry("Following error window", U32),
    WINDOW_TIME: ObjectEntry("Following error time out", U16, "rw", 20),
    REACHED: ObjectEntry("Position window", U32),
    VELOCITY: ObjectEntry("Velocity actual value", I32, "ro", mapped=True),
    TARGET_TORQUE: ObjectEntry("Target torque", I16, mapped=True),
    MAX_TORQUE: ObjectEntry("Max torque", U16, "rw", 1000, True),
    TORQUE_DEMAND: ObjectEntry("Torque demand", I16, "ro", mapped=True),
    RATED_CURRENT: ObjectEntry("Motor rated current", U32, "ro"),
    RATED_TORQUE: ObjectEntry("Motor rated torque", U32, "ro"),
    TORQUE: ObjectEntry("Torque actual value", I16, "ro", mapped=True),
    CURRENT: ObjectEntry("Current actual value", I16, "ro", mapped=True),
    SUPPLY: ObjectEntry("DC link circuit voltage", U32, "ro", mapped=True),
    TARGET_POSITION: ObjectEntry("Target position", I32, mapped=True),
    HOME_OFFSET: ObjectEntry("Home offset", I32),
    LOWEST: ObjectEntry("Min position limit", I32),
    HIGHEST: ObjectEntry("Max position limit", I32),
    MAX_SPEED: ObjectEntry("Max profile velocity", U32),
    PROFILE_SPEED: ObjectEntry("Profile velocity", U32, mapped=True),
    ACCELERATION: ObjectEntry("Profile acceleration", U32),
    DECELERATION: ObjectEntry("Profile deceleration", U32),
    STOP_DECELERATION: ObjectEntry("Quick stop deceleration", U32),
    (0x608F, 1): ObjectEntry("Encoder increments", U32, "ro"),
    (0x608F, 2): ObjectEntry("Motor revolutions", U32, "ro", 1),
    HOMING_METHOD: ObjectEntry("Homing method", I8, "rw", 35),
    SEARCH_SPEED: ObjectEntry("Speed during search for switch", U32),
    HOME_SPEED: ObjectEntry("Speed during search for zero", U32),
    HOMING_ACCELERATION: ObjectEntry("Homing acceleration", U32),
    POSITION_OFFSET: ObjectEntry("Position offset", I32, mapped=True),
    VELOCITY_OFFSET: ObjectEntry("Velocity offset", I32, mapped=True),
    TORQUE_OFFSET: ObjectEntry("Torque offset", I16, mapped=True),
    SET_POINT: ObjectEntry("Interpolation data", I32, mapped=True),
    INTERPOLATION: ObjectEntry("Interpolation time period value", U8, "rw", 4),
    INTERPOLATION_POWER: ObjectEntry("Interpolation time index", I8, "rw", -3),
    FOLLOWING_ERROR: ObjectEntry("Following error actual value", I32, "ro", mapped=True),
    INPUTS: ObjectEntry("Digital inputs", U32, "ro", mapped=True),
    OUTPUT: ObjectEntry("Physical outputs", U32, mapped=True),
    OUTPUT_MASK: ObjectEntry("Bit mask", U32),
    TARGET_VELOCITY: ObjectEntry("Target velocity", I32, mapped=True),
    SUPPORTED_MODES: ObjectEntry("Supported drive modes", U32, "ro", sum(1 << (mode - 1) for mode in MODES)),
}


def mapping(keys: tuple[Key, ...]) -> list[int]:
    """Values of a mapping object: index, subindex and bits of each entry.

    Raises:
        BusError: more than the 64 bits of a frame.
    """
    bits = sum(ENTRIES[key].kind.bits for key in keys)
    if bits > 64:
        names = ", ".join(f"{index:04X}:{sub}" for index, sub in keys)
        raise BusError(f"{bits} bits", place="PDO", value=names, expected="at most 64, a frame's")
    return [index << 16 | sub << 8 | ENTRIES[index, sub].kind.bits for index, sub in keys]


def _process_data() -> dict[Key, ObjectEntry]:
    """Two sets of process data either way; the second ones are not valid until a master maps and validates them."""
    entries: dict[Key, ObjectEntry] = {}
    ways = ((0x1400, 0x1600, 0x200, "receive", RECEIVED), (0x1800, 0x1A00, 0x180, "transmit", SENT))
    for parameter, mapped, cob, way, keys in ways:
        for k in range(2):
            number = f"0x{cob + 0x100 * k + INVALID * k:X}"
            entries[parameter + k, 1] = ObjectEntry(f"COB-ID used by {way} PDO {k + 1}", U32, "rw", f"$NODEID+{number}")
            entries[parameter + k, 2] = ObjectEntry("Transmission type", U8, "rw", 1)
            entries[parameter + k, 3] = ObjectEntry("Inhibit time", U16)
            entries[parameter + k, 5] = ObjectEntry(
                "Event timer", U16, "rw", 100 if (parameter + k, 5) == TIMEOUT else 0
            )
            values = mapping(keys) if k == 0 else []
            entries[mapped + k, 0] = ObjectEntry("Number of mapped objects", U8, "rw", len(values))
            for sub in range(1, 9):
                value = values[sub - 1] if sub <= len(values) else 0
                entries[mapped + k, sub] = ObjectEntry(f"Mapping entry {sub}", U32, "rw", value)
    return entries


ENTRIES |= _process_data()
RECORDS = {0x1016: "Consumer heartbeat time", 0x1018: "Identity object", 0x1400: "RPDO parameter"}
RECORDS |= {0x1600: "RPDO mapping", 0x1800: "TPDO parameter", 0x1A00: "TPDO mapping"}
RECORDS |= {0x607D: "Software position limit", 0x608F: "Position encoder resolution"}
RECORDS |= {0x60C1: "Interpolation data record", 0x60C2: "Interpolation time period"}
RECORDS |= {0x6099: "Homing speeds", 0x60FE: "Digital outputs"}
RECORDS |= {index + 1: RECORDS[index] for index in (0x1400, 0x1600, 0x1800, 0x1A00)}


def packing(keys: tuple[Key, ...]) -> struct.Struct:
    """Layout of process data in a frame."""
    return struct.Struct("<" + "".join(ENTRIES[key].kind.packed for key in keys))


def eds_text(node: int, name: str, defaults: Mapping[Key, int | str]) -> str:
    """The EDS of a node, as text.

    Args:
        node: its number.   name: of the product, such as "lwa4p joint1".   defaults: values in place of the table's.
    Returns:
        text: of a file that `canopen` and other tools import.
    """
    name = name.encode("ascii", "backslashreplace").decode("ascii")  # the format knows nothing else
    return "\n".join(_lines(node, name, defaults)) + "\n"


def _lines(node: int, name: str, defaults: Mapping[Key, int | str]) -> Iterator[str]:
    yield from ["[FileInfo]", f"FileName=node{node}.eds", "FileVersion=1", "FileRevision=1", "EDSVersion=4.0"]
    yield from [f"Description={name}", "CreatedBy=Armwright", "", "[DeviceInfo]", "VendorName=Armwright"]
    yield from [f"VendorNumber=0x{TWIN_VENDOR:X}", f"ProductName={name}", f"ProductNumber=0x{TWIN_PRODUCT:X}"]
    yield from ["RevisionNumber=0x1", "OrderCode=twin", *(f"BaudRate_{rate}=1" for rate in (125, 250, 500, 800, 1000))]
    yield from ["SimpleBootUpMaster=0", "SimpleBootUpSlave=1", "Granularity=8", "DynamicChannelsSupported=0"]
    yield from ["GroupMessaging=0", "NrOfRXPDO=2", "NrOfTXPDO=2", "LSS_Supported=0", ""]
    parts: dict[int, dict[int, ObjectEntry]] = {}
    for (index, sub), entry in sorted(ENTRIES.items()):
        parts.setdefault(index, {})[sub] = entry
    groups = {"MandatoryObjects": [0x1000, 0x1001, 0x1018]}
    groups["OptionalObjects"] = [each for each in parts if each not in groups["MandatoryObjects"]]
    for title, indices in groups.items():
        yield from [f"[{title}]", f"SupportedObjects={len(indices)}"]
        yield from [f"{k}=0x{index:04X}" for k, index in enumerate(indices, 1)]
        yield ""
    for index, entries in parts.items():
        if index not in RECORDS:
            yield from _variable(f"{index:04X}", entries[0], defaults.get((index, 0)))
            continue
        if 0 not in entries:
            entries = {0: ObjectEntry("Highest sub-index supported", U8, "const", max(entries)), **entries}
        yield from [f"[{index:04X}]", f"ParameterName={RECORDS[index]}", "ObjectType=0x9", f"SubNumber={len(entries)}"]
        yield ""
        for sub, entry in entries.items():
            yield from _variable(f"{index:04X}sub{sub:X}", entry, defaults.get((index, sub)))


def _variable(section: str, entry: ObjectEntry, default: Any) -> list[str]:
    value = entry.default if default is None else default
    rows = [f"[{section}]", f"ParameterName={entry.name}", "ObjectType=0x7", f"DataType=0x{entry.kind.code:04X}"]
    return [*rows, f"AccessType={entry.access}", f"DefaultValue={value}", f"PDOMapping={int(entry.mapped)}", ""]


def dictionary(text: str, node: int) -> canopen.ObjectDictionary:
    """The object dictionary that canopen's importer makes of an EDS's text."""
    from canopen.objectdictionary.eds import import_eds

    return import_eds(io.StringIO(text), node)


@cache
def bounds(kind: NumberType) -> tuple[int, int]:
    """The least and the greatest number of a type."""
    signed = kind.packed.islower()
    return (-(2 ** (kind.bits - 1)), 2 ** (kind.bits - 1) - 1) if signed else (0, 2**kind.bits - 1)
