"""Actuators of a simulator that move an arm as Armwright simulates it: numbers of the record, fitted over a motion."""

from __future__ import annotations

import importlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from armwright.description.record_of import record_of
from armwright.description.robot import RobotDescription
from armwright.entry import AnyArm, AnyMotion, as_arm, as_motion
from armwright.errors import ModelError, ScheduleError, check_known
from armwright.export.mjcf import MujocoActuators, mjcf_text, write_mjcf
from armwright.export.servo_actuators import DELAYS, FITTED, KINDS, ServoActuator, servo_actuators, spreads, whole_steps
from armwright.model import build_model
from armwright.output import check_destination, write_whole
from armwright.progress import Shown, automatic
from armwright.results.result import Result
from armwright.results.svg import ink_axes
from armwright.results.table import Table, number
from armwright.simulation.inputs.schedule import Schedule
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Recording
from armwright.simulation.simulation import simulate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEP = 2e-3  # [s] of MuJoCo, its default
ROWS = 2000  # that are compared, at most
FLOOR = 1e-6  # [rad | m] below which a difference is not worth a fit
STIFF = 0.3  # weight of a number's logarithm beside a joint's difference before the fit: it stays where the motion does not tell
ROUNDS = 8
FAR = 1e-3  # step of a logarithm for differences
ENDING = ".actuators.json"
POOR, LEAST = 0.05, 1e-3  # of a joint's motion (standard deviation), and in rad | m: a larger difference is poor
UNITS = {"stiffness": ("N m/rad", "N/m"), "damping": ("N m s/rad", "N s/m"), "armature": ("kg m²", "kg"),
         "friction": ("N m", "N"), "effort": ("N m", "N"), "play": ("rad", "m"), "rms": ("rad", "m")}  # fmt: skip


