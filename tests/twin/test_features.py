"""The table of features, walked: each acts over the bus as in the simulation, to the bit and visibly, or is refused by name."""

import platform
from dataclasses import fields, replace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import BusError, ScenarioError
from armwright.model.drive import Drive
from armwright.model.tree import Body, Tree
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Inputs, Loop, Recording, Solver, Start
from armwright.twin.rehearsal import rehearse
from armwright.twin.run import run_controller
from armwright.twin.twin import Twin
from simulation.plants import BRAKE, COGGING, COULOMB, CYLINDER, ELASTIC, LINE, MOTOR, STOPS, SUPPLY, THERMAL, chain
from twin.features_on_bus import EXACT, FEATURES, NONE, REFUSED

LIMITS = {
    "position_rad": [-2.0, 2.0],
    "velocity_rad_per_s": 4.0,
    "torque_n_m": 40.0,
    "current_a": 12.0,
    "voltage_v": 48.0,
}
LAW = aw.Cascade(position_kp=15.0, speed_kp=8.0, speed_ki=80.0, speed_feedforward=1.0, delay_ticks=1)
LEVEL = "x86-64-v2" if platform.machine() in ("x86_64", "AMD64") else None
SENSORS = aw.Sensors(counts=360_000, side="link", velocity="difference")
FINE = replace(SENSORS, counts=10**9)  # shows what an integrator does differently
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
PUSH = aw.Schedule([0.0, 0.05, 0.1], [[0.0] * 6, [0.0, 0.0, 15.0, 0.0, 4.0, 0.0], [0.0] * 6], WRENCH)
HOLD = aw.Schedule([0.0, 0.05, 0.062], [[0.0], [1.0], [0.0]], ["joint0"])
TABLE = {"inertia": [1e-3] * 3, "com": [0.2, 0.0, 0.05]}
BODIES = [
    aw.Payload(0.0413, 1.5, **TABLE),
    aw.Payload(0.1, 0.4, **TABLE),
    aw.Payload(0.15, 0.0),
]  # inside ticks, and on one


def swing(t):
    return aw.scalar.array([0.3 + 0.2 * (1.0 - aw.scalar.cos(12.0 * t))])


class Gripping:
    """The same reference, which takes up a body and puts it down."""

    payloads = (BODIES[0], aw.Payload(0.102, 0.0))

    def __call__(self, t):
        return swing(t)


class OfTheTip:
    def signals(self, arm):
        return (aw.Signal("goal", "m", (3,)),)

    def __call__(self, t):
        return {"goal": aw.scalar.array([t, t, t])}


class Scale:
    def signals(self, arm):
        return (aw.Signal("weight", "N", (1,)),)

    def measure(self, plant, s, w):
        return {"weight": plant.q[:1]}, s


def not_traced(t, r, y):
    return np.array([30.0 * float(r.q[0] - y.q[0])])


def rod(command="current", motor=(), **joint):
    """Keys of a joint that turns a rod about a level axis; None: without."""
    driven = None if motor is None else {**MOTOR, **dict(motor)}
    own = {"command": command, "motor": driven, "limits": LIMITS, "brake": BRAKE, **joint}
    return {key: value for key, value in own.items() if value is not None}


def scenario(robot=None, second=None, sensors=SENSORS, **joint):
    arm = chain([rod(**joint)] + ([second] if second else []), robot=robot)
    loop = aw.Loop(LAW, swing, period=4e-3, sensors=sensors, timing=aw.Timing("one-tick"))
    return aw.Scenario(arm, duration=0.2, loop=loop, start=[0.3])


BASE = scenario()


def served():
    """The rod with a servo."""
    loop = {"period_s": 1e-3, "p": 32.0, "p_scale_per_rad": 0.166, "output_limit": 1.0}
    return scenario(command="position", firmware=loop)


def coupled():
    """Two rods; the first joint turns the second one's motor too."""
    return chain([rod(), rod(motor={"coupling": [{"joint": "joint0", "ratio": 10.0}]})])


