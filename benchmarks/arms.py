"""The arms that are timed: built-in ones, and random chains that look like nobody's robot, so that little folds away."""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import armwright as aw
from armwright.description.database import parse
from armwright.model import EfficiencyTable, build_model

CHAIN = "chain-"  # the name of a random chain is this and its number of joints


@functools.cache
def timed_arm(name: str) -> aw.Model:
    """A built-in arm, or a random chain such as "chain-30"; rotor inertia on, friction and gear loss off."""
    arm = random_chain(int(name.removeprefix(CHAIN))) if name.startswith(CHAIN) else aw.load(name)
    return arm.replace(friction=None, efficiency=None)


def sprung_arms(name: str) -> dict[str, aw.Model]:
    """A built-in arm with one spring at its second joint, by kind: a line, a table of 12 points, a cylinder across the joint."""
    line = {"stiffness_n_m_per_rad": 80.0, "rest_rad": -1.5, "preload_n_m": 4.0}
    at = np.linspace(-4.0, 4.0, 12)
    table = {"positions_rad": at.tolist(), "torques_n_m": (60.0 * np.sin(at)).tolist(), "outside": "constant"}
    ends = {"link_a": "link1", "anchor_a_m": [0.0, -0.35, 0.1], "link_b": "link2", "anchor_b_m": [-0.3, 0.05, 0.0]}
    cylinder = {"name": "balancer", **ends, "force_n": -300.0, "length_m": 0.4, "stiffness_n_per_m": 900.0}
    springs = {"a linear spring": {"spring": line}, "a table of 12 points": {"spring": table}, "a cylinder": {}}
    arms = {}
    for kind, own in springs.items():
        record = aw.load(name).record.model_dump(exclude_none=True, exclude={"remarks"})
        record["source"] = "estimate"
        record["joints"] = [*record["joints"][:1], record["joints"][1] | own, *record["joints"][2:]]
        record["cylinders"] = [] if own else [cylinder]
        robot = aw.RobotDescription(**record)
        arms[kind] = build_model(robot).replace(friction=None, efficiency=None)
    return arms


@dataclass(frozen=True)
class LossyGear:
    """Efficiency at torques that leave a gear [N m], the same either way; one of them holds at every torque."""

    efficiency: tuple[float, ...]
    torques: tuple[float, ...] = (1.0,)
    smoothing: float = 0.05  # [rad/s]

    def fitted(self, arm: aw.Model) -> aw.Model:
        """The arm with such gears at all joints."""
        eta: Any = self.efficiency[0]
        if len(self.torques) > 1:
            eta = EfficiencyTable(self.torques, (), (self.efficiency,), (self.efficiency,))
        drives = (replace(body.drive, efficiency=eta, smoothing=self.smoothing) for body in arm.bodies)
        bodies = (replace(body, drive=drive) for body, drive in zip(arm.bodies, drives, strict=True))
        return replace(arm, bodies=tuple(bodies))

    def entering(self, leaving: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Torques that enter the gears, of any shape: a line between T / factor(T), the factor that of the end beyond it."""
        s = np.abs(speed) / np.hypot(speed, self.smoothing)
        eta, size = np.array(self.efficiency), np.abs(leaving)
        driving = 1.0 - (1.0 - eta) * s[..., None]
        factors = np.where((leaving * speed >= 0.0)[..., None], driving, 1.0 + (1.0 / eta - 1.0) * s[..., None])
        at, t = np.array(self.torques), self.torques / factors
        k = np.clip(np.searchsorted(at, size) - 1, 0, max(len(at) - 2, 0))[..., None]
        low, high = (np.take_along_axis(t, np.minimum(k + j, len(at) - 1), -1)[..., 0] for j in (0, 1))
        gap = at[np.minimum(k + 1, len(at) - 1)] - at[k]
        share = (size - at[k][..., 0]) / np.where(gap == 0.0, 1.0, gap)[..., 0]
        beyond = np.where(size < at[0], size / factors[..., 0], size / factors[..., -1])
        inside = (at[0] <= size) & (size <= at[-1])
        return np.sign(leaving) * np.where(inside, low + share * (high - low), beyond)


GEARS = {
    "gears of 80 %": LossyGear((0.8,)),
    "gears by a table of 2 torques": LossyGear((0.6, 0.8), (5.0, 20.0)),
    "gears by a table of 4 torques": LossyGear((0.4, 0.6, 0.72, 0.8), (2.0, 5.0, 12.0, 30.0)),
}


def random_chain(n: int) -> aw.Model:
    """n revolute joints about random axes, short links of real bodies, a geared motor each: M is well conditioned."""
    rng = np.random.default_rng([n, 9])
    links = ["base", *(f"link{k + 1}" for k in range(n))]
    joints = [_joint(rng, parent, child) for parent, child in itertools.pairwise(links)]
    record = {
        "name": f"{CHAIN}{n}",
        "source": "definition",
        "command": "torque",
        "gravity_m_s2": [0.0, 0.0, -9.80665],
        "joints": joints,
        "links": [{"name": name, **_body(rng)} for name in links[1:]],
    }
    return build_model(parse(record, f"random chain of {n} joints"))


def _joint(rng: np.random.Generator, parent: str, child: str) -> dict[str, Any]:
    ratio = rng.choice([-1.0, 1.0]) * rng.uniform(20.0, 100.0)
    frame = {"xyz_m": rng.uniform(-0.1, 0.1, 3).tolist(), "rpy_rad": rng.uniform(-np.pi, np.pi, 3).tolist()}
    motor = {"gear_ratio": ratio, "rotor_inertia_kg_m2": rng.uniform(0.1, 1.0) / ratio**2}
    base = {"name": f"to-{child}", "type": "revolute", "parent": parent, "child": child}
    return {**base, "frame": frame, "axis": rng.normal(size=3).tolist(), "motor": motor}


def _body(rng: np.random.Generator) -> dict[str, Any]:
    """A cloud of mass with three random thicknesses."""
    mass = rng.uniform(0.3, 2.0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    spread = turn @ np.diag(rng.uniform(0.02, 0.06, 3) ** 2) @ turn.T  # ∫ r rᵀ dm / m
    tensor = mass * (np.trace(spread) * np.eye(3) - spread)
    entries = {f"{'xyz'[i]}{'xyz'[j]}": float(tensor[i, j]) for i in range(3) for j in range(i, 3)}
    return {"mass_kg": mass, "com_m": rng.uniform(-0.05, 0.05, 3).tolist(), "inertia_kg_m2": entries}


def random_states(arm: aw.Model, count: int) -> dict[str, np.ndarray]:
    """Random states and torques, of the size that an arm has in motion."""
    rng = np.random.default_rng(2)
    shape = (count, arm.n)
    q, qd, qdd = (scale * rng.uniform(-1.0, 1.0, shape) for scale in (np.pi, 2.0, 5.0))
    return {"q": q, "qd": qd, "qdd": qdd, "tau": rng.uniform(-20.0, 20.0, shape)}


@functools.cache
def joint_count(name: str) -> int:
    """Of an arm by name, without building a chain."""
    return int(name.removeprefix(CHAIN)) if name.startswith(CHAIN) else timed_arm(name).n
