"""Logs of arms by a simulator of its own, Pinocchio and NumPy alone, with what goes wrong in real ones.

A random arm moves along a known motion, or is held to it by a controller; encoders count, drives add noise, and a logger that
runs beside the controller stamps rows late, takes some twice and misses others.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.identification.arm.torque_model import TorqueModel, torque_model
from armwright.identification.logs.log import Log
from armwright.results.csv_tables import write_table
from identification.arm.moved_arm import FILE, SIGNAL

TWISTS = (0.0, -np.pi / 2, np.pi / 2, np.pi / 2, -np.pi / 2, np.pi / 2, np.pi / 2)  # [rad] about x, from joint to joint
OFFSETS = ((0, 0, 0.3), (0.05, 0, 0), (0, -0.32, 0), (0.08, 0, 0), (-0.08, 0.35, 0), (0, 0, 0), (0.09, 0, 0))  # [m]
MASSES = (5.0, 4.0, 3.5, 3.0, 2.2, 1.5, 0.8)  # [kg]
UNITS = {"position": "rad", "speed": "rad/s", "torque": "N m", "link torque": "N m"}


@dataclass(frozen=True, eq=False)
class Motion:
    """A Fourier series of every joint at any times: harmonics `hz` (k,), amplitudes a, b (k, n), middle (n,)."""

    hz: np.ndarray
    a: np.ndarray
    b: np.ndarray
    middle: np.ndarray

    @classmethod
    def of(cls, n: int, seed: int, seconds: float = 10.0, harmonics: int = 5, speed: float = 1.0) -> Motion:
        """A random one of this period [s], whose speeds have a root mean square `speed` [rad/s]."""
        rng = np.random.default_rng([seed, 1])
        hz = np.arange(1, harmonics + 1) / seconds
        a, b = rng.normal(size=(2, harmonics, n)) / np.sqrt(np.arange(1, harmonics + 1))[:, None]
        size = speed / np.sqrt(((2 * np.pi * hz[:, None]) ** 2 * (a**2 + b**2)).sum(axis=0) / 2)
        return cls(hz, a * size, b * size, rng.uniform(-0.5, 0.5, n))

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q, q̇, q̈ (rows, n)."""
        w = 2 * np.pi * self.hz
        s, c = np.sin(np.multiply.outer(t, w)), np.cos(np.multiply.outer(t, w))
        q = s @ self.a + c @ self.b + self.middle
        return q, (w * c) @ self.a - (w * s) @ self.b, -(w**2 * s) @ self.a - (w**2 * c) @ self.b


