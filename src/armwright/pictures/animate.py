"""Animation of an arm through a run, in real time.

| ending | content                                                                | read by                                   |
|--------|------------------------------------------------------------------------|-------------------------------------------|
| .glb   | glTF 2.0: the arm's bodies and the motion of its joints                | Blender, three.js, 3-D viewers of systems |
| .html  | a page that plays it, with the reference as a ghost and curves below   | any browser of 2023 or later, offline     |
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.entry import AnyArm, AnyRun, as_arm, as_run
from armwright.errors import RunError
from armwright.model import Model
from armwright.output import check_destination, whole_file
from armwright.pictures.arm_glb import animated_arm
from armwright.results.aliases import PARTIAL
from armwright.results.notes import UNREAL
from armwright.results.plot_curves import describe
from armwright.results.plot_page import PAGES as PLOT_PAGES, PageNumbers, embedded, packed, page, plot_data
from armwright.results.recording import in_order

if TYPE_CHECKING:
    import xarray as xr

ENDINGS = (".glb", ".html")
MOST_TURNS = 1e5  # of a joint in one animation, four keyframes each
PAGES = Path(__file__).parent / "pages"
SCRIPTS = (
    *(PLOT_PAGES / name for name in ("unpack.js", "charts.js")),
    *(PAGES / name for name in ("gltf.js", "stage.js", "player.js")),
)
STYLES = (PLOT_PAGES / "page.css", PAGES / "player.css")


def animate(run: AnyRun, arm: AnyArm, path: str | os.PathLike[str], *, lane: int | None = None) -> None:
    """Writes the arm's motion through a run, as animated glTF or as a page with a player; completely or not at all.

    Bodies look like the visuals of the arm's links; an arm without any is drawn as a figure of its joints. Between
    keyframes the tip is within 10 µm of the motion that the run's rows describe. In the file the arm is called by its name,
    joints' nodes by theirs, the tip's node "tip NAME"; a run of a controlled arm has a second animation, "reference".

    Args:
        run: what `simulate` returned, with q (k, n) [rad | m].   arm: the arm that moved.
        path: the file, ending in .glb or .html.
        lane: which of the run's lanes; needed where there are several.
    Raises:
        RunError: no run, a run of another arm, several lanes and none chosen, rows that are no finite numbers, a mesh
            that is missing or cannot be read.
        OutputError: an unknown ending, a folder that is missing, no permission, a full disk.
    Example:
        >>> run = aw.simulate(aw.Scenario("two-link", 0.2, command=[0.0, 0.0]))
        >>> aw.animate(run, "two-link", "fall.html")
    """
    run = as_run(run)
    arm = as_arm(arm)
    path = check_destination(path, ENDINGS)
    run = one_lane(in_order(run), lane)
    t, motions = drawable_motions(run, arm)
    about = {PARTIAL: str(run.attrs[PARTIAL])} if PARTIAL in run.attrs else {}
    glb = animated_arm(arm, t, motions, about)
    html = path.suffix.lower() == ".html"
    content = _player(run, arm, t, glb, lane).encode("utf-8") if html else glb
    with whole_file(path, ENDINGS) as temporary:
        temporary.write_bytes(content)


def one_lane(run: xr.Dataset, lane: int | None) -> xr.Dataset:
    """The single lane of a run; a run without lanes unchanged.

    Raises:
        RunError: there is no such lane, or several and none chosen.
    """
    if "lane" not in run.dims:
        if lane is not None:
            raise RunError("this run has no lanes", place="lane", value=lane, expected="none")
        return run
    lanes = [int(k) for k in run["lane"].values] if "lane" in run.coords else list(range(run.sizes["lane"]))
    if lane is None and len(lanes) != 1:
        raise RunError(f"the run has {len(lanes)} lanes", place="lane", expected=f"one of {_span(lanes)}")
    if lane is not None and (isinstance(lane, bool) or lane not in lanes):
        raise RunError("no such lane", place="lane", value=lane, expected=f"one of {_span(lanes)}")
    return run.isel(lane=0 if lane is None else lanes.index(lane))


def _span(lanes: list[int]) -> str:
    if len(lanes) > 4 and lanes == list(range(lanes[0], lanes[0] + len(lanes))):
        return f"{lanes[0]} … {lanes[-1]}"
    return ", ".join(map(str, lanes[:20])) + (", …" if len(lanes) > 20 else "")


def drawable_motions(run: xr.Dataset, arm: Model) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times (k,) and the joints' positions (k, n) of the run, and of its reference if it has one.

    Raises:
        RunError: a run of another arm, or rows that cannot be drawn.
    """
    joints = [str(joint) for joint in run["joint"].values]
    if joints != arm.names:
        what = f"the run is of {run.attrs.get('robot', 'another arm')}"
        expected = f"those of {arm.name}: {', '.join(arm.names)}"
        raise RunError(what, place="joint", value=joints, expected=expected)
    for body, kind in zip(arm.coordinates, run["kind"].values, strict=True):
        if kind != body.kind.name:
            expected = f"{body.kind.name}, as it is in {arm.name}"
            raise RunError(place=f"kind of joint {body.joint!r}", value=str(kind), expected=expected)
    if "q" not in run:
        raise RunError("missing", place="q", expected="all variables that simulate returns")
    t, q = np.asarray(run["time"].values, dtype=float), np.asarray(run["q"].values, dtype=float)
    if not len(t):
        raise RunError("the run has no rows", expected="at least one")
    _check_finite(t, q, joints)
    _check_drawable(arm, q)
    motions = {"run": q}
    reference = run.get("q_reference")
    if reference is not None and reference.dims == run["q"].dims and np.isfinite(reference.values).all():
        motions["reference"] = np.asarray(reference.values, dtype=float)
        _check_drawable(arm, motions["reference"])
    return t, motions


