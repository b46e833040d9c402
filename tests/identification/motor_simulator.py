"""Logs of motors by a simulator on SciPy alone: winding, rotor, dry friction that sticks, gear, delay, encoder, noise, loop.

    L di/dt = u(t − d) − R i − K w,   J dw/dt = K i − B w − C sgn w,   dq/dt = w;   at rest w = 0 while |K i| ≤ C.

Between changes of command and of direction this is linear with constant coefficients: the matrix exponential is exact. The end
of a motion, or the current that breaks the rotor loose, is found by Brent's method.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

PATHS = {
    "R": "motor.motor.resistance_ohm",
    "Kt": "motor.motor.torque_constant_n_m_per_a",
    "J": "motor.motor.rotor_inertia_kg_m2",
    "viscous": "motor.friction.viscous_n_m_s_per_rad",
    "coulomb": "motor.friction.coulomb_positive_n_m",
    "delay": "delay_s",
}
FILE = """
joints = ["motor"]
files.log.path = "{name}.csv"
time = {{ column = "t", unit = "s" }}
gears.ratios = [{gear}]
signals = [
{signals}
]
"""
SIGNALS = {
    "u": 'quantity = "voltage", columns = "u", unit = "V"',
    "i": 'quantity = "current", columns = "i", unit = "A"',
    "q": 'quantity = "position", columns = "q", unit = "counts", counts_per_turn = {counts}, side = "motor"',
    "w": 'quantity = "speed", columns = "w", unit = "rad/s", side = "motor"',
}
PARTS = 4  # of a row, at whose ends events are looked for


@dataclass(frozen=True)
class Motor:
    """R [Ω], L [H], K [N m/A], J [kg m²], B [N m s/rad], C [N m], all of the motor's own side, and the ratio of its gear."""

    R: float = 1.2
    L: float = 4e-4
    K: float = 0.05
    J: float = 2e-5
    B: float = 2e-5
    C: float = 0.006
    gear: float = 1.0

    def numbers(self, delay: float) -> dict[str, float]:
        """True numbers by the names of `PATHS`; friction is behind the gear there, of rigid joints."""
        behind = abs(self.gear)
        return {
            "R": self.R, "Kt": self.K, "J": self.J, "viscous": self.B * behind**2, "coulomb": self.C * behind,
            "delay": delay,
        }  # fmt: skip

    @cached_property
    def matrices(self) -> dict[int, np.ndarray]:
        """(5, 5) of  d/dt (i, w, q, u, 1)  by the side of the motion, 0 at rest."""
        found = {}
        for side in (-1, 0, 1):
            a = np.zeros((5, 5))
            a[0, [0, 1, 3]] = -self.R / self.L, -self.K / self.L, 1.0 / self.L
            if side:
                a[1, [0, 1, 4]] = self.K / self.J, -self.B / self.J, -side * self.C / self.J
                a[2, 1] = 1.0
            found[side] = a
        return found

    def moved(self, x: np.ndarray, u: float, time: float, steps: dict[tuple[int, float], np.ndarray]) -> np.ndarray:
        """State (i, w, q) a time later, the voltage held; `steps` keeps transitions."""
        left, over = time, lambda side, part: expm(self.matrices[side] * part)
        while left > 0.0:
            side = int(np.sign(x[1])) or int(np.sign(x[0]) * (abs(self.K * x[0]) > self.C))
            state = np.array([*x, u, 1.0])

            def room(new: np.ndarray, side: int = side) -> float:
                return float(side * new[1]) if side else float(self.C - abs(self.K * new[0]))

            if left == time:
                if (side, time) not in steps:
                    steps[side, time] = over(side, time)
                new = steps[side, time] @ state
            else:
                new = over(side, left) @ state
            if room(new) >= 0.0:
                return new[:3]
            if side and x[1] == 0.0:  # it came loose and rests again within this part
                return np.array([(over(0, left) @ state)[0], 0.0, x[2]])
            part = float(brentq(lambda t, s=side, z=state, r=room: r(over(s, t) @ z), 0.0, left, xtol=1e-9 * time))
            new = over(side, part) @ state
            x = np.array([new[0], 0.0, new[2]]) if side else new[:3] * [1.0 + 1e-9, 1.0, 1.0]
            left -= part
        return x


@dataclass(frozen=True)
class Bench:
    """Experiment with a motor: how it is driven and logged.

    Attributes:
        period: [s] of the rows.   rows: how many.   delay: of the command, in rows.   most: largest voltage [V].
        hold: rows for which a level is held, least and most.   counts: of the encoder a turn, which truncates.
        noise: of current and speed, of the largest.   signals: logged: "i", "q", "w".
        loop: whether the voltage is that of a speed loop on the encoder, or the levels themselves.
    """

    period: float = 1e-3
    rows: int = 2000
    delay: float = 1.3
    most: float = 10.0
    hold: tuple[int, int] = (10, 100)
    counts: int = 4096
    noise: float = 0.01
    signals: tuple[str, ...] = ("i", "q")
    loop: bool = False


