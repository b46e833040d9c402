"""Commands that change the arm: `database-read` loads another one, `payload` puts a body into its hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from armwright.errors import SessionError
from armwright.session.listing import Output, TextLine
from armwright.session.state import HandLoad, initial_state, load_arm
from armwright.session.values import number, split
from armwright.session.variables import payload_text
from armwright.session.workspace import Workspace

NONE = "none"
ORIGIN = "0 0 0"
ROUNDING = 1e-9  # of principal moments: a flat disc's are 1, 1 and 2


def database_read(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`database-read ROBOT`: loads another arm; its vectors start at zero, and it has no simulation yet."""
    state = session.state
    loaded = load_arm(arguments["robot"])
    session.state = initial_state(loaded).replace(
        dac_period=state.dac_period, step=state.step, output_file=state.output_file, lines=state.lines
    )
    arm = loaded.arm
    drives = ", ".join(dict.fromkeys(body.drive.command for body in arm.coordinates))
    line = TextLine(f"{arm.name}: {arm.n} joints {', '.join(arm.names)}; driven by {drives}", "good")
    return [line, *(TextLine(str(warning), "note") for warning in arm.warnings)]


def payload(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`payload MASS [com=…] [inertia=…] [frame=…]`, `payload none`; `payload` alone shows the present one."""
    state = session.state
    if arguments["mass"] is None:
        for name in ("com", "inertia", "frame"):
            if arguments[name] is not None:
                raise SessionError("missing", place="payload mass", expected=f"mass=… beside {name}")
        present = state.loaded.payload
        return [TextLine("the hand is empty" if present is None else payload_text(state, present))]
    if arguments["mass"] == NONE:
        session.state = state.replace(loaded=replace(state.loaded, payload=None))
        return [TextLine("the hand is empty", "good")]
    mass = number("payload mass", arguments["mass"], "kg")
    if mass < 0.0:
        raise SessionError(place="payload mass", value=mass, expected="0 kg or more")
    com = _three("payload com", arguments["com"] or ORIGIN, "m")
    inertia = _three("payload inertia", arguments["inertia"] or ORIGIN, "kg m²")
    if min(inertia) < 0.0 or 2.0 * max(inertia) > sum(inertia) * (1.0 + ROUNDING):
        raise SessionError(
            "no body has these principal moments", place="payload inertia", value=arguments["inertia"],
            expected="none below 0, and none above the sum of the two others",
        )  # fmt: skip
    load = HandLoad(mass, com, inertia, arguments["frame"])
    session.state = state.replace(loaded=replace(state.loaded, payload=load))
    _ = session.state.arm  # refuses now a load that no arm could carry
    return [TextLine(payload_text(session.state, load), "good")]


def _three(place: str, text: str, unit: str) -> tuple[float, float, float]:
    """Three numbers, x y z, in `unit`."""
    parts = split(place, text)
    if len(parts) != 3:
        expected = f'3 values [{unit}], such as "0 0 0.05"'
        raise SessionError(f"{len(parts)} value{'s' * (len(parts) != 1)}", place=place, value=text, expected=expected)
    x, y, z = (number(place, f"{formula} {own}", unit) for formula, own in parts)
    return x, y, z