def loop(**changes):
    return replace(BASE, loop=replace(BASE.loop, **changes))


def sensors(**changes):
    return loop(sensors=replace(SENSORS, **changes))


def timing(**changes):
    return loop(timing=replace(BASE.loop.timing, **changes))


def solver(*arguments, **changes):
    return replace(loop(sensors=FINE), solver=aw.Solver(*arguments, **changes))


def ringing(**changes):
    """An elastic gear, for which steps of a period are long."""
    return replace(solver("rk45", **changes), arm=scenario(elasticity=ELASTIC).arm)


def inputs(**changes):
    return replace(BASE, inputs=aw.Inputs(**changes))


def keeping(**changes):
    return replace(BASE, recording=aw.Recording(**changes))


def motor(**changes):
    return scenario(motor=changes)


def sliding(counts):
    """A slide in place of the rod, with so many counts in a metre."""
    limits = {"position_m": [-2.0, 2.0], "velocity_m_per_s": 4.0, "force_n": 200.0}
    seen = replace(SENSORS, counts_per_m=counts)
    return scenario(type="prismatic", command="torque", limits=limits, motor=None, brake=None, sensors=seen)


# Scenarios with each feature, and without it where that is not BASE.
CASES = {
    "duration": lambda: (replace(BASE, duration=0.16), BASE),
    "vary": lambda: replace(BASE, vary={"rod0.mass_kg": 3.3}),
    "lanes": lambda: replace(BASE, lanes=1),
    "seed": lambda: (replace(sensors(position_noise=1e-4), seed=4), sensors(position_noise=1e-4)),
    "first_lane": lambda: (replace(sensors(position_noise=1e-4), first_lane=4), sensors(position_noise=1e-4)),
    "document": lambda: BASE,
    "source": lambda: BASE,
    "notes": lambda: BASE,
    "loop.controller": lambda: loop(controller=replace(LAW, position_kp=14.0)),
    "loop.reference": lambda: loop(reference=[0.32]),
    "loop.reference, grip and release": lambda: loop(reference=Gripping()),
    "loop.period": lambda: loop(period=5e-3),
    "loop.initial_command": lambda: loop(initial_command=[2.0]),
    "loop.sensors.counts": lambda: sensors(counts=20_000),
    "loop.sensors.counts_per_m": lambda: (sliding(1e6), sliding(1e4)),
    "loop.sensors.side": lambda: sensors(side="motor", counts=None),
    "loop.sensors.velocity": lambda: sensors(velocity="filtered", cutoff_hz=60.0),
    "loop.sensors.velocity, exact": lambda: sensors(velocity="exact"),
    "loop.sensors.cutoff_hz": lambda: (
        sensors(velocity="observer", cutoff_hz=60.0),
        sensors(velocity="observer", cutoff_hz=50.0),
    ),
    "loop.sensors.position_noise": lambda: sensors(position_noise=1e-4),
    "loop.command_filter.limit": lambda: loop(command_filter=aw.CommandFilter(limit=5.0)),
    "loop.command_filter.rate": lambda: loop(command_filter=aw.CommandFilter(rate=300.0)),
    "loop.timing.preset": lambda: timing(preset="ideal"),
    "loop.timing.measurement_delay": lambda: timing(measurement_delay=5e-3),
    "loop.timing.command_delay": lambda: timing(command_delay=5e-3),
    "loop.timing.jitter": lambda: timing(jitter=5e-3),
    "loop.timing.measurement_loss": lambda: timing(measurement_loss=0.2),
    "loop.timing.command_loss": lambda: timing(command_loss=0.2),
    "loop.timing.clock_drift": lambda: timing(clock_drift=0.01),
    "inputs.wrench": lambda: inputs(wrench=PUSH),
    "inputs.supply": lambda: inputs(supply=aw.Schedule([0.0, 0.1], [[48.0], [2.0]], ["supply"])),
    "inputs.brake": lambda: inputs(brake=HOLD),
    "inputs.payload": lambda: inputs(payload=BODIES),
    "start.q": lambda: replace(BASE, start=[0.31]),
    "solver.integrator": lambda: (solver("semi_implicit_euler"), solver()),
    "solver.step": lambda: tuple(
        replace(solver("semi_implicit_euler", step=4e-3 / k, substeps=k), loop=replace(BASE.loop, period=None))
        for k in (2, 1)
    ),
    "solver.substeps": lambda: (solver(substeps=3), solver(substeps=2)),
    "solver.accuracy": lambda: (solver(accuracy=0.1), solver(accuracy=1e-7)),
    "solver.global_error": lambda: (solver("auto", global_error=False), solver("auto")),
    "solver.rtol": lambda: tuple(ringing(rtol=each, atol=1e-12) for each in (1e-3, 1e-9)),
    "solver.atol": lambda: tuple(ringing(rtol=1e-12, atol=each) for each in (1e-3, 1e-9)),
    "solver.horizon": lambda: (solver("auto", horizon=500.0), solver("auto")),
    "solver.max_substeps": lambda: (solver("rk45", max_substeps=500), solver("rk45")),
    "solver.events": lambda: (solver("rk45", events={"up": lambda t, x: x.q[0] - 0.4}), solver("rk45")),
    "solver.target": lambda: replace(BASE, solver=aw.Solver(target=LEVEL)),
    "recording.every": lambda: keeping(every=5),
    "recording.period": lambda: keeping(period=8e-3),
    "recording.what": lambda: keeping(what="state"),
    "recording.reduce": lambda: keeping(reduce=("rms_error",)),
    "arm.gravity": lambda: scenario(robot={"gravity_m_s2": [0.0, 0.0, -9.0]}),
    "arm.supply": lambda: scenario(robot={"supply": {**SUPPLY, "voltage_v": 8.0, "chopper_voltage_v": 9.0}}),
    "arm.mimics": lambda: scenario(second={"mimic": {"joint": "joint0", "multiplier": 0.5, "offset_rad": 0.1}}),
    "arm.cylinders": lambda: scenario(
        robot={"cylinders": [{**CYLINDER, "link_b": "rod0", "force_n": 10.0, "stiffness_n_per_m": 10.0}]}
    ),
    "arm.body.mass": lambda: replace(BASE, arm=BASE.arm.with_payload(0.3, [0.2, 0.0, 0.0], [1e-3] * 3)),
    "arm.body.friction": lambda: scenario(friction=COULOMB),
    "arm.body.limits": lambda: scenario(limits={**LIMITS, "current_a": 8.0}),
    "arm.body.elasticity": lambda: scenario(elasticity=ELASTIC),
    "arm.body.brake": lambda: (
        replace(scenario(brake={"holding_torque_n_m": 30.0}), inputs=aw.Inputs(brake=HOLD)),
        inputs(brake=HOLD),
    ),
    "arm.body.spring": lambda: scenario(spring=LINE),
    "arm.drive.command": lambda: (
        replace(scenario(command="torque"), loop=replace(BASE.loop, controller=replace(LAW, speed_kp=24.0))),
        BASE,
    ),
    "arm.drive.gear_ratio": lambda: motor(gear_ratio=60.0),
    "arm.drive.rotor_inertia": lambda: motor(rotor_inertia_kg_m2=1e-4),
    "arm.drive.efficiency": lambda: motor(gear_efficiency=0.8),
    "arm.drive.torque_constant": lambda: motor(torque_constant_n_m_per_a=0.07),
    "arm.drive.back_emf_constant": lambda: motor(back_emf_constant_v_s_per_rad=0.9),
    "arm.drive.resistance": lambda: motor(resistance_ohm=8.0),
    "arm.drive.inductance": lambda: motor(inductance_h=5e-3),
    "arm.drive.current_loop": lambda: (
        motor(inductance_h=5e-3, current_loop_hz=100.0),
        motor(inductance_h=5e-3, current_loop_hz=200.0),
    ),
    "arm.drive.thermal": lambda: motor(thermal=THERMAL),
    "arm.drive.cogging": lambda: motor(cogging=COGGING),
}
# Words of the refusal.
WRONG = {
    "solver.device": (lambda: solver(device="cuda"), "solver.device = 'cuda'"),
    "command": (lambda: replace(BASE, loop=None, command=[1.0]), "loop"),
    "lanes, several": (lambda: replace(BASE, vary={"rod0.mass_kg": aw.Batch([3.2, 3.3])}), "lanes: 2 lanes"),
    "loop.controller, absent": (lambda: loop(controller=None), "loop.controller: no controller"),
    "loop.controller, not traced": (lambda: loop(controller=not_traced), "loop.controller"),
    "loop.reference, without positions of joints": (lambda: loop(reference=OfTheTip()), "loop.reference: has no"),
    "loop.sensors, others beside the joints'": (lambda: loop(sensors=[SENSORS, Scale()]), "loop.sensors: further"),
    "loop.sensors.side, motor with counts": (lambda: sensors(side="motor"), "loop.sensors.side = 'motor'"),
    "loop.sensors.velocity_noise": (lambda: sensors(velocity_noise=1e-3), "loop.sensors.velocity_noise = 0.001"),
    "loop.sensors.current_noise": (lambda: sensors(current_noise=1e-3), "loop.sensors.current_noise = 0.001"),
    "loop.command_filter.resolution": (
        lambda: loop(command_filter=aw.CommandFilter(resolution=0.1)),
        "loop.command_filter.resolution = 0.1",
    ),
    "start.qd": (lambda: replace(BASE, start=Start([0.3], [0.1])), "start.qd: the arm moves at the start"),
    "start, a state": (lambda: replace(BASE, start=aw.simulate(BASE, progress=False)), "start: continues from"),
    "recording.reference": (lambda: keeping(reduce=("rms_error",), reference=[0.0]), "recording.reference"),
    "arm.body.limits, of torque absent": (
        lambda: scenario(limits={"position_rad": [-2.0, 2.0], "velocity_rad_per_s": 4.0}),
        "joint 'joint0' limits: no limit of torque",
    ),
    "arm.body.limits, of position or speed absent": (
        lambda: scenario(limits={"torque_n_m": 40.0, "velocity_rad_per_s": 4.0}),
        "joint 'joint0' limits: no limit; expected position and velocity limits",
    ),
    "arm.body.stops": (
        lambda: scenario(stops=STOPS, limits={**LIMITS, "position_rad": [-2.0, 0.6]}),
        "joint 'joint0': the reference is 0.6",
    ),
    "arm.drive.command, voltage": (lambda: scenario(command="voltage"), "command = 'voltage'"),
    "arm.drive.coasts": (lambda: scenario(command="voltage", motor={"pwm": "coast"}), "command = 'voltage'"),
    "arm.drive.dead_zone": (lambda: scenario(command="voltage", motor={"dead_zone_v": 1.0}), "command = 'voltage'"),
    "arm.drive.firmware": (served, "command = 'position'"),
    "inputs.enabled": (lambda: replace(served(), inputs=aw.Inputs(enabled=1)), "command = 'position'"),
    "arm.drive.coupling": (
        lambda: replace(BASE, start=None, loop=replace(BASE.loop, reference=None), arm=coupled()),
        "motor.coupling: the motor of joint 'joint1' is turned by other joints too",
    ),
}
OF_PLANT = ("lanes, several", "start", "loop.sensors", "arm.drive", "arm.body.limits")  # refused by the twin as well
OFTEN = (  # what is not left to `study`
    *("lanes", "seed", "loop.initial_command", "loop.reference, grip and release", "loop.timing", "inputs"),
    *("solver.integrator", "arm.supply", "arm.drive.thermal"),
)
STRUCTURE = {  # fields that say what the arm is, and hold no effect of their own
    *("arm.name", "arm.bodies", "arm.frames", "arm.tip", "arm.without_masses"),
    *(f"arm.body.{name}" for name in ("joint", "link", "kind", "parent", "placement", "link_frame", "offset", "drive")),
    *("arm.body.first_moment", "arm.body.inertia"),  # of the mass
    "arm.drive.smoothing",  # of the efficiency
}


