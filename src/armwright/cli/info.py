"""`armwright info`: the numbers of a robot file with their sources, and the operations of its kernels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import armwright as aw
from armwright.cli.arguments import Robot, flag
from armwright.cli.tables import number, table

if TYPE_CHECKING:
    from armwright.cli.tables import Table
    from armwright.description import RobotDescription
    from armwright.joint_kinds import JointKind
    from armwright.model import Model

DEGREES = 57.29577951308232  # in a radian
PRODUCTS, SUMS = ("MUL", "SQ"), ("ADD", "SUB", "TWICE")


def info(
    robot: Robot,
    operations: bool = flag("--operations", "Count the operations of every kernel instead, step by step."),
) -> None:
    """Show an arm: frames, masses, motors, friction, limits, sources of all numbers, warnings.

    \b
    Examples:
      armwright info cmu-dd
      armwright info my-arm.toml
      armwright info puma560 --operations
    """
    from armwright.cli.tables import console_for_tables

    arm = aw.load(robot, on_impossible="warn")
    record = arm.description
    assert record is not None
    console = console_for_tables()
    if operations:
        console.print(_operations(arm))
        return
    console.print(f"{arm.name}: {record.title}" if record.title else arm.name, style="bold")
    if record.notes:
        console.print(record.notes)
    console.print(_summary(arm, record))
    for part in (
        *_geometry(record),
        _mimics(record),
        _masses(record),
        _inertias(record),
        _drives(arm, record),
        _efficiencies(record),
        _couplings(record),
        _friction(record),
        _springs(record),
        _cylinders(record),
        _effects(record),
        _limits(arm),
        _sources(record),
    ):
        if part is not None:
            console.print()
            console.print(part)
    for warning in arm.warnings:
        console.print(f"\nwarning: {warning}", style="yellow")


def _summary(arm: Model, record: RobotDescription) -> str:
    from armwright.errors import ModelError
    from armwright.ik.closed_form.geometry import NEARLY, geometry_of
    from armwright.kinematics.reach import reach

    try:
        far = f"{number(reach(arm))} m at most, base to {arm.tip}, pulled straight"
    except ModelError:
        far = "—, the arm names no tip"
    kinds = Counter(body.kind.name for body in arm.bodies)
    followers = f", {len(arm.bodies) - arm.n} of them mimic others" if arm.mimics is not None else ""
    lines = {
        "joints": ", ".join(f"{count} {kind}" for kind, count in kinds.items()) + followers,
        "mass": f"{number(record.total_mass)} kg, all links",
        "reach": far,
        "gravity": f"{'  '.join(f'{g:g}' for g in arm.gravity)} m/s², in base axes",
    }
    if arm.tip is not None and arm.n > 1:
        geometry, kind = geometry_of(arm), "closed form"
        if geometry is None:
            geometry, kind = geometry_of(arm, tolerance=NEARLY), "closed form of nearly this arm, polished"
        lines["inverse"] = "numeric" if geometry is None else f"{kind}, {geometry.description}"
    return "\n".join(f"{name:<8} {value}" for name, value in lines.items())


def _geometry(record: RobotDescription) -> list[Table | None]:
    """One table for each way in which the file places joints: classic DH, modified DH, explicit frames."""
    parts = []
    for way, title in (("dh", "Denavit-Hartenberg, classic"), ("modified_dh", "Denavit-Hartenberg, modified (Craig)")):
        rows = [[j.name, j.type, j.parent, j.child, *_dh(row, j.kind)] for j, row in _parts(record, way)]
        heads = ("joint", "type", "parent", "child", "α [°]", "a [m]", "r [m]", "θ [°]")
        parts.append(table(title, heads, rows, left=("type", "parent", "child", "r [m]", "θ [°]")))
    rows = []
    for joint, frame in _parts(record, "frame"):
        turned = [DEGREES * angle for angle in frame.rpy_rad.value]
        axis = getattr(joint, "axis", None)
        turns_about = map(number, axis.value) if axis is not None else ("",) * 3
        place = (*map(number, frame.xyz_m.value), *map(number, turned), *turns_about)
        rows.append([joint.name, joint.type, joint.parent, joint.child, *place])
    heads = ("joint", "type", "parent", "child", "x", "y", "z", "roll", "pitch", "yaw", "axis x", "axis y", "axis z")
    title = "Joint frames in the parent link: x y z [m], fixed-axis angles [°], axis"
    parts.append(table(title, heads, rows, left=("type", "parent", "child")))
    return parts


def _parts(record: RobotDescription, name: str) -> list[tuple[Any, Any]]:
    """Each joint that has a part of this name, or whose motor has it, with the part."""
    holders = ((joint, holder) for joint in record.joints for holder in (joint, getattr(joint, "motor", None)))
    found = ((joint, getattr(holder, name, None)) for joint, holder in holders)
    return [(joint, part) for joint, part in found if part is not None]


def _dh(row: Any, kind: JointKind) -> list[str]:
    """α, a, r, θ; what moves is written q, with its offset."""
    alpha = number(DEGREES * float(row.alpha_rad))
    if kind.turns:
        offset = DEGREES * float(row.offset_rad)
        return [alpha, number(row.a_m), number(row.r_m), _moving(offset)]
    if kind.slides:
        return [alpha, number(row.a_m), _moving(float(row.offset_m)), number(DEGREES * float(row.theta_rad))]
    return [alpha, number(row.a_m), number(row.r_m), number(DEGREES * float(row.theta_rad))]


def _moving(offset: float) -> str:
    if not offset:
        return "q"
    return f"q {'+' if offset > 0 else '−'} {number(abs(offset))}"


def _masses(record: RobotDescription) -> Table | None:
    rows = []
    for link in record.links:
        com: Any = link.com_m.value
        rows.append([link.name, *map(number, (link.mass_kg, *com))])
    return table("Links: mass [kg], centre of mass [m] in the link's frame", ("link", "mass", "x", "y", "z"), rows)


def _inertias(record: RobotDescription) -> Table | None:
    rows = []
    for link in record.links:
        i = link.inertia_kg_m2
        rows.append([link.name, *map(number, (i.xx, i.yy, i.zz, i.xy, i.xz, i.yz))])
    heads = ("link", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
    return table("Links: inertia about the centre of mass, in the link's axes [kg m²]", heads, rows)


def _drives(arm: Model, record: RobotDescription) -> Table | None:
    with_motor = {joint.name for joint, _ in _parts(record, "motor")}
    rows = []
    for body in arm.coordinates:
        drive = body.drive
        if body.joint not in with_motor:
            rows.append([body.joint, drive.command, *[""] * 8])
            continue
        efficiency = "table" if hasattr(drive.efficiency, "torques") else number(drive.efficiency)
        gear = (drive.gear_ratio, drive.rotor_inertia, drive.reflected)
        motor = (drive.torque_constant, drive.back_emf_constant, drive.resistance, drive.inductance)
        rows.append([body.joint, drive.command, *map(number, gear), efficiency, *map(number, motor)])
    heads = ("joint", "command", "gear n", "rotor [kg m²]", "at the joint", "η")
    heads = (*heads, "Kt [N m/A]", "Ke [V s/rad]", "R [Ω]", "L [H]")
    return table("Drives (DC-equivalent constants)", heads, rows, left=("command",))


def _efficiencies(record: RobotDescription) -> Table | None:
    """Tables of gear efficiency, a line for each speed."""
    rows = []
    for joint, efficiency in _parts(record, "gear_efficiency_table"):
        for row in efficiency.rows:
            torques = _one_or_many(getattr(efficiency, efficiency.torque_key))
            speed = getattr(row, efficiency.speed_key)
            back = row.driving if row.driven_back is None else row.driven_back
            shares = (_one_or_many(row.driving), _one_or_many(back))
            rows.append([joint.name, torques, "any" if speed is None else number(speed), *shares])
    heads = ("joint", "leaves the gear [N m | N]", "at a speed of [rad/s | m/s]", "η driving", "η driven back")
    return table("Gear efficiency by load", heads, rows, left=(heads[1], *heads[3:]))


def _couplings(record: RobotDescription) -> Table | None:
    """Motors that other joints turn too, as in a wrist."""
    rows = []
    for joint, motor in _parts(record, "motor"):
        turns = [f"{number(each.ratio)} · {each.joint}" for each in motor.coupling]
        if turns:
            rows.append([joint.name, " + ".join([f"{number(motor.gear_ratio)} · {joint.name}", *turns])])
    heads = ("motor of", "turns by [rad for each rad | m]")
    return table("Coupled motors: other joints turn them too", heads, rows, left=heads[1:])


def _mimics(record: RobotDescription) -> Table | None:
    rows = [
        [joint.name, mimic.joint, number(mimic.multiplier), f"{number(mimic.offset)} {mimic.units.position}"]
        for joint, mimic in _parts(record, "mimic")
    ]
    heads = ("joint", "master", "multiplier", "offset")
    return table("Joints that mimic others: q = multiplier · q_master + offset", heads, rows, left=("master",))


def _friction(record: RobotDescription) -> Table | None:
    """As the file gives it: keys with their units, so that either law, side and kind of joint fits one table."""
    rows = [
        [joint.name, friction.law, friction.side, _numbers(friction, "side", "law")]
        for joint, friction in _parts(record, "friction")
    ]
    return table("Friction", ("joint", "law", "side", "numbers"), rows, left=("law", "side", "numbers"))


def _springs(record: RobotDescription) -> Table | None:
    """As the file gives them."""
    rows = []
    for joint, spring in _parts(record, "spring"):
        keys = [key for key in type(spring).model_fields if key not in ("source", "outside")]
        texts = [f"{key} {_one_or_many(getattr(spring, key))}" for key in keys if getattr(spring, key) is not None]
        texts += [] if spring.outside is None else [f"outside {spring.outside}"]
        rows.append([joint.name, ", ".join(texts)])
    return table("Springs at joints", ("joint", "numbers"), rows, left=("numbers",))


def _effects(record: RobotDescription) -> Table | None:
    """Elastic gears, stops, brakes, and what motors and the supply have beyond their constants; as the file gives it."""
    rows = []
    for joint in record.joints:
        motor = getattr(joint, "motor", None)
        parts = {name: getattr(joint, name, None) for name in ("elasticity", "stops", "brake", "firmware")}
        parts |= {name: getattr(motor, name, None) for name in ("thermal", "cogging")}
        rows += [[joint.name, name, _numbers(part)] for name, part in parts.items() if part is not None]
        texts = _named(motor, ("current_loop_hz", "pwm", "dead_zone_v"))
        rows += [[joint.name, "motor", texts]] if texts else []
    rows += [] if record.supply is None else [["all", "supply", _numbers(record.supply)]]
    heads = ("joint", "effect", "numbers")
    return table("Further effects of gears, motors and supply", heads, rows, left=heads[1:])


def _numbers(part: Any, *without: str) -> str:
    """The numbers of a table of a record, with their keys but for some."""
    return _named(part, [name for name in type(part).model_fields if name not in ("source", *without)])


def _named(part: Any, names: Iterable[str]) -> str:
    """Values of a table of a record that it has, with their keys."""
    values = {name: value for name in names if (value := getattr(part, name, None)) is not None}
    return ", ".join(
        f"{name} {value if isinstance(value, str) else _one_or_many(value)}" for name, value in values.items()
    )


def _one_or_many(quantity: Any) -> str:
    value = quantity.value
    return f"[{', '.join(map(number, value))}]" if isinstance(value, tuple) else number(value)


def _cylinders(record: RobotDescription) -> Table | None:
    rows = []
    for c in record.cylinders:
        ends = ((c.link_a, c.anchor_a_m), (c.link_b, c.anchor_b_m))
        places = [f"{link} ({_one_or_many(anchor)[1:-1]})" for link, anchor in ends]
        rows.append([c.name, *places, *map(number, (c.force_n, c.length_m, c.stiffness_n_per_m))])
    heads = ("cylinder", "from link (x, y, z [m])", "to link (x, y, z [m])")
    heads = (*heads, "push [N]", "at length [m]", "stiffness [N/m]")
    return table("Cylinders between links; a push below 0 is a pull", heads, rows, left=heads[1:3])


def _limits(arm: Model) -> Table | None:
    from armwright.joint_kinds import UNITS

    rows = []
    for body in arm.bodies:
        low, high = body.limits.position
        scale = 1.0 if body.kind.units.linear else DEGREES
        bounded = low > -float("inf") or high < float("inf")
        place = f"{number(scale * low)} … {number(scale * high)}{'°' if scale > 1 else ' m'}" if bounded else ""
        most = [getattr(body.limits, name) for name in ("velocity", "acceleration", "torque", "voltage", "current")]
        rows.append([body.joint, place, *("" if value == float("inf") else number(value) for value in most)])
    units = [UNITS[linear] for linear in sorted({body.kind.units.linear for body in arm.bodies})]
    speed, force = " | ".join(each.speed for each in units), " | ".join(each.torque for each in units)
    rate = " | ".join(f"{unit}²" for unit in speed.split(" | "))
    heads = ("joint", "position", f"velocity [{speed}]", f"acceleration [{rate}]", f"motor torque [{force}]")
    heads = (*heads, "voltage [V]", "current [A]")
    return table("Limits", heads, rows)


def _sources(record: RobotDescription) -> Table | None:
    from armwright.description.paths import quantities

    counts = Counter(source or "" for _, _, source in quantities(record, pictures=False))
    rows = []
    for key, count in counts.items():
        source = record.source_of(key)
        about = [source.text if source.text != key else "", source.date, source.licence, source.url]
        rows.append([key, source.kind, str(count), "; ".join(part for part in about if part)])
    return table("Sources", ("source", "kind", "numbers", "what it is"), rows, left=("kind", "what it is"))


def _operations(arm: Model) -> Any:
    """Operations of each kernel: products and sums as traced, after each step on the arm, and of all kinds after the passes."""
    from rich.console import Group
    from rich.text import Text

    from armwright.errors import ModelError
    from armwright.kernels.signatures import SIGNATURES, trace_kernel
    from armwright.model.simplify import STEPS
    from armwright.program.passes import optimised

    columns = ["kernel", "products, sums as traced", *(step.__name__.replace("_", " ") for step in STEPS)]
    columns += ["sin, cos", "operations", "after the passes"]
    rows, lacking = [], []
    for name, signature in SIGNATURES.items():
        try:
            programs, model = [trace_kernel(arm, signature, steps=())], arm
        except ModelError as error:
            lacking.append(str(error))
            continue
        for step in STEPS:
            model = step(model) if step in signature.steps else model
            programs.append(trace_kernel(model, signature, steps=()))
        counts = [program.operation_counts() for program in programs]
        cells = [f"{sum(c[o] for o in PRODUCTS)}, {sum(c[o] for o in SUMS)}" for c in counts]
        last = programs[-1].instructions
        left = [i for i in optimised(last) if i.operation not in ("INPUT", "OUTPUT", "CONST")]
        trigonometry = f"{counts[-1]['SIN']}, {counts[-1]['COS']}"
        rows.append([name, *cells, trigonometry, str(sum(counts[-1].values())), str(len(left))])
    counted = table(f"{arm.name}: operations a state", columns, rows)
    return Group(*(part for part in (counted, *(Text(line, style="dim") for line in lacking)) if part is not None))
