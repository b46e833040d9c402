"""`armwright servos`: the library of servos, and one with all its numbers and their sources."""

from __future__ import annotations

from typing import TYPE_CHECKING

import armwright as aw
from armwright.cli.arguments import argument
from armwright.errors import check_known

if TYPE_CHECKING:
    from armwright.cli.tables import Table
    from armwright.robotfiles import Servo


def servos(
    name: str | None = argument("NAME", "A servo: shows all its numbers, uncertainties and sources.", None),
) -> None:
    """List the servos that a joint of a robot file can name by servo = "NAME", or show one.

    \b
    Examples:
      armwright servos
      armwright servos sts3215-7.4v
    """
    from armwright.cli.tables import console_for_tables
    from armwright.errors import DescriptionError

    known, console = aw.robotfiles.servos(), console_for_tables()
    if name is None:
        console.print(_overview(known))
        return
    check_known(DescriptionError, name, known, "no such servo", place="servo")
    servo = known[name]
    console.print(f"{name}: {servo.title}", style="bold")
    console.print(servo.notes)
    for part in (_numbers(servo), _sources(servo)):
        console.print()
        console.print(part)


def _overview(known: dict[str, Servo]) -> Table | None:
    from armwright.cli.tables import number, table

    rows = []
    for name, servo in known.items():
        shaft, sheet = servo.shaft, servo.data_sheet
        constants = (servo.limits.voltage_v, shaft.gear_ratio, shaft.torque_constant_n_m_per_a, shaft.resistance_ohm)
        stated = ("", "") if sheet is None else (number(sheet.stall_torque_n_m), number(sheet.no_load_speed_rad_per_s))
        rows.append([name, servo.title, servo.command, *map(number, constants), *stated])
    heads = ("name", "servo", "command", "supply [V]", "gear n", "Kt at the shaft [N m/A]", "R [Ω]")
    heads = (*heads, "stall torque [N m]", "no-load speed [rad/s]")
    return table(None, heads, rows, left=("servo", "command"))


def _numbers(servo: Servo) -> Table | None:
    from armwright.cli.tables import number, table
    from armwright.description.paths import quantities, unit_at

    rows = []
    for path, quantity, source in quantities(servo):
        std = "" if quantity.std is None else number(quantity.std)
        rows.append([path, number(quantity), std, unit_at(f"servo.{path}"), source or ""])
    return table("Numbers", ("number", "value", "std", "unit", "source"), rows, left=("unit", "source"))


def _sources(servo: Servo) -> Table | None:
    from armwright.cli.tables import table
    from armwright.description.paths import quantities
    from armwright.description.servos import servo_library

    known, rows = servo_library().sources, []
    for key in dict.fromkeys(source or "" for _, _, source in quantities(servo)):
        about = (known[key].text, known[key].date, known[key].licence, known[key].url)
        rows.append([key, known[key].kind, "; ".join(part for part in about if part)])
    return table("Sources", ("source", "kind", "what it is"), rows, left=("kind", "what it is"))
