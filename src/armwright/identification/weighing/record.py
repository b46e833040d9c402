"""The robot's record with measured masses, centres and inertias of a link, each with its deviation and how it was found."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from armwright.description.paths import path_name
from armwright.description.record_of import Arm
from armwright.description.robot import RobotDescription, Source
from armwright.errors import IdentificationError
from armwright.identification.estimate import Estimate, write_numbers
from armwright.identification.weighing.measured_number import MeasuredNumber

KEYS = {
    "mass": "mass_kg",
    **{f"com_{axis}": f"com_m[{k}]" for k, axis in enumerate("xyz")},
    **{f"i{pair}": f"inertia_kg_m2.{pair}" for pair in ("xx", "xy", "xz", "yy", "yz", "zz")},
}
KIND = {"m": "mass", "c": "centre", "i": "inertia"}  # first letter of a key → quantity


def write_measured(
    arm: str | os.PathLike[str] | Arm | RobotDescription,
    link: str,
    measured: Mapping[str, MeasuredNumber] | Estimate,
    output: str | os.PathLike[str],
    key: str = "measured",
) -> Path:
    """Writes the robot's record with measured numbers of a link, of the kind "measurement", with their deviations.

    Args:
        arm: an arm, its description, its name or the path of its file.   link: whose numbers they are.
        measured: by key, some of mass, com_x, com_y, com_z, ixx, ixy, ixz, iyy, iyz, izz (inertia about the centre of mass in
            link axes), or what `measured_tensor` returns.   output: path of a TOML file; it may be the robot's own.
        key: of the source.
    Returns:
        path: of the file.
    Raises:
        IdentificationError: an unknown key, a number of another quantity, or no such link.
        OutputError, DescriptionError: as `write_into`; a link that no body has with these numbers.
    Example:
        >>> found = {"mass": aw.identification.measured_mass([2.9], scale_std=0.01)}
        >>> path = aw.identification.write_measured("two-link", "forearm", found, "arm.toml")
        >>> aw.load(path).parameters["forearm.mass_kg"].value
        2.9
    """
    if isinstance(measured, Estimate):
        numbers = {
            f"i{name}": (float(v), float(s))
            for name, v, s in zip(measured.names, measured.values, measured.std, strict=True)
        }
        text = measured.method
        wrong = [name for name in numbers if name not in KEYS]
    elif isinstance(measured, Mapping) and measured and all(isinstance(x, MeasuredNumber) for x in measured.values()):
        numbers = {name: (each.value, each.std) for name, each in measured.items()}
        text = "; ".join(f"{name}: {each.how}" for name, each in measured.items())
        wrong = [name for name, each in measured.items() if name not in KEYS or KIND[name[0]] != each.quantity]
    else:
        raise IdentificationError(
            place="measured", value=measured, expected="measured numbers by key, or a measured tensor"
        )
    if wrong:
        raise IdentificationError("no number of a link", place="measured", value=wrong[0], choices=tuple(KEYS))
    if not isinstance(link, str):
        raise IdentificationError(place="link", value=link, expected="the name of a link")
    paths = {f"{path_name(link)}.{KEYS[name]}": pair for name, pair in numbers.items()}
    return write_numbers(arm, paths, Source(kind="measurement", text=text), output, key)
