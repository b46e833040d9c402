"""Numbers of the record as inputs: an arm with some of its parameters left open. Design section 2.

`Varied(arm, ["link6.mass_kg"])` names them; `.model(values)` is the arm with other values, numbers or symbols, through the
same map from record to model as ever; `.check(values)` refuses values that no record could hold.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from armwright.description.paths import path_name, quantities, split_path, with_values
from armwright.description.robot import Link, RobotDescription
from armwright.errors import ModelError
from armwright.lint.feasibility import IMPOSSIBLE, is_possible
from armwright.model.model import Model, assembled
from armwright.model.parameter_table import Parameter, parameters_of
from armwright.quantity import INCREASING, RISING, rise
from armwright.scalar import Array
from armwright.spatial import TENSOR, pseudo_inertia

TAKEN_AWAY = {  # by `arm.replace`: the parameters that no longer count
    "friction": ".friction.",
    "springs": ".spring.",
    "rotors": ".motor.rotor_inertia_kg_m2",
    "efficiency": ".motor.gear_efficiency",
    "gravity": "gravity_m_s2",
}


class Varied:
    """An arm some of whose parameters are inputs.

    Attributes:
        arm: as it was loaded.   parameters: what varies, one number each, in the order asked for.
        nominal: (k,) their values in the record.   sizes: how many numbers each of the names asked for stands for.
    """

    def __init__(self, arm: Model, names: Sequence[str]):
        """The arm with these parameters left open.

        Args:
            arm: made from a description.
            names: paths of numbers in the record, such as "link6.mass_kg"; one with several numbers, such as
                "link6.com_m", stands for all of them, "link6.com_m[2]" for one.
        Raises:
            ModelError: a name that the record does not have (it lists what there is), one that comes twice, or an arm whose
                numbers are no longer the record's.
        """
        if arm.description is None:
            raise ModelError("this model was not made from a description", place="vary", file=arm.name)
        if isinstance(names, (str, memoryview)) or not all(isinstance(name, str) for name in names):
            raise ModelError(place="vary", value=names, expected="a list of names of parameters")
        self.arm, self._record = arm, arm.description
        self._cylinders = {cylinder.name for cylinder in arm.description.cylinders}
        self._table = parameters_of(arm.description)
        self._numbers = {path: quantity.value for path, quantity, _ in quantities(arm.description, pictures=False)}
        named = {name: tuple(self._named(name)) for name in names}
        self.sizes = {name: len(parameters) for name, parameters in named.items()}
        self.parameters = tuple(p for name in names for p in named[name])
        twice = next((name for name, count in Counter(self.names).items() if count > 1), None)
        if twice is not None:
            raise ModelError("named twice", place="vary", value=twice)
        self.nominal = np.array([p.value for p in self.parameters], dtype=float)
        if list(_numbers(self.model(self.nominal))) != list(_numbers(arm)):
            expected = "an arm with the numbers of its record; change others with arm.replace"
            raise ModelError(
                "numbers of the model differ from its record", place="vary", expected=expected, file=arm.name
            )
        self._links = list(self._varied_links())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the varied parameters, in the order of the values."""
        return tuple(p.name for p in self.parameters)

    def _named(self, name: str) -> Iterator[Parameter]:
        path, entry = name, None
        if name.endswith("]") and name not in self._numbers and name[name.rfind("[") + 1 : -1].isdigit():
            path, entry = name[: name.rfind("[")], int(name[name.rfind("[") + 1 : -1])
        value = self._numbers.get(path)
        size = len(value) if isinstance(value, tuple) else 1
        joint, of_friction, _ = path.partition(".friction.smoothing_")
        if of_friction and not any(known.startswith(joint + of_friction) for known in self._numbers):
            what = f"no smoothing speed in [joints.friction] of {joint!r}"
            expected = "one in the record, to vary it; without one friction is not smoothed"
            raise ModelError(what, place="vary", value=name, expected=expected, file=self.arm.name)
        if value is None or (entry is not None and (not isinstance(value, tuple) or entry >= size)):
            raise ModelError(
                "no such parameter", place="vary", value=name, expected=self._alternatives(path), file=self.arm.name
            )
        for change, part in TAKEN_AWAY.items():
            of_cylinder = change == "springs" and split_path(path)[0] in self._cylinders
            if change in self.arm.changes and (part in path or of_cylinder):
                raise ModelError(
                    f"arm.replace({change}=…) has replaced it", place="vary", value=name, file=self.arm.name
                )
        if isinstance(value, tuple):
            yield from (self._table[f"{path}[{k}]"] for k in (range(size) if entry is None else [entry]))
        else:
            yield self._table[path]

    def _alternatives(self, path: str) -> str:
        """Parameters of the same link or joint, or else the names of links and joints."""
        name = split_path(path)[0]
        siblings = [known for known in self._numbers if split_path(known)[0] == name]
        if siblings:
            head = path_name(name)
            return f"{head}.X, X one of {', '.join(known.removeprefix(f'{head}.') for known in siblings)}"
        return f"a parameter of {', '.join(dict.fromkeys(path_name(split_path(known)[0]) for known in self._numbers))}"

    def model(self, values: Array) -> Model:
        """The arm with these values (k,), numbers or symbols, unchecked; changes by `arm.replace` are kept."""
        return assembled(self._with(values)).replace(**self.arm.changes)

    def _with(self, values: Array) -> RobotDescription:
        by_path: dict[str, Any] = {}
        for p, value in zip(self.parameters, values, strict=True):
            if p.entry is None:
                by_path[p.path] = value
            else:
                whole = list(by_path.get(p.path, self._numbers[p.path]))
                whole[p.entry] = value
                by_path[p.path] = tuple(whole)
        return with_values(self._record, by_path)

    def check(self, values: np.ndarray) -> None:
        """Refuses values (…, k) that the record could not hold.

        Raises:
            ModelError: names the parameter or link, the lane, the value and what was expected.
        """
        rows = values.reshape(-1, len(self.parameters))
        finite = bool(np.isfinite(rows).all())
        for k, p in enumerate(self.parameters):
            column = rows[:, k]
            single = p.entry is None  # the test of several numbers is about them together
            fits = p.reading.test(column) if single else True
            if finite and np.all(fits):
                continue
            fits = np.isfinite(column) & fits
            if not fits.all():
                lane = int(np.argmin(fits))
                expected = p.reading.expected if single else "a finite number"
                raise ModelError(place=f"parameters[{lane}] {p.name}", value=float(column[lane]), expected=expected)
        for path, reading in {p.path: p.reading for p in self.parameters if p.reading in (INCREASING, RISING)}.items():
            whole = self._whole(path, rows)
            fits = rise(whole) & ((reading is INCREASING) | (whole[0] > 0.0))
            _refuse(whole, fits, path, reading.expected)
        for table, path in self._efficiency_tables():
            self._check_efficiencies(table, path, rows)
        for link, entries in self._links:
            self._check_link(link, [rows[:, e.column] if isinstance(e, _Column) else e for e in entries])

    def _efficiency_tables(self) -> Iterator[tuple[Any, str]]:
        """Efficiency tables of gears with varied numbers, and their paths."""
        for joint in self._record.joints:
            motor, path = getattr(joint, "motor", None), f"{path_name(joint.name)}.motor.gear_efficiency_table"
            if motor is not None and any(p.path.startswith(f"{path}.") for p in self.parameters):
                yield motor.gear_efficiency_table, path

    def _check_efficiencies(self, table: Any, path: str, rows: np.ndarray) -> None:
        """Refuses a table through which the torque would not rise, in one of the lanes."""
        torques, speed_before = self._whole(f"{path}.{table.torque_key}", rows), None
        for k, row in enumerate(table.rows):
            back = "driving" if row.driven_back is None else "driven_back"
            for key, driving in (("driving", True), (back, False)):
                at = f"{path}.rows[{k}].{key}"
                shares = self._whole(at, rows)
                _refuse(shares, ((shares > 0.0) & (shares <= 1.0)).all(axis=0), at, "numbers above 0, at most 1")
                expected = "efficiencies with which the torque into the gear rises with that out of it"
                _refuse(shares, table.rises(torques, shares, driving).all(axis=0), at, expected)
            if len(table.rows) > 1:
                at = f"{path}.rows[{k}].{table.speed_key}"
                speed = self._whole(at, rows)
                if speed_before is not None:
                    _refuse(
                        speed, rise(np.concatenate([speed_before, speed])), at, "more than the speed of the row before"
                    )
                speed_before = speed

    def _whole(self, path: str, rows: np.ndarray) -> np.ndarray:
        """Numbers at a path (size, lanes), those that do not vary included."""
        columns = {p.entry or 0: rows[:, k] for k, p in enumerate(self.parameters) if p.path == path}
        numbers = np.ravel(self._numbers[path])
        return np.array([columns.get(k, np.full(len(rows), value)) for k, value in enumerate(numbers)])

    def _varied_links(self) -> Iterator[tuple[str, list[float | _Column]]]:
        """Links whose mass properties vary: each one's ten numbers, constant or a column of the values."""
        columns = {p.name: k for k, p in enumerate(self.parameters)}
        for link in self._record.links:
            if not _possible(link):
                continue  # the record itself was accepted so
            paths = [f"{path_name(link.name)}.{path}" for path in BODY]
            if any(path in columns for path in paths):
                numbers = [
                    link.mass_kg.number,
                    *link.com_m.numbers,
                    *(getattr(link.inertia_kg_m2, e).value for e in TENSOR),
                ]
                named = zip(paths, numbers, strict=True)
                yield link.name, [_Column(columns[path]) if path in columns else value for path, value in named]

    def _check_link(self, link: str, numbers: Sequence[Any]) -> None:
        mass, (xx, xy, xz, yy, yz, zz) = numbers[0], numbers[4:]
        # Positive definite about the centre of mass, and so about any point: Sylvester's minors of ½ tr(I) 1 - I.
        half = 0.5 * (xx + yy + zz)
        a, c, e = half - xx, half - yy, half - zz
        minor = a * c - xy * xy
        sure = (mass > 0) & (a > 0) & (minor > 0) & (minor * e - a * yz * yz - c * xz * xz - 2.0 * xy * xz * yz > 0)
        doubtful = np.flatnonzero(~np.broadcast_to(sure, max(np.size(v) for v in numbers)))  # flat bodies too: det = 0
        for start in range(0, len(doubtful), PIECE):
            lanes = doubtful[start : start + PIECE]
            body = _pseudo_inertias(
                np.stack([np.broadcast_to(v if np.ndim(v) == 0 else v[lanes], len(lanes)) for v in numbers])
            )
            fits = is_possible(body)
            if not fits.all():
                lane = int(np.argmin(fits))
                raise ModelError(
                    f"an impossible inertia: its pseudo-inertia has the eigenvalue {np.linalg.eigvalsh(body[lane])[0]:.4g}",
                    place=f"parameters[{lanes[lane]}] link {link!r}",
                    expected=f"none below {-IMPOSSIBLE:g} of the largest",
                )


