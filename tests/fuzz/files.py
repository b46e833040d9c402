"""Kinds of files: the seeds that are mutated, and what reads them."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import struct
from collections.abc import Callable
from functools import cache
from importlib import resources
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

import numpy as np

import armwright as aw
from armwright.results import run_reader
from fuzz.case import Case
from fuzz.mutation import damaged, mutated
from simulation.runs import MIXED, invented

SEEDS = Path(__file__).parent / "seeds"
EXAMPLES = Path(__file__).parents[2] / "examples"
MESHES = {name: (SEEDS / name).read_bytes() for name in ("box.stl", "box.obj")}


def seed(name: str) -> str:
    """A good file's text."""
    return (SEEDS / name).read_text(encoding="utf-8")


@cache
def robots() -> list[str]:
    """Texts of good robot files, small ones more than once."""
    builtin = [
        (resources.files("armwright.robots") / f"{name}.toml").read_text() for name in ("two-link", "puma560", "lwa4p")
    ]
    examples = [(EXAMPLES / name).read_text() for name in ("hot-lift.toml", "scara.toml")]
    seeds = [seed("everything.toml"), seed("balanced.toml")]
    return [*seeds * 4, *[builtin[0], examples[0]] * 3, MIXED, *builtin, *examples]


def make_robot(rng: Random) -> Case:
    text = mutated(rng.choice(robots()), "toml", rng, robots())
    do = rng.choice(("load",) * 12 + ("to_toml", "evaluate", "check", "urdf", "mjcf"))
    return Case("robot", {"arm.toml": text, **MESHES}, {"file": "arm.toml", "do": do})


def make_urdf(rng: Random) -> Case:
    files = {"arm.urdf": seed("arm.urdf").encode(), **MESHES}
    if rng.random() < 0.8:
        files["arm.urdf"] = mutated(seed("arm.urdf"), "xml", rng)
    if rng.random() < 0.3:
        files["arm.drive.toml"] = mutated(seed("arm.drive.toml"), "toml", rng, [seed("everything.toml")])
    options = {
        "mimic": rng.choice(("coupled", "independent", "fixed")),
        "smoothing": rng.choice((0.01, 0.01, 0.01, -1, "a")),
    }
    return Case("urdf", files, {"file": "arm.urdf", "do": rng.choice(("load",) * 9 + ("check",)), "options": options})


def make_mjcf(rng: Random) -> Case:
    files = {"arm.xml": mutated(seed("arm.xml"), "xml", rng), **MESHES}
    return Case("mjcf", files, {"file": "arm.xml", "do": "load", "options": rng.choice(({}, {"smoothing": 0.01}))})


def run_robot(case: Case) -> None:
    """Reads a robot's file, of whatever format, and does a little with the arm."""
    do, file = case.call["do"], case.call["file"]
    if do == "check":
        aw.robotfiles.check(file, **case.call.get("options", {}))
        return
    if do in ("urdf", "mjcf"):
        aw.robotfiles.convert(file, {"urdf": "new.urdf", "mjcf": "new.xml"}[do])
        return
    arm = aw.load(file, **case.call.get("options", {}))
    if do == "to_toml" and arm.description is not None:
        aw.robotfiles.to_toml(arm.description)
    elif do == "evaluate":
        with np.errstate(all="ignore"):  # numbers near the largest overflow; the caller sees inf
            aw.forward_dynamics(arm, *np.zeros((3, arm.n)))


def make_parts(rng: Random) -> Case:
    return Case("parts", {"arm.parts.toml": mutated(seed("arm.parts.toml"), "toml", rng), **MESHES})


def run_parts(case: Case) -> None:
    from armwright.parts.build import build_parts

    build_parts("arm.parts.toml")


def make_assembly(rng: Random) -> Case:
    files = {name: seed(name).encode() for name in ("toy.assembly.toml", "toy.modules.toml")}
    for name in rng.choice((["toy.assembly.toml"], ["toy.modules.toml"], [*files])):
        files[name] = mutated(seed(name), "toml", rng)
    return Case("assembly", files)


def run_assembly(case: Case) -> None:
    aw.modules.assemble("toy.assembly.toml")


def make_task(rng: Random) -> Case:
    return Case("task", {"pick.task.toml": mutated(seed("pick.task.toml"), "toml", rng)})


def run_task(case: Case) -> None:
    aw.modules.read_task("pick.task.toml")


def make_scenario(rng: Random) -> Case:
    names = ("driven.scenario.toml", "loop.scenario.toml", "tuned.scenario.toml")
    files = {file: seed(file).encode() for file in ("everything.toml", "torques.csv")}
    text = mutated(seed(rng.choice(names)), "toml", rng, [seed(name) for name in names])
    return Case("scenario", {"one.scenario.toml": text, **files, **MESHES}, rng.choice(("read",) * 30 + ("start",)))


def run_scenario(case: Case) -> None:
    scenario = aw.read_scenario("one.scenario.toml")
    if case.call == "start":
        aw.simulation.Simulation(scenario)


def make_tuned(rng: Random) -> Case:
    text = mutated(seed("tuned.scenario.toml"), "toml", rng)
    return Case("scenario", {"tuned.scenario.toml": text}, "read")  # of a command line only