def _check_finite(t: np.ndarray, q: np.ndarray, joints: list[str]) -> None:
    if not np.isfinite(q).all():
        row, joint = np.argwhere(~np.isfinite(q))[0]
        what = f"from t = {t[row]:g} s on the simulation diverges"
        place = f"q of joint {joints[joint]!r}"
        raise RunError(what, place=place, value=float(q[row, joint]), expected="a run, or the part of it before")


def _check_drawable(arm: Model, q: np.ndarray) -> None:
    """Refuses positions at which nothing can be seen, and turns that need more keyframes than a viewer plays."""
    for body, positions in zip(arm.coordinates, q.T, strict=True):
        place, farthest = f"q of joint {body.joint!r}", float(np.abs(positions).max())
        if farthest > UNREAL:
            raise RunError(place=place, value=farthest, expected=f"at most {UNREAL:g}")
        turns = float(np.abs(np.diff(positions)).sum()) / (2.0 * np.pi)
        if body.kind.turns and turns > MOST_TURNS:
            raise RunError(f"{turns:.3g} turns", place=place, expected=f"at most {MOST_TURNS:g}")


def _player(run: xr.Dataset, arm: Model, t: np.ndarray, glb: bytes, lane: int | None) -> str:
    plot, numbers = describe(run), PageNumbers()
    about: dict[str, Any] = {**plot_data(plot, numbers), "start": float(t[0]), "duration": float(t[-1] - t[0])}
    title = "" if arm.description is None or not arm.description.title else arm.description.title
    subtitle = " · ".join(filter(None, (title, "" if lane is None else f"lane {lane}", plot.note)))
    words = {"title": f"{arm.name} in motion", "heading": arm.name, "subtitle": subtitle}
    data = {"plot": embedded(about), "numbers": numbers.text(), "arm": packed(glb)}
    return page(PAGES / "player.html", SCRIPTS, STYLES, words, **data)
