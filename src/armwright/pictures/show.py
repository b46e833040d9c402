"""Picture of an arm, drawn without GPU or display, or a live page in a browser."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from armwright.entry import AnyArm, as_arm
from armwright.errors import OutputError, Problem
from armwright.output import check_destination, whole_file
from armwright.pictures.posed_arm import posed_arm

if TYPE_CHECKING:
    from armwright.pictures.live import LiveArm

ENDINGS = (".png", ".html", ".glb")
SIZE, LEAST, MOST = 900, 120, 4000  # pixels of a PNG's longer side: by default, at least, at most


@dataclass(frozen=True)
class Shown:
    """Result of `show`.

    Attributes:
        path: the picture.   notes: visuals that are drawn in another way than the record has them.
    """

    path: Path
    notes: tuple[Problem, ...]


@overload
def show(arm: AnyArm, path: str | os.PathLike[str], q: Any = None, *, size: int | None = None) -> Shown: ...


@overload
def show(arm: AnyArm, path: None = None, q: Any = None, *, live: Literal[True], port: int = 0) -> LiveArm: ...


def show(
    arm: AnyArm,
    path: str | os.PathLike[str] | None = None,
    q: Any = None,
    *,
    size: int | None = None,
    live: bool = False,
    port: int = 0,
) -> Shown | LiveArm:
    """Draws an arm in one pose: its sections and meshes, or its joints as drums on a stick where it has neither.

    Args:
        arm: the arm.
        path: of the picture: .png, .html (a page with a slider for every joint and all it needs inside) or .glb (a scene
            for other programs, a node for each body); one that is there is replaced.
        q: (n,) [rad | m] the pose; by default 0.   size: pixels of a PNG's longer side; by default 900.
        live: True for a page of this machine that moves as the program says, in place of a file.
        port: of 127.0.0.1, for the live page; 0: one that is free.
    Returns:
        shown: where the picture is, and notes; of a live page its `LiveArm`, with the address.
    Raises:
        ShapeError: q is no pose of the arm.
        OutputError: the picture cannot be written, or not in that size; the port is in use, or no port.
    Example:
        >>> shown = aw.show("two-link", "arm.html", q=[0.3, 0.5])  # a page with sliders
        >>> shown.path.name
        'arm.html'
    """
    arm = as_arm(arm)
    if live:
        from armwright.pictures.live import LiveArm

        for name, value in (("path", path), ("size", size)):
            if value is not None:
                raise OutputError("a live page is no file", place=name, value=value, expected="one or the other")
        return LiveArm(arm, q, port)
    if path is None:
        raise OutputError("missing", place="path", expected=f"a file ({', '.join(ENDINGS)}), or live")
    if port:
        raise OutputError("only a live page has a port", place="port", value=port)
    path = check_destination(path, ENDINGS)
    _check_size(path, size)
    posed = posed_arm(arm, q)
    with whole_file(path, ENDINGS) as temporary:
        if path.suffix.lower() == ".png":
            from armwright.pictures.png import write_png

            write_png(posed, temporary, SIZE if size is None else size)
        else:
            from armwright.pictures.scene import write_glb, write_html

            (write_glb if path.suffix.lower() == ".glb" else write_html)(posed, temporary)
    return Shown(path, posed.notes)


def _check_size(path: Path, size: int | None) -> None:
    if size is not None and path.suffix.lower() != ".png":
        raise OutputError("only a .png has a size", place="size", value=size, file=path)
    if size is not None and (isinstance(size, bool) or not isinstance(size, int) or not LEAST <= size <= MOST):
        expected = f"{LEAST} to {MOST} pixels for the longer side"
        raise OutputError(place="size", value=size, expected=expected, file=path)
