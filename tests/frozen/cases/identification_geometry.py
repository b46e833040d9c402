"""Calibrations of geometry by points, poses, distances and touched points, and poses that are chosen for them."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import armwright as aw
from armwright.identification import Measured, Measurements
from armwright.identification.geometry.arm_chain import TERMS, ArmChains, Columns, gravity_loads
from armwright.identification.geometry.chain import moved
from armwright.identification.geometry.poses import exchanged
from frozen.answers import all_refused, beside, record
from frozen.numbers import Case
from identification.geometry.measured_arm import measured, nominal, rpy, shift, truth
from identification.geometry.test_chain import KINDS
from identification.geometry.test_kinds import FILE, JOINTS

ident = aw.identification
IGNORED = ("sha", "version", "sources", "file")
CLOSE = 1e-4
TOOL = shift(0.03, -0.02, 0.12) @ rpy(0.2, -0.1, 0.4)


def poses(count, seed):
    return np.random.default_rng([seed, 7]).uniform(-2.5, 2.5, (count, 6))


def of(found, folder, write=True):
    """A calibration: corrections, errors of poses held out, noise and the record."""
    estimate, fit = found.estimate, found.fit
    parts = {
        "names": list(estimate.names), "values": estimate.values, "std": estimate.std,
        "remarks": list(estimate.remarks),
        "condition": np.log(estimate.condition), "scales": fit.scales, "outliers": list(fit.outliers),
        "weights": fit.weights,
        "errors": found.errors, "noise": found.noise, "priors": list(found.tried_priors.values()),
        "terms": found.tried_terms,
        "by_pose": found.by_pose, "formulas": list(found.formulas), "frames": found.frames().rows(),
    }  # fmt: skip
    if write:
        path = found.write(folder / "calibrated.toml", key="own")
        model = aw.load(path, kinematics_only=True, on_impossible="warn")
        parts["reached"] = [aw.forward_kinematics(model, each) for each in poses(3, 1)]
        parts["added"] = list(record(path).get("frames", []))
    return {"result": found} | parts


def points(folder, kind="row", seed=1, count=16, write=True, loss="tukey", folds=2, terms=("zeros", "frames"), **more):
    """A calibration by a tracker's points."""
    eccentricity = more.pop("eccentricity", {})
    real = truth(kind, seed, eccentricity=eccentricity)
    found = aw.calibrate(
        measured(real, seed, count, **more), nominal(kind, folder), loss=loss, folds=folds, terms=terms
    )
    return of(found, folder, write)


def tool(folder):
    """By poses of a tool."""
    real, draw, q = truth("frame", 11), np.random.default_rng(11), poses(16, 11)
    placed = np.linalg.inv(real.tracker) @ np.array([real.pose(each) for each in q]) @ TOOL
    turns = Rotation.from_rotvec(draw.normal(0, 3e-4, (16, 3))) * Rotation.from_matrix(placed[:, :3, :3])
    values = np.c_[placed[:, :3, 3] + draw.normal(0, 1e-4, (16, 3)), turns.as_quat()[:, [3, 0, 1, 2]]]
    values[4] = np.nan
    data = Measurements(JOINTS, q, [Measured("gripper", "pose", values)])
    return of(aw.calibrate(data, nominal("frame", folder), folds=3), folder)


def distances(folder, known):
    """By distances from two anchors."""
    real, draw, point = truth("frame", 12), np.random.default_rng(12), np.array([0.05, 0.02, 0.1])
    q, given = poses(50, 13), []
    at = np.array([(each[:3, :3] @ point + each[:3, 3]) for each in map(real.pose, q)])
    for name, anchor in (("left", [1.2, 0.3, 0.1]), ("right", [0.2, -1.4, 0.4])):
        distance = np.linalg.norm(at - anchor, axis=1) + draw.normal(0, 1e-4, len(q))
        given.append(Measured(name, "distance", distance[:, None], place=point, anchor=anchor if known else None))
    return of(aw.calibrate(Measurements(JOINTS, q, given), nominal("frame", folder), folds=2), folder, write=known)


def touched(folder):
    """By two sockets that a probe touches from many sides."""
    real, draw, point = truth("frame", 14), np.random.default_rng(14), np.array([0.0, 0.02, 0.1])
    sockets, rows, labels = (np.array([0.3, 0.1, 0.5]), np.array([-0.1, 0.35, 0.4])), [], []
    for k in range(10):

        def away(q, socket=sockets[k % 2]):
            return real.pose(q)[:3, :3] @ point + real.pose(q)[:3, 3] - socket

        found = least_squares(away, draw.uniform(-2, 2, 6), xtol=1e-10, ftol=1e-10, gtol=1e-10)
        if found.cost < 1e-12:
            rows.append(found.x)
            labels.append([float(k % 2)])
    q = np.array(rows) + draw.normal(0, 5e-5, (len(rows), 6))
    data = Measurements(JOINTS, q, [Measured("probe", "fixed point", np.array(labels))])
    return of(aw.calibrate(data, nominal("frame", folder), terms=("zeros",), folds=2), folder)


