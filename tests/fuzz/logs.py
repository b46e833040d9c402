"""Kinds of logs and stores of other programs: dialects of CSV, MCAP, Parquet, and the Zarr stores of sweeps."""

from __future__ import annotations

import contextlib
import datetime
import decimal
import io
import json
import os
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import armwright as aw
from fuzz.case import Case
from fuzz.files import seed
from fuzz.mutation import WORDS, damaged, mutated

SIGNALS = """
[[signals]]
quantity = "position"
columns = [{q}]
unit = "rad"
side = "joint"

[[signals]]
quantity = "torque"
columns = [{tau}]
unit = "N m"
side = "joint"
"""
ROWS = 60  # of a log that is built here


def log_text(file: str, time: str, unit: str, q: str, tau: str) -> str:
    """A `*.log.toml` of one file with positions and torques."""
    head = f'robot = "two-link"\n\n[files.bench]\npath = "{file}"\n\n[time]\ncolumn = "{time}"\nunit = "{unit}"\n'
    return head + SIGNALS.format(q=q, tau=tau)


def run_log(case: Case) -> None:
    log = aw.identification.read_log("bench.log.toml", on_error="raise" if case.call == "raise" else "keep")
    if case.call == "prepare" and not log.errors:
        aw.identification.prepare_log(log)


# Dialects of CSV.

ENDS = (*("\n", "\r\n", "\r") * 6, "\r\r\n", "\n\r", "\n\n", "\x85", "\u2028", "\x0b", "")
ENCODINGS = (*("utf-8",) * 12, *("utf-8-sig",) * 3, "utf-16", "utf-16-le", "utf-32", "latin-1", "cp037")
DELIMITERS = (*(",", ";", "\t", " ", "|") * 3, ":", "é", '"', "\n", ".", "0", "-")
READERS = {  # what reads a dialect, and the names of its columns
    **dict.fromkeys(("raise", "keep", "prepare"), ("t", "c1", "c2", "v1", "v2", "m1", "m2")),
    "schedule": ("t", "c1", "c2"),
    "motion": ("t", "q_a", "qd_a", "qdd_a"),
    "table": ("c_1", "c_2", "v_1", "v_2", "m_1", "m_2"),
}
CELLS_OF_TEXT = (
    "",
    "-nan",
    "1.#IND",
    "1e999",
    '"',
    "#",
    "1 2",
    "x",
    "1,5",
    "0x10",
    "1_0",
    "∞",
    "é",
    "١",
    "-",
    "1e",
    "9" * 400,
)


def make_dialect(rng: Random) -> Case:
    reader = rng.choice(("raise", "keep", "prepare", *READERS))
    heads = [*READERS[reader]]
    rows = [line.split(",")[: len(heads)] for line in seed("bench.csv").splitlines()[1 : rng.choice((2, 3, 40, 200))]]
    delimiter = rng.choice(DELIMITERS) if reader in ("raise", "keep", "prepare") or rng.random() < 0.2 else ","
    decimal_mark = rng.choice((".", ",")) if delimiter not in (",", ".") else "."
    heads = _other_heads(heads, rng) if rng.random() < 0.4 else heads
    lines = [delimiter.join(heads)] if rng.random() < 0.9 else []
    for row in rows:
        cells = [cell.replace(".", decimal_mark) for cell in row]
        if rng.random() < 0.01:
            k = rng.randrange(len(cells))
            cells[k : k + 1] = rng.choice(([], [cells[k]] * 2, [f'"{cells[k]}'], *([each] for each in CELLS_OF_TEXT)))
        lines.append(delimiter.join(f'"{cell}"' if rng.random() < 0.02 else cell for cell in cells))
    preamble = rng.choice((0, 0, 0, 0, 1, 3)) if len(heads) > 6 else 0
    lines = [*(rng.choice(("", "logger 3", '"', "a,b,c")) for _ in range(preamble)), *lines]
    end, other_ends = rng.choice(ENDS), rng.random() < 0.2
    text = "".join(f"{line}{rng.choice(ENDS) if other_ends and rng.random() < 0.05 else end}" for line in lines)
    if rng.random() < 0.1:
        text = text.rstrip(end) if end else text
    data = text.encode(rng.choice(ENCODINGS), "replace")
    if rng.random() < 0.1:
        data = damaged(data, rng)
    about = {
        "delimiter": delimiter if rng.random() < 0.9 else rng.choice(DELIMITERS), "decimal": decimal_mark,
        "header": rng.random() < 0.95, "skip_lines": preamble if rng.random() < 0.95 else rng.choice((1, 7, 10**9)),
    }  # fmt: skip
    described = "\n".join(f"{key} = {json.dumps(value)}" for key, value in about.items())
    log = seed("bench.log.toml").replace('delimiter = ","', described)
    if rng.random() < 0.2:
        log = log.replace('"c1"', "1").replace('"c2"', rng.choice(("2", "7", "8", "0", '"c 2"')))
    return Case("csv dialect", {"bench.csv": data, "bench.log.toml": log.encode()}, reader)


