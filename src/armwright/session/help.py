"""`help`: the tables of commands and variables, and a page about each; `tour`: a first lesson in robot dynamics."""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
from collections.abc import Mapping
from typing import Any

from armwright.session.arguments import Argument, same, unknown
from armwright.session.controllers import gain_names, laws
from armwright.session.listing import Output, Sheet, TextLine, significant
from armwright.session.variables import TABLE, VARIABLES, SessionVariable
from armwright.session.workspace import SessionCommand, Workspace

VALUES = "NAME = VALUES sets a variable: one value a joint, or one for all; 30 deg, pi/2, 2*theta; NAME[JOINT] = VALUE one joint"

SPELLING = (
    "help NAME tells all about one of them, help symbols the letters of the equations; tour is for newcomers. "
    "- and _ are alike, so are large and small letters."
)
ENTRY = re.compile(r"(?:^|(?<=\.)   )(?P<names>[a-z_]+(?:, [a-z_]+)*): ", re.MULTILINE)
"""`name: what it is.   other, another: what they are.` in the docstring of a controller."""

REPORT = "CMU report"  # as the pages of help call [SwartzReport]
KEY = re.compile(r"\[([A-Z]\w*)\]")

SOURCES = {
    "SwartzReport": "N. M. Swartz. Arm Dynamics Simulation. Carnegie-Mellon University, Robotics Institute; "
    "dated 23 November 1982",
    "AstromHagglund2006": "K. J. Åström, T. Hägglund. Advanced PID Control. ISA, 2006.",
    "DenavitHartenberg1955": "J. Denavit, R. S. Hartenberg. A kinematic notation for lower-pair mechanisms based on matrices. "
    "ASME Journal of Applied Mechanics 22(2), 215–221, 1955.",
    "Featherstone2008": "R. Featherstone. Rigid Body Dynamics Algorithms. Springer, 2008.",
    "Kutta1901": "W. Kutta. Beitrag zur näherungsweisen Integration totaler Differentialgleichungen. "
    "Zeitschrift für Mathematik und Physik 46, 435–453, 1901.",
    "LuhWalkerPaul1980": "J. Y. S. Luh, M. W. Walker, R. P. C. Paul. On-line computational scheme for mechanical manipulators. "
    "ASME Journal of Dynamic Systems, Measurement, and Control 102(2), 69–76, 1980.",
    "SicilianoEtAl2009": "B. Siciliano, L. Sciavicco, L. Villani, G. Oriolo. Robotics: Modelling, Planning and Control. "
    "Springer, 2009.",
    "Symon1971": "K. R. Symon. Mechanics, third edition. Addison-Wesley, 1971.",
    "WalkerOrin1982": "M. W. Walker, D. E. Orin. Efficient dynamic computer simulation of robotic mechanisms. "
    "ASME Journal of Dynamic Systems, Measurement, and Control 104(3), 205–211, 1982.",
    "Whitney1972": "D. E. Whitney. The mathematics of coordinated control of prosthetic arms and manipulators. "
    "ASME Journal of Dynamic Systems, Measurement, and Control 94(4), 303–309, 1972.",
}
"""Key → the entry, without marks of Markdown."""

SYMBOLS = (
    ("θ, θ̇, θ̈", "rad, rad/s, rad/s²", "theta, omega, alpha: position, velocity, acceleration of a joint; m for one that slides"),
    ("τ", "N m", "torque of the motors, referred to the joints; N for one that slides"),
    ("V, i", "V, A", "voltage and current of a motor"),
    ("M(θ)", "kg m²", "mass matrix: torques for a unit of each joint's acceleration; the report's H"),
    ("C(θ, θ̇) θ̇", "N m", "torques of centrifugal and Coriolis forces, which grow with speed squared"),
    ("g(θ)", "N m", "torques that gravity asks for at rest; the report's G"),
    ("friction", "N m", "of joints and gears, by the robot's record"),
    ("n", "–", "gear ratio: turns of the motor for one of the joint; 1 is a direct drive"),
    ("Kt", "N m/A", "torque constant of a motor: torque for a unit of current"),
    ("Ke", "V s/rad", "back-EMF constant: voltage that a unit of speed eats up; the same number as Kt, in these units"),
    ("R", "Ω", "resistance of a motor's winding"),
    ("F(θ, θ̇, V)", "rad/s²", "the Forward Arm: the accelerations that these give"),
    ("T, U", "J", "in energy: kinetic and potential energy"),
    ("m, c, g", "kg, m, m/s²", "in energy: mass of a link, its centre of mass, gravitational acceleration"),
    ("A₁ … A_N, T", "–", "in pose: where each joint's frame is in the one before it, and the hand in the base; N joints"),
    ("J(θ)", "m or –", "Jacobian: velocity of the hand for a unit of each joint's velocity"),
    ("v, ω", "m/s, rad/s", "speed of the hand, and how fast it turns"),
    ("v̇₀", "m/s²", "acceleration of the base, by which gravity enters"),
    ("t, T", "s", "in DACOut: time, and DACSampTimePeriod, by which k counts"),
    ("u, θ_ref", "V, A, N m or N; rad", "of a controller: its command to the drives, and the positions that it is asked for"),
    ("q, q_r, e", "rad", "in controllers: theta, the positions asked for, and q_r − q"),
)  # fmt: skip
"""Symbol, unit, meaning."""


