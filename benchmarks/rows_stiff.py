"""Light links behind stiff gears at equal error: `rodas3` beside MuJoCo's implicitfast and CVODES, ns for a simulated ms.

Each engine takes the longest step, or the loosest tolerance, of a ladder with which its largest error over time is within
a part of each state's range. MuJoCo has no elastic gears: there a body of next to no mass turns with each rotor, and carries its
link on a joint with the gear's spring and damper, which is the same motion.
"""

# MuJoCo's names come from compiled modules without stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from xml.etree import ElementTree

import mujoco
import numpy as np
from mujoco import rollout
from records import Record, Task, record
from timing import Check, Contestant, Entry, race

import armwright as aw
from armwright.description.database import parse
from armwright.model import build_model
from armwright.simulation.loop.compiled import compile_loop

JOINTS = 3
LENGTH, MASS, TENSOR = 0.3, 0.5, 0.004  # [m] [kg] [kg m²] of each link, about its centre in the middle
GEAR = {"stiffness_n_m_per_rad": 1e5, "damping_n_m_s_per_rad": 200.0}
MOTOR = {"gear_ratio": 50.0, "rotor_inertia_kg_m2": 4e-5, "torque_constant_n_m_per_a": 0.06, "resistance_ohm": 1.2}
ROW = 1e-2  # [s] between rows that are compared; also the longest step of the rules that choose theirs
DURATION = 0.5  # [s]
VOLTS = 8.0  # commands within ± this
ERRORS = (1e-2, 1e-3)  # of each state's range
TOLERANCES = 10.0 ** -np.arange(1.5, 9.0, 0.5)  # rtol
ABSOLUTE = 1e-2  # atol is this part of rtol
STEPS = 1e-3 / 2.0 ** np.arange(0, 14)  # [s]
TRUTH = 1e-11  # rtol of CVODES
PEERS = ("cvodes", "implicitfast")
NO_WEIGHT = 1e-12  # [kg] and [kg m²] of bodies that MuJoCo asks to have some
EXPECTED = {"implicitfast": 100.0, "cvodes": 100.0}

Work = Callable[[], np.ndarray]  # → (lanes, rows, 2n) positions and speeds of the links


def tasks(quick: bool) -> list[Task]:
    """One race."""
    return [Task("stiff", "stiff gears at equal error", partial(stiff_records, quick))]


def stiff_arm() -> aw.Model:
    """Rods one behind the other that turn about y, each behind an elastic gear."""
    tensor = {"xx": TENSOR, "xy": 0, "xz": 0, "yy": TENSOR, "yz": 0, "zz": TENSOR}
    joints, links = [], []
    for k in range(JOINTS):
        frame = {"xyz_m": [LENGTH if k else 0.0, 0, 0], "rpy_rad": [0, 0, 0]}
        ends = {"parent": f"rod{k - 1}" if k else "base", "child": f"rod{k}", "frame": frame, "axis": [0, 1, 0]}
        joints.append({"name": f"joint{k}", "type": "revolute", **ends, "motor": MOTOR, "elasticity": GEAR})
        links.append({"name": f"rod{k}", "mass_kg": MASS, "com_m": [LENGTH / 2, 0, 0], "inertia_kg_m2": tensor})
    head = {"name": "stiff-gears", "source": "definition", "command": "voltage", "gravity_m_s2": [0, 0, -9.80665]}
    return build_model(parse({**head, "joints": joints, "links": links}, "stiff gears"))