def _other_heads(heads: list[str], rng: Random) -> list[str]:
    """The names of columns with units, in quotes, twice, empty, or others."""
    heads, k = list(heads), rng.randrange(len(heads))
    draw = rng.randrange(10)
    if draw == 0:
        heads = [f"{head} [{rng.choice(('s', 'rad', 'V', '', ']', 'm/s²'))}]" for head in heads]
    elif draw == 1:
        heads = [f'"{head}"' for head in heads]
    elif draw == 2:
        heads[k] = rng.choice(("", " ", heads[0], "c\r1", '"c\n1"', '"c1', "0", "nan", *WORDS))
    elif draw == 3:
        heads = rng.choice((heads[:-1], [*heads, "x"], [*heads, ""], heads[::-1], ["t_s", "shoulder", "elbow"]))
    return heads


def run_dialect(case: Case) -> None:
    from armwright.results.csv_tables import read_table

    if case.call == "schedule":
        aw.simulation.read_schedule("bench.csv", ["c1", "c2"])
    elif case.call == "motion":
        aw.trajectories.load_motion("bench.csv")
    elif case.call == "table":
        read_table("bench.csv", {key: ["1", "2"] for key in "cvm"})
    else:
        run_log(case)


# MCAP.

JOINT_STATE = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
TYPES = (
    "float64",
    "string",
    "float64[3]",
    "wstring",
    "uint8[]",
    "string<=3[<=2]",
    "Unknown",
    "std_msgs/Header[]",
    "bool",
    "byte",
)


def cdr(stamp: int, names: list[bytes], *fields: list[float], count: int | None = None) -> bytes:
    """A message sensor_msgs/JointState; `count`: of names, if it is another than there are."""
    body = struct.pack("<iI", *divmod(stamp, 10**9)) + struct.pack("<I", 1) + bytes(4)
    body += struct.pack("<I", len(names) if count is None else count)
    for name in names:
        body += bytes(-len(body) % 4) + struct.pack("<I", len(name) + 1) + name + b"\0"
    for values in fields:
        body += bytes(-len(body) % 4) + struct.pack("<I", len(values))
        body += bytes(-len(body) % 8) * bool(values) + struct.pack(f"<{len(values)}d", *values)
    return b"\x00\x01\x00\x00" + body


def make_mcap(rng: Random) -> Case:
    from mcap.writer import CompressionType, Writer

    buffer = io.BytesIO()
    writer = Writer(buffer, compression=rng.choice([*CompressionType]), chunk_size=rng.choice((200, 10**6)))
    writer.start()
    text = JOINT_STATE
    if rng.random() < 0.15:
        kinds = ("float64[]", "string[]", "int32", "uint32", "string", "position", "builtin_interfaces/Time", "=" * 80)
        text = text.replace(rng.choice(kinds), rng.choice((*TYPES, "", *WORDS)), rng.choice((1, 9)))
    schema_name = "sensor_msgs/msg/JointState" if rng.random() < 0.9 else rng.choice(("a/JointState", "JointState", ""))
    encoding = "ros2msg" if rng.random() < 0.95 else rng.choice(("ros2idl", "", "protobuf"))
    schema = writer.register_schema(schema_name, encoding, text.encode("utf-8", "surrogatepass"))
    kind = "cdr" if rng.random() < 0.95 else rng.choice(("json", "ros1", ""))
    channels = [writer.register_channel("/joint_states", kind, schema if rng.random() < 0.97 else 0)]
    if rng.random() < 0.1:
        channels.append(writer.register_channel(rng.choice(("/other", "/joint_states", "")), "cdr", schema))
    every = rng.random() < 0.3  # of the messages are odd, not only a few
    for row in range(rng.choice((0, 1, 2, ROWS))):
        stamp = 10_000_000 * row
        data = _odd_message(stamp, rng) if rng.random() < (0.5 if every else 0.03) else _message(stamp, row)
        at = stamp if rng.random() < 0.99 else rng.choice((0, 2**64 - 1, 2**63))
        writer.add_message(rng.choice(channels), at, data, at, row)
    if rng.random() < 0.97:
        writer.finish()
    data = buffer.getvalue()
    if rng.random() < 0.3:
        data = damaged(data, rng)
    time = rng.choice(("stamp", "stamp", "log_time"))
    names = ('"position/shoulder", "position/elbow"', '"effort/shoulder", "effort/elbow"')
    log = log_text("bench.mcap", time, "ns", *names)
    if rng.random() < 0.15:
        topic = rng.choice(("/joint_states", "/other", "", "x"))
        log = log.replace('path = "bench.mcap"', f'path = "bench.mcap"\ntopic = "{topic}"')
    files = {"bench.mcap": data, "bench.log.toml": mutated(log, "toml", rng) if rng.random() < 0.1 else log.encode()}
    return Case("mcap", files, rng.choice(("raise", "keep", "prepare")))