def placed(folder):
    """With a tracker and points whose places are known."""
    real, draw, q = truth("frame", 15), np.random.default_rng(15), poses(16, 15)
    values = np.array([real.points(each) for each in q]) + draw.normal(0, 1e-4, (16, 3, 3))
    xyz, turn = real.tracker[:3, 3], Rotation.from_matrix(real.tracker[:3, :3]).as_euler("xyz")
    places = ([0.1, 0.0, 0.05], [-0.05, 0.1, 0.06], [-0.05, -0.08, 0.1])
    given = [Measured(f"m{k}", "point", values[:, k], place=places[k]) for k in range(3)]
    return of(
        aw.calibrate(Measurements(JOINTS, q, given, placed=[*xyz, *turn]), nominal("frame", folder), folds=2), folder
    )


def compliant(folder):
    """An arm that bends under gravity."""
    arm, real, draw = aw.load("puma560", on_impossible="warn"), truth("row", 4), np.random.default_rng(4)
    q = draw.uniform(-2.5, 2.5, (24, 6))
    bent = q.copy()
    bent[:, 1] -= 2e-4 * aw.compile(arm).gravity_torques(q)[:, 1]
    values = np.array([real.points(each) for each in bent]) + draw.normal(0, 1e-4, (24, 3, 3))
    data = Measurements(arm.names, q, [Measured(f"m{k}", "point", values[:, k]) for k in range(3)])
    return of(aw.calibrate(data, arm, terms=("zeros", "frames", "joint compliance"), folds=2), folder, write=False)


def findings():
    """What is said of columns that repeat, stand still or are not rigid."""
    q = poses(8, 1)
    values = np.array([truth("frame", 1).points(each) for each in q])
    still = q.copy()
    still[:, 2], still[5] = 0.3, still[4]
    given = [
        Measured("a", "point", values[:, 0]), Measured("b", "point", 1e-3 * values[:, 1]),
        Measured("c", "point", values[:, 0]),
        Measured("d", "point", values[:, 2] + [[0.06 * k, 0, 0] for k in range(8)], frame="link3"),
    ]  # fmt: skip
    found = Measurements(JOINTS, still, given, name="bench")
    return beside(
        found, "findings", "heading", kept=[each.name for each in found.measured], seen=found.measured[0].seen
    )


def of_a_file(folder):
    """Degrees, millimetres, roll, pitch and yaw, or quaternions, and an empty cell."""
    rows = [
        f"{10 * k},{-5 * k},{100 + k},{200},{300},{k},{2 * k},{3 * k},{'' if k == 2 else 0.5 + k}" for k in range(5)
    ]
    (folder / "points.csv").write_text("a,b,x,y,z,r,p,w,d\n" + "\n".join(rows) + "\n")
    found = {}
    for name, (old, new) in {
        "usual": ("", ""), "radians": ('angle_unit = "deg"', 'angle_unit = "rad"'),
        "metres": ('unit = "mm"', 'unit = "m"'),
        "reversed": ("signs = [1, -1]", "signs = -1"), "vector": ('rotation = "rpy"', 'rotation = "rotvec"'),
    }.items():  # fmt: skip
        (folder / "x.calibration.toml").write_text(FILE.replace(old, new) if old else FILE)
        try:
            data = ident.read_measurements(folder / "x.calibration.toml")
        except aw.ArmwrightError as error:
            found[name] = str(error).replace(str(folder), "FOLDER")
            continue
        found[name] = {
            "q": data.q,
            "hand": data.measured[0].values,
            "wire": data.measured[1].values,
            "text": data.sentences(),
        }
    return found


def chains(name, folder):
    """Poses, derivatives and loads of an arm whose geometry is corrected by all terms."""
    if name == "kinds":
        link = '[[links]]\nname = "{}"\nmass_kg = 1.0\ncom_m = [0.1, 0.05, 0.2]\n'
        link += "inertia_kg_m2 = { xx = 0.1, xy = 0.0, xz = 0.0, yy = 0.1, yz = 0.0, zz = 0.1 }\n"
        (folder / "kinds.toml").write_text(KINDS + "".join(link.replace("{}", each) for each in "abcde"))
        arm = aw.load(folder / "kinds.toml")
    else:
        arm = aw.load(name, on_impossible="warn")
    made = ArmChains(arm, TERMS, Columns())
    factors, q = made.to(None), np.random.default_rng(0).uniform(-1.0, 1.0, (3, arm.n))
    values = np.random.default_rng(1).normal(0, 1e-3, len(made.columns.found))
    here = moved(factors, q, values)
    return {
        "names": [each.name for each in made.columns.found], "placement": here.placement, "shifting": here.shifting,
        "turning": here.turning, "loads": gravity_loads(arm, q),
    }  # fmt: skip