@dataclass(frozen=True, eq=False)
class ActuatorFit(Result):
    """Actuators that move an arm in MuJoCo as Armwright simulates it.

    Attributes:
        robot: the description of the arm.   kind: "position" or "dcmotor".   motion: its file or its kind.
        actuators: by joint.   spread: relative standard deviations of their numbers by joint, from those of the record.
        t: (k,) [s].   goal, simulated: (k, n) goals and Armwright's positions [rad | m].
        before, after: (k, n) MuJoCo's positions with the numbers of the record, and with the fitted ones [rad | m].
        version: of MuJoCo.
    """

    robot: RobotDescription
    kind: str
    motion: str
    actuators: Mapping[str, ServoActuator]
    spread: Mapping[str, Mapping[str, float]]
    t: np.ndarray
    goal: np.ndarray
    simulated: np.ndarray
    before: np.ndarray
    after: np.ndarray
    version: str

    @property
    def names(self) -> list[str]:
        """Of the joints."""
        return list(self.actuators)

    def rms(self, positions: np.ndarray) -> np.ndarray:
        """(n,) root mean square of a motion's difference from Armwright's [rad | m]."""
        return np.sqrt(np.mean((positions - self.simulated) ** 2, axis=0))

    @cached_property
    def in_mujoco(self) -> MujocoActuators:
        """The actuators for `write_mjcf`."""
        return MujocoActuators(self.kind, self.actuators, STEP)

    def write(self, path: str | os.PathLike[str]) -> tuple[list[Path], list[str]]:
        """Writes an MJCF with these actuators, and their numbers beside it as NAME.actuators.json.

        Args:
            path: of the MJCF, ending in .xml or .mjcf.
        Returns:
            files: both.   losses: what an MJCF cannot hold, one sentence each.
        Raises:
            OutputError: a file cannot be written.
        """
        target = check_destination(path, (".xml", ".mjcf"))
        beside = check_destination(target.with_name(target.stem + ENDING))
        losses = write_mjcf(self.robot, target, self.in_mujoco)
        write_whole(beside, json.dumps(self.document(), indent=1, ensure_ascii=False) + "\n")
        return [target, beside], losses

    def document(self) -> dict[str, Any]:
        """Numbers of every joint with mean and spread (one standard deviation; null where the record has none), and units."""
        before, after = self.rms(self.before), self.rms(self.after)
        joints = {}
        for i, (name, each) in enumerate(self.actuators.items()):
            linear = self._linear[i]
            fitted = {
                key: {
                    "mean": _finite(getattr(each, key)),
                    "spread": getattr(each, key) * self.spread[name][key] or None,
                    "unit": UNITS[key][linear],
                }
                for key in FITTED
            }
            fitted["effort_limit"] = fitted.pop("effort")
            joints[name] = fitted | {
                "delay": {"mean": each.delay, "spread": None, "unit": "s"},
                "play": {"mean": each.play, "spread": None, "unit": UNITS["play"][linear]},
                "goal_speed": {"mean": _finite(each.goal_speed), "spread": None, "unit": "m/s" if linear else "rad/s"},
                "rms": {"before": before[i], "after": after[i], "unit": UNITS["rms"][linear]},
            }
        return {
            "robot": self.robot.name,
            "motion": self.motion,
            "simulator": f"MuJoCo {self.version}, implicitfast, steps of {STEP:g} s",
            "joints": joints,
        }

    @cached_property
    def _linear(self) -> list[bool]:
        return [body.kind.units.linear for body in build_model(self.robot).coordinates]

    def _unit(self, key: str) -> str:
        return " | ".join(
            unit for unit, has in zip(UNITS[key], (not all(self._linear), any(self._linear)), strict=True) if has
        )

    def tables(self) -> list[Table]:
        """Numbers of each joint, and how far MuJoCo is from Armwright."""
        words = (*((key, key) for key in FITTED[:-1]), ("limit", "effort"), ("before", "rms"), ("after", "rms"))
        heads = ("joint", *(f"{word} [{self._unit(key)}]" for word, key in words))
        before, after = self.rms(self.before), self.rms(self.after)
        cells = [
            [
                name,
                *(number(getattr(each, key), ".4g") for key in FITTED),
                number(before[i], ".2g"),
                number(after[i], ".2g"),
            ]
            for i, (name, each) in enumerate(self.actuators.items())
        ]
        return [Table(self.heading, heads, cells)]

    def sentences(self) -> list[str]:
        """Difference before and after the fit, and the version of MuJoCo that reads the file."""
        before, after = (float(np.sqrt(np.mean(self.rms(each) ** 2))) for each in (self.before, self.after))
        late = [name for name, each in self.actuators.items() if whole_steps(each, STEP)]
        since = DELAYS if late and self.kind == "position" else KINDS[self.kind]
        why = f", for the delay of {', '.join(late)}" if since == DELAYS else ""
        return [
            f"MuJoCo {self.version} is {before:.2g} {self._unit('rms')} from Armwright with the record's numbers, "
            f"{after:.2g} with these (root mean square over {self.motion}).",
            f"MuJoCo {since} or later reads it{why}.",
        ]

    @property
    def poor(self) -> list[str]:
        """One sentence on each joint that MuJoCo moves otherwise: by more than 1e-3 rad | m and 5 % of its motion, rms."""
        before, after, moved = self.rms(self.before), self.rms(self.after), self.simulated.std(axis=0)
        instead = (
            "" if self.kind == "dcmotor" else ", or fit a dcmotor, which has the goal's speed and the voltage's limit"
        )
        return [
            f"the fit of {name} is poor: MuJoCo is {after[i]:.2g} {UNITS['rms'][self._linear[i]]} from Armwright with it, "
            f"{before[i]:.2g} without, in a motion of {moved[i]:.2g} (rms); take a motion like those you will run{instead}"
            for i, name in enumerate(self.names)
            if after[i] > max(LEAST, POOR * moved[i])
        ]

    @property
    def height(self) -> float:
        """Of its picture [inch]."""
        return 1.2 + 1.1 * len(self.names)

    def draw(self, figure: Figure, ink: str, quiet: str) -> None:
        """Draws each joint's difference from Armwright over time, before and after."""
        places = figure.subplots(len(self.names), 1, sharex=True, squeeze=False)[:, 0]
        for i, (axes, name) in enumerate(zip(places, self.names, strict=True)):
            for positions, colour, label in ((self.before, quiet, "record"), (self.after, "#2a7fc9", "fitted")):
                axes.plot(self.t, 1e3 * (positions[:, i] - self.simulated[:, i]), color=colour, lw=1.2, label=label)
            axes.set_ylabel(f"{name}\n[{'mm' if self._linear[i] else 'mrad'}]", color=ink)
            ink_axes(axes, ink)
        places[0].legend(loc="upper right", ncols=2, frameon=False, labelcolor=ink)
        places[0].set_title("MuJoCo less Armwright", loc="left", color=ink)
        places[-1].set_xlabel("t [s]", color=ink)