def help_page(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`help`, `help TOPIC`."""
    topic = arguments["topic"]
    if topic is None:
        return _contents(session.commands)
    if same(topic) in session.commands:
        return _of_command(session.commands[same(topic)])
    if same(topic) in VARIABLES:
        return _of_variable(session, VARIABLES[same(topic)])
    if same(topic) == "symbols":
        return [Sheet("Symbols of the equations", ("symbol", "unit", "meaning"), SYMBOLS, words=3)]
    kinds = {same(kind): (kind, law) for kind, law in laws().items()}
    if same(topic) in kinds:
        return _of_law(*kinds[same(topic)])
    known = [*(entry.name for entry in (*session.commands.values(), *TABLE)), "symbols", *laws()]
    raise unknown("no such command or variable", topic, known, "help topic")


def _contents(commands: Mapping[str, SessionCommand]) -> list[Output]:
    every = list(dict.fromkeys(commands.values()))
    variables = tuple((v.name, v.unit or "by joint", v.meaning) for v in TABLE)
    report = tuple((c.name, c.summary) for c in every if c.report)
    others = tuple((c.name, c.summary) for c in every if not c.report)
    return [
        Sheet("Variables", ("name", "unit", "meaning"), variables, words=3),
        TextLine(VALUES, "dim"),
        Sheet("Commands of the 1982 report", ("command", "what it does"), report, words=2),
        Sheet("More commands", ("command", "what it does"), others, words=2),
        TextLine(SPELLING),
    ]


def usage(command: SessionCommand) -> str:
    """Form of a command with its arguments: `payload MASS`."""
    parts = [command.name]
    for argument in command.arguments:
        word = "|".join(argument.choices) if argument.choices else argument.name.upper()
        parts.append(word if argument.default is None else f"[{word}]")
    return " ".join(parts) + (" [NAME=VALUE …]" if command.pairs else "")


def _of_command(command: SessionCommand) -> list[Output]:
    output: list[Output] = [TextLine(usage(command), "head"), TextLine(command.summary)]
    rows = tuple((a.name, a.help, "must be given" if a.default is None else a.default) for a in command.arguments)
    if rows:
        output.append(Sheet("", ("argument", "what it is", "default"), rows, words=3))
    if command.name == "controller":
        note = "U is the unit of a joint's command: V, A, N m or N; help joint-pid explains that controller"
        output += [_gains_of_laws(), TextLine(note, "dim")]
    output += _sources(command.equation, command.source)
    if command.example:
        output.append(TextLine(f"example   {command.example}"))
    return output


def _of_variable(session: Workspace, variable: SessionVariable) -> list[Output]:
    unit = " | ".join(dict.fromkeys(variable.units(session.state.arm)))
    form = "one number" if variable.quantity is None else "one number a joint"
    own = 0.0 - float(session.state.loaded.base.gravity[2])
    example = {"m/s²": significant(own), "s": "1 ms"}.get(variable.unit, "0")
    return [
        TextLine(f"{variable.name} [{unit}]", "head"),
        TextLine(f"{variable.meaning}; {form}"),
        *_sources(variable.equation, variable.source),
        TextLine(f"example   {variable.name} = {example}"),
    ]


def _sources(equation: str, source: str) -> list[Output]:
    """An equation, its source, and that source in full."""
    lines = [f"{word}  {text}" for word, text in (("equation", equation), ("source  ", source)) if text]
    lines += [f"          {work}" for work in cited(source)]
    if equation:
        lines.append("letters   help symbols")
    return [TextLine(text) for text in lines]


def gains(law: type) -> dict[str, str]:
    """Gains of a controller that may be typed → meaning and unit, from the docstring of the controller."""
    entries = inspect.getdoc(law) or ""
    entries = inspect.cleandoc(entries.partition("Args:\n")[2].partition("Raises:")[0])
    entries = re.sub(r"\n +", " ", entries)  # continuation lines
    marks = list(ENTRY.finditer(entries))
    ends = [mark.start() for mark in marks[1:]] + [len(entries)]
    meanings: dict[str, str] = {}
    for mark, end in zip(marks, ends, strict=True):
        meanings |= dict.fromkeys(mark["names"].split(", "), entries[mark.end() : end].strip().rstrip("."))
    return {name: meanings.get(name, "") for name in gain_names(law)}


def _gains_of_laws() -> Sheet:
    """Every controller with those of its gains that have a unit."""
    rows = []
    for kind, law in laws().items():
        units = {name: re.search(r"\[.*?\]", meaning) for name, meaning in gains(law).items()}
        rows.append((kind, ", ".join(f"{name} {unit[0]}" for name, unit in units.items() if unit)))
    return Sheet("", ("kind", "gains"), tuple(rows), words=2)


def _of_law(kind: str, law: type) -> list[Output]:
    """A controller: its equation and its gains."""
    equation = (inspect.getdoc(law) or "").partition("Args:\n")[0].strip()
    source = " ".join(f"[{key}]" for key in KEY.findall(sys.modules[law.__module__].__doc__ or ""))
    return [
        TextLine(kind, "head"),
        *(TextLine(line) for line in equation.splitlines()),
        Sheet("", ("gain", "what it is"), tuple(gains(law).items()), words=2),
        *_sources("", source),
        TextLine(f'example   controller {kind} {"=… ".join(needed(law))}=… scale="10 deg"'),
    ]


def needed(law: type) -> list[str]:
    """The required gains of a controller."""
    fields = {field.name: field for field in dataclasses.fields(law)}  # type: ignore[arg-type]
    return [name for name in gains(law) if fields[name].default is dataclasses.MISSING]


def cited(source: str) -> list[str]:
    """The works that a source names, one a line: `CMU report: N. M. Swartz. …`, `[Kutta1901]: W. Kutta. …`."""
    keys = [key for key in KEY.findall(source) if key in SOURCES]
    works = [f"[{key}]: {SOURCES[key]}" for key in dict.fromkeys(keys)]
    return [f"{REPORT}: {SOURCES['SwartzReport']}"] * (REPORT in source) + works


STEPS = (
    ("An arm is links and joints. This one has six joints, and a motor at each of them. Here is all that the session knows of "
     "it: theta are the joints' angles, omega their speeds, alpha their accelerations.", ("show",)),
    ("Stretch it out sideways: the second joint lifts the whole arm. Angles are radians unless you say deg.",
     ("theta = 0", "theta[2] = 90 deg", "theta")),
    ("What must the motors do to hold it still there? The Inverse Arm answers: motion in, torque and voltage out. With omega "
     "and alpha at zero, all that is left is gravity.", ("inverse-arm",)),
    ("Torque and voltage are tied: a motor turns volts into torque, and its own speed eats volts up. Give joint 2 some speed, "
     "the way that its motor pushes: the voltage stays, and less torque is left.",
     ("voltage[2]", "torque[2]", "omega[2] = 0.5", "voltage[2]", "torque[2]", "omega = 0")),
    ("The other way round is the Forward Arm: voltage in, acceleration out. The voltage still holds the arm, so nothing "
     "moves. Take it away, and the arm begins to fall.", ("forward-arm", "voltage = 0", "forward-arm")),
    ("Step by step through time, that is a simulation: here a quarter of a second, in steps of a thousandth. Before it starts, "
     "look at the energy: all of it is height.",
     ("energy", "simulate new steps=250", "print-simulation step=\"50 ms\" what=theta,omega")),
    ("Falling turns height, the potential energy, into speed, the kinetic one. The friction of the joints and the motors, which "
     "brake, take the rest: the sum is less than before the fall.", ("energy",)),
    ("Everything can be taken back, saved and replayed: undo, save, record. help says more, help NAME tells the equation "
     "behind each command, and help symbols its letters. Your own session is as you left it.", ()),
)  # fmt: skip

PAUSE = Argument("pause", "text", "", prompt="Enter goes on, q ends the tour", default="")


def tour(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`tour`: pauses after every step where someone is there to read."""
    lesson = type(session)("cmu-dd")  # type: ignore[call-arg]
    output: list[Output] = []
    show = session.show or output.append
    for k, (text, lines) in enumerate(STEPS, 1):
        show(TextLine(f"\n{k} of {len(STEPS)}. {text}", "head"))
        for line in lines:
            show(TextLine(f"sim> {line}", "good"))
            for part in lesson.run(line):
                show(part)
        ask = session.ask
        if ask is None or k == len(STEPS):
            continue
        try:
            if ask(PAUSE, "").strip().lower().startswith("q"):
                break
        except EOFError:
            break
    return output
