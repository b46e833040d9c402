"""Files of a session: scripts and their recording; `save` and `restore` of the whole state.

A saved state is one NetCDF file: a run like others, with the session as JSON in an attribute.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import numpy as np

import armwright as aw
from armwright.description.content import Content, parse_robot, robot_text
from armwright.errors import SessionError
from armwright.model import build_model
from armwright.output import check_destination
from armwright.reading import read_file
from armwright.results.aliases import SESSION
from armwright.session.controllers import built_controller
from armwright.session.listing import Output, TextLine
from armwright.session.state import ControllerSettings, HandLoad, LoadedArm, SessionState, initial_state
from armwright.session.workspace import Workspace
from armwright.validation import validated

OFF = "off"
LONGEST = 1_000_000  # characters of a script
FORM = 2  # of the attribute's JSON
# In the order of `SessionState`:
VECTORS = ("q", "qd", "qdd", "u", "dac")
TIMES = ("dac_period", "step")


def read_script(file: str) -> list[str]:
    """The lines of a script.

    Raises:
        SessionError: no such file, or none in UTF-8.
    """
    try:
        text = read_file(file, "a script", SessionError).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise SessionError("no text in UTF-8", file=file, expected="a script, one line a command") from None
    if len(text) > LONGEST:
        raise SessionError(f"{len(text)} characters", file=file, expected=f"a script of at most {LONGEST}")
    return text.splitlines()


def run_script(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`run-script FILE`: does its lines as if they were typed; the first one that fails ends it, what came before stays."""
    output: list[Output] = []
    lines = read_script(arguments["file"])
    session.inner_scripts += 1
    try:
        session.run_lines(lines, arguments["file"], session.show or output.append)
    finally:
        session.inner_scripts -= 1
    session.ended = False  # `quit` in a script ends the script
    return output


def record(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`record FILE`: writes all lines so far, and from now on, as a script that replays to the same numbers; `record off`."""
    if arguments["file"] == OFF:
        if session.recording is None:
            raise SessionError("nothing is being recorded", place="record off")
        path, session.recording = session.recording, None
        return [TextLine(f"recorded in {path}", "good")]
    session.recording = check_destination(arguments["file"])
    session.write_recording()
    return [TextLine(f"recording into {session.recording}, from the session's first line", "good")]


def save(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`save FILE.nc`: every variable, the arm's name, payload, controller, lines and the simulation."""
    import xarray as xr

    state, file = session.state, arguments["file"]
    if not str(file).lower().endswith(".nc"):
        raise SessionError(place="save file", value=file, expected="a name that ends in .nc")
    run = xr.Dataset() if state.run is None else state.run.copy()
    run.attrs = {**run.attrs, SESSION: json.dumps(_saved_state(state))}
    aw.save(run, file)
    session.saved = state.run
    return [TextLine(f"wrote {file}", "good")]


def _saved_state(state: SessionState) -> dict[str, Any]:
    loaded, controller = state.loaded, state.controller
    wiring = None
    if controller is not None:
        wiring = {"kind": controller.kind, "settings": controller.gains, "scale": controller.scale}
    return {
        "form": FORM,
        "robot": loaded.robot,
        "record": Content.of(robot_text(loaded.base.record)).model_dump(),
        "gravity": loaded.gravity,
        "payload": None if loaded.payload is None else asdict(loaded.payload),
        "wiring": wiring,
        "lines": list(state.lines),
        **{name: getattr(state, name).tolist() for name in VECTORS},
        **{name: getattr(state, name) for name in TIMES},
    }


def restore(session: Workspace, arguments: dict[str, Any]) -> list[Output]:
    """`restore FILE.nc`: everything as it was saved, the robot's numbers included; an open output file is closed."""
    file = arguments["file"]
    run = aw.load_run(file)
    text = run.attrs.pop(SESSION, None)
    if text is None:
        raise SessionError("no session", file=file, expected="a file that save wrote")
    try:
        record = json.loads(text)
        if record["form"] != FORM:
            raise SessionError(place="form", value=record["form"], expected=f"{FORM}, of this version", file=file)
        loaded = _loaded(record, file)
        values: dict[str, Any] = {name: _vector(record[name], loaded.base.n) for name in VECTORS}
        values |= {name: _time(record[name]) for name in TIMES}
        controller = None if record["wiring"] is None else _controller_settings(record["wiring"])
        lines = tuple(str(line) for line in record["lines"])
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        what = f"not as save wrote it: {type(error).__name__} {error}"
        raise SessionError(what, file=file) from None
    last_run = run if run.sizes else None
    state = initial_state(loaded).replace(**values, controller=controller, run=last_run, lines=lines)
    if controller is not None:
        built_controller(state, controller)
    session.change(state)
    session.saved = last_run
    output: list[Output] = [TextLine(f"restored {loaded.robot} from {file}", "good")]
    if loaded.robot in aw.builtin_names() and robot_text(aw.load(loaded.robot).record) != record["record"]["text"]:
        output.append(
            TextLine(f"the built-in {loaded.robot} has changed since; this session keeps its own numbers", "note")
        )
    return output


def _loaded(record: dict[str, Any], file: str) -> LoadedArm:
    """The arm as it was saved; no other file is read, whatever the saved state names."""
    robot, payload = str(record["robot"]), record["payload"]
    text = validated(Content, record["record"], place="record", file=file, error=SessionError).checked("record", file)
    base = build_model(parse_robot(text, f"{file} ({robot})"))
    if robot in aw.builtin_names() and robot_text(aw.load(robot).record) == text:
        base = aw.load(robot)  # with its looks
    if payload is not None:
        payload = HandLoad(float(payload["mass"]), tuple(payload["com"]), tuple(payload["inertia"]), payload["frame"])
    gravity = None if record["gravity"] is None else float(record["gravity"])
    loaded = LoadedArm(robot, base, gravity, payload)
    _ = loaded.arm
    return loaded


def _controller_settings(record: dict[str, Any]) -> ControllerSettings:
    return ControllerSettings(str(record["kind"]), dict(record["settings"]), tuple(float(s) for s in record["scale"]))


def _vector(values: Any, n: int) -> np.ndarray:
    array = np.array(values, dtype=float)
    if array.shape != (n,) or not np.isfinite(array).all():
        raise ValueError(f"{array.tolist()}, expected {n} finite numbers")
    array.flags.writeable = False
    return array


def _time(value: Any) -> float:
    """A time step [s]."""
    if not (0.0 < float(value) < np.inf):
        raise ValueError(f"{value}, expected a time above 0 [s]")
    return float(value)
