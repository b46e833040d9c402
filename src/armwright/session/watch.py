"""`watch`: a local browser page that shows the arm at theta and plays each simulation."""

from __future__ import annotations

from typing import Any

import armwright as aw
from armwright.session.listing import Output, TextLine
from armwright.session.workspace import Workspace

NO_BROWSER = "no browser was found; open the address in one"


def watch(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`watch`, `watch off`: opens or closes the page; if already open, `watch` shows its address."""
    if arguments["state"] == "off":
        closed = session.live is not None
        session.stop_watching()
        return [TextLine("the page is closed" if closed else "no page is open", "good" if closed else "plain")]
    if session.live is None:
        session.live = aw.show(session.state.arm, q=session.state.q, live=True)
    lines: list[Output] = [TextLine(f"{session.state.arm.name} is at {session.live.url}", "good")]
    lines += [TextLine(str(note), "note") for note in session.live.notes]
    if arguments["open"] == "yes" and not session.live.open():
        lines.append(TextLine(NO_BROWSER, "note"))
    return lines