def _message(stamp: int, row: int) -> bytes:
    x = 0.01 * row
    return cdr(stamp, [b"shoulder", b"elbow"], [x, -x], [1.0, -1.0], [0.5, 0.2 + x])


def _odd_message(stamp: int, rng: Random) -> bytes:
    """A message that is cut, has no names, other lengths, other names, or bytes of chance."""
    good = _message(stamp, 3)
    names = rng.choice(
        ([], [b"elbow"], [b"elbow", b"shoulder"], [b"shoulder"] * 2, [b"\xff\xfe", b"elbow"], [b"", b""])
    )
    few = rng.choice(([], [1.0], [1.0] * 3, [float("nan")] * 2, [1e300, -1e300], [float("inf"), 0.0]))
    return rng.choice(
        (
            good[: rng.randint(0, len(good))],
            damaged(good, rng),
            cdr(stamp, names, few, [], few),
            cdr(stamp, [b"shoulder", b"elbow"], few, few, few),
            cdr(stamp, names, [1.0, 2.0], [], [], count=rng.choice((0, 1, 3, 2**31, 2**32 - 1))),
            cdr(rng.choice((0, 2**31 * 10**9 - 1, 5)), names, few, [], few),
            b"",
            rng.randbytes(rng.choice((1, 4, 40))),
        )
    )


# Parquet.

CELLS: tuple[Any, ...] = (
    *(1.0, 0, -1, True, None, "a", b"a", float("nan"), float("inf"), 1e300, 2**62, [1.0], {"a": 1}),
    *(datetime.datetime(2020, 1, 1), datetime.date(1, 1, 1), datetime.time(1), datetime.timedelta(days=1)),
    decimal.Decimal("1.5"),
)


def make_parquet(rng: Random) -> Case:
    import pyarrow
    import pyarrow.parquet

    rows = rng.choice((0, 1, 2, ROWS, ROWS))
    times = [0.01 * k for k in range(rows)]
    columns = {"t": times, "q1": times, "q2": times[::-1], "m1": [1.0] * rows, "m2": [0.1] * rows}
    arrays = {name: pyarrow.array(values, pyarrow.float64()) for name, values in columns.items()}
    for _ in range(rng.choice((0, 0, 1, 1, 2))):
        name = rng.choice([*arrays])
        draw = rng.random()
        if draw < 0.4:
            arrays[name] = pyarrow.array([rng.choice(CELLS)] * rows)
        elif draw < 0.6:
            kind = rng.choice(
                (
                    *(pyarrow.float32(), pyarrow.float16(), pyarrow.int8(), pyarrow.uint64(), pyarrow.null()),
                    *(pyarrow.timestamp("ns"), pyarrow.timestamp("s", "UTC"), pyarrow.duration("us")),
                    *(
                        pyarrow.string(),
                        pyarrow.decimal128(38, 2),
                        pyarrow.dictionary(pyarrow.int8(), pyarrow.float64()),
                    ),
                )
            )
            arrays[name] = pyarrow.array([None] * rows, kind)
        elif draw < 0.8:
            values = [*columns.get(name, times)]
            if values:
                values[rng.randrange(len(values))] = rng.choice((float("nan"), float("inf"), 1e300, None, -5.0))
            arrays[name] = pyarrow.array(values, pyarrow.float64())
        else:
            arrays = {
                (rng.choice(("", "t", f"{key} [rad]", *WORDS)) if key == name else key): a for key, a in arrays.items()
            }
    heads = [key.replace("\0", "") for key in arrays]
    if rng.random() < 0.05:
        heads[-1] = heads[0]
    buffer = io.BytesIO()
    compression = rng.choice(("snappy", "zstd", "gzip", "none", "lz4"))
    table = pyarrow.Table.from_arrays([*arrays.values()], names=heads)
    pyarrow.parquet.write_table(table, buffer, compression=compression, row_group_size=rng.choice((7, 1000)))
    data = buffer.getvalue()
    if rng.random() < 0.4:
        data = damaged(data, rng)
    log = log_text("bench.parquet", "t", "s", '"q1", "q2"', rng.choice(('"m1", "m2"', "4, 5", '"m1", 9')))
    return Case(
        "parquet", {"bench.parquet": data, "bench.log.toml": log.encode()}, rng.choice(("raise", "keep", "prepare"))
    )


