"""Capsules around the links of an arm: segments with a radius that enclose the links' shapes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from armwright import scalar
from armwright.description.robot import Link
from armwright.entry import AnyArm, as_arm
from armwright.errors import DescriptionError, ModelError, RunError, check_known
from armwright.model import BASE, Model
from armwright.solids.mesh import Mesh
from armwright.solids.shapes import Box, Prism
from armwright.solids.surface import surface
from armwright.spatial import Placement

LARGER = 1.0 + 1e-9  # so that rounding leaves no point outside
ROUND = 1.005  # by which the corners of a round solid's flat sides go outward, so that they hold it
FLAT = (Box, Prism, Mesh)


@dataclass(frozen=True, eq=False)
class Capsule:
    """All points within `radius` [m] of the segment between a and b, each (3,) [m] in the frame of a link.

    The frame is that of `forward_kinematics(arm, q, frame=capsule.link)`. Links that are fixed to another count as that one.
    """

    link: str
    body: int  # index of the moving body that carries the link, or BASE
    a: np.ndarray
    b: np.ndarray
    radius: float

    @property
    def volume(self) -> float:
        """[m³]."""
        return np.pi * self.radius**2 * (float(np.linalg.norm(self.b - self.a)) + 4.0 / 3.0 * self.radius)


def link_capsules(arm: AnyArm, radius: float | Mapping[str, float] | None = None, most: int = 3) -> tuple[Capsule, ...]:
    """Capsules around an arm's links, at most `most` for each link: from its shapes if it has any, else from joint to joint.

    Args:
        arm: the arm.
        radius: [m] of the links that have no shapes, from the axis of their joint to those of the next ones and to the frames
            that they carry; one number, or link → number. No number is assumed.
        most: capsules of a link; a link of many shapes has those joined whose common capsule adds the least volume.
    Returns:
        capsules: in the order of the links.
    Raises:
        ModelError: a link without shapes and without radius, a name that is no link.   RunError: a mesh that cannot be read.
    Example:
        >>> len(aw.collision.link_capsules("puma560", radius=0.06))
        6
    """
    arm = as_arm(arm)
    links = {link.name: link for link in arm.description.links} if arm.description is not None else {}
    for name in radius if isinstance(radius, Mapping) else ():
        check_known(ModelError, name, links, place="radius", expected="a link")
    capsules: list[Capsule] = []
    for body in (BASE, *range(len(arm.bodies))):
        label = arm.bodies[body].link if body != BASE else base_link(arm)
        carried = [link for name, link in links.items() if arm.frames[name].body == body]
        clouds = [cloud for link in carried for cloud in _visual_points(arm, link)]
        if clouds:
            found = [_refined(label, body, cloud) for cloud in _joined(clouds, most)]
        elif segments := _skeleton(arm, body):
            size = _given_radius(arm, label, radius)
            found = [Capsule(label, body, a, b, size) for a, b in segments]
        else:
            continue
        # from the body's frame, which stands on its joint, into the link's
        into = arm.frames[label].placement.inverse()
        capsules += [replace(each, a=_point(into, each.a), b=_point(into, each.b)) for each in found]
    return tuple(capsules)


def base_link(arm: Model) -> str:
    """Name of the link that stands still."""
    return "base" if arm.description is None else arm.description.base


def _point(placement: Placement, point: np.ndarray) -> np.ndarray:
    """(3,) floats."""
    return np.asarray(placement.point(point), dtype=float)


def _given_radius(arm: Model, link: str, radius: float | Mapping[str, float] | None) -> float:
    size = radius.get(link) if isinstance(radius, Mapping) else radius
    if size is None:
        what = f"the record has no shapes of link {link!r}"
        raise ModelError(what, place="radius", expected="a radius [m] of the links without shapes", file=arm.name)
    number = scalar.real_number(size)
    if number is None or not 0.0 < number < np.inf:
        raise ModelError(place="radius", value=size, expected="a number above 0 [m]", file=arm.name)
    return number


def bounding_capsule(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """A small capsule that holds points (k, 3) [m]: the two ends (3,) of its segment and its radius [m].

    About the line through the middle of their extents along one of their principal axes or of the frame's, whichever gives
    the least volume.
    """
    centred = points - points.mean(axis=0)
    axes = np.vstack([np.linalg.svd(centred, full_matrices=False)[2], np.eye(3)])
    return min((_about(points, axis) for axis in axes), key=_volume)


def _about(points: np.ndarray, axis: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    along = points @ axis
    across = points - along[:, None] * axis
    middle = 0.5 * (across.min(axis=0) + across.max(axis=0))
    middle -= (middle @ axis) * axis
    away = np.linalg.norm(across - middle, axis=1)
    behind = np.sqrt(np.maximum(away.max() ** 2 - away**2, 0.0))  # how far behind an end a point may lie
    low, high = (along + behind).min(), (along - behind).max()
    if low > high:
        low = high = 0.5 * (low + high)
    a, b = middle + low * axis, middle + high * axis
    return a, b, _radius(points, a, b)


def _radius(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance [m] of points (k, 3) from the segment a to b."""
    along = b - a
    t = np.clip((points - a) @ along / max(float(along @ along), 1e-30), 0.0, 1.0)
    return float(np.linalg.norm(points - a - t[:, None] * along, axis=1).max()) * LARGER


