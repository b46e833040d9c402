"""Mass, centre and inertia of a link by scale, supports and pendulums: motions by SciPy, deviations by drawing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.errors import DescriptionError, IdentificationError
from raises_at import raises_at

ident = aw.identification
MASS, INERTIA, G = 2.314, 0.0412, 9.80665


def period_of(force, inertia, start):
    """Time of a full swing of  inertia(θ) θ'' = force(θ)  from rest at `start`: four quarters."""

    def crossing(t, y):
        return y[0]

    crossing.terminal = True
    run = solve_ivp(
        lambda t, y: [y[1], force(y[0]) / inertia], (0, 10), [start, 0.0], events=crossing, rtol=1e-11, atol=1e-12
    )
    return 4.0 * float(run.t_events[0][0])


@pytest.mark.parametrize("amplitude", [0.01, 0.2, 0.5])
def test_a_compound_pendulum_gives_the_inertia_that_it_swings_with(amplitude):
    """m g d sin θ, whatever the amplitude, to a part in a million of the moment about the axis."""
    d = 0.21
    period = period_of(lambda a: -MASS * G * d * np.sin(a), INERTIA + MASS * d**2, amplitude)
    found = ident.measured_inertia_pendulum(period, MASS, d, amplitude=amplitude)
    assert found.value == pytest.approx(INERTIA, abs=4e-6 * (INERTIA + MASS * d**2) * (1 + (amplitude / 0.3) ** 4))


@pytest.mark.parametrize("top", [None, 0.22])
def test_a_bifilar_pendulum_gives_the_inertia_that_it_turns_with(top):
    """The torque of two wires: m g dz/dθ with  (h − z)² = h² − D D' (1 − cos θ)/2, at small angles."""
    height, spacing = 1.2, 0.3
    product = spacing * (spacing if top is None else top)

    def torque(angle):  # −m g dz/dθ
        return -MASS * G * product * np.sin(angle) / 4.0 / np.sqrt(height**2 - product * (1.0 - np.cos(angle)) / 2.0)

    found = ident.measured_inertia_bifilar(period_of(torque, INERTIA, 1e-3), MASS, height, spacing, spacing_top=top)
    assert found.value == pytest.approx(INERTIA, rel=1e-6)


def test_supports_hold_a_link_at_its_centre():
    """Moments about the first support: a scale under the second reads the share of the weight."""
    centre, first, second = 0.17, -0.05, 0.35
    reading = MASS * (centre - first) / (second - first)
    found = ident.measured_centre(reading, second - first, MASS, origin=first)
    assert found.value == pytest.approx(centre, abs=1e-12)


DRAWN = {
    "centre": (ident.measured_centre, [(1.05, 0.002), (0.4, 0.001), (2.3, 0.004)]),
    "pendulum": (ident.measured_inertia_pendulum, [(1.18, 0.002), (2.3, 0.004), (0.21, 0.0006)]),
    "bifilar": (ident.measured_inertia_bifilar, [(1.5, 0.004), (2.3, 0.004), (1.2, 0.003), (0.3, 0.001)]),
}


@pytest.mark.study
@pytest.mark.parametrize("name", list(DRAWN))
def test_deviations_are_those_of_drawn_readings(name):
    """Standard deviation of 1500 results from readings drawn with theirs, within 6 %; the shares add up to 1."""
    function, readings = DRAWN[name]
    stated = function(*readings)
    rng = np.random.default_rng(0)
    results = [function(*(float(rng.normal(*reading)) for reading in readings)).value for _ in range(1500)]
    assert stated.std == pytest.approx(np.std(results), rel=0.06)
    assert stated.value == pytest.approx(np.mean(results), abs=4 * stated.std / np.sqrt(1500))
    assert sum(share for *_, share in stated.readings) == pytest.approx(1.0)


def test_a_mass_counts_scatter_scale_digit_and_tare():
    """u² = s²/k + resolution²/12 + u_scale² + u_tare²."""
    found = ident.measured_mass([2.61, 2.614, 2.612], scale_std=0.002, resolution=0.001, tare=(0.3, 0.001))
    expected = np.var([2.61, 2.614, 2.612], ddof=1) / 3 + 0.001**2 / 12 + 0.002**2 + 0.001**2
    assert found.value == pytest.approx(2.312)
    assert found.std == pytest.approx(np.sqrt(expected))
    assert "no reading has a deviation" in str(ident.measured_mass([1.0]))


