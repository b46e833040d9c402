"""`tour`: a first lesson in robot dynamics; what it says is done before the reader's eyes, in a session of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from armwright.session.arguments import Argument
from armwright.session.listing import Line, Shown

if TYPE_CHECKING:
    from armwright.session.session import Session

STEPS = (
    ("An arm is links and joints. This one has six joints, and a motor at each of them. Here is all that the session knows of "
     "it: theta are the joints' angles, omega their speeds, alpha their accelerations.", ("show",)),
    ("Stretch it out sideways: the second joint lifts the whole arm. Angles are radians unless you say deg.",
     ("theta = 0", "theta[2] = 90 deg", "theta")),
    ("What must the motors do to hold it still there? The Inverse Arm answers: motion in, torque and voltage out. With omega "
     "and alpha at zero, all that is left is gravity.", ("inverse-arm",)),
    ("Torque and voltage are tied: a motor turns volts into torque, and its own speed eats volts up. Give joint 2 some speed, "
     "the way that its motor pushes: the voltage stays, and less torque is left.",
     ("voltage[2]", "torque[2]", "omega[2] = -0.5", "voltage[2]", "torque[2]", "omega = 0")),
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


def tour(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`tour`: pauses after every step where someone is there to read."""
    lesson = type(session)("cmu-dd")
    kept: list[Shown] = []
    say = session.tell or kept.append
    for k, (text, lines) in enumerate(STEPS, 1):
        say(Line(f"\n{k} of {len(STEPS)}. {text}", "head"))
        for line in lines:
            say(Line(f"sim> {line}", "good"))
            for shown in lesson.run(line):
                say(shown)
        ask = session.ask
        if ask is None or k == len(STEPS):
            continue
        try:
            if ask(PAUSE, "").strip().lower().startswith("q"):
                break
        except EOFError:
            break
    return kept
