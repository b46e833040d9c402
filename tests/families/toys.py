"""A toy member of each family that must be there before a robot is read, and all that meets it. Run as a program."""

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.friction_laws import LAWS, FrictionLaw, OwnKey
from armwright.joint_kinds import KINDS, Helical


class Toy(FrictionLaw):
    """a tanh(q̇ / w), with a level and a width of its own."""

    name = "toy"
    equation = """
    `law = "toy"`:  f = offset + viscous q̇ + a tanh(q̇ / w)."""
    own = (
        OwnKey("toy_level", "torque", "a.", "NotNegative", linear=True, start=lambda level, fastest: level, low=0.0),
        OwnKey("toy_width", "speed", "w.", "Positive", start=lambda level, fastest: 0.1 * fastest, low=1e-6),
    )
    dry = "none"
    feature = "toy friction"
    lost = "the friction law 'toy'"
    step_limits = (("the toy friction", 1, 0),)

    def add(self, torque, friction, speed, load, warming):
        level, width = friction.parameters
        return torque + level * scalar.tanh(speed / width)

    def steep(self, friction):
        return 0.0, friction.parameters[1]

    def holding(self, friction):
        return -friction.parameters[0], friction.parameters[0]

    def fitted(self, values, speed):
        return values["toy_level"] * np.tanh(speed / values["toy_width"])


@dataclass(frozen=True)
class Thread(Helical):
    """A screw whose pitch no file states."""

    pitch: float = 2e-3
    name, about, numbers = "thread", "A toy thread.", {}


LAWS[Toy.name], KINDS[Thread.name] = Toy(), Thread


def main() -> None:
    """Meets both everywhere."""
    from pathlib import Path

    import pytest

    import armwright as aw
    from armwright.description.database import parse
    from armwright.description.drive import LinearFriction, RotaryFriction
    from armwright.description.writer import to_toml
    from armwright.dynamics import regressor_drive
    from armwright.export.mjcf import write_mjcf
    from armwright.export.urdf import write_urdf
    from armwright.features import ARM, GROUPS
    from armwright.identification.arm.friction_law import CANDIDATES, FrictionRows, choose_terms, fitted_law
    from armwright.model import build_model
    from armwright.simulation.plant.step_causes import Weakened
    from physics.arms import workshop

    level, width = 2.5, 0.3
    record = workshop()
    record["joints"][2]["friction"] = {"law": "toy", "toy_level_n_m": level, "toy_width_rad_per_s": width}
    record["joints"][1]["friction"] = {"law": "toy", "toy_level_n": 3.0, "toy_width_m_per_s": 0.1}
    turning = {**record, "joints": [dict(joint) for joint in record["joints"]]}
    record["joints"][4]["type"] = "thread"
    arm = build_model(parse(record, "toys"))
    again = build_model(parse(__import__("tomllib").loads(to_toml(arm.description)), "again"))
    assert to_toml(again.description) == to_toml(arm.description)  # reader and writer
    assert '`law = "toy"`' in (RotaryFriction.__doc__ or "")
    assert "toy_level_n" in LinearFriction.model_fields

    q, qd, qdd = np.random.default_rng(0).normal(size=(3, arm.n))
    still = arm.replace(friction=None)
    felt = aw.inverse_dynamics(arm.replace(efficiency=None), q, qd, qdd)
    bare = aw.inverse_dynamics(still.replace(efficiency=None), q, qd, qdd)
    assert np.isclose(felt[2] - bare[2], level * np.tanh(qd[2] / width))
    dyn = aw.compile(arm)  # kernels, their inverse and derivatives
    assert np.allclose(dyn.inverse_dynamics(q, qd, dyn.forward_dynamics(q, qd, qdd)), qdd, atol=1e-9)
    slope, step = dyn.inverse_dynamics_derivatives(q, qd, qdd)[0][:, 4], 1e-6 * np.eye(arm.n)[4]
    beside = (dyn.inverse_dynamics(q + each, qd, qdd) for each in (step, -step))
    assert np.allclose(slope, np.subtract(*beside) / 2e-6, rtol=1e-5, atol=1e-5)
    columns = regressor_drive(arm, qd, qdd) @ arm.drive_parameters
    assert np.isclose(
        columns[2], arm.drive_parameters.reshape(arm.n, -1)[2, 0] * qdd[2] + level * np.tanh(qd[2] / width)
    )

    run = aw.simulate(aw.Scenario(arm, duration=0.02, command=[1.0] * arm.n), progress=False)
    assert np.isfinite(run.q.values).all()
    assert "thread" in run.kind.values
    causes = Weakened.of(arm).names
    assert any("toy friction" in name and "joint3" in name for name in causes), causes

    assert list(ARM["toy friction"].where(arm)) == ["joint2", "joint3"]
    assert "toy friction" in GROUPS["friction"]
    with pytest.raises(aw.ArmwrightError, match=r"'joint5' type = 'thread': .*URDF"):
        write_urdf(arm, "toys.urdf")
    plain = parse(turning, "plain")
    for losses in (write_urdf(plain, Path("plain.urdf")), write_mjcf(plain, Path("plain.xml"))):
        assert any("the friction law 'toy'" in loss for loss in losses)

    assert "toy" in CANDIDATES
    speed = np.linspace(-2.0, 2.0, 400)
    rows = FrictionRows(
        0.0 * speed, speed, 0.4 * speed + level * np.tanh(speed / width), 0.0 * speed, np.full(400, np.nan)
    )
    assert "toy" in choose_terms(rows, ("toy",)).terms
    law = fitted_law(rows, ("viscous", "toy"))
    assert np.allclose([law.values["toy_level"], law.values["toy_width"]], [level, width], rtol=1e-3)
    print("met everywhere")


if __name__ == "__main__":
    main()