def _volume(capsule: tuple[np.ndarray, np.ndarray, float]) -> float:
    a, b, radius = capsule
    return radius**2 * (float(np.linalg.norm(b - a)) + 4.0 / 3.0 * radius)


def _refined(link: str, body: int, points: np.ndarray) -> Capsule:
    """The capsule after a search for the ends with the least volume."""
    from scipy.optimize import minimize

    a, b, radius = bounding_capsule(points)

    def volume(ends: np.ndarray) -> float:
        return _volume((ends[:3], ends[3:], _radius(points, ends[:3], ends[3:])))

    found = minimize(volume, np.r_[a, b], method="Nelder-Mead", options={"maxiter": 600, "xatol": 1e-5, "fatol": 0.0})
    if found.fun < _volume((a, b, radius)):
        a, b = found.x[:3], found.x[3:]
    return Capsule(link, body, a, b, _radius(points, a, b))


def _joined(clouds: list[np.ndarray], most: int) -> list[np.ndarray]:
    """At most `most` clouds of points, the ones joined first whose common capsule adds the least volume."""
    clouds = [_hull(each) for each in clouds]
    volumes = [_volume(bounding_capsule(each)) for each in clouds]
    added = {
        (i, j): _volume(bounding_capsule(np.vstack([clouds[i], clouds[j]]))) - volumes[i] - volumes[j]
        for i, j in combinations(range(len(clouds)), 2)
    }
    left = set(range(len(clouds)))
    while added and (len(left) > most or min(added.values()) <= 0.0):
        i, j = min(added, key=added.__getitem__)
        clouds.append(_hull(np.vstack([clouds[i], clouds[j]])))
        volumes.append(volumes[i] + volumes[j] + added[i, j])
        left -= {i, j}
        k = len(clouds) - 1
        added = {pair: value for pair, value in added.items() if not {i, j} & set(pair)}
        for other in left:
            together = _volume(bounding_capsule(np.vstack([clouds[other], clouds[k]])))
            added[other, k] = together - volumes[other] - volumes[k]
        left.add(k)
    return [clouds[i] for i in sorted(left)]


def _hull(points: np.ndarray) -> np.ndarray:
    """Corners of the convex hull; the points themselves where they lie in a plane."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return points[ConvexHull(points).vertices]
    except QhullError:
        return np.unique(points, axis=0)


def _visual_points(arm: Model, link: Link) -> Iterator[np.ndarray]:
    """For each solid of a link, corners (k, 3) [m] that hold it, in the frame of the body that carries the link."""
    for visual in link.visuals:
        if visual.hole:
            continue
        try:
            corners = np.asarray(surface(visual.solid).vertices, dtype=float)
        except DescriptionError as error:
            raise RunError.of(*error.problems).within(f"link {link.name!r}", arm.name) from None
        corners = corners if isinstance(visual.solid, FLAT) else ROUND * corners
        at = (arm.frames[link.name].placement @ visual.placement()).matrix().astype(float)
        yield corners @ at[:3, :3].T + at[:3, 3]


def _skeleton(arm: Model, body: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Segments from a body's origin to those of the bodies that it carries, and to the tip; none of a base alone."""
    ends = [other.placement.position for other in arm.bodies if other.parent == body] if body != BASE else []
    if arm.tip is not None and arm.frame().body == body:
        ends.append(arm.frame().placement.position)
    if body != BASE and not ends:
        ends = [np.zeros(3)]
    return [(np.zeros(3), np.asarray(end, dtype=float)) for end in ends]
