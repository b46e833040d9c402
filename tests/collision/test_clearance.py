"""Clearance of arms: capsules hold the shapes, kernels are the function on floats, and what is refused."""

from functools import cache

import numpy as np
import pytest

import armwright as aw
from armwright.collision.capsules import bounding_capsule, link_capsules
from armwright.errors import ModelError, ScenarioError, ShapeError
from armwright.kinematics.forward_kinematics import body_placements
from armwright.solids.surface import surface
from raises_at import raises_at

FLOOR = aw.collision.PlaneObstacle((0, 0, -0.2), (0, 0, 2), name="floor")
TABLE = aw.collision.BoxObstacle((0.4, 0.6, 0.1), (0.7, 0.2, 0.1), (0, 0, 0.5), name="table")
BALL = aw.collision.SphereObstacle(0.1, (0.4, -0.5, 0.6), name="ball")


@cache
def puma():
    return aw.collision.clearance(aw.load("puma560"), (FLOOR, TABLE, BALL), radius=0.06)


@pytest.mark.parametrize("seed", range(20))
def test_a_bounding_capsule_holds_its_points(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(rng.integers(1, 60), 3)) * rng.uniform(0, 1, 3) + rng.normal(size=3)
    a, b, radius = bounding_capsule(points)
    along = b - a
    t = np.clip((points - a) @ along / max(along @ along, 1e-30), 0, 1)
    assert np.linalg.norm(points - a - t[:, None] * along, axis=1).max() <= radius


def test_a_cylinder_s_capsule_is_not_much_larger():
    turn = np.linspace(0, 2 * np.pi, 40)
    points = np.concatenate([np.c_[0.1 * np.cos(turn), 0.1 * np.sin(turn), z + 0 * turn] for z in (-0.5, 0.5)])
    a, b, radius = bounding_capsule(points @ np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0])
    assert radius < 0.13
    assert np.linalg.norm(b - a) <= 1.001


def test_capsules_hold_the_record_s_shapes():
    arm = aw.load("cmu-dd")
    capsules = link_capsules(arm)
    rng = np.random.default_rng(0)
    for link in arm.record.links:
        frame = arm.frames[link.name]
        for visual in link.visuals:
            if visual.hole:
                continue
            carrier = next(arm.frames[c.link].placement for c in capsules if c.body == frame.body)
            at = (carrier.inverse() @ frame.placement @ visual.placement()).matrix().astype(float)
            mesh = surface(visual.solid, 360)
            points = mesh.vertices[rng.integers(0, len(mesh.vertices), 50)] @ at[:3, :3].T + at[:3, 3]
            inside = np.zeros(len(points), dtype=bool)
            nearest = np.full(len(points), np.inf)
            for c in capsules:
                if c.body == frame.body:
                    along = c.b - c.a
                    t = np.clip((points - c.a) @ along / max(along @ along, 1e-30), 0, 1)
                    off = np.linalg.norm(points - c.a - t[:, None] * along, axis=1) - c.radius
                    inside |= off <= 0
                    nearest = np.minimum(nearest, off)
            assert inside.all(), (link.name, visual.name, nearest.max())


@pytest.mark.study
@pytest.mark.parametrize("name", ["cmu-dd", "panda", "scara"])
def test_capsules_stand_in_the_frames_of_their_links(name):
    """Drawn where `forward_kinematics(frame=link)` puts them, they hold the link's shapes, or join its joints, at any pose."""
    arm = aw.load("examples/scara.toml" if name == "scara" else name)
    clear = aw.collision.clearance(arm, radius=0.03)
    shapes = {link.name: [each for each in link.visuals if not each.hole] for link in arm.record.links}
    for q in np.random.default_rng(2).uniform(-1.5, 1.5, (8, arm.n)):
        drawn = {}
        for c in clear.capsules:
            at = aw.forward_kinematics(arm, q, frame=c.link)
            drawn.setdefault(c.link, []).append((*(at[:3, :3] @ end + at[:3, 3] for end in (c.a, c.b)), c.radius))
        placed = body_placements(arm, q)
        for body, (link, capsules) in enumerate((b.link, drawn[b.link]) for b in arm.bodies if b.link in drawn):
            if shapes.get(link):
                at = aw.forward_kinematics(arm, q, frame=link)
                for visual in shapes[link]:
                    within = at @ visual.placement().matrix().astype(float)
                    points = surface(visual.solid, 40).vertices @ within[:3, :3].T + within[:3, 3]
                    assert np.min([distance(points, *each) for each in capsules], axis=0).max() <= 1e-9, link
            else:  # from the axis of its joint on
                origin = np.asarray(placed[body].position, dtype=float)[None]
                assert min(distance(origin, a, b, 0.0)[0] for a, b, _ in capsules) < 1e-9, link


def distance(points, a, b, radius):
    """(k,) distances of points (k, 3) from a capsule's surface; negative inside."""
    along = b - a
    t = np.clip((points - a) @ along / max(along @ along, 1e-30), 0.0, 1.0)
    return np.linalg.norm(points - a - t[:, None] * along, axis=1) - radius


def test_a_kernel_is_the_function_on_floats():
    q = np.random.default_rng(0).uniform(-3, 3, (50, 6))
    found = puma().distances(q)
    assert found.shape == (50, len(puma().pairs))
    assert np.abs(found - [puma().distances_at(each) for each in q]).max() < 1e-12
    assert (puma().distances(q[7]) == found[7]).all()