@dataclass(frozen=True, eq=False)
class Machine:
    """A random arm of revolute joints, its URDF and what is not in it.

    Attributes:
        path: of the URDF.   rotor, viscous, coulomb, offset: (n,) at the joints.
    """

    path: Path
    rotor: np.ndarray
    viscous: np.ndarray
    coulomb: np.ndarray
    offset: np.ndarray
    names: list[str] = field(default_factory=list)

    @classmethod
    def written(cls, folder: Path, n: int, seed: int = 0) -> Machine:
        """The arm of a seed, its URDF in a folder."""
        rng, links, joints = np.random.default_rng([seed, n]), ['<link name="base"/>'], []
        for k in range(n):
            mass, size = MASSES[k] * rng.uniform(0.8, 1.2), 0.3 if k < 5 else 0.12
            c, moments = rng.uniform(-0.3, 0.3, 3) * size, rng.uniform(0.3, 1.0, 3) * mass * size**2 / 10
            tensor = np.diag(moments.sum() - moments)
            inertia = " ".join(
                f'i{a}{b}="{float(tensor[i, j])}"' for i, a in enumerate("xyz") for j, b in enumerate("xyz") if i <= j
            )
            own = f'<origin xyz="{" ".join(map(str, c.tolist()))}"/><mass value="{mass}"/><inertia {inertia}/>'
            links.append(f'<link name="link{k + 1}"><inertial>{own}</inertial></link>')
            place = f'<origin xyz="{" ".join(map(str, OFFSETS[k]))}" rpy="{TWISTS[k]} 0 0"/>'
            parent = f"link{k}" if k else "base"
            limit = '<limit lower="-6.2" upper="6.2" velocity="20" effort="2000"/>'
            joints.append(
                f'<joint name="j{k + 1}" type="revolute"><parent link="{parent}"/><child link="link{k + 1}"/>'
                f'<axis xyz="0 0 1"/>{place}{limit}</joint>'
            )
        path = folder / f"machine{n}_{seed}.urdf"
        path.write_text(f'<robot name="machine{n}">{"".join(links + joints)}</robot>')
        scale = np.array(MASSES[:n])
        rotor, viscous, coulomb = (scale * rng.uniform(low, 2 * low, n) for low in (0.02, 0.3, 0.4))
        return cls(path, rotor, viscous, coulomb, 0.1 * scale * rng.normal(size=n), [f"j{k + 1}" for k in range(n)])

    @property
    def arm(self) -> aw.Model:
        """Kinematics alone, as a user has them."""
        return aw.load(self.path, kinematics_only=True)

    def _pinocchio(self):
        """The module, and the arm without drives under standard gravity."""
        pin = pytest.importorskip("pinocchio", exc_type=ImportError)
        model = pin.buildModelFromUrdf(str(self.path))
        model.gravity.linear = np.array([0.0, 0.0, -9.80665])
        return pin, model

    def torque(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, link_only: bool = False) -> np.ndarray:
        """Torques (rows, n) [N m] of the motors, or of links alone, as sensors behind the gears measure them."""
        pin, model = self._pinocchio()
        data = model.createData()
        links = np.array([pin.rnea(model, data, *row) for row in zip(q, qd, qdd, strict=True)])
        own = self.rotor * qdd + self.viscous * qd + self.coulomb * np.sign(qd) + self.offset
        return links if link_only else links + own

    def truth(self, model: TorqueModel) -> np.ndarray:
        """(p,) true parameters of a model's columns; 0 of those that this machine has not."""
        full = torque_model(aw.load(self.path), friction=())
        own = {
            column.name: value
            for column, value in zip(full.columns, full.prior, strict=True)
            if column.kind == "inertial"
        }
        drives = {kind: getattr(self, kind) for kind in ("rotor", "viscous", "coulomb", "offset")}
        return np.array(
            [
                drives[column.kind][self.names.index(column.joint)]
                if column.kind in drives
                else own.get(column.name, 0.0)
                for column in model.columns
            ]
        )

    def _acceleration(self, pin, model, data, tau, q: np.ndarray, qd: np.ndarray, dry: np.ndarray) -> np.ndarray:
        """q̈ (n,) under torques of the motors and dry friction."""
        return pin.aba(model, data, q, qd, tau - dry - self.viscous * qd - self.offset)

    def controlled(
        self, motion: Motion, t: np.ndarray, noise: float, seed: int, steps: int = 5
    ) -> tuple[np.ndarray, ...]:
        """q and held torques at times t of a loop with gains in proportion to inertia and noisy encoders."""
        pin, model = self._pinocchio()
        model.armature = self.rotor
        data, rng, h = model.createData(), np.random.default_rng([seed, 4]), (t[1] - t[0]) / steps
        wanted, speeds, accelerations = motion.at(t)
        q, qd = wanted[0].copy(), speeds[0].copy()
        logged = np.zeros((2, *wanted.shape))
        size = np.diag(pin.crba(model, data, q)) + self.rotor
        last = q + noise * rng.normal(size=len(q))
        for k in range(len(t)):
            measured = q + noise * rng.normal(size=len(q))
            speed = (measured - last) / (t[1] - t[0]) if k else qd
            last = measured
            tau = pin.rnea(model, data, wanted[k], speeds[k], accelerations[k])
            tau = tau + size * (400 * (wanted[k] - measured) + 30 * (speeds[k] - speed))
            tau = tau + self.coulomb * np.sign(speeds[k]) + self.viscous * speeds[k]
            logged[0, k], logged[1, k] = measured, tau
            for _ in range(steps):  # Heun's, friction's direction that of the predicted middle
                forward = partial(self._acceleration, pin, model, data, tau)
                q, qd = _heun(forward, q, qd, h, self.coulomb)
        return logged[0], logged[1]


def _heun(acceleration, q: np.ndarray, qd: np.ndarray, h: float, coulomb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """q and q̇ after a step h [s]; dry friction has the direction of the speed in the middle."""
    dry = coulomb * np.sign(qd + 0.5 * h * acceleration(q, qd, coulomb * np.sign(qd)))
    first = acceleration(q, qd, dry)
    second = acceleration(q + h * qd, qd + h * first, dry)
    return q + h * qd + 0.5 * h * h * first, qd + 0.5 * h * (first + second)


def counted(values: np.ndarray, step: float, rng: np.random.Generator, truncated: bool = False) -> np.ndarray:
    """Values in whole counts of an encoder whose zero is anywhere."""
    shift = rng.uniform(0, step, values.shape[1:])
    whole = np.floor((values + shift) / step) if truncated else np.round((values + shift) / step)
    return whole * step - (0 if truncated else shift)


def written(
    folder: Path, name: str, joints: list[str], columns: Mapping[str, np.ndarray], held: str | None = None
) -> Path:
    """A log of quantities (rows, n) beside the times "t", as CSV with its description; one of them held until the next row."""
    table, text = {"t": columns["t"]}, FILE.format(name=name, joints=joints)
    for quantity, values in columns.items():
        if quantity != "t":
            heads = [f"{quantity.replace(' ', '_')}{k + 1}" for k in range(values.shape[1])]
            table |= dict(zip(heads, values.T, strict=True))
            side = 'side = "joint"' + "\nheld = true" * (quantity == held)
            text += SIGNAL.format(quantity=quantity, columns=heads, unit=UNITS[quantity], side=side)
    write_table(folder / f"{name}.csv", table)
    path = folder / f"{name}.log.toml"
    path.write_text(text, encoding="utf-8")
    return path


def beside_the_controller(
    rng: np.random.Generator, rows: int, jitter: float = 0.1, drift: float = 2e-4
) -> tuple[np.ndarray, np.ndarray]:
    """Stamps in periods, and numbers of the states they found, of a logger that runs beside a controller of the same rate.

    It reads the latest state: where it comes early it finds one twice, where it is late it misses one.
    """
    stamps = np.arange(rows) * (1 + drift) + rng.uniform(0, 1) + jitter * rng.normal(size=rows) + 1
    stamps = np.maximum.accumulate(stamps)
    return stamps, np.floor(stamps).astype(int)


def read(path: Path) -> Log:
    return aw.identification.read_log(path)
