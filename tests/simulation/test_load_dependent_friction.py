"""Friction that rises with the torques on both sides of it: servos on a bench, beside an integration of its equations."""

from __future__ import annotations

import json
from math import exp, log10, sin
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import DescriptionError
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant
from raises_at import raises_at

SERVOS = Path(__file__).resolve().parents[3] / "shared" / "data" / "servos"
KEYS = {  # of published parameters, where a model has them
    "friction_base": ("coulomb_positive_n_m", "coulomb_negative_n_m"),
    "friction_viscous": ("viscous_n_m_s_per_rad",),
    "dtheta_stribeck": ("stribeck_speed_rad_per_s",),
    "alpha": ("stribeck_exponent",),
    "load_friction_motor": ("load_motor",),
    "load_friction_external": ("load_external",),
    "load_friction_motor_stribeck": ("load_motor_stribeck",),
    "load_friction_external_stribeck": ("load_external_stribeck",),
    "load_friction_motor_quad": ("load_motor_quadratic_per_n_m",),
    "load_friction_external_quad": ("load_external_quadratic_per_n_m",),
}
DIRECTED = {"load_motor": 0.3, "load_external": 0.1, "load_motor_stribeck": 0.1, "load_external_stribeck": 0.2}
MADE = {  # numbers of the size of a servo's, so that the law is held where the published ones are not there
    "kt": 0.4,
    "R": 3.0,
    "armature": 2e-3,
    "coulomb": 0.02,
    "viscous": 0.006,
    "still": 0.03,
    "speed": 0.8,
    "exponent": 1.3,
    **DIRECTED,
    "motor_quadratic": 0.2,
    "external_quadratic": 0.1,
}
MASS, LENGTH, GRAVITY = 0.3, 0.1, 9.81
VOLTS = (2.5, -1.0, 1.2, -3.0, 0.0, 0.3)  # for a tenth of a second each
HOLD = 0.1


def published(name):
    """Numbers of `MADE` of a published set, by its file; of models M1 to M6 each has those that it knows."""
    path = SERVOS / f"{name}.json"
    if not path.is_file():
        pytest.skip(f"the published parameters are not here: {path}")
    p = json.loads(path.read_text(encoding="utf-8"))
    shared = (
        p.get("load_friction_base", 0.0),
        p.get("load_friction_stribeck", 0.0),
    )  # of models with one for both torques
    return {
        "kt": p["kt"],
        "R": p.get("R", 1.0),  # which one set lacks
        "armature": p["armature"],
        "coulomb": p["friction_base"],
        "viscous": p["friction_viscous"],
        "still": p["friction_base"] + p.get("friction_stribeck", 0.0),
        "speed": p.get("dtheta_stribeck", 1.0),
        "exponent": p.get("alpha", 1.0),
        "load_motor": p.get("load_friction_motor", shared[0]),
        "load_external": p.get("load_friction_external", shared[0]),
        "load_motor_stribeck": p.get("load_friction_motor_stribeck", shared[1]),
        "load_external_stribeck": p.get("load_friction_external_stribeck", shared[1]),
        "motor_quadratic": p.get("load_friction_motor_quad", 0.0),
        "external_quadratic": p.get("load_friction_external_quad", 0.0),
    }


def record(folder, p, extra=""):
    """The bench: a mass on a rod without mass, downward at 0."""
    path = folder / "bench.toml"
    path.write_text(f"""
name = "bench"
source = "definition"
gravity_m_s2 = [0.0, 0.0, -{GRAVITY}]
command = "voltage"
[[links]]
name = "arm"
mass_kg = {MASS}
com_m = [0.0, 0.0, -{LENGTH}]
inertia_kg_m2 = {{ xx = 1e-9, yy = 1e-9, zz = 1e-9, xy = 0.0, xz = 0.0, yz = 0.0 }}
[[joints]]
name = "servo"
type = "revolute"
parent = "base"
child = "arm"
axis = [0.0, -1.0, 0.0]
frame = {{ xyz_m = [0.0, 0.0, 0.0], rpy_rad = [0.0, 0.0, 0.0] }}
[joints.motor]
gear_ratio = 1.0
rotor_inertia_kg_m2 = {p["armature"]}
torque_constant_n_m_per_a = {p["kt"]}
resistance_ohm = {p["R"]}
[joints.friction]
law = "load-dependent"
viscous_n_m_s_per_rad = {p["viscous"]}
coulomb_positive_n_m = {p["coulomb"]}
coulomb_negative_n_m = {p["coulomb"]}
stribeck_torque_n_m = {p["still"]}
stribeck_speed_rad_per_s = {p["speed"]}
stribeck_exponent = {p["exponent"]}
load_motor = {p["load_motor"]}
load_external = {p["load_external"]}
load_motor_stribeck = {p["load_motor_stribeck"]}
load_external_stribeck = {p["load_external_stribeck"]}
load_motor_quadratic_per_n_m = {p["motor_quadratic"]}
load_external_quadratic_per_n_m = {p["external_quadratic"]}
{extra}
""")
    return path