def fit_actuators(arm: AnyArm, motion: AnyMotion, kind: str = "position", *, progress: Shown = None) -> ActuatorFit:
    """Actuators with which MuJoCo moves an arm of servos as Armwright simulates it, over a motion.

    Goals are those of the motion at MuJoCo's steps of 2 ms, from rest at its beginning. Stiffness, damping, armature, friction
    and limit of every joint begin as the record's (`armwright.export.servo_actuators`) and are fitted together, by least squares
    of the positions; a number that the motion does not tell stays near the record's. Delay and play are the record's.

    Args:
        arm: whose joints all follow goals, `command = "position"`.
        motion: of all joints, or its file; without payloads.
        kind: "position", a gain with damping, or "dcmotor", a motor with resistance, back-EMF and the goal's speed.
        progress: True or None: a bar where it is seen; False: none; a function is called with rounds done and of all.
    Returns:
        fit: numbers, motions before and after.
    Raises:
        ModelError: another kind, a joint that does not follow goals, no MuJoCo, or an arm that it refuses.
        ScheduleError: a motion that does not end, or carries something.
    Example:
        >>> move = aw.trajectories.Quintic(np.zeros(4), np.full(4, 0.1), duration=0.3)
        >>> fit = aw.export.fit_actuators("open-manipulator-x", move)
        >>> float(np.abs(fit.after - fit.simulated).max()) < 1e-3  # rad
        True
    """
    check_known(ModelError, kind, KINDS, place="kind")
    robot = record_of(as_arm(arm))
    model = build_model(robot)
    path, start = as_motion(motion, model), servo_actuators(robot)
    if not np.isfinite(path.duration):
        raise ScheduleError("does not end", place="motion", expected="one of finite duration")
    if np.size(path.payloads):
        raise ScheduleError(
            "carries a payload, which the file has not", place="motion", expected="one without payloads"
        )
    try:
        mujoco: Any = importlib.import_module("mujoco")
    except ImportError:
        raise ModelError(
            "needs MuJoCo, which is not installed: pip install armwright[bench]", place="kind", value=kind
        ) from None
    t = STEP * np.arange(int(np.ceil(path.duration / STEP - 1e-9)) + 1)
    goal = path.at(path.time + np.minimum(t, path.duration))[0]
    with automatic(progress, f"fit of actuators, {model.name}") as tell:
        tell(0, ROUNDS)
        run = simulate(
            Scenario(
                model,
                float(t[-1]),
                command=Schedule(t, goal, tuple(model.names)),
                start=goal[0],
                recording=Recording(period=STEP),
            ),
            progress=False,
        )
        player = _Player(mujoco, robot, kind, goal)
        before = player.play(start)
        factors = _fitted(player, start, np.asarray(run.q), before, tell)
    found = {name: each.scaled(factors[i]) for i, (name, each) in enumerate(start.items())}
    name = Path(path.file).name if path.file else type(path).__name__
    return ActuatorFit(
        robot, kind, name, found, spreads(robot), t, goal, np.asarray(run.q), before, player.play(found), mujoco.__version__
    )  # fmt: skip


