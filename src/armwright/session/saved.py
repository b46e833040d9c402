"""`save` and `restore`: the whole state in one NetCDF file. It is a run like others, with the session in an attribute."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

import armwright as aw
from armwright.errors import SessionError
from armwright.session.listing import Line, Shown
from armwright.session.state import LoadedArm, Payload, State, Wiring, load_arm
from armwright.session.wiring import law

if TYPE_CHECKING:
    from armwright.session.session import Session

ATTRIBUTE = "armwright_session"
FORM = 1  # of what the attribute holds
# In the order of `State`:
VECTORS = ("q", "qd", "qdd", "u", "dac")
TIMES = ("dac_period", "step")


def save(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`save FILE.nc`: every variable, the arm's name, payload, controller, lines and the simulation."""
    import xarray as xr

    state, file = session.state, given["file"]
    if not str(file).lower().endswith(".nc"):
        raise SessionError(f"save: {file}: expected a name that ends in .nc")
    run = xr.Dataset() if state.run is None else state.run.copy()
    run.attrs = {**run.attrs, ATTRIBUTE: json.dumps(_record(state))}
    aw.save(run, file)
    return [Line(f"wrote {file}", "good")]


def _record(state: State) -> dict[str, Any]:
    loaded = state.loaded
    return {
        "form": FORM,
        "robot": loaded.robot,
        "digest": loaded.digest,
        "gravity": loaded.gravity,
        "payload": None if loaded.payload is None else asdict(loaded.payload),
        "wiring": None if state.wiring is None else asdict(state.wiring),
        "lines": list(state.lines),
        **{name: getattr(state, name).tolist() for name in VECTORS},
        **{name: getattr(state, name) for name in TIMES},
    }


def restore(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`restore FILE.nc`: everything as it was saved; an open output file is closed."""
    file = given["file"]
    run = aw.load_run(file)
    text = run.attrs.pop(ATTRIBUTE, None)
    if text is None:
        raise SessionError(f"restore: {file}: holds no session; expected a file that save wrote")
    try:
        record = json.loads(text)
        if record["form"] != FORM:
            raise SessionError(
                f"restore: {file}: is of form {record['form']}; expected form {FORM}, which this version writes"
            )
        loaded = _loaded(record)
        vectors = [_vector(record[name], loaded.base.n) for name in VECTORS]
        dac_period, step = (float(record[name]) for name in TIMES)
        wiring = None if record["wiring"] is None else _wiring(record["wiring"])
        lines = tuple(str(line) for line in record["lines"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise SessionError(f"restore: {file}: not what save wrote: {type(error).__name__} {error}") from None
    state = State(
        loaded, *vectors, dac_period=dac_period, step=step, wiring=wiring, run=run if run.sizes else None, lines=lines
    )
    if wiring is not None:
        law(state)
    session.change(state)
    shown: list[Shown] = [Line(f"restored {loaded.robot} from {file}", "good")]
    if loaded.digest != record["digest"]:
        shown.append(Line(f"the record of {loaded.robot} has changed since it was saved: results will differ", "note"))
    return shown


def _loaded(record: dict[str, Any]) -> LoadedArm:
    found = load_arm(str(record["robot"]))
    payload = record["payload"]
    if payload is not None:
        payload = Payload(float(payload["mass"]), tuple(payload["com"]), tuple(payload["inertia"]), payload["frame"])
    gravity = None if record["gravity"] is None else float(record["gravity"])
    loaded = LoadedArm(found.robot, found.base, gravity, payload)
    _ = loaded.arm
    return loaded


def _wiring(record: dict[str, Any]) -> Wiring:
    return Wiring(str(record["kind"]), dict(record["settings"]), tuple(float(s) for s in record["scale"]))


def _vector(values: Any, n: int) -> np.ndarray:
    array = np.array(values, dtype=float)
    if array.shape != (n,):
        raise ValueError(f"shape {array.shape}, expected ({n},)")
    array.flags.writeable = False
    return array
