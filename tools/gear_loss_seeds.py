"""Arm identification with gear loss over many seeds, beside the same motions, noise and resolution of an arm without loss.

    python tools/gear_loss_seeds.py --seeds 40

Three arms: LWA 4P, puma560 with friction on the motors, and one of four joints with η = 0.75; all logged as encoder counts of
the motors and milliamperes. Every seed is a motion and a noise of its own. What `identify_arm` gets is a record of the arm's
kinematics, gears and rotors, with other masses. For each arm the table has, without loss and with:

    share of base parameters within 3 of their standard deviations;   root mean square of their errors, each by its deviation in
    the same seed without loss;   R², the lowest of a joint, as a mean over the seeds;   how many of the written records
    `validate` passes on a new motion, of those for which it passes the true record.

Exit code 1 where with loss the share is more than 0.02 lower, the errors more than 1.3 times as large, R² more than 0.01 lower,
or a record does not pass.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import armwright as aw
from armwright.identification.logs.log import Log
from armwright.model import build_model
from armwright.results.csv_tables import write_table

SECONDS, RATE, HARMONICS = 20.0, 250.0, 10
COUNTS = 8192  # of an encoder in a turn of its motor
RESOLUTION = 1e-3  # of currents [A]
NOISE = 0.01  # of each current's deviation without loss
SHARE, ERRORS, R2 = 0.02, 1.3, 0.01  # what the loss may cost
WITHIN = 3.0  # standard deviations

FOUR_JOINTS = """
name = "four-joint"
source = "sketch"
gravity_m_s2 = [0.0, 0.0, -9.81]
command = "current"

[sources.sketch]
kind = "estimate"
text = "a geared arm of usual sizes"
"""
JOINT = """
[[joints]]
name = "{name}"
type = "revolute"
parent = "{parent}"
child = "{child}"
dh = {{ alpha_rad = {alpha}, r_m = {r}, a_m = {a}, offset_rad = 0.0 }}
motor = {{ gear_ratio = {n}, rotor_inertia_kg_m2 = {rotor}, torque_constant_n_m_per_a = {kt}, gear_efficiency = 0.75 }}
friction = {{ viscous_n_m_s_per_rad = {fv}, coulomb_positive_n_m = {fc}, coulomb_negative_n_m = {fc} }}