def test_distances_beside_sampled_capsules():
    """Points on the axes of capsules, dense, come no nearer than the kernel says, and as near."""
    arm, clear = aw.load("puma560"), puma()
    t = np.linspace(0, 1, 201)[:, None]
    for q in np.random.default_rng(5).uniform(-3, 3, (20, 6)):
        axes = {}
        for c in clear.capsules:
            at = aw.forward_kinematics(arm, q, frame=c.link)
            a, b = (at[:3, :3] @ end + at[:3, 3] for end in (c.a, c.b))
            axes.setdefault(c.link, []).append((a + t * (b - a), c.radius))
        for (one, two), distance in zip(clear.pairs, clear.distances(q), strict=True):
            points = np.concatenate([each for each, _ in axes[one]])
            if two == "floor":
                expected = points[:, 2].min() + 0.2 - 0.06
            elif two == "ball":
                expected = np.linalg.norm(points - BALL.position, axis=1).min() - 0.1 - 0.06
            elif two == "table":
                continue
            else:
                others = np.concatenate([each for each, _ in axes[two]])
                expected = np.linalg.norm(points[:, None] - others, axis=2).min() - 0.12
            assert expected - 5e-3 < distance <= expected + 1e-9, (one, two)


def test_the_nearest_is_named():
    q = np.zeros((3, 6))
    q[1, 1] = -1.5  # reaches down
    nearest = aw.collision.clearance(aw.load("puma560"), (FLOOR,), radius=0.06).nearest(q)
    assert (nearest.index, nearest.pair[1]) == (1, "floor")
    assert nearest.distance < 0
    assert str(nearest).endswith(" mm")


@pytest.mark.parametrize("length", [1e-320, 1e-200, 1.0, 1e300])
def test_a_normal_has_any_length(length):
    plane = aw.collision.PlaneObstacle((0.0, 0.0, -0.3), (0.0, length, 2.0 * length))
    a, b = np.array([0.1, 0.2, 0.5]), np.array([0.3, -0.2, 0.4])
    unit = np.array([0.0, 1.0, 2.0]) / np.sqrt(5.0)
    expected = min(unit @ (end - [0.0, 0.0, -0.3]) for end in (a, b))
    assert plane.distance(a, b) == pytest.approx(expected, rel=1e-3 if length < 1e-300 else 1e-12)


def test_a_radius_in_millimetres_is_told_from_a_large_one():
    arm = aw.load("puma560")
    with raises_at(ModelError, "radius", "metres, as 0.06"):
        aw.collision.clearance(arm, radius=60)
    with raises_at(ModelError, "radius", r"2000 poses.*smaller radius, .* ignore$"):
        aw.collision.clearance(arm, radius=0.8)
    names = [body.link for body in arm.bodies]
    every = [(one, two) for one in names for two in names if one < two]
    assert aw.collision.clearance(arm, (FLOOR,), radius=0.8, ignore=every).pairs == tuple(
        (each, "floor") for each in names
    )


def test_neighbours_are_not_looked_at():
    clear = aw.collision.clearance(aw.load("two-link"), radius=0.02)
    assert clear.pairs == ()
    assert clear.distances(np.zeros((4, 2))).shape == (4, 0)
    with pytest.raises(ScenarioError):
        clear.nearest(np.zeros((4, 2)))


@pytest.mark.parametrize(
    ("call", "error", "place"),
    [
        (lambda arm: aw.collision.clearance(arm), ModelError, "radius"),
        (lambda arm: aw.collision.clearance(arm, radius=0.0), ModelError, "radius"),
        (lambda arm: aw.collision.clearance(arm, radius=60), ModelError, "radius"),
        (lambda arm: aw.collision.clearance(arm, radius={"elbow": 1.0}), ModelError, "radius"),
        (lambda arm: aw.collision.clearance(arm, radius={"link1": 0.1}), ModelError, "radius"),
        (lambda arm: aw.collision.clearance(arm, radius=0.1, ignore=[("link1", "link9")]), ModelError, "ignore"),
        (lambda arm: aw.collision.clearance(arm, "x", radius=0.1), ScenarioError, "obstacles"),
        (lambda arm: aw.collision.PlaneObstacle((0, 0, 0), (0, 0, 0)), ScenarioError, "plane.normal"),
        (lambda arm: aw.collision.PlaneObstacle((0, np.nan, 0), (0, 0, 1)), ScenarioError, "plane.point"),
        (lambda arm: aw.collision.BoxObstacle((1, 1, 0), (0, 0, 0)), ScenarioError, "box.size"),
        (lambda arm: aw.collision.SphereObstacle(-1, (0, 0, 0)), ScenarioError, "sphere.radius"),
        (lambda arm: puma().distances(np.zeros((3, 5))), ShapeError, "clearance"),
        (lambda arm: puma().nearest(np.full((3, 6), np.nan)), ScenarioError, "q"),
        (lambda arm: puma().nearest(np.zeros((0, 6))), ScenarioError, "q"),
        (lambda arm: aw.collision.clearance(arm.n), ModelError, "arm"),
    ],
)
def test_refused(call, error, place):
    with pytest.raises(error) as caught:
        call(aw.load("puma560"))
    assert place in caught.value.problems[0].place
