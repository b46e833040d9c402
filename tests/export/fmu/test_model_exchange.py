"""FMUs for model exchange, moved by FMPy's CVode: as our own accurate solver, through contacts too; and their derivatives."""

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from export.fmu.fmus import Instance, simulated, this_platform
from raises_at import raises_at
from simulation.plants import COULOMB, ELASTIC, MOTOR, SUPPLY, THERMAL, chain, pendulum
from simulation.test_switching import PLAY, STOPS, bounced


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("name", "version"),
    [("two-link", "3.0"), ("puma560", "3.0"), ("puma560", "2.0"), ("lwa4p", "3.0"), ("panda", "2.0")],
)
def test_another_solver_comes_to_the_same_motion(name, version, tmp_path):
    arm, duration = aw.load(name), 0.25
    command = np.random.default_rng(0).normal(scale=2.0, size=arm.n)
    q0 = 0.1 * np.arange(1, arm.n + 1)
    scenario = aw.Scenario(
        arm, duration=duration, command=command, start=q0, solver=aw.Solver("cvodes"), recording=aw.Recording(every=0)
    )
    exported = aw.export.export_fmu(
        scenario, tmp_path / "plant.fmu", interface="model-exchange", platforms=this_platform(), version=version
    )
    x = simulated(exported.path, duration, u=command)
    run = aw.simulate(scenario)
    np.testing.assert_allclose(x[: arm.n], run.q.values[-1], atol=1e-7)
    np.testing.assert_allclose(x[arm.n : 2 * arm.n], run.qd.values[-1], atol=1e-6)


@pytest.mark.sample(1)
@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_initial_values_have_one_name_in_both_interfaces(version, tmp_path):
    """`start.q` and `start.qd` begin either kind of unit in the same state, motors behind elastic gears too."""
    joint = {"command": "voltage", "motor": MOTOR, "friction": COULOMB}
    arm = chain([{**joint, "elasticity": ELASTIC}, joint])
    begun, found = {f"start.{name}.{joint}": v for name, row in (("q", [0.4, -0.2]), ("qd", [0.1, 0.3]))
                    for joint, v in zip(arm.names, row, strict=True)}, []  # fmt: skip
    for interface in ("co-simulation", "model-exchange"):
        scenario = aw.Scenario(arm, duration=0.1, command=[0.0, 0.0], start=[0.1, 0.2])
        exported = aw.export.export_fmu(
            scenario, tmp_path / "plant.fmu", interface=interface, platforms=this_platform(), version=version
        )
        fmu = Instance(exported.path, exchange=interface == "model-exchange")
        parameters = fmu.names("start", "parameter")
        assert sorted(parameters) == sorted(begun)
        starts = {v.name: v.start for v in fmu.description.modelVariables}
        assert [float(starts[f"start.q.{joint}"]) for joint in arm.names] == [0.1, 0.2]
        assert not any(starts[name] for name in fmu.names("x", "output"))
        if interface == "model-exchange":
            with pytest.raises(Exception, match="Set"):
                fmu.set(fmu.names("x", "output")[0], 0.3)
            assert "before initialization ends; start.q and start.qd can" in fmu.messages[-1]
            fmu.close()
            fmu = Instance(exported.path, exchange=True)
        fmu.begin(**begun)
        found.append(dict(zip(fmu.names("x", "output"), fmu.get(*fmu.names("x", "output")), strict=True)))
        fmu.close()
    assert found[0] == found[1]
    run = aw.simulate(aw.Scenario(arm, duration=1e-3, command=[0.0, 0.0], start=aw.Start([0.4, -0.2], [0.1, 0.3])))
    joints = [f"x.q.{joint}" for joint in arm.names]
    np.testing.assert_array_equal([found[1][name] for name in joints], run.q.values[0])