def loaded_arm(folder, *, with_friction=True):
    """A bench with a second one at its end, and a spring; motors are torques."""
    text = (
        record(folder, MADE)
        .read_text(encoding="utf-8")
        .replace('command = "voltage"', 'command = "torque"\ntip = "hand2"')
    )
    head, _, joint = text.partition("[[links]]")
    first = ("[[links]]" + joint).replace("[0.0, 0.0, 0.0], rpy", "[0.0, 0.0, -0.2], rpy")
    second = first.replace('"arm"', '"arm2"').replace('"base"', '"arm"').replace('"servo"', '"servo2"')
    text = (
        head
        + first
        + second
        + '[[frames]]\nname = "hand2"\nlink = "arm2"\nxyz_m = [0.0, 0.1, -0.3]\nrpy_rad = [0.0, 0.0, 0.0]\n'
    )
    text = text.replace(
        "[joints.friction]", "[joints.spring]\nstiffness_n_m_per_rad = 0.5\nrest_rad = 0.2\n[joints.friction]"
    )
    path = folder / "arm.toml"
    path.write_text(text, encoding="utf-8")
    arm = aw.load(path)
    return arm if with_friction else arm.replace(friction=None)


def level(p, v, tau_m, tau_e):
    """Largest friction without its viscous part: SOURCE.md's equation of M6."""
    s = exp(-(abs(v / p["speed"]) ** p["exponent"]))
    quadratic = 0.0
    if tau_m * tau_e < 0:
        if abs(tau_m) > abs(tau_e):
            quadratic = p["external_quadratic"] * tau_e**2
        elif abs(tau_m) < abs(tau_e):
            quadratic = p["motor_quadratic"] * tau_m**2
    still = abs(p["load_external_stribeck"] * tau_e - p["load_motor_stribeck"] * tau_m)
    load = abs(p["load_external"] * tau_e - p["load_motor"] * tau_m)
    return p["coulomb"] + load + s * (p["still"] - p["coulomb"] + still + quadratic)


def integrated(p, step, inertia):
    """Positions at the ends of all voltages, by steps in which the level is held and the speed goes no further than to 0."""
    q = v = 0.0
    found = []
    for volts in VOLTS:
        for _ in range(round(HOLD / step)):
            tau_m = p["kt"] * (volts - p["kt"] * v) / p["R"]
            tau_e = -MASS * GRAVITY * LENGTH * sin(q)
            most = level(p, v, tau_m, tau_e) + p["viscous"] * abs(v)
            free = v + step * (tau_m + tau_e) / inertia
            lost = step * most / inertia
            v = free - lost if free > lost else free + lost if free < -lost else 0.0
            q += step * v
        found.append(q)
    return np.array(found)


def simulated(arm, **solver):
    """Positions at the ends of all voltages."""
    schedule = aw.Schedule(HOLD * np.arange(len(VOLTS)), np.array(VOLTS)[:, None], ("servo",))
    scenario = aw.Scenario(arm, duration=HOLD * len(VOLTS), command=schedule, start=[0.0], solver=aw.Solver(**solver))
    run = aw.simulate(scenario, progress=False)
    return np.interp(HOLD * (1 + np.arange(len(VOLTS))), run.time.values, run.q.values[:, 0])


@pytest.mark.parametrize("speed", [0.0, 0.01, -0.4, 3.0])
def test_levels_are_those_of_the_published_equation(tmp_path, speed):
    """In the plant: the torque that its friction resists with at a speed, or may hold with at rest."""
    arm = aw.load(record(tmp_path, MADE))
    law, friction = aw_law(arm)
    for tau_m, tau_e in np.random.default_rng(1).uniform(-2, 2, (50, 2)):
        found = float(law.level(friction, speed, (tau_m, tau_e)))
        assert found == pytest.approx(level(MADE, speed, tau_m, tau_e), rel=1e-12)
    same = float(law.level(friction, speed, (0.7, -0.7)))
    assert same == pytest.approx(level({**MADE, "motor_quadratic": 0.0, "external_quadratic": 0.0}, speed, 0.7, -0.7))