def test_a_tensor_of_six_axes():
    """Exact of exact moments; with noise within 4.5 of its deviations; axes in a plane determine none."""
    rng = np.random.default_rng(3)
    points = rng.normal(size=(20, 3)) * [0.1, 0.05, 0.03]
    tensor = 0.2 * (np.trace(points.T @ points) * np.eye(3) - points.T @ points)
    axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1]]
    u = np.array(axes) / np.linalg.norm(axes, axis=1, keepdims=True)
    moments = np.einsum("ki,ij,kj->k", u, tensor, u)
    true = tensor[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    assert np.allclose(ident.measured_tensor(axes, list(moments)).values, true, atol=1e-14)
    scaled = []
    for _ in range(200):
        noisy = [(m + rng.normal(0, 1e-3 * m), 1e-3 * m) for m in moments]
        found = ident.measured_tensor(axes, noisy)
        scaled.append((found.values - true) / found.std)
    assert np.mean(np.abs(scaled) < 1.96) == pytest.approx(0.95, abs=0.03)
    with raises_at(IdentificationError, "axes", "six directions"):
        ident.measured_tensor([[1, k, 0] for k in range(6)], list(moments[:6]))
    with pytest.raises(IdentificationError, match="principal moments"):
        ident.measured_tensor(axes[:6], [1.0, 1.0, 5.0, 1.0, 3.0, 3.0])


def test_numbers_go_into_the_record_with_their_source(tmp_path):
    """Value, deviation and kind; the dynamics count them; comments of the file stay; impossible ones are refused."""
    path = tmp_path / "arm.toml"
    plain = aw.load("two-link")
    ident.write_measured(
        "two-link", "forearm", {"mass": ident.measured_mass([3.0], scale_std=0.01)}, path, key="scales"
    )
    arm = aw.load(path)
    assert float(arm.record.link("forearm").mass_kg) == 3.0
    assert arm.record.link("forearm").mass_kg.std == 0.01
    assert arm.provenance("forearm.mass_kg").kind == "measurement"
    assert "scale" in arm.provenance("forearm.mass_kg").text
    assert not np.allclose(aw.gravity_torques(arm, [0.1, 0.2]), aw.gravity_torques(plain, [0.1, 0.2]))
    more = {
        "com_x": ident.measured_centre((1.5, 0.001), 0.2, 3.0),
        "izz": ident.measured_inertia_pendulum((1.4954, 1e-3), 3.0, 0.2),
    }
    ident.write_measured(path, "forearm", more, path)
    arm = aw.load(path)
    assert arm.record.link("forearm").com_m.value[0] == pytest.approx(0.1)
    assert arm.provenance("forearm.inertia_kg_m2.zz").kind == "measurement"
    assert float(arm.record.link("forearm").mass_kg) == 3.0
    before = path.read_text()
    with pytest.raises(DescriptionError, match="impossible inertia"):
        ident.write_measured(path, "forearm", {"izz": ident.measured_inertia_bifilar(20.0, 3.0, 1.0, 0.5)}, path)
    assert path.read_text() == before
    with raises_at(IdentificationError, "measured", value="com_x"):
        ident.write_measured(path, "forearm", {"com_x": ident.measured_mass([1.0])}, path)
    with pytest.raises(IdentificationError, match=r"link9\.mass_kg"):
        ident.write_measured(path, "link9", {"mass": ident.measured_mass([1.0])}, path)


@pytest.mark.parametrize(
    ("function", "arguments", "said"),
    [
        (ident.measured_mass, [[]], "readings"),
        (ident.measured_centre, [1.0, 0.0, 2.0], "span"),
        (ident.measured_centre, [2.1, 0.4, 2.0], "both supports"),
        (ident.measured_centre, [-0.1, 0.4, 2.0], "both supports"),
        (ident.measured_centre, [1.0, (0.2, -0.1), 2.0], "deviation of 0"),
        (ident.measured_inertia_pendulum, [0.1, 2.0, 0.5], "shorter than"),
        (ident.measured_inertia_bifilar, [1.0, "two", 1.0, 1.0], "mass"),
    ],
)
def test_what_is_no_reading_is_refused(function, arguments, said):
    """By the name of the reading."""
    with pytest.raises(IdentificationError, match=said):
        function(*arguments)


def test_the_command_measures_and_writes(tmp_path):
    """Exit 0 with the interval; exit 2 and one line of what is wrong."""
    run = CliRunner().invoke
    out = tmp_path / "arm.toml"
    words = ["measure", "mass", "two-link", "--reading", "2.9", "--scale-std", "0.01", "--link", "forearm"]
    found = run(app, [*words, "-o", str(out)])
    assert found.exit_code == 0, found.output
    assert "95 %: 2.8804 to 2.9196 kg" in found.output
    assert float(aw.load(out).record.link("forearm").mass_kg) == 2.9
    for each in ("centre --reading 1.0 --span 0.4 --mass 2", "pendulum --swing-period 1.3,.001 --mass 2 --distance 0.2",
                 "bifilar --swing-period 1.3 --mass 2 --wire-length 1 --spacing 0.2,0.001"):  # fmt: skip
        assert run(app, ["measure", *each.split()]).exit_code == 0, each
    wrong = run(app, words)
    assert wrong.exit_code == 2
    assert "--output" in wrong.output
    wrong = run(app, ["measure", "pendulum", "--swing-period", "1.3,1,1", "--mass", "2", "--distance", "0.2"])
    assert wrong.exit_code == 2
    assert "--swing-period" in wrong.output


@pytest.mark.parametrize(("readings", "scale_std"), [(2, 0.0), (3, 0.0), (3, 0.5)])
def test_interval_of_a_few_readings_covers_the_mass(readings, scale_std):
    """The scatter of two readings says little of their deviation: 1.96 of it cover in 7 of 10 cases."""
    draw, covered = np.random.default_rng(1), 0
    for _ in range(400):
        seen = 10.0 + scale_std * draw.standard_normal() + draw.standard_normal(readings)
        low, high = aw.identification.measured_mass(seen, scale_std=scale_std).interval
        covered += low < 10.0 < high
    assert 0.92 < covered / 400 < 0.99