[[links]]
name = "{child}"
mass_kg = {m}
com_m = {com}
inertia_kg_m2 = {{ xx = {xx}, xy = 0.0, xz = 0.0, yy = {yy}, yz = 0.0, zz = {zz} }}
"""
NUMBERS = (
    {"name": "yaw", "alpha": 1.5707963267948966, "r": 0.3, "a": 0.0, "n": 100.0, "rotor": 8e-5, "kt": 0.08, "fv": 4.0,
     "fc": 5.0, "m": 9.0, "com": [0.01, -0.12, 0.02], "xx": 0.08, "yy": 0.05, "zz": 0.08},
    {"name": "shoulder", "alpha": 0.0, "r": 0.0, "a": 0.45, "n": 120.0, "rotor": 8e-5, "kt": 0.08, "fv": 6.0, "fc": 7.0,
     "m": 7.0, "com": [-0.22, 0.01, 0.03], "xx": 0.02, "yy": 0.13, "zz": 0.14},
    {"name": "elbow", "alpha": 0.0, "r": 0.0, "a": 0.35, "n": -100.0, "rotor": 3e-5, "kt": 0.06, "fv": 3.0, "fc": 4.0,
     "m": 4.0, "com": [-0.17, 0.0, -0.02], "xx": 0.01, "yy": 0.05, "zz": 0.05},
    {"name": "wrist", "alpha": 0.0, "r": 0.0, "a": 0.1, "n": 80.0, "rotor": 9e-6, "kt": 0.05, "fv": 0.8, "fc": 1.0,
     "m": 1.2, "com": [0.03, 0.01, 0.05], "xx": 0.004, "yy": 0.005, "zz": 0.003},
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """An arm with gears of an efficiency, and the friction terms that are fitted."""

    arm: aw.Arm
    efficiency: float
    friction: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Seed:
    """Result of a seed: errors (b,), standard deviations (b,), least R² of a joint, and whether the written record passes.

    `passed` is None where the true record does not pass either, or nothing was validated.
    """

    errors: np.ndarray
    std: np.ndarray
    r2: float
    passed: bool | None


def with_efficiency(arm: aw.Arm, efficiency: float | None) -> aw.Arm:
    """The arm with gears of that efficiency, free to turn as far as the motions go."""
    value = None if efficiency is None else {"value": efficiency, "source": "definition"}
    joints = tuple(
        joint.replace(motor=joint.motor.replace(gear_efficiency=value), limits={}) for joint in arm.record.joints
    )
    return build_model(arm.record.replace(joints=joints), on_impossible="warn")


def four_joints(folder: Path) -> aw.Arm:
    """The arm of four joints."""
    names = ["base", *(f"link{k}" for k in range(1, 5))]
    parts = [
        JOINT.format(parent=parent, child=child, **numbers)
        for parent, child, numbers in zip(names, names[1:], NUMBERS, strict=False)
    ]
    path = folder / "four-joint.toml"
    path.write_text(FOUR_JOINTS + "".join(parts), encoding="utf-8")
    return aw.load(path)


def cases(folder: Path) -> dict[str, Case]:
    """The three arms."""
    usual = ("viscous", "coulomb", "offset")
    return {
        "lwa4p": Case(with_efficiency(aw.load("lwa4p"), 0.85), 0.85, usual),
        "puma560": Case(with_efficiency(aw.load("puma560"), 0.8), 0.8, ("viscous", "asymmetric")),
        "four-joint": Case(four_joints(folder), 0.75, usual),
    }


def motion(n: int, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """t, q, q̇, q̈ of a random Fourier series with the period of the log."""
    t = np.arange(round(SECONDS * RATE)) / RATE
    order = np.arange(1, HARMONICS + 1)
    w, scale = 2 * np.pi * order / SECONDS, 0.6 / np.sqrt(order)[:, None]
    a, b = scale * rng.normal(size=(2, HARMONICS, n))
    s, c = np.sin(w * t[:, None]), np.cos(w * t[:, None])
    q = s @ a + c @ b + rng.uniform(-0.5, 0.5, n)
    return t, q, (w * c) @ a - (w * s) @ b, -(w**2 * s) @ a - (w**2 * c) @ b


def written_log(folder: Path, name: str, arm: aw.Arm, seed: list[int]) -> Log:
    """A log of the arm in counts and milliamperes; its noise is that of the same arm without loss."""
    rng = np.random.default_rng(seed)
    t, *state = motion(arm.n, rng)
    bodies = arm.coordinates
    gears = np.array([float(body.drive.gear_ratio) for body in bodies])
    per_ampere = gears * [float(body.drive.torque_constant) for body in bodies]
    plain = aw.compile(arm.replace(efficiency=None)).inverse_dynamics(*state) / per_ampere
    noise = NOISE * plain.std(axis=0) * rng.normal(size=plain.shape)
    current = aw.compile(arm).inverse_dynamics(*state) / per_ampere + noise
    columns = {"t": t}
    for k in range(arm.n):
        columns[f"counts{k}"] = np.round(state[0][:, k] * gears[k] / (2 * np.pi) * COUNTS)
        columns[f"mA{k}"] = 1e3 * np.round(current[:, k] / RESOLUTION) * RESOLUTION
    write_table(folder / f"{name}.csv", columns)
    path = folder / f"{name}.log.toml"
    path.write_text(
        f'joints = {arm.names}\ngears.ratios = {gears.tolist()}\n[files.log]\npath = "{name}.csv"\n'
        '[time]\ncolumn = "t"\nunit = "s"\n'
        f'[[signals]]\nquantity = "position"\ncolumns = {[f"counts{k}" for k in range(arm.n)]}\nunit = "counts"\n'
        f'side = "motor"\ncounts_per_turn = {COUNTS}\n'
        f'[[signals]]\nquantity = "current"\ncolumns = {[f"mA{k}" for k in range(arm.n)]}\nunit = "mA"\n',
        encoding="utf-8",
    )
    return aw.identification.read_log(path)


def nominal(arm: aw.Arm) -> aw.Arm:
    """The arm as a drawing has it: masses 15 % larger."""
    masses = {f"{body.link}.mass_kg": 1.15 * float(body.mass) for body in arm.bodies}
    return arm.with_values(masses)


def one_seed(folder: Path, arm: aw.Arm, start: aw.Arm, friction: Sequence[str], seed: int, validated: bool) -> Seed:
    """Errors of one log's fit."""
    log = written_log(folder, "log", arm, [seed, 28])
    found = aw.identification.identify_arm(log, start, friction=friction, record=validated, checks=())
    fit = found.fit
    model = fit.equations.model
    own = {column.name: value for column, value in zip(model.columns, model.prior, strict=True)}
    links = np.asarray(arm.inertial_parameters, dtype=float)  # of the true arm; drives are the record's own
    truth = np.array([*links, *[own[column.name] for column in model.columns[len(links) :]]])
    passed = None
    if validated:
        new = written_log(folder, "new", arm, [seed, 29])
        if aw.identification.validate(arm, new, simulation=False).passed:
            written = found.write(folder / "found.toml")
            passed = aw.identification.validate(written, new, simulation=False).passed
    return Seed(fit.values - fit.base.of(np.nan_to_num(truth)), fit.std, float(np.nanmin(fit.r2)), passed)