def values(run_or_rehearsal):
    recording, units = run_or_rehearsal.recording, run_or_rehearsal.units
    return np.hstack([run_or_rehearsal.q, recording.u, units.thousandths(recording.y[:, -1:])])


@pytest.fixture(scope="module")
def base():
    return values(rehearse(BASE))


def marked(name):
    return pytest.param(name, marks=[] if name.startswith(OFTEN) else [pytest.mark.study])


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", [marked(name) for name in CASES])
def test_what_is_carried_acts_as_in_the_simulation(name, base, bus):
    made, without = CASES[name](), None
    if isinstance(made, tuple):
        made, without = made
    with Twin(made, bus):
        run = run_controller(made, bus, following_error=1.0)
    assert run.equal, str(run.first_difference)
    ours, other = values(run.rehearsal), base if without is None else values(rehearse(without))
    same = ours.shape == other.shape and np.array_equal(ours, other)
    assert same == (FEATURES[name] != EXACT)  # without effect, or what it is replaced by is that of BASE


@pytest.mark.parametrize("name", WRONG)
def test_what_is_not_carried_is_refused_by_name(name):
    make, message = WRONG[name]
    with pytest.raises((BusError, ScenarioError)) as error:
        rehearse(make())
    assert message in str(error.value)
    assert "\n" not in str(error.value)
    if name.startswith(OF_PLANT):
        with pytest.raises(BusError) as error:
            Twin(make())
        assert message in str(error.value)


