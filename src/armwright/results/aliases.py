"""Names of a run's variables in the session and in the 1982 report."""

from __future__ import annotations

from collections.abc import Sequence

QUANTITIES = {
    "theta": "q", "omega": "qd", "alpha": "qdd", "torque": "tau", "voltage": "voltage", "current": "current",
    "command": "u", "reference": "q_reference", "measured": "q_measured",
}  # fmt: skip
"""Variables of a run by their names in the session."""

LOOP_STATE = "loop_state"  # variable of a run: the state of the loop at its end, as numbers of no unit
LOOP_END = "time_s"  # attribute of that variable: the run's last time
SESSION = "armwright_session"  # attribute of a run that a session saved: the session as JSON
PARTIAL = "partial"  # attribute of a run that was interrupted: after how many steps


def variables(names: Sequence[str] | None) -> list[str] | None:
    """Variables of a run by name; names of the session are accepted too."""
    return None if names is None else list(dict.fromkeys(QUANTITIES.get(name, name) for name in names))


def joint_names(joints: Sequence[str] | None, known: Sequence[str]) -> list[str] | None:
    """Joints by name or number from 1; anything else is returned unchanged."""
    by_number = {str(k): name for k, name in enumerate(known, 1) if str(k) not in known}
    return None if joints is None else [by_number.get(str(joint), str(joint)) for joint in joints]