def _fitted(
    player: _Player, start: Mapping[str, ServoActuator], wanted: np.ndarray, before: np.ndarray, tell: Any
) -> np.ndarray:
    """(n, 5) factors of the numbers, by Gauss and Newton in their logarithms with SciPy's trust region."""
    from scipy.optimize import least_squares

    n, every = wanted.shape[1], max(1, len(wanted) // ROWS)
    scale = np.maximum(np.sqrt(np.mean((before - wanted) ** 2, axis=0)), FLOOR) * np.sqrt(len(wanted[::every]))
    rounds = iter(range(1, 10**6))

    def residuals(x: np.ndarray) -> np.ndarray:
        factors = np.exp(x.reshape(n, len(FITTED)))
        moved = player.play({name: each.scaled(factors[i]) for i, (name, each) in enumerate(start.items())})
        return np.concatenate([((moved - wanted)[::every] / scale).ravel(), STIFF * x])

    def jacobian(x: np.ndarray) -> np.ndarray:
        """A joint's numbers are taken to move that joint alone, so that those of all joints are tried at once."""
        tell(min(next(rounds), ROUNDS - 1), ROUNDS)
        middle, slopes = residuals(x), np.zeros((x.size + wanted[::every].size, x.size))
        np.fill_diagonal(slopes[wanted[::every].size :], STIFF)
        for k in range(len(FITTED)):
            moved = residuals(x + FAR * (np.arange(x.size) % len(FITTED) == k)) - middle
            for i in range(n):
                slopes[i : wanted[::every].size : n, len(FITTED) * i + k] = moved[i : wanted[::every].size : n] / FAR
        return slopes

    blank, slopes_of = np.zeros(n * len(FITTED)), cast(Any, jacobian)
    found = least_squares(residuals, blank, jac=slopes_of, max_nfev=ROUNDS, ftol=1e-3, xtol=1e-4, bounds=(-2.0, 2.0))
    tell(ROUNDS, ROUNDS)
    return np.exp(found.x.reshape(n, len(FITTED)))


class _Player:
    """Plays goals with actuators in MuJoCo, from the text that is written."""

    def __init__(self, mujoco: Any, robot: RobotDescription, kind: str, goal: np.ndarray):
        self.mujoco, self.robot, self.kind, self.goal = mujoco, robot, kind, goal

    def play(self, actuators: Mapping[str, ServoActuator]) -> np.ndarray:
        """Positions (k, n) of the joints [rad | m]."""
        text, _ = mjcf_text(self.robot, MujocoActuators(self.kind, actuators, STEP))
        try:
            model = self.mujoco.MjModel.from_xml_string(text)
        except ValueError as error:
            raise ModelError(f"MuJoCo refuses it: {' '.join(str(error).split())}", value=self.robot.name) from None
        data = self.mujoco.MjData(model)
        at = [model.joint(name).qposadr[0] for name in actuators]
        data.qpos[at] = self.goal[0]
        for k in np.flatnonzero(model.actuator_actnum):  # the first state is the goal as it moves at its speed
            data.act[model.actuator_actadr[k]] = self.goal[0, k]
        for joint in self.robot.moving_joints:
            if joint.mimic is not None:
                master = list(actuators).index(joint.mimic.joint)
                data.qpos[model.joint(joint.name).qposadr[0]] = (
                    joint.mimic.offset + joint.mimic.multiplier * self.goal[0, master]
                )
        found = np.empty_like(self.goal)
        for k in range(len(self.goal)):
            found[k] = data.qpos[at]
            data.ctrl[:] = self.goal[k]
            self.mujoco.mj_step(model, data)
        return found


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
