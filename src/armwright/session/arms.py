"""What stands before the session: another arm, something in its hand, a controller between DACOut and the motors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import SessionError
from armwright.session.listing import Line, Sheet, Shown, significant
from armwright.session.shown import shown_payload
from armwright.session.state import Payload, load_arm, rest
from armwright.session.values import number, split
from armwright.session.wiring import law, laws, settings, wired

if TYPE_CHECKING:
    from armwright.session.session import Session

NONE = "none"
ORIGIN = "0 0 0"
ROUNDING = 1e-9  # of principal moments: a flat disc's are 1, 1 and 2


def database_read(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`database-read ROBOT`: another arm; its vectors begin at zero, and there is no simulation of it yet."""
    state = session.state
    loaded = load_arm(given["robot"])
    fresh = rest(loaded)
    session.state = fresh.replace(dac_period=state.dac_period, step=state.step, output=state.output, lines=state.lines)
    arm = loaded.arm
    drives = ", ".join(dict.fromkeys(body.drive.command for body in arm.coordinates))
    shown: list[Shown] = [Line(f"{arm.name}: {arm.n} joints {', '.join(arm.names)}; driven by {drives}", "good")]
    return [*shown, *(Line(warning, "note") for warning in arm.warnings)]


def payload(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`payload MASS [com=…] [inertia=…] [frame=…]`, `payload none`; `payload` alone shows what is held."""
    from dataclasses import replace

    state = session.state
    if given["mass"] is None:
        beside = [name for name in ("com", "inertia", "frame") if given[name] is not None]
        if beside:
            raise SessionError(f"payload: mass is missing beside {beside[0]}; expected mass=…")
        held = state.loaded.payload
        return [Line("the hand is empty" if held is None else f"payload: {shown_payload(state, held)}")]
    if given["mass"] == NONE:
        session.state = state.replace(loaded=replace(state.loaded, payload=None))
        return [Line("the hand is empty", "good")]
    mass = number("payload: mass", given["mass"], "kg")
    if mass < 0.0:
        raise SessionError(f"payload: mass = {mass:g} kg: expected 0 or more")
    com = _three("payload: com", given["com"] or ORIGIN, "m")
    inertia = _three("payload: inertia", given["inertia"] or ORIGIN, "kg m²")
    if min(inertia) < 0.0 or 2.0 * max(inertia) > sum(inertia) * (1.0 + ROUNDING):
        raise SessionError(
            f"payload: inertia = {given['inertia']}: no body has these principal moments; expected none below 0, and "
            "none above the sum of the two others"
        )
    held = Payload(mass, com, inertia, given["frame"])
    session.state = state.replace(loaded=replace(state.loaded, payload=held))
    _ = session.state.arm  # refuses now what no arm could hold
    return [Line(f"payload: {shown_payload(session.state, held)}", "good")]


def _three(what: str, text: str, unit: str) -> tuple[float, float, float]:
    parts = split(what, text)
    if len(parts) != 3:
        raise SessionError(
            f'{what}: {len(parts)} value{"s" * (len(parts) != 1)}; expected 3, such as "0 0 0.05" [{unit}]'
        )
    x, y, z = (number(what, f"{formula} {own}", unit) for formula, own in parts)
    return x, y, z


def controller(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`controller KIND scale=… GAIN=…`: what DACOut's reference input is wired to; `controller none` wires it to the motors."""
    state, kind = session.state, given["kind"]
    if kind is None:
        return _told(session)
    if kind == NONE:
        if given["pairs"] or given["scale"]:
            raise SessionError("controller none: takes no gains")
        session.state = state.replace(wiring=None, dac=np.zeros(state.arm.n))
        return [Line("DACOut is wired to the motors", "good")]
    session.state = state.replace(wiring=wired(state, kind, given["scale"], given["pairs"]), dac=np.zeros(state.arm.n))
    return _told(session)


def _told(session: Session) -> list[Shown]:
    wiring = session.state.wiring
    if wiring is None:
        rows = tuple(
            (name, " ".join(fields)) for name, fields in ((name, settings(kind)) for name, kind in laws().items())
        )
        return [
            Line("DACOut is wired to the motors; there is no controller"),
            Sheet("controllers", ("kind", "gains"), rows, words=2),
        ]
    law(session.state)
    gains = ", ".join(f"{name} = {text}" for name, text in wiring.settings.items())
    units = ["m" if body.kind == "prismatic" else "rad" for body in session.state.arm.coordinates]
    scale = ", ".join(f"{significant(s)} {unit}/V" for s, unit in dict.fromkeys(zip(wiring.scale, units, strict=True)))
    return [Line(f"DACOut asks {wiring.kind} for positions, {scale}; {gains}", "good")]