# Stores of sweeps.

SWEEP = """
import sys
from distributed import Client
import armwright as aw
if __name__ == "__main__":
    with Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None) as client:
        aw.sweeps.sweep(sys.argv[1], sys.argv[2], lanes=4, chunk=2, client=client, progress=False)
"""
ODD_JSON: tuple[Any, ...] = (
    *(
        None,
        True,
        0,
        -1,
        1.5,
        10**30,
        "",
        "x",
        "NaN",
        "{",
        "[]",
        [],
        [1],
        [[]],
        {},
        {"a": 1},
        "\u202e",
        "x" * 300,
        [-1],
        [10**12],
    ),
    *("float64", "uint8", "int99", ["lane"], {"name": "bytes"}, {"name": "gone", "configuration": {}}, 2, 3),
)


@cache
def _store() -> dict[str, bytes]:
    """Files of a good store, made by another process, whose cluster ends with it."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(__file__).parent / "seeds" / "tuned.scenario.toml"
        command = [sys.executable, "-c", SWEEP, str(scenario), f"{folder}/runs.zarr"]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
        paths = sorted(path for path in Path(folder).rglob("*") if path.is_file())
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def make_zarr(rng: Random) -> Case:
    files = dict(_store())
    for _ in range(rng.choice((1, 1, 1, 2))):
        name = rng.choice([*files, *(["runs.zarr/zarr.json"] * 8)])
        if name not in files:
            continue
        draw = rng.random()
        if draw < 0.1:
            del files[name]
        elif draw < 0.2:
            files[name] = rng.choice([*files.values()])
        elif draw < 0.4 or not name.endswith(".json"):
            files[name] = damaged(files[name], rng)
        else:
            with contextlib.suppress(ValueError):  # damaged before
                files[name] = json.dumps(_other_json(json.loads(files[name]), rng)).encode()
    names = ("runs.zarr",) * 20 + ("x" * 300, "fifo.zarr", "folder.zarr", "loop.zarr", "gone.zarr", "a\0", "")
    return Case("zarr", files, rng.choice(names))


def _other_json(value: Any, rng: Random) -> Any:
    """The value with something in it replaced; text that is JSON itself is looked into."""
    if isinstance(value, str) and value[:1] in ("{", "[") and rng.random() < 0.8:
        try:
            return json.dumps(_other_json(json.loads(value), rng))
        except ValueError:
            return rng.choice(ODD_JSON)
    if not isinstance(value, (dict, list)) or not value or rng.random() < 0.15:
        return rng.choice(ODD_JSON)
    key = rng.choice([*value]) if isinstance(value, dict) else rng.randrange(len(value))
    other: Any = value.copy()
    if rng.random() < 0.1:
        del other[key]
    else:
        other[key] = _other_json(value[key], rng)
    return other


def run_zarr(case: Case) -> None:
    import dask

    with dask.config.set(scheduler="synchronous"):
        run = aw.sweeps.load_sweep(case.call)
        if os.path.isdir("runs.zarr"):
            run.load()


LOGS: dict[str, tuple[float, Callable[[Random], Case], Callable[[Case], Any]]] = {
    # kind: (share of the inputs, what makes one, what reads it)
    "csv dialect": (8, make_dialect, run_dialect),
    "mcap": (4, make_mcap, run_log),
    "parquet": (4, make_parquet, run_log),
    "zarr": (4, make_zarr, run_zarr),
}