def test_the_table_has_every_field_and_no_other():
    """A new field of a scenario or record has no outcome over a bus until somebody writes one."""
    parts = {"loop": Loop, "inputs": Inputs, "start": Start, "solver": Solver, "recording": Recording}
    parts |= {"loop.sensors": aw.Sensors, "loop.timing": aw.Timing, "loop.command_filter": aw.CommandFilter}
    parts |= {"": Scenario, "arm": Tree, "arm.body": Body, "arm.drive": Drive}
    there = {f"{part}.{each.name}".lstrip(".") for part, kind in parts.items() for each in fields(kind)}
    assert {name.partition(",")[0] for name in FEATURES} | set(parts) - {""} | STRUCTURE == there | {
        "arm.body",
        "arm.drive",
    }
    assert not STRUCTURE & set(FEATURES)
    assert {name for name, outcome in FEATURES.items() if outcome == REFUSED} == set(WRONG)
    assert set(FEATURES) - set(WRONG) == set(CASES)
    assert all(word in (EXACT, NONE, REFUSED) or word.startswith("replaced by ") for word in FEATURES.values())


@pytest.mark.study
def test_all_at_once_with_delays_and_losses(bus):
    """Body, push and brake on a hot motor behind a weak supply, with both delays, losses, jitter and noise."""
    slow = aw.Timing("sync", measurement_delay=6e-3, command_delay=5e-3, jitter=3e-3, measurement_loss=0.05)
    made = scenario(
        robot={"supply": {**SUPPLY, "voltage_v": 12.0, "chopper_voltage_v": 13.0}},
        motor={"thermal": THERMAL},
        friction={**COULOMB, "viscous_fall_k": 5.0},
    )
    gentle = replace(LAW, position_kp=6.0, speed_kp=3.0, speed_ki=15.0, delay_ticks=2)
    noisy = replace(SENSORS, counts=50_000, position_noise=1e-4, velocity="filtered", cutoff_hz=60.0)
    each = {"payload": BODIES, "wrench": PUSH, "brake": HOLD}
    made = replace(made, loop=replace(made.loop, timing=slow, controller=gentle, sensors=noisy))
    whole = replace(made, inputs=aw.Inputs(**each), seed=3)
    with Twin(whole, bus):
        run = run_controller(whole, bus, following_error=1.0)
    assert run.equal, str(run.first_difference)
    for name in each:
        one_less = replace(whole, inputs=aw.Inputs(**{**each, name: None}))
        assert not np.array_equal(values(rehearse(one_less)), values(run.rehearsal)), name