class MuJoCoStiff:
    """The same arm in MuJoCo."""

    def __init__(self, arm: aw.Model, step: float):
        root = ElementTree.Element("mujoco")
        option = {"gravity": "0 0 -9.80665", "timestep": repr(float(step)), "integrator": "implicitfast"}
        absent = dict.fromkeys(("contact", "constraint", "limit", "frictionloss", "equality", "sensor"), "disable")
        ElementTree.SubElement(ElementTree.SubElement(root, "option", option), "flag", absent)
        at, actuators = ElementTree.SubElement(root, "worldbody"), ElementTree.SubElement(root, "actuator")
        spring = {"stiffness": repr(GEAR["stiffness_n_m_per_rad"]), "damping": repr(GEAR["damping_n_m_s_per_rad"])}
        for k, body in enumerate(arm.coordinates):
            drive = body.drive
            at = ElementTree.SubElement(at, "body", pos=f"{LENGTH if k else 0.0} 0 0")
            turn = {"name": f"motor{k}", "axis": "0 1 0", "armature": repr(float(drive.reflected))}
            ElementTree.SubElement(at, "joint", turn)
            tiny = {"mass": repr(NO_WEIGHT), "pos": "0 0 0", "diaginertia": f"{NO_WEIGHT} {NO_WEIGHT} {NO_WEIGHT}"}
            ElementTree.SubElement(at, "inertial", tiny)
            at = ElementTree.SubElement(at, "body", pos="0 0 0")
            ElementTree.SubElement(at, "joint", {"name": f"gear{k}", "axis": "0 1 0", **spring})
            real = {"mass": repr(MASS), "pos": f"{LENGTH / 2} 0 0", "diaginertia": f"{TENSOR} {TENSOR} {TENSOR}"}
            ElementTree.SubElement(at, "inertial", real)
            gain = float(drive.gear_ratio * drive.torque_constant / drive.resistance)
            bias = -gain * float(drive.gear_ratio * drive.back_emf_constant)
            force = {"gainprm": repr(gain), "biastype": "affine", "biasprm": f"0 0 {bias!r}"}
            ElementTree.SubElement(actuators, "general", {"joint": f"motor{k}", **force})
        self.model = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
        self.data, self.n, self.step = mujoco.MjData(self.model), arm.n, step

    def rows(self, commands: np.ndarray, every: int, count: int) -> np.ndarray:
        """(lanes, count, 2n) positions and speeds of the links every so many steps: `mujoco.rollout`, one thread."""
        rest = np.zeros((len(commands), mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
        held = np.ascontiguousarray(
            np.broadcast_to(commands[:, None, :], (len(commands), every * count, commands.shape[1]))
        )
        states, _ = rollout.rollout(self.model, self.data, rest, held)
        states = np.asarray(states)[:, every - 1 :: every, 1 : 1 + 4 * self.n]
        return states[..., 0::2] + states[..., 1::2]  # of motors and of gears, in turns


def stiff_records(quick: bool, repetitions: int) -> list[Record]:
    """A row for each error: ours, MuJoCo's and CVODES, with the steps that it allows them."""
    arm, (lanes, few) = stiff_arm(), size(quick)
    commands = np.random.default_rng(4).uniform(-VOLTS, VOLTS, (lanes, arm.n))
    truth = ours(arm, "cvodes", commands[:few], TRUTH)()
    ranges = np.ptp(truth, axis=1, keepdims=True)

    def check(allowed: float, states: np.ndarray) -> Check:
        wrong = np.abs(states[:few] - truth) / ranges
        return Check(float(wrong.max()) if np.isfinite(wrong).all() else float("nan"), allowed)

    engines: dict[str, tuple[np.ndarray, int, Callable[[float], Work]]] = {
        "ours": (TOLERANCES, lanes, partial(ours, arm, "rodas3", commands)),
        "cvodes": (TOLERANCES, few, partial(ours, arm, "cvodes", commands[:few])),
        "implicitfast": (STEPS, few, partial(peer, arm, commands[:few])),
    }
    entries = []
    for allowed in ERRORS:
        contestants, taken = {}, {}
        for name, (ladder, units, make) in engines.items():
            for value in ladder:
                run, taken[name] = make(value), float(value)
                if check(allowed, run()).passed:
                    break
            contestants[name] = Contestant(
                f"{name}, {taken[name]:.2g}", run, round(units * DURATION / 1e-3), partial(check, allowed)
            )
        labels = {"arm": arm.name, "joints": arm.n, "work": f"an error of {allowed:g} of the range", "lanes": lanes}
        wanted = EXPECTED if not quick else {}
        entries.append(Entry(labels, contestants, dict.fromkeys(PEERS, "ours"), wanted, taken))
    return [record(row) for row in race(entries, repetitions)]


def ours(arm: aw.Model, integrator: str, commands: np.ndarray, rtol: float) -> Work:
    """Runs the lanes by one of our integrators."""
    solver = aw.Solver(integrator, step=ROW, rtol=float(rtol), atol=ABSOLUTE * float(rtol))
    loop = compile_loop(arm, integrator, adaptivity=solver.adaptivity)
    kept = aw.Recording(what="state")

    def run() -> np.ndarray:
        scenario = aw.Scenario(arm, duration=DURATION, command=aw.Batch(commands), solver=solver, recording=kept)
        run = aw.simulate(scenario, loop=loop, threads=1)
        return np.concatenate([run["q"].values, run["qd"].values], axis=-1)[:, 1:]

    return run


def peer(arm: aw.Model, commands: np.ndarray, step: float) -> Work:
    """Runs the lanes by MuJoCo."""
    engine = MuJoCoStiff(arm, step)
    return lambda: engine.rows(commands, round(ROW / step), round(DURATION / ROW))


def size(quick: bool) -> tuple[int, int]:
    """Lanes, and how many of them the peers run."""
    return (64, 2) if quick else (1000, 4)


def notes(quick: bool) -> dict[str, list[str]]:
    lanes, few = size(quick)
    lines = [
        f"{JOINTS} rods of {LENGTH} m and {MASS} kg behind gears of {GEAR['stiffness_n_m_per_rad']:g} N m/rad, time constants "
        f"from 70 µs; {lanes:,} lanes of {DURATION:g} s, constant voltages, one thread; MuJoCo {mujoco.__version__} (rollout) "
        f"and CVODES run {few} of them",
        f"each with the longest step (halved from 1 ms) or the loosest tolerance with the error of the row in each state's "
        f"range, against CVODES at 1e-11, at rows every {1e3 * ROW:g} ms; CVODES is CasADi's, with its interpreter",
    ]
    return {"stiff": lines}