def designed(count=12, **options):
    given = {"candidates": 40, "seed": 2} | options
    found = ident.design_poses("lwa4p", count, [[0.1, 0.0, 0.05], [0.0, 0.1, 0.05]], **given)
    names = ("q", "points", "o1", "random_o1", "condition", "deviations", "names", "least")
    return beside(found, *names)


def in_a_room():
    arm = aw.load("lwa4p")
    room = aw.collision.clearance(arm, [aw.collision.PlaneObstacle([0, 0, -0.1], [0, 0, 1])], radius=0.05, least=0.01)
    return designed(clearance=room, box=[[-2.0, -2.0, 0.0], [2.0, 2.0, 2.0]], terms=("zeros",))


def refusals(folder):
    arm, q = nominal("frame", folder), poses(6, 1)
    point = Measured("m", "point", np.ones((6, 3)) * np.arange(6)[:, None])

    def data(**more):
        return Measurements(more.pop("joints", JOINTS), more.pop("q", q), more.pop("given", [point]), **more)

    def calibrate(measurements=None, of=arm, **options):
        return lambda: aw.calibrate(data() if measurements is None else measurements, of, **options)

    def poses_of(count=20, points=(0.1, 0.0, 0.05), **options):
        return lambda: ident.design_poses("lwa4p", count, points, **options)

    quaternion = np.c_[np.zeros((6, 3)), 1.02 * np.ones(6), np.zeros((6, 3))]
    return all_refused({
        "few": calibrate(), "joint": calibrate(data(joints=["elbow", *JOINTS[1:]])), "loss": calibrate(loss="cubes"),
        "no arm": calibrate(of=None), "term": calibrate(terms=["nothing"]),
        "masses": calibrate(terms=["joint compliance"]),
        "folds": calibrate(folds=1), "half": calibrate(folds=2.5),
        "frame": calibrate(data(given=[Measured("m", "point", point.values, "hand")])),
        "three": lambda: data(q=q[:3], given=[Measured("m", "point", np.ones((3, 3)))]),
        "four": lambda: data(q=q[:4], given=[Measured("m", "point", np.ones((4, 3)))]),
        "rows": lambda: data(q=q[:5]), "twice": lambda: data(given=[point, point]),
        "not finite": lambda: data(q=q * np.nan),
        "joints twice": lambda: data(joints=["a"] * 6), "placed": lambda: data(placed=[1.0]),
        "kind": lambda: Measured("m", "line", q),
        "width": lambda: Measured("m", "point", q), "infinite": lambda: Measured("m", "point", np.full((6, 3), np.inf)),
        "quaternion": lambda: Measured("m", "pose", quaternion),
        "nearly": lambda: Measured("m", "pose", quaternion / 1.0101),
        "place": lambda: Measured("m", "point", point.values, place=[1.0, np.nan, 0.0]),
        "name": lambda: Measured("", "point", point.values),
        "count": poses_of(3), "candidates": poses_of(20, candidates=20), "points": poses_of(points=(0.1, 0.0)),
        "seed": poses_of(seed=-1),
        "box": poses_of(box=[[5, 5, 5], [6, 6, 6]], candidates=30), "corners": poses_of(box=[[1, 1, 1], [0, 0, 0]]),
        "eccentric": lambda: points(folder, terms=("zeros", "eccentricity")), "fraction": poses_of(2.5),
    }, folder)  # fmt: skip


def case(call, close=CLOSE, ignored=(), study=False):
    return Case(call, close, (*IGNORED, *ignored), study)


CASES = {
    "points": case(points),
    "points of frames": case(lambda folder: points(folder, "frame", 2, count=12)),
    "points with a mistake": case(lambda folder: points(folder, wrong=2, markers=2, write=False)),
    "points by huber": case(lambda folder: points(folder, loss="huber", wrong=2, count=12, write=False)),
    "points by squares": case(lambda folder: points(folder, loss="squares", common=3e-4, count=12, write=False)),
    "points of eccentric gears": case(
        lambda folder: points(
            folder, "frame", 3, 16, False, terms=("zeros", "frames", "eccentricity"), eccentricity={1: 2e-3}
        )
    ),
    "points of a good record": case(lambda folder: points(folder, noise=2e-2, count=12, write=False)),
    "poses of a tool": case(tool),
    "distances": case(lambda folder: distances(folder, True)),
    "distances of unknown anchors": case(lambda folder: distances(folder, False), 1e-3),
    "touched": case(touched, 1e-3),
    "placed": case(placed),
    "compliant": case(compliant, 1e-3),
    "findings": case(lambda _: findings()),
    "file": of_a_file,
    **{f"chain of {name}": lambda folder, name=name: chains(name, folder) for name in ("kinds", "puma560", "cmu-dd")},
    "design": case(lambda _: designed()),
    "design in a room": case(lambda _: in_a_room()),
    "exchange": lambda _: [
        exchanged(np.random.default_rng(k).normal(size=(9, 2, 4)), 4, np.random.default_rng(k)) for k in (0, 1, 2)
    ],
    "refusals": refusals,
}