def _refuse(values: np.ndarray, fits: Any, path: str, expected: str) -> None:
    """Refuses the first lane of values (size, lanes) that does not fit (lanes,)."""
    if not fits.all():
        lane = int(np.argmin(fits))
        raise ModelError(place=f"parameters[{lane}] {path}", value=tuple(values[:, lane].tolist()), expected=expected)


def _pseudo_inertias(numbers: np.ndarray) -> np.ndarray:
    """(lanes, 4, 4) of (10, lanes) numbers in the order of `BODY`: `pseudo_inertia` for many bodies."""
    mass, com, (xx, xy, xz, yy, yz, zz) = numbers[0], numbers[1:4], numbers[4:]
    about_com = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    body = np.empty((4, 4, len(mass)))
    body[:3, :3] = 0.5 * (xx + yy + zz) * np.eye(3)[:, :, None] - about_com + mass * com[:, None] * com[None, :]
    body[:3, 3] = body[3, :3] = mass * com
    body[3, 3] = mass
    return body.transpose(2, 0, 1)


@dataclass(frozen=True)
class _Column:
    """Column of the values that holds a number."""

    column: int


PIECE = 65536  # bodies whose eigenvalues are taken in one go
BODY = ("mass_kg", "com_m[0]", "com_m[1]", "com_m[2]", *(f"inertia_kg_m2.{entry}" for entry in TENSOR))


def _possible(link: Link) -> bool:
    return bool(is_possible(pseudo_inertia(float(link.mass_kg), np.array(link.com_m), link.inertia_kg_m2.matrix())))


def _numbers(value: Any) -> Iterator[Any]:
    """Every number of a model, in order."""
    if isinstance(value, Model):
        for part in (
            value.bodies,
            value.gravity,
            value.mimics,
            value.cylinders,
            *(value.frames[name] for name in sorted(value.frames)),
        ):
            yield from _numbers(part)
    elif is_dataclass(value):
        for each in fields(value):
            yield from _numbers(getattr(value, each.name))
    elif isinstance(value, (tuple, list)):
        for item in value:
            yield from _numbers(item)
    elif isinstance(value, np.ndarray):
        yield from value.ravel().tolist()
    else:
        yield value
