"""A shaded picture of triangles on the ground, in NumPy: no GPU, no display.

Lambert's law and Blinn's highlight under one soft-shadowed light and the sky, averaged over four points a pixel. [Blinn1977]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright.pictures.raster import NOTHING, Seen, raster

FINE = 2  # points a pixel's side
SHADOW = 1100  # points of the shadow map's side
SOFT = 2  # neighbours of a point of the shadow map that soften its edge
LIGHT = np.array([0.45, -0.55, 0.95])  # left, back and up: direction to the light, which turns with the camera about z
SKY, GROUND, PAPER = np.array([0.95, 0.97, 1.0]), np.array([0.93, 0.92, 0.9]), np.array([1.0, 1.0, 1.0])
AMBIENT, DIRECT, SHINE, GLOSS = 0.56, 0.62, 0.14, 36.0
VEIL = 0.45  # how light the ground's own grey is: darker than white paper, lighter than dark paper
LINE, DARK = 0.16, 0.30  # share by which the grid's lines and shadows on the ground are darker
EDGE = 0.62  # brightness where a body ends
RIM = 0.1  # of the picture's width: within that of its border ground and shadow fade to paper


@dataclass(frozen=True, eq=False)
class Camera:
    """Looks at a point from a direction, with perspective.

    Attributes:
        rotation: (3, 3), rows right, down and forward on the screen.   eye: (3,) [m].
        focal: [pixel].   width, height: [pixel].   lift: height of the view's axis above the middle [pixel].
    """

    rotation: np.ndarray
    eye: np.ndarray
    focal: float
    width: int
    height: int
    lift: float = 0.0

    @property
    def centre(self) -> np.ndarray:
        """(2,) [pixel]: the view's axis on the screen."""
        return np.array([0.5 * self.width, 0.5 * self.height - self.lift])

    def project(self, points: np.ndarray) -> np.ndarray:
        """Points (…, 3) [m] on the screen: x, y [pixel] and nearness 1/depth [1/m]."""
        seen = (points - self.eye) @ self.rotation.T
        depth = np.maximum(seen[..., 2], 1e-6)
        return np.concatenate(
            [self.focal * seen[..., :2] / depth[..., None] + self.centre, 1 / depth[..., None]], axis=-1
        )

    def directions(self) -> np.ndarray:
        """(height, width, 3): unit vectors through the pixels."""
        x = (np.arange(self.width) + 0.5 - self.centre[0]) / self.focal
        y = (np.arange(self.height) + 0.5 - self.centre[1]) / self.focal
        rays = np.stack([*np.meshgrid(x, y), np.ones((self.height, self.width))], axis=-1) @ self.rotation
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def camera(
    points: np.ndarray, azimuth: float, elevation: float, width: int, height: int, field: float = 0.42
) -> Camera:
    """Camera that just sees all points (k, 3) [m] from a direction [rad]; `field` is the angle of view [rad]."""
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    forward = -np.array([ca * ce, sa * ce, se])
    right = np.array([-sa, ca, 0.0])
    rotation = np.array([right, np.cross(forward, right), forward])
    focal = 0.5 * min(width, height) / np.tan(0.5 * field)
    low, high = points.min(axis=0), points.max(axis=0)
    seen = (points - 0.5 * (low + high)) @ rotation.T
    eye = np.array([0.0, 0.0, -4 * float(np.linalg.norm(high - low)) - 1e-3])
    for _ in range(11):  # towards where the points fill the screen; depth changes with every step
        depth = seen - eye
        screen = focal * depth[:, :2] / np.maximum(depth[:, 2:], 1e-6)
        bottom, top = screen.min(axis=0), screen.max(axis=0)
        eye[:2] += 0.5 * (bottom + top) / focal * -eye[2]
        eye[2] *= max(float(np.max((top - bottom) / (width, height))), 1e-3)
    return Camera(rotation, 0.5 * (low + high) + eye @ rotation, focal, width, height)


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Triangles to be drawn.

    Attributes:
        corners: (t, 3, 3) [m].   normals: (t, 3, 3).   colours: (t, 3), from 0 to 1.
        bodies: (t,) to which they belong: an edge is drawn between two.
    """

    corners: np.ndarray
    normals: np.ndarray
    colours: np.ndarray
    bodies: np.ndarray


def render(surfaces: Surfaces, view: Camera, floor: float, grid: float) -> np.ndarray:
    """The picture (height, width, 4), from 0 to 1: bodies opaque, the ground as a veil that suits light and dark paper.

    Args:
        surfaces: the triangles.   view: the camera.   floor: z of the ground [m].   grid: spacing of its lines [m].
    """
    sizes = (FINE * size for size in (view.focal, view.width, view.height, view.lift))
    fine = Camera(view.rotation, view.eye, *sizes)  # type: ignore[arg-type]
    seen = raster(fine.project(surfaces.corners), fine.width, fine.height)
    rays = fine.directions()
    light = _light(view)
    shadow = _Shadow(surfaces.corners, light)
    image = _ground(fine, rays, seen, shadow, floor, grid)
    lit = seen.triangle != NOTHING
    image[lit] = _bodies(surfaces, seen, lit, fine, rays, light, shadow)
    image = np.where((_edges(surfaces, seen) & lit)[..., None], EDGE * image, image)
    # on white paper it is `image` again
    cover = np.where(lit, 1.0, (PAPER - image).max(axis=2) / (1.0 - VEIL))[..., None]
    inked = np.concatenate([image - PAPER * (1.0 - cover), cover], axis=2)
    small = inked.reshape(view.height, FINE, view.width, FINE, 4).mean(axis=(1, 3))
    colour = small[..., :3] / np.maximum(small[..., 3:], 1e-9)
    return np.clip(np.concatenate([colour, small[..., 3:]], axis=2), 0.0, 1.0)


def _light(view: Camera) -> np.ndarray:
    """Unit vector towards the light: from the left behind the camera, above."""
    right, back = view.rotation[0], -view.rotation[2]
    level = np.array([back[0], back[1], 0.0]) / max(float(np.hypot(back[0], back[1])), 1e-9)
    towards = -LIGHT[0] * right - LIGHT[1] * level + np.array([0.0, 0.0, LIGHT[2]])
    return towards / np.linalg.norm(towards)


class _Shadow:
    """Shadow map: the points nearest to the light; a point behind them is in the dark."""

    def __init__(self, corners: np.ndarray, light: np.ndarray):
        side = np.cross(light, (0.0, 0.0, 1.0))
        side = side / max(float(np.linalg.norm(side)), 1e-9)
        self.rotation = np.array([side, np.cross(light, side), light])
        flat = corners.reshape(-1, 3) @ self.rotation.T
        self.low = flat[:, :2].min(axis=0)
        self.size = max(float(np.ptp(flat[:, :2], axis=0).max()), 1e-9)
        self.map = raster(self._placed(corners), SHADOW, SHADOW).nearness.reshape(-1)
        self.bias = 3.5 * self.size / SHADOW

    def foot(self, floor: float) -> np.ndarray:
        """(2,) [m]: the middle of the bodies, moved along the light down to the ground."""
        middle = (self.low + 0.5 * self.size) @ self.rotation[:2]
        return (middle + self.rotation[2] * (floor - middle[2]) / self.rotation[2, 2])[:2]

    def _placed(self, points: np.ndarray) -> np.ndarray:
        turned = points @ self.rotation.T
        turned[..., :2] = (turned[..., :2] - self.low) / self.size * (SHADOW - 4 * SOFT - 4) + 2 * SOFT + 2
        return turned

    def share(self, points: np.ndarray) -> np.ndarray:
        """Share of the light that reaches points (k, 3) [m], from 0 to 1."""
        placed = self._placed(points)
        column, row = (np.floor(placed[:, k]).astype(int) for k in (0, 1))
        near = np.flatnonzero((np.minimum(column, row) >= SOFT) & (np.maximum(column, row) < SHADOW - SOFT))
        place, height = row[near] * SHADOW + column[near], placed[near, 2] + self.bias
        total = np.zeros(len(near))
        steps = range(-SOFT, SOFT + 1)
        for dx in steps:
            for dy in steps:
                total += height >= self.map[place + (dy * SHADOW + dx)]
        share = np.ones(len(points))
        share[near] = total / len(steps) ** 2
        return share


def _bodies(
    surfaces: Surfaces, seen: Seen, lit: np.ndarray, view: Camera, rays: np.ndarray, light: np.ndarray, shadow: _Shadow
) -> np.ndarray:
    names, weights = seen.triangle[lit], seen.weights[lit]
    corners, ray = surfaces.corners[names], rays[lit]
    depth = (corners - view.eye) @ view.rotation[2]
    weights = weights / depth  # linear in space, where it was linear on the screen
    weights /= weights.sum(axis=1, keepdims=True)
    points = np.einsum("kc,kci->ki", weights, corners)
    normals = np.einsum("kc,kci->ki", weights, surfaces.normals[names])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    facing = np.einsum("ki,ki->k", normals, ray)
    normals = np.where(facing[:, None] > 0, -normals, normals)
    direct = np.maximum(normals @ light, 0.0)
    reached = shadow.share(points + 1.5 * shadow.bias * normals)
    half = light - ray
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    shine = np.maximum(np.einsum("ki,ki->k", normals, half), 0.0) ** GLOSS
    sky = AMBIENT * (0.68 + 0.32 * normals[:, 2:])
    rim = 0.1 * (1 - np.abs(facing[:, None])) ** 3
    colours = surfaces.colours[names]
    return colours * (sky * SKY + (DIRECT * direct * reached)[:, None]) + SHINE * (shine * reached)[:, None] + rim


def _ground(view: Camera, rays: np.ndarray, seen: Seen, shadow: _Shadow, floor: float, grid: float) -> np.ndarray:
    """Background: paper that fades into a grid around the arm, with the arm's shadow."""
    image = np.broadcast_to(PAPER, rays.shape).copy()
    centre = shadow.foot(floor)
    below = np.flatnonzero((rays[..., 2].ravel() < -1e-4) & (seen.triangle.ravel() == NOTHING))
    ray = rays.reshape(-1, 3)[below]
    points = view.eye + ray * ((floor - view.eye[2]) / ray[:, 2:])
    away = np.hypot(*(points[:, :2] - centre).T) / (0.75 * shadow.size)
    close = away < 1.25
    below, ray, points = below[close], ray[close], points[close]
    fade = (1.25 - away[close])[:, None].clip(0.0, 1.0) ** 1.5
    thick = np.linalg.norm(points - view.eye, axis=1) / view.focal * 0.8 / np.maximum(-ray[:, 2], 0.2)
    off = np.abs(points[:, :2] / grid - np.rint(points[:, :2] / grid)).min(axis=1) * grid
    line = np.clip(1.5 - off / thick, 0.0, 1.0)[:, None]
    colour = (PAPER + (GROUND - PAPER) * fade) * (1 - LINE * line * fade)
    dark = np.clip(1.25 - away[close], 0.0, 0.5)[:, None] * 2 * (1 - shadow.share(points)[:, None])
    row, column = np.divmod(below, view.width)
    inside = np.minimum.reduce([row, column, view.height - 1 - row, view.width - 1 - column])
    strength = np.clip(inside / (RIM * view.width), 0.0, 1.0)[:, None]
    image.reshape(-1, 3)[below] = PAPER + (colour * (1 - DARK * dark) - PAPER) * strength
    return image


def _edges(surfaces: Surfaces, seen: Seen) -> np.ndarray:
    """True at pixels where a body ends, or one part of it is well before another."""
    bodies = np.where(seen.triangle == NOTHING, -1, surfaces.bodies[seen.triangle])
    nearness = np.where(np.isfinite(seen.nearness), seen.nearness, 0.0)
    edges = np.zeros(bodies.shape, dtype=bool)
    for body, near, edge in ((bodies, nearness, edges), (bodies.T, nearness.T, edges.T)):  # rows, then columns
        step = np.abs(near[1:] - near[:-1]) > 0.02 * np.maximum(near[1:], near[:-1])
        jump = (body[1:] != body[:-1]) | step
        edge[1:] |= jump
        edge[:-1] |= jump
    return edges