def test_stops_are_events_and_bounces_come_to_the_closed_form(tmp_path):
    arm = pendulum("torque", gravity=0.0, stops=STOPS, limits={"position_rad": [-0.1, 0.1]})
    exact = np.array(bounced(float(aw.mass_matrix(arm, np.zeros(1))[0, 0]), 0.1, 1.0, 2.0))
    scenario = aw.Scenario(arm, duration=2.0, command=[0.0], start=aw.Start(qd=[1.0]))
    exported = aw.export.export_fmu(
        scenario, tmp_path / "bounce.fmu", interface="model-exchange", platforms=this_platform()
    )
    assert np.abs(simulated(exported.path, 2.0, tolerance=1e-10, u=[0.0]) - exact).max() < 1e-6


@pytest.mark.study
def test_play_temperatures_and_a_supply_are_states(tmp_path):
    motor = {**MOTOR, "inductance_h": 2e-3}
    joint = {"command": "voltage", "motor": motor, "friction": COULOMB}
    arm = chain(
        [{**joint, "elasticity": PLAY, "motor": {**motor, "thermal": THERMAL}}, joint], robot={"supply": SUPPLY}
    )
    scenario = aw.Scenario(arm, duration=0.2, command=[8.0, -5.0], solver=aw.Solver("cvodes", rtol=1e-10))
    exported = aw.export.export_fmu(
        scenario, tmp_path / "effects.fmu", interface="model-exchange", platforms=this_platform()
    )
    assert sum(name.startswith("x.") for name in exported.outputs) == 2 * 2 + 2 + 2 + 2 + 1
    x = simulated(exported.path, 0.2, tolerance=1e-9, u=[8.0, -5.0])
    run = aw.simulate(scenario)
    np.testing.assert_allclose(x[:2], run.q.values[-1], atol=2e-6)
    np.testing.assert_allclose(x[2:4], run.qd.values[-1], atol=2e-4)


@pytest.mark.sample(1)
@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_directional_derivatives_are_the_slopes(version, tmp_path):
    """Central differences of what the unit itself computes, along random directions of states and inputs."""
    arm, rng = aw.load("puma560"), np.random.default_rng(3)
    scenario = aw.Scenario(arm, duration=1.0, command=np.zeros(6), inputs=aw.Inputs(wrench=np.zeros(6)))
    exported = aw.export.export_fmu(
        scenario, tmp_path / "plant.fmu", interface="model-exchange", platforms=this_platform(), version=version
    )
    fmu = Instance(exported.path, exchange=True)
    fmu.begin()
    knowns = [*fmu.names("x", "output"), *fmu.names("u", "input"), *fmu.names("wrench", "input")]
    unknowns = [f"der({name})" for name in fmu.names("x", "output")] + fmu.names("tau", "output")
    at, seed, h = rng.normal(size=len(knowns)), rng.normal(size=len(knowns)), 1e-5
    sides = []
    for sign in (1.0, -1.0):
        for name, value in zip(knowns, at + sign * h * seed, strict=True):
            fmu.set(name, value)
        sides.append(fmu.get(*unknowns))
    for name, value in zip(knowns, at, strict=True):
        fmu.set(name, value)
    slopes = fmu.directional(unknowns, knowns, seed)
    expected = (sides[0] - sides[1]) / (2.0 * h)
    np.testing.assert_allclose(slopes, expected, atol=1e-6 * np.abs(expected).max())
    with pytest.raises(Exception, match="DirectionalDerivative"):
        fmu.directional(unknowns, unknowns, np.ones(len(unknowns)))
    assert fmu.messages == ["derivatives are known by continuous states and inputs alone"]
    fmu.close()


def test_friction_that_sticks_is_refused(tmp_path):
    rough = {key: value for key, value in COULOMB.items() if key != "smoothing_rad_per_s"}
    arm = pendulum(motor=MOTOR, friction=rough, elasticity=ELASTIC)
    with raises_at(ScenarioError, "arm", "that sticks", value="chain"):
        aw.export.export_fmu(arm, tmp_path / "rough.fmu", interface="model-exchange")
