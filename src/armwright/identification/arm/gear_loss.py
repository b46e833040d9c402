"""Torque model of an arm with gear loss, linear about a point of its parameters, and its fit by Gauss-Newton.

With Y π + f_link the torques that links, springs and link-side friction take, and B the motors' speeds by the joints' (w = B q̇),
each gear delivers one of u = B⁻ᵀ (Y π + f_link), and the motors give

    tau = Bᵀ [ G⁻¹(u) + n² J ẇ + f_motor(w) ],    G⁻¹(u) = u/e,  e = η where u w > 0, 1/η where u w < 0,

with G of `actuators.gear`, tables of η and load-proportional friction included. G⁻¹ is continuous in u and linear between its
knots: about a point each motor has one line, which makes a linear model of the same columns, those of the link side divided by e
before they pass a filter. Gauss-Newton's steps with a line search on the residual end where alternating lines and parameters
would cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from armwright.actuators.coupling import motor_shares
from armwright.actuators.gear import gear_loss, loses_power
from armwright.description.paths import path_name
from armwright.errors import IdentificationError, check_known
from armwright.identification.arm.base import BaseParameters, base_parameters
from armwright.identification.arm.equations import Equations, Samples
from armwright.identification.arm.fit import ArmFit, fit_arm
from armwright.identification.arm.torque_model import TorqueColumn, TorqueModel
from armwright.identification.estimate import HALF_95
from armwright.model import Body, EfficiencyTable

EFFICIENCY = "efficiency"  # kind of a column: ∂tau/∂η
STARTS = (0.5, 0.65, 0.8, 0.95)  # η that a fit of it begins with
STEPS_OF_STARTS = 2  # of Gauss-Newton, for each of them
LOWEST, HIGHEST = 0.05, 2.0  # η on the way to a solution; above 1 it is no efficiency, and is said to be none
CHANGE = 1e-6  # of η, for its derivative: G⁻¹ is smooth in η
LEAST_DRIVEN_BACK = 0.02  # share of a gear's squared torque in back-driving, from which the log tells η
MOST_STEPS = 50  # of Gauss-Newton: six to ten are usual
SHORTEST = 1e-4  # part of a step that the line search tries last
GAIN = 1e-6  # of twice the log-likelihood: a step that brings less moves no parameter by 1e-3 deviations
FLOOR = 1e-12  # of a torque's squares: what is left of a log that the model explains exactly

MOST_EFFICIENT = 1.01  # η that the noise of a log may give a gear without loss
UNSETTLED = 0.5  # deviations, of the last step
UNSURE = 0.1  # half of an efficiency's 95 % interval that is no answer


@dataclass(frozen=True, eq=False)
class LossyModel(TorqueModel):
    """The torque model of an arm with gear loss, linear about a point.

    Attributes:
        linear: the model without loss.   kept: numbers of its columns that are this model's; those of efficiencies follow.
        stated: numbers of its rotor columns that are not fitted: without loss no torque separates them from links' inertia.
        behind: (kept,) bool: on the link side of the gears.   fitted: numbers of the motors whose efficiency is fitted.
        about: (p,) parameters of the point; None: of the lossless arm, e = 1.
    """

    linear: TorqueModel
    kept: np.ndarray
    stated: np.ndarray
    behind: np.ndarray
    fitted: tuple[int, ...] = ()
    about: np.ndarray | None = None

    @property
    def lossy(self) -> np.ndarray:
        """(n,) bool: motors with a lossy gear."""
        return np.array([loses_power(body) or i in self.fitted for i, body in enumerate(self.arm.coordinates)])

    def at(self, parameters: np.ndarray) -> LossyModel:
        """The model about other parameters (p,); efficiencies stay within their bounds."""
        about = np.array(parameters, dtype=float)
        first = len(self.kept)
        about[first:] = np.clip(about[first:], LOWEST, HIGHEST)
        return replace(self, about=about)

    def rows(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Values (rows, n, p) of all columns, those of the link side by the slopes of G⁻¹ about the point."""
        return self.terms(q, qd, qdd)[0]

    def known_torques(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Torques (rows, n) [N m | N] that are not fitted: springs, rotors as stated, and offsets of the lines of G⁻¹."""
        return self.terms(q, qd, qdd)[1]

    def terms(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`rows` and `known_torques` together."""
        rows, springs = self.linear.terms(q, qd, qdd)
        first, columns = len(self.kept), np.zeros((*springs.shape, len(self)))
        columns[:, :, :first] = rows[:, :, self.kept]
        known = rows[:, :, self.stated] @ self.linear.prior[self.stated]
        if self.about is None:
            return columns, known + springs
        B = motor_shares(self.arm)
        to_motors = np.linalg.inv(B)
        taken = columns[:, :, :first] @ np.where(self.behind, self.about[:first], 0.0)
        before = springs @ to_motors
        slope, offset, by_eta = self._lines(before + taken @ to_motors, qd @ B.T)
        if (np.eye(len(B)) == B).all():
            columns[:, :, :first] *= np.where(self.behind, slope[:, :, None], 1.0)
        else:
            through = np.einsum("ji,ti,ik->tkj", to_motors, slope, B)  # B⁻¹ diag(1/e) B of rows of torques, transposed
            links = np.flatnonzero(self.behind)
            columns[:, :, links] = through @ columns[:, :, links]
        entering = before * slope + offset
        for k, i in enumerate(self.fitted, start=first):
            entering[:, i] -= by_eta[:, i] * self.about[k]
            columns[:, :, k] = by_eta[:, i, None] * B[i]
        return columns, known + entering @ B

    def directed(self, rows: np.ndarray, speeds: np.ndarray) -> np.ndarray:
        """The columns as they are: friction behind a lossy gear has its slope, row by row."""
        return rows

    def known_rows(self, qd: np.ndarray, smoother: np.ndarray) -> np.ndarray | None:
        """(rows, n) False where the direction of the joint's lossy gear is not sure: at rest, and where two low-passes differ."""
        B = motor_shares(self.arm)
        w, smooth = qd @ B.T, smoother @ B.T
        unsure = ((w == 0) | (np.sign(w) != np.sign(smooth))) & self.lossy
        return ~(unsure @ (B != 0))

    def driven_back(self, samples: Iterable[Samples]) -> np.ndarray:
        """(n,) share of Σ u² in which the load drives the gear, over the rows of samples."""
        assert self.about is not None
        B = motor_shares(self.arm)
        to_motors, links = np.linalg.inv(B), np.flatnonzero(self.behind)
        back, total = np.zeros(self.arm.n), np.full(self.arm.n, np.finfo(float).tiny)
        for block in samples:
            rows, springs = self.linear.terms(block.q, block.qd, block.qdd)
            u = (springs + rows[:, :, self.kept[links]] @ self.about[links]) @ to_motors
            back += np.where(u * (block.qd @ B.T) < 0, u * u, 0.0).sum(axis=0)
            total += (u * u).sum(axis=0)
        return back / total

    def _lines(self, leaving: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Slopes and offsets (rows, n) of G⁻¹ at torques that leave the gears (rows, n), and its derivative by η."""
        assert self.about is not None
        slope, offset, by_eta = np.ones_like(w), np.zeros_like(w), np.zeros_like(w)
        fitted = dict(zip(self.fitted, self.about[len(self.kept) :], strict=True))
        for i, body in enumerate(self.arm.coordinates):
            if i in fitted:
                ends = [
                    _inverse_line(_with_efficiency(body, fitted[i] + h), leaving[:, i], w[:, i])
                    for h in (-CHANGE, CHANGE, 0.0)
                ]
                low, high = (s * leaving[:, i] + o for s, o in ends[:2])
                by_eta[:, i] = (high - low) / (2 * CHANGE)
                slope[:, i], offset[:, i] = ends[2]
            elif loses_power(body):
                slope[:, i], offset[:, i] = _inverse_line(body, leaving[:, i], w[:, i])
        return slope, offset, by_eta


def _with_efficiency(body: Body, efficiency: float) -> Body:
    return replace(body, drive=replace(body.drive, efficiency=efficiency))


def _inverse_line(body: Body, leaving: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slope and offset (rows,) of a gear's G⁻¹ at torques that leave it, at speeds w of its motor."""
    loss = gear_loss(body.drive, w, body.friction)
    assert loss is not None
    slope, offset = loss.line_of_output(leaving)
    return 1.0 / slope, -offset / slope


def lossy_model(linear: TorqueModel, fitted: Collection[str] | Literal["all"] = ()) -> LossyModel | None:
    """The model with the gear loss of the arm's record; None of an arm without, where no efficiency is to be fitted.

    Rotors are grouped as without loss: those that only the loss would tell from their links' inertia keep the record's number,
    unless it is 0, that is unknown, behind a gear. Friction stands on the side that the record has it on, else at the joint.

    Args:
        linear: the model without loss.   fitted: names of joints whose motors' efficiency is one more parameter; "all".
    Raises:
        IdentificationError: an unknown joint, an efficiency to fit in place of a table.
    """
    arm = linear.arm
    chosen = _chosen(linear, arm.names if fitted == "all" else fitted)
    if not chosen and not any(loses_power(body) for body in arm.coordinates):
        return None
    bodies = {body.joint: body for body in arm.coordinates}
    for column in linear.columns:
        if len(column.turned) > 1 and not bodies[column.joint].drive.coupling:
            what = f"several joints turn the motor of {column.joint!r} by the log's gears, and the record states no coupling"
            raise IdentificationError(what, place="fit_efficiency", expected="motor.coupling in the record")
    lossy = {body.joint for i, body in enumerate(arm.coordinates) if i in chosen or loses_power(body)}
    rotors = {k for k, column in enumerate(linear.columns) if column.kind == "rotor" and column.joint in lossy}
    grouped = rotors - set(base_parameters(linear).independent.tolist()) if rotors else set()
    stated = np.array(
        sorted(k for k in grouped if _is_stated(bodies[linear.columns[k].joint], linear.prior[k])), dtype=int
    )
    kept = [
        k for k, column in enumerate(linear.columns)
        if k not in stated and not (column.joint in lossy and _is_of_other_side(column, bodies[column.joint]))
    ]  # fmt: skip
    behind = np.array([_is_behind(linear.columns[k], bodies.get(linear.columns[k].joint)) for k in kept])
    etas = tuple(
        TorqueColumn(
            f"eta{i + 1}", "1", body.joint, EFFICIENCY, f"gear efficiency of {body.joint}",
            f"{path_name(body.joint)}.motor.gear_efficiency", ((i, 1.0),),
        )
        for i, body in enumerate(arm.coordinates) if i in chosen
    )  # fmt: skip
    stated_etas = [arm.coordinates[i].drive.efficiency for i in chosen]  # no tables, which `_chosen` refuses
    known = [np.nan if eta is None or isinstance(eta, EfficiencyTable) else float(eta) for eta in stated_etas]
    B = motor_shares(arm)
    # a gear's loss reaches all that turn its motor
    mixed = ((np.linalg.inv(B) != 0) | np.eye(arm.n, dtype=bool)) @ (B != 0)
    of_joint = linear.of_joint[:, kept].copy()
    of_joint[:, behind] = mixed.T @ of_joint[:, behind]
    of_joint = np.concatenate([of_joint, (B[list(chosen)] != 0).T], axis=1)
    return LossyModel(
        arm, (*(linear.columns[k] for k in kept), *etas), np.concatenate([linear.prior[kept], known]), of_joint, linear.dyn,
        linear.sprung, linear, np.array(kept), stated, behind, chosen,
    )  # fmt: skip


def _chosen(linear: TorqueModel, names: Collection[str]) -> tuple[int, ...]:
    """Numbers of the motors whose efficiency is to be fitted."""
    arm = linear.arm
    for name in names:
        check_known(IdentificationError, name, arm.names, "unknown", place="fit_efficiency")
        if isinstance(arm.coordinates[arm.names.index(name)].drive.efficiency, EfficiencyTable):
            what = f"joint {name!r} has a gear_efficiency_table, of which a log tells no single number"
            expected = "gear_efficiency in the record, or the table as it is, without fit_efficiency"
            raise IdentificationError(what, place="fit_efficiency", expected=expected)
    return tuple(i for i, name in enumerate(arm.names) if name in names)


def _is_stated(body: Body, inertia: float) -> bool:
    """True of a rotor whose inertia the record knows: 0 behind a gear is an unknown one, of a direct drive it is the link's."""
    return np.isfinite(inertia) and (inertia > 0 or body.drive.gear_ratio == 1.0)


def on_motor(body: Body) -> bool:
    """True if the record has a joint's friction on the motor's side of its gear."""
    return body.friction is not None and body.friction.on_motor


def _is_of_other_side(column: TorqueColumn, body: Body) -> bool:
    """True of a coupled motor's or its joint's friction where the record has it on the other side."""
    if column.kind in ("inertial", "rotor", "offset", "spring", "sine", "cosine") or not body.drive.coupling:
        return False
    return (len(column.turned) > 1) != on_motor(body)


def _is_behind(column: TorqueColumn, body: Body | None) -> bool:
    """True of a column whose torque the gear delivers: links, springs, what is behind a coupled motor, friction of the joint."""
    if body is None or column.kind in ("inertial", "spring", "sine", "cosine"):
        return True
    coupled = bool(body.drive.coupling)
    if column.kind == "rotor":
        return coupled and len(column.turned) == 1
    return not on_motor(body) if column.kind == "offset" or not coupled else len(column.turned) == 1


@dataclass(frozen=True, eq=False)
class GearFit:
    """A lossy model about its solution.

    Attributes:
        model: about the parameters with the least residuals.   equations: of it.
        dropped: numbers of columns that count as 0.   steps: how many it took.
        unfitted: joints whose efficiency was to be fitted and stays the record's, each with the reason.
    """

    model: LossyModel
    equations: Equations
    dropped: Sequence[int] = ()
    steps: int = 0
    unfitted: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class GearProblem:
    """Log and method of a fit with gear loss.

    Attributes:
        equations: of the log, by a model.   regrouped: (equations, dropped) → base parameters of columns but those dropped.
        method: "ols", or as "wls".
    """

    equations: Callable[[TorqueModel], Equations]
    regrouped: Callable[[Equations, Sequence[int]], BaseParameters]
    method: str = "wls"

    def fit(self, equations: Equations, dropped: Sequence[int] = ()) -> ArmFit:
        """Least squares about the point of the equations' model."""
        return fit_arm(equations, self.regrouped(equations, dropped), "ols" if self.method == "ols" else "wls")


def fit_gears(
    problem: GearProblem,
    model: LossyModel,
    useless: Callable[[Equations], Sequence[int]] = lambda _: (),
    samples: Callable[[TorqueModel], Iterable[Samples]] | None = None,
    strict: bool = True,
) -> GearFit:
    """The model about the least-squares solution of a log.

    Args:
        problem: the log.   model: about no point yet.   useless: numbers of columns to leave out, from a fit with all of them.
        samples: of the log, by a model; needed where an efficiency is fitted.
        strict: refuse an efficiency that the log does not tell; False: it stays the record's, unless that is so of all.
    Raises:
        IdentificationError: an efficiency to fit of a gear that the load hardly drives back.   As `fit_arm`.
    """
    unfitted: dict[str, str] = {}
    if model.fitted:
        assert samples is not None
        model = _at_best_efficiency(problem, model)
        unfitted = _uncertain_efficiencies(problem, model, samples(model))
        if unfitted and (strict or len(unfitted) == len(model.fitted)):
            joint, why = next(iter(unfitted.items()))
            expected = "a motion that lowers loads and brakes them; or gear_efficiency in the record"
            raise IdentificationError(f"joint {joint!r}: {why}", place="fit_efficiency", expected=expected)
        if unfitted:
            model = _without(model, unfitted)
    if model.about is None:
        model = _from_lossless(problem, model)
    found = _gauss_newton(problem, model)
    dropped = useless(found.equations)
    if dropped:
        found = _gauss_newton(problem, found.model, dropped)
    return replace(found, unfitted=unfitted)


def _without(model: LossyModel, joints: Collection[str]) -> LossyModel:
    """The model, about the same parameters, in which some efficiencies are not fitted."""
    assert model.about is not None
    fewer = lossy_model(model.linear, [model.arm.names[i] for i in model.fitted if model.arm.names[i] not in joints])
    assert fewer is not None
    values = dict(zip(model.columns, model.about, strict=True))
    return fewer.at(np.array([values.get(column, 0.0) for column in fewer.columns]))


def _uncertain_efficiencies(problem: GearProblem, model: LossyModel, samples: Iterable[Samples]) -> dict[str, str]:
    """Joints whose efficiency a log hardly tells, each with the reason."""
    fit = problem.fit(problem.equations(model))
    stds = dict(zip(fit.base.independent.tolist(), fit.std, strict=True))
    shares, found = model.driven_back(samples), {}
    for k, i in enumerate(model.fitted, start=len(model.kept)):
        joint, half = model.arm.names[i], HALF_95 * stds.get(k, np.inf)
        if shares[i] < LEAST_DRIVEN_BACK:
            share = f"{shares[i]:.1%} of its squared torque, below {LEAST_DRIVEN_BACK:.0%}"
            found[joint] = f"the load hardly drives its gear back ({share}): efficiency looks like friction and mass"
        elif half > UNSURE:
            found[joint] = f"its gear's load is too small: efficiency would be known to ±{half:.2g} (95 %)"
    return found


def _from_lossless(problem: GearProblem, model: LossyModel) -> LossyModel:
    """The model about the parameters of a lossless fit."""
    assert not model.fitted
    return model.at(problem.fit(problem.equations(replace(model, about=None))).parameters)


def _at_best_efficiency(problem: GearProblem, model: LossyModel) -> LossyModel:
    """The model about the best fit of a grid of η, which is the same for all motors, with the best η of each joint by itself."""
    count = len(model.kept)
    joints = {model.arm.names[i] for i in model.fitted}
    least, etas = np.full(model.arm.n, np.inf), np.ones(model.arm.n)
    best: tuple[float, np.ndarray] = (np.inf, np.zeros(count))
    for eta in STARTS:
        bodies = (_with_efficiency(body, eta) if body.joint in joints else body for body in model.arm.bodies)
        stated = replace(
            model, arm=replace(model.arm, bodies=tuple(bodies)), columns=model.columns[:count], fitted=(),
            prior=model.prior[:count], of_joint=model.of_joint[:, :count],
        )  # fmt: skip
        found = _gauss_newton(problem, _from_lossless(problem, stated), most=STEPS_OF_STARTS)
        about = found.model.about
        assert about is not None
        squares = np.array([factor.residual(about) for factor in found.equations.factors])
        least, etas = np.minimum(squares, least), np.where(squares < least, eta, etas)
        best = min(best, (_cost(found.equations, problem.method), about), key=lambda each: each[0])
    return model.at(np.concatenate([best[1], etas[list(model.fitted)]]))


def _gauss_newton(
    problem: GearProblem, model: LossyModel, dropped: Sequence[int] = (), most: int = MOST_STEPS
) -> GearFit:
    """Steps of Gauss-Newton from a point until the residuals fall no more."""
    equations = problem.equations(model)
    base = problem.regrouped(equations, dropped)
    fixed = replace(problem, regrouped=lambda *_: base)
    cost = _cost(equations, problem.method)
    for steps in range(most):
        assert model.about is not None
        step, part = fixed.fit(equations).parameters - model.about, 1.0
        while True:
            trial = model.at(model.about + part * step)
            there = problem.equations(trial)
            new = _cost(there, problem.method)
            if new <= cost or part < SHORTEST:
                break
            part *= 0.5
        if new > cost:
            return GearFit(model, equations, dropped, steps)
        gained, model, equations, cost = cost - new, trial, there, new
        if gained < GAIN:
            return GearFit(model, equations, dropped, steps + 1)
    return GearFit(model, equations, dropped, most)


def _cost(equations: Equations, method: str) -> float:
    """Σ_j rows_j log |τ_j - τ̂_j|², twice the negative log-likelihood with a variance by joint; of "ols" with one for all."""
    assert isinstance(equations.model, LossyModel)
    about = equations.model.about
    assert about is not None
    factors = [factor for factor in equations.factors if factor.rows]
    floor = FLOOR * max(max(factor.sum_of_squares for factor in factors), np.finfo(float).tiny)
    rows = np.array([factor.rows for factor in factors])
    squares = np.array([max(factor.residual(about), floor) for factor in factors])
    return float(rows.sum() * np.log(squares.sum()) if method == "ols" else rows @ np.log(squares))


def distance(fit: ArmFit) -> float:
    """Largest distance of a fit from the point that its model is linear about, in standard deviations of a direction."""
    model = fit.equations.model
    assert isinstance(model, LossyModel)
    assert model.about is not None
    return float(np.abs(fit.information @ (fit.values - model.about[fit.base.independent])).max(initial=0.0))


def loss_remarks(fit: ArmFit, unfitted: Mapping[str, str]) -> list[str]:
    """Sentences about gears with loss: whose numbers are the record's, and what they change."""
    model = fit.equations.model
    if not isinstance(model, LossyModel):
        return []
    stated = [b.joint for i, b in enumerate(model.arm.coordinates) if model.lossy[i] and i not in model.fitted]
    said = [f"{joint}: gear efficiency stays the record's, {why}" for joint, why in unfitted.items()]
    if stated:
        said.append(f"gear loss of {', '.join(stated)} is the record's: links and friction are those beside it")
    rotors = [model.linear.columns[k].joint for k in model.stated if model.linear.prior[k] != 0]
    if rotors:
        said.append(
            f"rotor inertia of {', '.join(rotors)} is the record's: without gear loss no log can separate it from the link's"
        )
    return said


def doubtful_losses(fit: ArmFit) -> list[str]:
    """Sentences about fitted efficiencies that are none or too uncertain, and about a fit that did not settle."""
    model, base, said = fit.equations.model, fit.base, []
    if not isinstance(model, LossyModel):
        return []
    for b, k in enumerate(base.independent):
        if base.columns[k].kind == EFFICIENCY:
            eta, half = float(fit.values[b]), HALF_95 * float(fit.std[b])
            number = f"gear efficiency {eta:.3g} ± {half:.2g} (95 %)"
            if eta - half > MOST_EFFICIENT:
                said.append(
                    f"{base.columns[k].joint}: {number}: a gear that gives more power than it gets; is its friction of this form?"
                )
            elif half > UNSURE:
                said.append(
                    f"{base.columns[k].joint}: {number}: too uncertain; lower loads more, or state it in the record"
                )
    lost = [model.columns[k].joint for k in range(len(model.kept), len(model)) if k not in base.independent]
    said += [f"{joint}: this motion does not tell its gear efficiency" for joint in lost]
    if (far := distance(fit)) > UNSETTLED:
        said.append(f"the fit with gear loss did not settle: its last step was {far:.2g} deviations")
    return said