@dataclass(frozen=True)
class Row:
    """A row of the table: an arm without and with loss."""

    name: str
    efficiency: float
    share: tuple[float, float]
    errors: tuple[float, float]
    r2: tuple[float, float]
    passed: tuple[str, str]

    @property
    def failures(self) -> list[str]:
        """Sentences on costs of the loss that are larger than allowed."""
        found = []
        if self.share[1] < self.share[0] - SHARE:
            found.append(
                f"{self.name}: share within {WITHIN:g} deviations {self.share[1]:.3f}, without loss {self.share[0]:.3f}"
            )
        if self.errors[1] > ERRORS * self.errors[0]:
            found.append(f"{self.name}: errors {self.errors[1]:.2f}, without loss {self.errors[0]:.2f}")
        if self.r2[1] < self.r2[0] - R2:
            found.append(f"{self.name}: R² {self.r2[1]:.4f}, without loss {self.r2[0]:.4f}")
        passed, of = self.passed[1].split("/")
        if passed != of:
            found.append(f"{self.name}: {self.passed[1]} records pass")
        return found

    def __str__(self) -> str:
        pairs = [f"{a:.3f} | {b:.3f}" for a, b in (self.share, self.errors)] + ["{:.5f} | {:.5f}".format(*self.r2)]
        return " | ".join([f"{self.name:10s}", f"{self.efficiency:.2f}", *pairs, *self.passed])


def study(name: str, case: Case, folder: Path, seeds: range, validated: int = 0) -> Row:
    """The table's row of an arm; the first `validated` seeds are written and validated too."""
    results = []
    for arm in (with_efficiency(case.arm, None), case.arm):
        start = nominal(arm)
        results.append([one_seed(folder, arm, start, case.friction, k, k - seeds[0] < validated) for k in seeds])
    shares = [np.mean([np.abs(each.errors) <= WITHIN * each.std for each in some]) for some in results]
    errors = [_by_deviation(some, results[0]) for some in results]
    r2 = [np.mean([each.r2 for each in some]) for some in results]
    known = [[each.passed for each in some if each.passed is not None] for some in results]
    passed = [f"{sum(some)}/{len(some)}" for some in known]
    pairs = [(float(one), float(other)) for one, other in (shares, errors, r2)]
    return Row(name, case.efficiency, pairs[0], pairs[1], pairs[2], (passed[0], passed[1]))


def _by_deviation(results: Sequence[Seed], without: Sequence[Seed]) -> float:
    """Root mean square of errors by the deviations without loss."""
    return float(np.sqrt(np.mean([(one.errors / other.std) ** 2 for one, other in zip(results, without, strict=True)])))


def main() -> int:
    """Runs the study and prints its table."""
    parser = argparse.ArgumentParser(description="Identification with gear loss beside that without.")
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--validated", type=int, default=8, help="seeds whose record is written and validated")
    parser.add_argument("--robot", default="", help="one of the arms; by default all")
    options = parser.parse_args()
    begin, failures = time.perf_counter(), []
    with tempfile.TemporaryDirectory() as folder:
        chosen = {k: v for k, v in cases(Path(folder)).items() if options.robot in ("", k)}
        print(
            "arm | η | within 3 deviations: without | with | error: without | with | R²: without | with | passed: without | with"
        )
        for name, case in chosen.items():
            row = study(name, case, Path(folder), range(options.seeds), options.validated)
            print(row, flush=True)
            failures += row.failures
    for each in failures:
        print(each)
    print(f"{time.perf_counter() - begin:.0f} s")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