def simulated(motor: Motor, bench: Bench, seed: int) -> dict[str, np.ndarray]:
    """Columns of a log: t, u, and i, q, w as measured."""
    rng = np.random.default_rng(seed)
    lengths = rng.integers(*bench.hold, bench.rows // bench.hold[0] + 1)
    levels = rng.uniform(-bench.most, bench.most, len(lengths)) * (np.arange(len(lengths)) % 5 > 0)
    goals = np.repeat(levels, lengths)[: bench.rows]
    count = 2.0 * np.pi / bench.counts
    whole, fraction = int(bench.delay), bench.delay % 1.0
    parts = [(whole + 1, fraction), (whole, 1.0 - fraction)]  # commands before and behind the change within a row
    pieces = [(late, part * bench.period / PARTS) for late, part in parts for _ in range(PARTS) if part > 0.0]
    steps: dict[tuple[int, float], np.ndarray] = {}
    x, u, states = np.array([0.0, 0.0, rng.uniform(0.0, count)]), np.zeros(bench.rows), np.zeros((bench.rows, 3))
    counted, sum_of_errors = np.floor(x[2] / count), 0.0
    for k in range(bench.rows):
        states[k] = x
        before, counted = counted, np.floor(x[2] / count)
        u[k] = goals[k]
        if bench.loop:  # a PI loop of the speed, as differences of counts
            error = 0.7 * goals[k] / motor.K - (counted - before) * count / bench.period
            sum_of_errors += error * bench.period
            u[k] = np.clip(motor.K * (2.0 * error + 40.0 * sum_of_errors), -bench.most, bench.most)
        u[k] = np.round(u[k] / bench.most * 2048) / 2048 * bench.most  # a stage of 12 bit
        for late, part in pieces:
            x = motor.moved(x, u[max(k - late, 0)] if k >= late else 0.0, part, steps)
    current, speed, position = states.T
    found = {"t": np.arange(bench.rows) * bench.period, "u": u}
    for name, values in (("i", current), ("w", speed)):
        found[name] = values + bench.noise * np.abs(values).max() * rng.standard_normal(bench.rows)
    found["q"] = np.floor(position / count)
    return found | {"true_i": current, "true_w": speed, "true_q": position}


def write_log(folder: Path, motor: Motor, bench: Bench, seed: int, name: str = "log") -> Path:
    """Path of a log."""
    columns = simulated(motor, bench, seed)
    chosen = {key: columns[key] for key in ("t", "u", *bench.signals)}
    np.savetxt(folder / f"{name}.csv", np.column_stack([*chosen.values()]), delimiter=",", header=",".join(chosen),
               comments="", fmt="%.9g")  # fmt: skip
    signals = "\n".join("    { " + SIGNALS[key].format(counts=bench.counts) + " }," for key in ("u", *bench.signals))
    path = folder / f"{name}.log.toml"
    path.write_text(FILE.format(name=name, gear=motor.gear, signals=signals))
    return path


CASES = {  # by what they try
    "L/R 0.33 ms": (Motor(), Bench()),
    "L/R 0.05 ms": (Motor(L=6e-5), Bench()),
    "L/R 3 ms": (Motor(L=3.6e-3), Bench()),
    "no inductance": (Motor(L=1e-6), Bench()),
    "speed logged": (Motor(), Bench(signals=("i", "w"))),
    "loop": (Motor(), Bench(loop=True)),
    "5 kHz": (Motor(), Bench(period=2e-4, rows=8000, hold=(50, 500))),
    "200 Hz": (Motor(R=2.5, L=2e-3, K=0.03, J=8e-5, B=5e-5, C=0.004), Bench(period=5e-3, hold=(8, 50))),
    "gear of 50": (
        Motor(R=8.0, L=1e-3, K=0.02, J=2e-6, B=1e-6, C=1e-3, gear=50.0),
        Bench(period=2e-3, counts=1024, most=12.0),
    ),
    "no delay": (Motor(), Bench(delay=0.0)),
    "heavy rotor": (
        Motor(R=0.5, L=5e-4, K=0.08, J=3e-4, B=1e-4, C=0.02),
        Bench(rows=4000, hold=(30, 300), most=24.0),
    ),
}


def deviations(estimate, motor: Motor, bench: Bench) -> dict[str, float]:
    """Errors in stated standard deviations, by the names of `PATHS`; NaN where none is stated."""
    found = {}
    for name, truth in motor.numbers(bench.delay * bench.period).items():
        path = PATHS[name]
        given = path in estimate.names
        found[name] = (estimate[path] - truth) / estimate.std[estimate.number(path)] if given else np.nan
    return found
