"""Arms that stick: against closed forms, and as laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from armwright.kernels.batch import Kernel
from armwright.kernels.target import select_target
from armwright.model.drive import Brake, Elasticity, Friction
from armwright.model.springs import LinearSpring
from armwright.program import trace
from armwright.simulation.integrate.integrators import INTEGRATORS
from armwright.simulation.integrate.stepping import speed_pairs
from armwright.simulation.plant.plant import Plant
from physics.arms import arm
from simulation.energies import stored_energy
from simulation.sticking import block, dry, sticking

RULES = tuple(INTEGRATORS)


def stepper(model, rule="rk4"):
    """The plant, and a compiled (x, u, h) → x after the step."""
    plant = Plant.of(model)
    chosen = INTEGRATORS[rule].paired(speed_pairs(plant.layout))
    shapes = {"x": (plant.size,), "u": (model.n,), "h": ()}
    program = trace("step", lambda x, u, h: plant.step(chosen, x, u, h), shapes, ("x_next",))
    return plant, Kernel(program, select_target())


def arms():
    """Sticking arms of every kind: of joints, of lossy gears before rotors, of elastic gears, and of coupled motors with all."""
    two = arm("two-link")
    rotors = (replace(body, drive=replace(body.drive, gear_ratio=1.0, rotor_inertia=0.3)) for body in two.bodies)
    geared = replace(two, bodies=tuple(rotors))
    elastic = sticking(geared, [8.0, 2.0], 0.7, on_motor=True)
    springs = tuple(replace(body, elasticity=Elasticity(400.0, 20.0)) for body in elastic.bodies)
    first, last = sticking(geared, [8.0, 2.0], 0.8).bodies
    coupled = replace(last, drive=replace(last.drive, coupling=((first.joint, 0.5),)))
    return {
        "friction": sticking(arm("puma560"), [10.0, 20.0, 10.0, 1.0, 1.0, 0.5]),
        "lossy": sticking(geared, [8.0, 2.0], 0.7, on_motor=True),
        "elastic": replace(elastic, bodies=springs),
        "wrist": replace(two, bodies=(first, coupled)),
    }


ARMS = arms()


@pytest.mark.sample(1)
@pytest.mark.parametrize("rule", RULES)
def test_an_arm_held_by_friction_stays_for_ever(rule):
    """A loaded arm at 1 ms: not a bit of its state changes, so that an hour is as ten minutes."""
    model = sticking(arm("two-link"), [90.0, 30.0])
    start = np.array([0.4, -0.7])
    solver = aw.Solver(step=1e-3, integrator=rule)
    scenario = aw.Scenario(
        model, duration=600.0 if rule == "rk3" else 10.0, start=aw.Start(q=start), command=[2.0, -1.0], solver=solver,
        recording=aw.Recording(every=1000),
    )  # fmt: skip
    run = aw.simulate(scenario)
    assert (run.q.values == start).all()
    assert (run.qd.values == 0.0).all()
    assert (run.qdd.values == 0.0).all()
    need = aw.inverse_dynamics(model.replace(friction=None), start, np.zeros(2), np.zeros(2))
    outputs = Plant.of(model).outputs(np.array([*start, 0.0, 0.0]), np.array([2.0, -1.0]))
    assert outputs["tau_link"] == pytest.approx(need, rel=1e-12)


def test_an_hour_on_a_slope():
    """By default steps, of as much as a row asks for."""
    model, start = sticking(arm("two-link"), [90.0, 30.0]), np.array([0.4, -0.7])
    run = aw.simulate(
        aw.Scenario(
            model, duration=3600.0, start=aw.Start(q=start), command=[2.0, -1.0], recording=aw.Recording(period=1.0)
        )
    )
    assert len(run.time) == 3601
    assert (run.q.values == start).all()
    assert (run.qd.values == 0.0).all()


def test_it_comes_to_rest_where_and_when_the_closed_form_says():
    """A block that slides against friction: v²/(2a) and v/a, position to order 2 in the step."""
    model, speed, level = block(2.0, friction=dry(3.0)), 0.5, 3.0
    plant, step = stepper(model)
    errors = []
    for h in (4e-3, 2e-3, 1e-3):
        x = plant.initial(np.zeros(1), np.array([speed]))[None]
        for _ in range(round(0.5 / h)):
            x = step(x, np.zeros((1, 1)), np.array([h]))
        assert x[0, 1] == 0.0
        errors.append(abs(x[0, 0] - speed**2 * 2.0 / (2.0 * level)))
    assert max(errors) < 0.5 * level / 2.0 * 4e-3**2
    assert errors[-1] < 0.5 * level / 2.0 * 1e-3**2


def test_a_joint_that_sticks_lets_its_coupled_motor_turn():
    """The first joint of a coupled wrist turns the last motor, too; friction of the last joint holds that joint alone."""
    wrist = ARMS["wrist"]
    levels = (0.5, 200.0)
    bodies = tuple(replace(body, friction=dry(level)) for body, level in zip(wrist.bodies, levels, strict=True))
    plant, step = stepper(replace(wrist, bodies=bodies), "rk3")
    x = plant.initial(np.zeros(2), np.array([0.5, 0.0]))[None]
    for _ in range(40):
        x = step(x, np.zeros((1, 2)), np.array([1e-3]))
    position, held, speed, still = x[0]
    assert position > 0.01
    assert speed > 0.1
    assert (held, still) == (0.0, 0.0)


# --- stick-slip: a block that a spring pulls whose other end moves at a constant speed ---------------------------------------

MASS, STIFFNESS, STATIC, KINETIC, PULL = 1.0, 100.0, 2.0, 1.0, 0.1
RATE = np.sqrt(STIFFNESS / MASS)
SLIP = 2.0 / RATE * (np.pi - np.arctan((STATIC - KINETIC) * RATE / (STIFFNESS * PULL)))
STICK = 2.0 * (STATIC - KINETIC) / (STIFFNESS * PULL)


def stick_slip_position(t: float) -> float:
    """Of the block: it waits until the spring pulls with the static level, slips, waits again."""
    t -= STATIC / (STIFFNESS * PULL)
    if t < 0.0:
        return 0.0
    cycles, t = divmod(t, SLIP + STICK)
    t = min(t, SLIP)
    stretch = KINETIC + (STATIC - KINETIC) * np.cos(RATE * t) + PULL * RATE * np.sin(RATE * t) * MASS
    return cycles * PULL * (SLIP + STICK) + STATIC / STIFFNESS + PULL * t - stretch / STIFFNESS


def stick_slip_block():
    """A motor too heavy to be slowed down, and a block behind its spring; friction falls at once."""
    friction = dry(KINETIC, stribeck=STATIC, stribeck_speed=1e-9)
    return block(MASS, friction=friction, rotor_inertia=1e12, elasticity=Elasticity(STIFFNESS, 0.0))


@pytest.mark.parametrize("rule", RULES)
def test_stick_slip_by_its_closed_form(rule):
    """Three cycles, of order 1 in the step."""
    plant, step = stepper(stick_slip_block(), rule)
    errors = []
    for h in (2e-3, 2.5e-4):
        x = plant.initial(np.zeros(1), np.zeros(1))
        plant.part(x, "motor_qd")[:] = PULL
        x, positions, count = x[None], [], round(2.2 / h)
        for _ in range(count):
            x = step(x, np.zeros((1, 1)), np.array([h]))
            positions.append(x[0, 0])
        exact = [stick_slip_position((k + 1) * h) for k in range(count)]
        errors.append(np.abs(np.array(positions) - exact).max())
    assert errors[0] < 4e-3
    assert errors[1] < 0.25 * errors[0]


def test_full_order_between_switches():
    """Slips of a block that ends within one: order 4 of rk4, since directions are held."""
    model = block(MASS, friction=dry(KINETIC), rotor_inertia=1e12, elasticity=Elasticity(STIFFNESS, 0.0))
    plant, step = stepper(model)
    errors = []
    for h in (0.02, 0.01):
        x = plant.initial(np.zeros(1), np.array([0.8]))
        plant.part(x, "motor_qd")[:] = 0.0
        x = x[None]
        for _ in range(round(0.1 / h)):
            x = step(x, np.zeros((1, 1)), np.array([h]))
        t = 0.1
        exact = (0.8 / RATE) * np.sin(RATE * t) - KINETIC / STIFFNESS * (1.0 - np.cos(RATE * t))
        assert x[0, 1] > 0.0
        errors.append(abs(x[0, 0] - exact))
    assert errors[0] / errors[1] > 2**3.7


# --- a block on a spring, which friction brings to rest off the middle ------------------------------------------------------

BEGIN, OFF = 0.095, KINETIC / STIFFNESS


def sprung_position(t: float) -> float:
    """Of the block let go at BEGIN: half swings about ± OFF, each shorter by twice that, until one ends where friction holds."""
    at = BEGIN
    while abs(at) > OFF and t > np.pi / RATE:
        at, t = 2.0 * np.copysign(OFF, at) - at, t - np.pi / RATE
    middle = np.copysign(OFF, at)
    return at if abs(at) <= OFF else middle + (at - middle) * np.cos(RATE * t)


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("rule", "settings", "most", "steps"),
    [
        ("rk45", {"rtol": 1e-7, "atol": 1e-9}, 1e-7, 500),
        ("rk45", {"rtol": 1e-11, "atol": 1e-13}, 1e-10, 2000),
        ("rodas3", {"rtol": 1e-6, "atol": 1e-8}, 1e-4, 1000),
        ("auto", {}, 1e-4, 2200),
        ("rk4", {"step": 1e-3}, 3e-4, None),
    ],
)
def test_swings_that_friction_ends(rule, settings, most, steps):
    """Rules that choose their steps find the turns, and keep their order between them; in few steps."""
    model = block(MASS, friction=dry(KINETIC), spring=LinearSpring(STIFFNESS, 0.0))
    solver = aw.Solver(integrator=rule, **({"step": 0.01} if rule in ("rk45", "rodas3") else {}), **settings)
    run = aw.simulate(aw.Scenario(model, duration=2.0, start=aw.Start(q=[BEGIN]), command=[0.0], solver=solver))
    exact = [sprung_position(float(t)) for t in run.time]
    assert np.abs(run.q.values[:, 0] - exact).max() < most
    assert run.qd.values[-1] == 0.0
    if steps is not None:
        assert run.steps_tried < steps


def test_cvodes_refuses_what_sticks():
    """One line, with the remedy."""
    model = block(MASS, friction=dry(KINETIC))
    scenario = aw.Scenario(model, duration=1.0, command=[0.0], solver=aw.Solver(integrator="cvodes", step=0.01))
    with pytest.raises(ScenarioError) as caught:
        aw.simulate(scenario)
    assert caught.value.place == "solver.integrator"
    assert "smoothing" in caught.value.expected


@pytest.mark.sample(1)
@pytest.mark.parametrize("rule", ["rk45", "rodas3"])
@pytest.mark.parametrize("name", ["friction", "lossy", "elastic"])
def test_rules_of_their_own_steps_agree_with_small_ones(name, rule):
    """An arm that is let go, where some joints stick, break loose and turn back: against rk4 in steps of 20 µs."""
    model = ARMS[name]
    scenario = aw.Scenario(
        model, duration=0.3, start=aw.Start(q=0.3 + np.zeros(model.n), qd=np.full(model.n, 0.3)), command=np.zeros(model.n),
        solver=aw.Solver(integrator="rk4", step=2e-5), recording=aw.Recording(every=500, what="state"),
    )  # fmt: skip
    exact = aw.simulate(scenario)
    solver, recording = aw.Solver(integrator=rule, step=0.01, rtol=1e-6, atol=1e-8), aw.Recording(what="state")
    run = aw.simulate(replace(scenario, solver=solver, recording=recording))
    assert run.q.values == pytest.approx(exact.q.values, abs=2e-4 * np.ptp(exact.q.values))
    assert ((exact.qd.values == 0.0).any(axis=0) == (run.qd.values == 0.0).any(axis=0)).all()


def soft_arm(seed):
    """Two links behind lossy gears that give way, with dry friction on either side."""
    draw = np.random.default_rng(seed)
    bodies = []
    for body in arm("two-link").bodies:
        level = 10.0 ** draw.uniform(-2.0, -1.0)
        friction = Friction(
            coulomb_positive=level, coulomb_negative=level * draw.uniform(0.9, 1.0), on_motor=bool(draw.integers(2))
        )
        inertia, efficiency = 10.0 ** draw.uniform(-5.0, -4.0), draw.uniform(0.6, 0.95)
        drive = replace(body.drive, gear_ratio=100.0, rotor_inertia=inertia, efficiency=efficiency, smoothing=None)
        elasticity = Elasticity(draw.uniform(100.0, 600.0), draw.uniform(0.1, 1.0))
        bodies.append(replace(body, friction=friction, drive=drive, elasticity=elasticity))
    return replace(arm("two-link"), bodies=tuple(bodies))


@pytest.mark.parametrize("seed", [0, 1])
def test_no_lane_runs_out_of_substeps_behind_soft_gears(seed):
    """Motors that turn back near the end of a step whose error asks for a far shorter one."""
    model, draw, lanes = soft_arm(seed), np.random.default_rng(seed), 200
    commands = draw.normal(size=(lanes, 2)) * 10.0 ** draw.uniform(-2.0, 1.0, (lanes, 1))
    q = draw.uniform(-2.0, 2.0, (lanes, 2)) * draw.integers(0, 2, (lanes, 1))
    qd = draw.normal(size=(lanes, 2)) * draw.integers(0, 2, (lanes, 1))
    run = aw.simulate(
        aw.Scenario(
            model,
            duration=0.2,
            command=aw.Batch(commands),
            start=aw.Start(q=aw.Batch(q), qd=aw.Batch(qd)),
            recording=aw.Recording(what="state"),
        )
    )
    assert run.stalled_at.isnull().all()
    assert run.diverged_at.isnull().all()
    assert run.steps_tried.max() < 3 * run.steps_tried.median()


# --- lossy gears -------------------------------------------------------------------------------------------------------------

ETA, ROTOR, WEIGHT = 0.6, 0.1, 6.0


@pytest.mark.parametrize("force", [WEIGHT * ETA * 1.001, WEIGHT, WEIGHT / ETA * 0.999])
def test_a_lossy_gear_holds_within_its_band(force):
    """Between η W and W/η the load stays; tau_link is the load."""
    model = block(0.3, WEIGHT, efficiency=ETA, rotor_inertia=ROTOR)
    run = aw.simulate(aw.Scenario(model, duration=1.0, command=[force], solver=aw.Solver(step=1e-3, integrator="rk4")))
    assert (run.q.values == 0.0).all()
    outputs = Plant.of(model).outputs(np.zeros(2), np.array([force]))
    assert outputs["tau_link"] == pytest.approx([WEIGHT])
    assert outputs["qdd"] == 0.0


@pytest.mark.parametrize(("force", "e"), [(WEIGHT / ETA * 1.001, ETA), (WEIGHT * ETA * 0.999, 1.0 / ETA)])
def test_a_lossy_gear_moves_just_outside_its_band(force, e):
    """With the acceleration of a driving gear, or of one that is driven back."""
    model = block(0.3, WEIGHT, efficiency=ETA, rotor_inertia=ROTOR)
    run = aw.simulate(aw.Scenario(model, duration=1.0, command=[force], solver=aw.Solver(step=1e-3, integrator="rk4")))
    acceleration = (e * force - WEIGHT) / (0.3 + e * ROTOR)
    assert run.q.values[-1, 0] == pytest.approx(0.5 * acceleration, rel=1e-6)


# --- brakes ------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rule", ["rk4", "rk45", "rodas3", "auto"])
def test_a_rigid_brake_holds_and_lets_go_at_its_instant(rule):
    """A block that falls freely from the release on, until the brake slips it to rest: closed forms."""
    mass, weight, level, released, applied = 2.0, 8.0, 20.0, 0.1, 0.3
    model = block(mass, weight, brake=Brake(level, None, None, None, on_motor=False))
    brake = aw.Schedule([0.0, released, applied], [[1.0], [0.0], [1.0]], ["slide"])
    settings = {} if rule == "auto" else {"step": 1e-3}
    scenario = aw.Scenario(
        model, duration=1.0, command=[0.0], inputs=aw.Inputs(brake=brake), solver=aw.Solver(integrator=rule, **settings)
    )
    run = aw.simulate(scenario)
    t, g, stops = run.time.values, weight / mass, (level - weight) / mass
    falls, slips = np.clip(t - released, 0.0, applied - released), np.maximum(t - applied, 0.0)
    speed = g * (applied - released)
    slips = np.minimum(slips, speed / stops)
    exact = -0.5 * g * falls**2 - speed * slips + 0.5 * stops * slips**2
    assert (run.q.values[t <= released] == 0.0).all()
    assert run.q.values[:, 0] == pytest.approx(exact, abs=5e-6 if rule == "rk4" else 1e-7)
    assert run.qd.values[-1] == 0.0


# --- laws --------------------------------------------------------------------------------------------------------------------


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ARMS)
def test_compiled_steps_are_those_of_the_floats(name):
    """Some steps of a moving arm: floats, and compiled."""
    model = ARMS[name]
    plant, step = stepper(model, "rk3")
    rng = np.random.default_rng(4)
    u = 4.0 * rng.normal(size=model.n)
    x = plant.initial(rng.normal(size=model.n), 0.02 * rng.normal(size=model.n))
    compiled = x[None]
    for _ in range(12):
        x = plant.step(INTEGRATORS["rk3"], x, u, 2e-3)
        compiled = step(compiled, u[None], np.array([2e-3]))
    assert compiled[0] == pytest.approx(x, rel=1e-9, abs=1e-11)


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ARMS)
def test_without_power_it_comes_to_rest(name):
    """Friction takes the energy of a moving arm without gravity: never more than before, in the end none and no bit moves."""
    model = replace(ARMS[name], gravity=np.zeros(3))
    plant, step = stepper(model, "rk3")
    rng = np.random.default_rng(2)
    rest = np.zeros(model.n)
    x = np.array([plant.initial(rng.normal(size=model.n), rng.normal(size=model.n)) for _ in range(8)])
    energies = []
    for _ in range(60):
        energies.append([stored_energy(plant, row) for row in x])
        for _ in range(25):
            x = step(x, np.broadcast_to(rest, (8, model.n)), np.full(8, 2e-3))
    rises = np.diff(np.array(energies), axis=0)
    assert rises.max() < 1e-6 * np.max(energies)
    last = x
    for _ in range(10):
        x = step(x, np.broadcast_to(rest, (8, model.n)), np.full(8, 2e-3))
    of = "motor_q" if "motor_q" in plant.layout else "q"  # behind springs links swing on
    assert (plant.part(last, f"{of}d") == 0.0).all()
    assert (plant.part(x, of) == plant.part(last, of)).all()


@pytest.mark.parametrize("name", ["friction", "wrist"])
def test_a_lane_is_its_own(name):
    """Lane 77 alone, among 100 and among 10⁴: the same bits."""
    model = ARMS[name]
    plant, step = stepper(model, "rk3")
    rng = np.random.default_rng(8)
    x = np.array([plant.initial(*row) for row in rng.normal(size=(10_000, 2, model.n))])
    u = 5.0 * rng.normal(size=(10_000, model.n))
    ends = []
    for rows in (slice(77, 78), slice(0, 100), slice(None)):
        at, h = x[rows], np.full(len(x[rows]), 1e-3)
        for _ in range(40):
            at = step(at, u[rows], h)
        ends.append(at[0 if len(at) == 1 else 77])
    assert (ends[0] == ends[1]).all()
    assert (ends[0] == ends[2]).all()