def make_motion(rng: Random) -> Case:
    names = ("two.motion.toml", "two.motion.toml", "tool.motion.toml")
    text = mutated(seed(rng.choice(names)), "toml", rng, [seed(name) for name in names])
    return Case("motion", {"one.motion.toml": text}, rng.choice((None,) * 4 + ("motion.csv", "motion.nc")))


def run_motion(case: Case) -> None:
    plan = aw.trajectories.plan("one.motion.toml")
    assert not plan.limits_report.excesses() or str(plan)
    if case.call is not None:
        plan.save(case.call)
        aw.trajectories.load_motion(case.call, plan.arm)


def make_csv(rng: Random) -> Case:
    name = rng.choice(("torques.csv", "sets.csv"))
    return Case("csv", {name: mutated(seed(name), "csv", rng)}, name)


def make_poses(rng: Random) -> Case:
    return Case("csv", {"poses.csv": mutated(seed("poses.csv"), "csv", rng)}, "poses.csv")  # of a command line only


def run_csv(case: Case) -> None:
    from armwright.results.csv_tables import read_table

    if case.call == "torques.csv":
        aw.simulation.read_schedule("torques.csv", ["shoulder", "elbow"], ["N m", "N m"])
    else:
        read_table("sets.csv", {key: ["shoulder", "elbow"] for key in ("q", "qd", "qdd")})


def make_log(rng: Random) -> Case:
    files = {name: seed(name).encode() for name in ("bench.log.toml", "bench.csv")}
    for name, form in rng.choice(
        ((("bench.log.toml", "toml"),), (("bench.csv", "csv"),), (("bench.log.toml", "toml"), ("bench.csv", "csv")))
    ):
        files[name] = mutated(seed(name), form, rng)
    return Case("log", files, rng.choice(("raise", "keep", "prepare")))


def run_log(case: Case) -> None:
    log = aw.identification.read_log("bench.log.toml", on_error="raise" if case.call == "raise" else "keep")
    if case.call == "prepare" and not log.errors:
        aw.identification.prepare_log(log)


def make_mesh(rng: Random) -> Case:
    ending = rng.choice(("stl", "obj", "ply", "stl-binary", "ply-binary"))
    if ending.endswith("binary"):
        content = damaged(_binary(ending), rng)
    else:
        content = mutated(seed(f"box.{ending}"), "mesh", rng)
    return Case(
        "mesh",
        {f"arm.{ending.partition('-')[0]}": content},
        rng.choice((1, 1, 1e-3, -1, [1, 1e-9, 1e9], 1e300, 5e-324)),
    )


@cache
def _binary(ending: str) -> bytes:
    """The seed's tetrahedron in the binary form of STL or PLY."""
    points = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    if ending == "stl-binary":
        rows = [struct.pack("<12fH", 0, 0, 0, *(x for k in face for x in points[k]), 0) for face in faces]
        return b"box".ljust(80) + struct.pack("<I", len(faces)) + b"".join(rows)
    head = seed("box.ply").partition("end_header\n")[0].replace("ascii", "binary_little_endian") + "end_header\n"
    return (
        head.encode()
        + b"".join(struct.pack("<3f", *p) for p in points)
        + b"".join(struct.pack("<B3i", 3, *f) for f in faces)
    )


def run_mesh(case: Case) -> None:
    from armwright.errors import DescriptionError
    from armwright.solids.mesh import Mesh
    from armwright.validation import validated

    solid = {"shape": "mesh", "file": next(iter(case.files)), "scale": case.call}
    validated(Mesh, solid, folder=Path(), error=DescriptionError).moments()


PIECES = ("", "(", ")", "**", "*", "-", "1e308", "t", "sin(", ",", " ", ".", "9", "deg", "j", "\0", "é", "/0", "**0.5")


def make_formula(rng: Random) -> Case:
    from fuzz.mutation import FORMULAS

    text = rng.choice(
        (*FORMULAS, "0.3*sin(2*pi*t) + step(t - 1)**2", "clip(t, -1, 1) / hypot(t, 3)", "30 deg + atan2(t, 2)")
    )
    for _ in range(rng.randint(0, 4)):
        k = rng.randint(0, len(text))
        piece = rng.choice((*PIECES, text[:k]))
        text = text[:k] + piece + text[k + rng.choice((0, 0, 1, 3)) :]
    return Case("formula", {}, {"text": text, "t": rng.choice((0.0, 0.5, -1.0, 1e300, -1e-300))})


def run_formula(case: Case) -> None:
    from armwright.expressions import expression, number

    number(case.call["text"])
    expression(case.call["text"], ("t",))({"t": case.call["t"]})


@cache
def _runs() -> list[bytes]:
    """Good runs: of one lane, of many, and one that keeps its scenario."""
    arm = aw.load("two-link")
    runs = [invented(arm, rows=4), invented(arm, lanes=3, rows=4)]
    runs[0].attrs["scenario"] = '{"scenario": "robot = \'two-link\'", "files": {}}'
    return [bytes(run.to_netcdf(engine="h5netcdf", format="NETCDF4")) for run in runs]


