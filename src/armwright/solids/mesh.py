"""A solid from a mesh file (STL, OBJ, PLY): volume, centre and inertia from its closed surface, through trimesh."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import os
import struct
import warnings
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import Field, PrivateAttr, ValidationInfo, model_validator

from armwright.errors import DescriptionError
from armwright.quantity import Scale3
from armwright.reading import read_file, real_path
from armwright.solids.moments import Moments
from armwright.solids.solid import SolidRecord
from armwright.validation import Invalid

if TYPE_CHECKING:
    import trimesh


CLOSED = "a closed surface that does not cross itself"
UNREADABLE = (  # exceptions of trimesh's readers on a broken file
    *(ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RuntimeError, OSError, struct.error),
    NameError,  # of a name that a branch should have set
    ImportError,  # COLLADA (.dae) without pycollada
)


FARTHEST = 1e12  # units of the file, and m: no robot has a vertex beyond it
FLAT = 1e-12  # of the cube of a mesh's size: a smaller volume counts as 0
SPOT = 1e-8  # of a mesh's size: vertices nearer to each other than this are merged


class Mesh(SolidRecord):
    """A closed surface from a file, in the file's own frame.

    `file` is a path relative to the robot file that names it, and never leads out of that file's folder.
    """

    shape: Literal["mesh"] = Field(description="Kind of solid.")
    file: str = Field(min_length=1, description="Path of the mesh, relative to this file and below its folder.")
    scale: Scale3 = Field(description="Metres per unit of the mesh file: 0.001 where that is in mm; or 3 of them.")
    _folder: Path | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _inside(self, info: ValidationInfo) -> Mesh:
        folder = (info.context or {}).get("folder")
        if folder is None:
            return self  # written in Python: the path is the caller's
        base = Path(folder).resolve()
        if "\0" in self.file or Path(self.file).is_absolute() or not real_path(base / self.file).is_relative_to(base):
            what = f"leads out of {os.fspath(folder)!r}"
            raise Invalid(what, place="file", value=self.file, expected="a path below it")
        self._folder = base
        return self

    @property
    def path(self) -> Path:
        """Path of the mesh: below the folder of the file that named it."""
        return Path(self.file) if self._folder is None else self._folder / self.file

    def surface(self) -> trimesh.Trimesh:
        """The mesh, in metres; a mirroring scale keeps the faces outward.

        Raises:
            DescriptionError: no such file, or nothing in it that can be read as a mesh.
        """
        try:
            surface = _read(self.path, _stamp(self.path)).copy()
        except DescriptionError as error:
            raise self._error(error.what, error.expected) from None
        scale = np.array(self.scale)
        with np.errstate(over="ignore", invalid="ignore"):
            surface.vertices *= scale
        if not (np.abs(surface.vertices) < FARTHEST).all():
            raise self._error(
                f"with scale {scale.tolist()} a vertex is beyond {FARTHEST:g} m", "a mesh of a robot's size"
            )
        if np.sign(scale).prod() < 0:
            surface.invert()
        return surface

    def moments(self) -> Moments:
        """Sums over the tetrahedra between the origin and each triangle.

        Raises:
            DescriptionError: an open mesh, one whose faces cross or disagree on the outside, one with a shell in another
            that counts twice, or one of no volume.
        """
        from armwright.solids.self_intersection import crossing_faces
        from armwright.solids.shells import misplaced_shell

        surface = self.surface()
        if not len(surface.faces) or not surface.is_watertight:
            raise self._error("an open mesh has no volume", CLOSED)
        if not surface.is_winding_consistent:
            raise self._error("its faces disagree on which side is out", CLOSED)
        crossing = crossing_faces(np.asarray(surface.triangles))
        if crossing is not None:
            one, two = (surface.triangles[face].mean(axis=0).round(6).tolist() for face in crossing)
            raise self._error(f"faces cross near {one} and {two} m", CLOSED)
        misplaced = misplaced_shell(surface)
        if misplaced is not None:
            place, count = misplaced[0].round(6).tolist(), misplaced[1]
            fault = "points inward and lies in nothing"
            if count > 0:
                fault = f"lies in another: its inside counts {count} times"
            raise self._error(
                f"the shell about {place} m {fault}", "separate solids, and cavities whose faces point inward"
            )
        a, b, c = np.moveaxis(np.asarray(surface.triangles) - surface.vertices.mean(axis=0), 1, 0)
        volume = float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6
        if not abs(volume) > FLAT * float(np.ptp(surface.vertices, axis=0).max()) ** 3:
            raise self._error(f"a volume of {volume:.3g} m³", "a solid")
        from trimesh.triangles import mass_properties

        body = mass_properties(surface.triangles, crosses=surface.triangles_cross, density=1.0)
        return Moments.of_tensor(abs(volume), body.center_mass, body.inertia * np.sign(volume))

    def _error(self, what: str, expected: str) -> DescriptionError:
        return DescriptionError(what, place=" mesh", value=self.file, expected=expected)


def _stamp(path: Path) -> tuple[int, int]:
    try:
        stat = path.stat()
    except OSError as error:
        raise DescriptionError(f"cannot be read: {error.strerror}") from None
    return stat.st_mtime_ns, stat.st_size


@lru_cache(maxsize=64)
def _read(path: Path, stamp: tuple[int, int]) -> trimesh.Trimesh:
    """The mesh in a file, its equal vertices merged; `stamp` is the file's state, so that a changed file is read again."""
    import trimesh

    kind = path.suffix.lower().removeprefix(".")
    if kind not in ("stl", "obj", "ply", "dae"):
        raise DescriptionError("no kind of mesh that is read", expected=".stl, .obj, .ply or .dae")
    if kind == "dae" and importlib.util.find_spec("collada") is None:
        raise DescriptionError(
            "COLLADA is read through pycollada, which is not installed: pip install armwright[meshes]"
        )
    content = read_file(path, "a mesh", DescriptionError)
    try:
        with _silenced():
            # From memory, so that no materials or textures beside it are opened.
            mesh = trimesh.load_mesh(io.BytesIO(content), file_type=kind, process=False)
    except UNREADABLE as error:
        first = (str(error).splitlines() or [type(error).__name__])[0]
        raise DescriptionError(f"not a mesh that can be read: {first}") from None
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise DescriptionError("holds no triangles", expected="a mesh")
    vertices, faces = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise DescriptionError("not a mesh that can be read", expected="triangles of points x, y, z")
    if not (np.isfinite(vertices).all() and np.abs(vertices).max() < FARTHEST):
        raise DescriptionError("a vertex is not a finite point")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise DescriptionError("a face names a vertex that does not exist")
    return trimesh.Trimesh(*_merged(vertices, faces), process=False)


def _merged(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices in one place are merged, since an STL repeats them for each triangle; triangles without area are left out."""
    size = float(np.ptp(vertices, axis=0).max()) or 1.0
    _, first, which = np.unique(np.rint(vertices / (SPOT * size)), axis=0, return_index=True, return_inverse=True)
    faces = which.reshape(-1)[faces]
    sound = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return vertices[first], faces[sound]


@contextlib.contextmanager
def _silenced() -> Iterator[None]:
    """Suppresses trimesh's log and NumPy's warnings about broken files; the result is checked here."""
    import logging

    logger = logging.getLogger("trimesh")
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)
