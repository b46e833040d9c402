"""The least-squares problem of an arm's inertial parameters from a log's states: ns per state, beside Pinocchio's regressor."""

from __future__ import annotations

from functools import partial

import numpy as np
from arms import random_states, timed_arm
from peers.pinocchio_peer import PinocchioArm, pin
from records import Record, Task, record
from timing import Check, Contestant, Entry, race

from armwright.identification.arm.equations import equations_of, stacked
from armwright.identification.arm.samples import Samples
from armwright.identification.arm.torque_model import torque_model

ARM = "lwa4p"
ROWS, QUICK_ROWS = 45_000, 500  # as the TX40's log has
TOLERANCE = 1e-9  # of the largest entry
WANTED = 2.0  # times


def tasks(quick: bool) -> list[Task]:
    """One row: triangular factors, as `identify_arm` makes them, and the same sums by Pinocchio's loop from Python."""
    return [Task("identification", f"{ARM} triangular factors", partial(_run, QUICK_ROWS if quick else ROWS))]


def notes(quick: bool) -> dict[str, list[str]]:
    """Text of the row."""
    return {
        "identification": [
            f"R with RᵀR = [Y τ]ᵀ[Y τ] of {QUICK_ROWS if quick else ROWS} states, all 60 columns, with all digits of Y",
            "Pinocchio: computeJointTorqueRegressor in a loop from Python, NumPy's product of each state added up",
        ]
    }


def _run(rows: int, repetitions: int) -> list[Record]:
    arm = timed_arm(ARM)
    states = random_states(arm, rows)
    q, qd, qdd = (states[name] for name in ("q", "qd", "qdd"))
    tau = np.random.default_rng(1).normal(size=q.shape)
    model, peer = torque_model(arm, friction=(), lacks=("rotors",)), PinocchioArm(arm)
    samples = Samples("states", 0, np.arange(rows) * 1.0, q, qd, qdd, tau)

    def factors() -> np.ndarray:
        return stacked(equations_of([samples], model).factors, len(model))[0]

    def loop() -> np.ndarray:
        total = np.zeros((len(model) + 1,) * 2)
        for k in range(rows):
            values = np.column_stack(
                [pin.computeJointTorqueRegressor(peer.model, peer.data, q[k], qd[k], qdd[k]), tau[k]]
            )
            total += values.T @ values
        return total

    truth = np.concatenate([model.rows(q, qd, qdd), tau[:, :, None]], axis=2).reshape(-1, len(model) + 1)
    truth = truth.T @ truth
    size = np.abs(truth).max()

    def ours(factor: np.ndarray) -> Check:
        return Check(float(np.abs(factor.T @ factor - truth).max() / size), TOLERANCE)

    def theirs(gram: np.ndarray) -> Check:  # of columns in frames of Pinocchio's own: what they explain is the same
        return Check(abs(_unexplained(gram) - _unexplained(truth)), 1e-6)

    contestants = {
        "ours": Contestant("Armwright", factors, rows, ours),
        "pinocchio_python": Contestant("Pinocchio from Python", loop, rows, theirs),
    }
    labels = {"arm": ARM, "work": "triangular factors", "states": rows}
    entry = Entry(labels, contestants, {"pinocchio_python": "ours"}, {"pinocchio_python": WANTED})
    return [record(row) for row in race([entry], repetitions)]


def _unexplained(gram: np.ndarray) -> float:
    """Share of the torques' squares that no parameters explain."""
    right = gram[:-1, -1]
    return float(1.0 - right @ np.linalg.pinv(gram[:-1, :-1], rcond=1e-10, hermitian=True) @ right / gram[-1, -1])