def make_run(rng: Random) -> Case:
    data = rng.choice(_runs())
    data = _other_run(data, rng) if rng.random() < 0.8 else damaged(data, rng)
    do = rng.choice(("load",) * 12 + ("statistics", "start", "plot", "animate", "reproduce"))
    return Case("run", {"one.nc": data}, do)


ATTRIBUTES: tuple[Any, ...] = ("", "{", "[]", 1.0, np.zeros(3), "\x1b[31m", np.nan, "a" * 9999)
VARIABLES: tuple[Any, ...] = (
    *(1.0, "text", np.zeros((2, 2)), np.zeros(0), np.array([b"a"]), np.arange(4)[::-1], np.zeros((3, 4, 9))),
)


def _other_run(data: bytes, rng: Random) -> bytes:
    """A run with variables left out, replaced or with other numbers, and with other attributes."""
    import h5py

    buffer = io.BytesIO(data)
    with h5py.File(buffer, "r+") as file:
        for _ in range(rng.randint(1, 2)):
            names = [name for name in file if isinstance(file[name], h5py.Dataset)]
            name = rng.choice(names) if names else ""
            draw = rng.randrange(5)
            if draw == 0 or not name:
                file.attrs[rng.choice([*file.attrs, "x"])] = rng.choice(ATTRIBUTES)
            elif draw == 1:
                del file[name]
            elif draw == 2 and file[name].dtype.kind == "f" and file[name].size:
                file[name][...] = rng.choice((np.nan, np.inf, 1e300, -1.0, 0.0))
            elif draw == 3:
                del file[name]
                file[name] = rng.choice(VARIABLES)
            else:
                for key in [*file[name].attrs][:2]:
                    del file[name].attrs[key]
    return buffer.getvalue()


def _of_a_fork(path: Path, _: float) -> bytes:
    """Answer of `run_reader` in a fork of this process, which begins 0.6 s sooner than another Python; commands begin one."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        with contextlib.suppress(BaseException), os.fdopen(writing, "wb") as pipe:
            pipe.write(run_reader.copy_or_reason(path))
        os._exit(0)
    os.close(writing)
    try:
        with os.fdopen(reading, "rb") as pipe:
            return pipe.read()
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def run_run(case: Case) -> None:
    with mock.patch.object(run_reader, "_of_another_process", _of_a_fork):
        _use_run(case)


def _use_run(case: Case) -> None:
    run = aw.load_run("one.nc")
    arm = aw.load("two-link")
    if case.call == "statistics":
        aw.statistics(run)
    elif case.call == "start":
        aw.Scenario(arm, duration=0.01, command=[0, 0], start=run)
    elif case.call == "plot":
        aw.plot(run, "run.svg")
    elif case.call == "animate":
        aw.animate(run, arm, "run.glb")
    elif case.call == "reproduce":
        aw.reproduce("one.nc")


SIMULATIONS = (  # what is mutated in other lines would make some of these long
    *(
        "simulate new zero=yes steps=3",
        "simulate new no steps=2 every=2",
        "simulate steps=-1",
        "simulate new steps=nan",
    ),
    *(
        "simulate new zero=yes steps=2 every=0",
        "simulate new yes schedule=torques.csv steps=2",
        "simulate old zero=yes steps=0",
    ),
)


def make_session(rng: Random) -> Case:
    lines = seed("day.sim").splitlines()
    chosen = "\n".join(rng.choice(lines) for _ in range(rng.randint(1, 4)))
    script = mutated(chosen, "script", rng, [seed("day.sim")])
    kept = [line for line in script.split(b"\n") if not line.strip().lower().startswith((b"py", b"sim"))]
    if rng.random() < 0.2:
        kept.insert(rng.randint(0, len(kept)), rng.choice(SIMULATIONS).encode())
    files = {"day.sim": b"\n".join(kept), "other.sim": b"theta[1] = 1\n"}
    return Case("session", {**files, **{name: seed(name).encode() for name in ("sets.csv", "torques.csv")}}, "day.sim")


def run_session(case: Case) -> None:
    from armwright.session import Session
    from armwright.session.files import read_script

    session = Session("two-link")
    session.run_lines(read_script(case.call), case.call, lambda output: str(output))


FILES: dict[str, tuple[float, Callable[[Random], Case], Callable[[Case], Any]]] = {
    # kind: (share of the inputs: the less one costs the more; what makes one; what reads it)
    "robot": (8, make_robot, run_robot),
    "urdf": (20, make_urdf, run_robot),
    "mjcf": (4, make_mjcf, run_robot),
    "parts": (3, make_parts, run_parts),
    "assembly": (5, make_assembly, run_assembly),
    "task": (5, make_task, run_task),
    "scenario": (4, make_scenario, run_scenario),
    "motion": (1, make_motion, run_motion),
    "csv": (60, make_csv, run_csv),
    "log": (2, make_log, run_log),
    "mesh": (20, make_mesh, run_mesh),
    "formula": (80, make_formula, run_formula),
    "run": (1, make_run, run_run),
    "session": (6, make_session, run_session),
}