def aw_law(arm):
    from armwright.friction_laws import LAWS

    friction = arm.coordinates[0].friction
    return LAWS[friction.law], friction


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["made", "xl330/m6", "mx64/m4", "mx106/m5", "xl320/m3", "feetech_sts3215_7_4V/m1"])
def test_a_bench_moves_as_its_equations_integrated_by_other_code(tmp_path, name):
    """The difference falls in proportion to that code's step, and is 2e-5 rad at most at 1e-6 s."""
    p = MADE if name == "made" else published(name)
    arm = aw.load(record(tmp_path, p))
    inertia = float(aw.mass_matrix(arm, np.zeros(1))[0, 0])
    ours = simulated(arm, integrator="rk45", rtol=1e-9, atol=1e-10)
    wrong = [np.abs(integrated(p, step, inertia) - ours).max() for step in (1e-3, 1e-4, 1e-6)]
    assert np.ptp(ours) > 0.1
    assert wrong[2] < 2e-5
    assert 0.9 < log10(wrong[0] / wrong[2]) / 3 < 1.1, wrong
    assert 0.9 < log10(wrong[1] / wrong[2]) / 2 < 1.1, wrong


def test_external_torque_is_all_but_the_motor_and_acceleration(tmp_path):
    """On an arm: gravity, C q̇, a spring and a wrench, without inertia and without other joints' friction."""
    arm, free = loaded_arm(tmp_path), loaded_arm(tmp_path, with_friction=False)
    plant, rng = Plant.of(arm), np.random.default_rng(3)
    for _ in range(20):
        q, qd, tau = rng.uniform(-1, 1, (3, 2))
        wrench = rng.uniform(-3, 3, 6)
        external = -aw.bias_torques(free, q, qd, wrench)
        resists = [level(MADE, v, m, e) for v, m, e in zip(qd, tau, external, strict=True)] + MADE["viscous"] * np.abs(
            qd
        )
        right = aw.forward_dynamics(free, q, qd, tau - np.sign(qd) * resists, wrench)
        x, inputs = plant.initial(q, qd), PlantInputs(tau, wrench=wrench)
        np.testing.assert_allclose(plant.derivative(x, inputs)[2:4], right, rtol=1e-9)


def test_a_servo_holds_what_it_could_not_lift(tmp_path):
    """Driven back it resists with more than without load: with the same voltage it lifts less than it holds."""
    arm = aw.load(record(tmp_path, MADE))
    q = 0.8
    run = aw.simulate(
        aw.Scenario(arm, duration=0.05, command=[MASS * GRAVITY * LENGTH * sin(q) / MADE["kt"] * MADE["R"]], start=[q]),
        progress=False,
    )
    assert np.ptp(run.q.values) == 0.0


@pytest.mark.parametrize("joint", ["servo", "servo2"])
def test_coupled_motors_take_another_law(tmp_path, joint):
    """True if the joint's own motor turns another joint too, or that one's turns it."""
    loaded_arm(tmp_path)
    path = tmp_path / "arm.toml"
    first, mark, second = path.read_text(encoding="utf-8").partition('name = "servo2"')
    parts = {"servo": first, "servo2": mark + second}
    other = "servo2" if joint == "servo" else "servo"
    coupled = f'coupling = [{{ joint = "{other}", ratio = 0.5 }}]\n[joints.spring]'
    parts[joint] = parts[joint].replace("[joints.spring]", coupled, 1)
    path.write_text("".join(parts.values()), encoding="utf-8")
    with raises_at(DescriptionError, "joint 'servo' friction.law") as caught:
        aw.load(path)
    assert caught.value.problems[1].place == "joint 'servo2' friction.law"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("load_coefficient = 0.1", "load_coefficient"),
        ("smoothing_rad_per_s = 0.0", "smoothing"),
    ],
)
def test_keys_that_do_not_go_together_are_named(tmp_path, change, words):
    with pytest.raises(DescriptionError, match=words):
        aw.load(record(tmp_path, MADE, change))
