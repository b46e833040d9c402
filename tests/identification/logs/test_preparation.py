"""Preparation of logs: no delay, known gains, derivatives of known functions, and no seams between blocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal as sp

import armwright as aw
from armwright.errors import LogError
from armwright.identification.logs.prepared import prepared_blocks
from armwright.identification.logs.spectrum import motion_band, spectrum
from identification.logs.example_logs import ALL, HEAD, POSITIONS, RATE, TORQUES, columns, motion, written
from raises_at import raises_at

TWO = HEAD + POSITIONS + TORQUES


def noisy(seconds=20.0, counts=100_000, torque=0.3):
    table = columns(seconds)
    rng = np.random.default_rng(11)
    for name in ("q1", "q2"):
        table[name] = np.round(table[name] * counts / (2 * np.pi)) * 2 * np.pi / counts
    for name in ("m1", "m2"):
        table[name] = table[name] + torque * rng.normal(size=len(table["t"]))
    return table


def test_derivatives_and_signals_of_a_noisy_log(tmp_path):
    log = aw.identification.read_log(written(tmp_path, TWO, {"arm.csv": noisy()}))
    data = aw.identification.prepare_log(log)
    q, qd, qdd, _ = motion(data["time"].values)
    assert np.abs(data["q"] - q).max() < 2e-3
    assert float(np.abs(data["qd"] - qd).max() / np.abs(qd).max()) < 0.02
    assert float(((data["qdd"] - qdd) ** 2).mean() / (qdd**2).mean()) < 0.02**2
    assert (data["qd"].attrs["units"], data["qdd"].attrs["units"]) == ("rad/s", "rad/s²")
    assert set(data["stretch"].values) == {0}


def test_the_choice_is_explained_in_words(tmp_path):
    log = aw.identification.read_log(written(tmp_path, TWO, {"arm.csv": noisy()}))
    choice = aw.identification.choose_preparation(log)
    assert 3.0 < choice.cutoff < 60.0  # the motion has 1.5 Hz and Coulomb friction, counts are noise from some 20 Hz on
    assert choice.decimate > 1
    assert choice.rate / choice.decimate >= 2 * choice.cutoff
    text = "\n".join(choice.reasons)
    for word in (
        f"cut-off {choice.cutoff:.4g} Hz",
        "no delay",
        "central differences",
        f"every {choice.decimate}",
        f"{choice.edge} rows",
    ):
        assert word in text
    assert aw.identification.prepare_log(log).attrs["preparation"] == text


@pytest.mark.parametrize("frequency", [2.0, 10.0, 25.0])
def test_the_filter_shifts_nothing_and_has_the_gain_of_two_butterworths(tmp_path, frequency):
    t = np.arange(5000) / RATE
    table = {"t": t, "q1": np.sin(2 * np.pi * frequency * t), "q2": np.cos(t), "m1": np.cos(t), "m2": np.sin(t)}
    log = aw.identification.read_log(written(tmp_path, TWO, {"arm.csv": table}), on_error="keep")
    data = aw.identification.prepare_log(
        log, preparation=aw.identification.choose_preparation(log, cutoff=20.0, decimate=1)
    )
    time = data["time"].values
    parts = np.stack([np.sin(2 * np.pi * frequency * time), np.cos(2 * np.pi * frequency * time)], axis=1)
    (in_phase, shifted), *_ = np.linalg.lstsq(parts, data["q"].values[:, 0], rcond=None)
    warped = np.tan(np.pi * frequency / RATE) / np.tan(np.pi * 20.0 / RATE)  # Butterworth by the bilinear transform
    assert in_phase == pytest.approx(1 / (1 + warped**8), abs=2e-3)
    assert abs(shifted) < 2e-3


@pytest.mark.parametrize("rows", [500, 1237])
def test_blocks_have_no_seams(tmp_path, rows):
    log = aw.identification.read_log(written(tmp_path, TWO, {"arm.csv": noisy()}))
    choice = aw.identification.choose_preparation(log)
    whole = aw.identification.prepare_log(log, preparation=choice)
    blocks = [block for _, block in prepared_blocks(log, log.runs[0].name, choice, rows)]
    assert len(blocks) > 5
    assert np.allclose(np.concatenate([block.t for block in blocks]), whole["time"], atol=1e-12)
    for name in ("q", "tau", "qd", "qdd"):
        values = np.concatenate([block.values[name] for block in blocks])
        assert np.abs(values - whole[name].values).max() < 1e-6 * np.abs(whole[name].values).max()


def test_stretches_are_filtered_apart(tmp_path):
    table = noisy()
    kept = np.r_[0:4000, 4400:10001]
    log = aw.identification.read_log(
        written(tmp_path, TWO, {"arm.csv": {name: column[kept] for name, column in table.items()}})
    )
    data = aw.identification.prepare_log(log)
    choice = aw.identification.choose_preparation(log)
    for number, (begin, end) in enumerate(((0, 3999), (4400, 10000))):
        times = data["time"].values[data["stretch"].values == number]
        assert times[0] == pytest.approx(table["t"][begin] + choice.edge / RATE)
        assert times[-1] <= table["t"][end] - choice.edge / RATE + 1e-9
    assert np.abs(data["q"] - motion(data["time"].values)[0]).max() < 2e-3


def test_uneven_times_are_interpolated(tmp_path):
    t = np.arange(8001) / RATE
    t[1:-1] += 0.2 / RATE * np.random.default_rng(2).uniform(-1, 1, len(t) - 2)
    q, _, _, tau = motion(t)
    table = {"t": t, "q1": q[:, 0], "q2": q[:, 1], "m1": tau[:, 0], "m2": tau[:, 1]}
    data = aw.identification.prepare_log(aw.identification.read_log(written(tmp_path, TWO, {"arm.csv": table})))
    assert np.abs(np.diff(data["time"].values, 2)).max() < 1e-12
    assert np.abs(data["q"] - motion(data["time"].values)[0]).max() < 1e-3


def test_speeds_alone_and_the_savitzky_golay_derivative(tmp_path):
    text = HEAD + '[[signals]]\nquantity = "speed"\ncolumns = ["v1", "v2"]\nunit = "rad/s"\nside = "joint"\n'
    log = aw.identification.read_log(written(tmp_path, text))
    data = aw.identification.prepare_log(
        log, preparation=aw.identification.choose_preparation(log, cutoff=40.0, differentiation="savgol")
    )
    assert "q" not in data
    assert np.abs(data["qdd"] - motion(data["time"].values)[2]).max() < 0.05


@pytest.mark.parametrize("derivatives", [1, 2])
def test_the_band_of_a_known_motion(derivatives):
    """Band-limited motion in white noise: the valley lies where the motion's spectrum meets the noise."""
    rng, rate = np.random.default_rng(5), 1000.0
    sections = sp.butter(6, 12.0, fs=rate, output="sos")
    clean = sp.sosfiltfilt(sections, rng.normal(size=60_000)) / (1 if derivatives == 2 else 3)
    band, _ = motion_band(clean + 1e-4 * rng.normal(size=len(clean)), rate, derivatives)
    assert 12.0 < band < 40.0
    assert motion_band(1e-4 * rng.normal(size=60_000), rate, derivatives)[0] == 0.0


def test_a_spectrum_is_power_per_hertz():
    rng, rate = np.random.default_rng(9), 250.0
    f, power = spectrum(0.3 * rng.normal(size=200_000), rate)
    assert np.median(power[f > 20]) == pytest.approx(2 * 0.3**2 / rate, rel=0.03)


def test_too_short_and_impossible_choices(tmp_path):
    log = aw.identification.read_log(written(tmp_path, ALL, {"arm.csv": columns(0.5)}), on_error="keep")
    choice = aw.identification.choose_preparation(log, cutoff=1.0)
    with raises_at(LogError, "run 'run1'", r"251 rows.*3602 rows"):
        aw.identification.prepare_log(log, preparation=choice)
    for wrong, said in (
        ({"cutoff": 300.0}, "below half the rate"),
        ({"cutoff": 0.5 / log.run().period * (1 - 1e-12)}, "below half the rate"),
        ({"cutoff": 10.0, "decimate": 40}, "decimate = 40: expected 1 to 2[45]"),
        ({"order": 0}, "order = 0"),
        ({"differentiation": "spline"}, "differentiation = 'spline'"),
    ):
        with pytest.raises(LogError, match=said):
            aw.identification.choose_preparation(log, **wrong)
    assert replace(choice, cutoff=2.0).sections.shape == (2, 6)


@pytest.mark.parametrize("rate", [200.0, 1000.0])
@pytest.mark.parametrize("lines", [4, 10, 200])
@pytest.mark.parametrize("slope", [0, 1, 2])
def test_the_band_of_a_multisine_reaches_its_highest_line(rate, lines, slope):
    """Lines an octave and more apart leave gaps in the spectrum, at which the band does not end."""
    rng, duration, highest = np.random.default_rng(lines), 10.0, 20.0
    t = np.arange(int(rate * duration)) / rate
    f = np.unique(np.round(np.geomspace(0.2, highest, lines) * duration)) / duration
    q = np.sum(f[:, None] ** -slope * np.sin(2 * np.pi * f[:, None] * t + rng.uniform(0, 6.28, (len(f), 1))), axis=0)
    q += 1e-6 * np.ptp(q) * rng.standard_normal(len(t))
    for signal, derivatives in ((q, 2), (np.gradient(q, 1.0 / rate), 1)):
        band, _ = motion_band(signal, rate, derivatives)
        assert highest <= band <= 4.5 * highest


def with_lost_rows(t, rng):
    return np.delete(t, rng.choice(np.arange(10, len(t) - 10), len(t) // 100, replace=False))


def with_jitter(t, rng):
    return np.sort(t + rng.uniform(-0.3, 0.3, len(t)) / RATE)


@pytest.mark.parametrize("change", [with_lost_rows, with_jitter, None])
def test_gaps_of_a_few_rows_are_bridged(tmp_path, change):
    """Lost rows, an uneven clock or empty cells: prepared rows are those of the motion, in one stretch, in any blocks."""
    rng, t = np.random.default_rng(5), columns(20.0)["t"]
    t = t if change is None else change(t, rng)
    q = motion(t)[0] + 1e-5 * rng.normal(size=(len(t), 2))
    table = {"t": t, "q1": q[:, 0], "q2": q[:, 1], "m1": np.cos(t), "m2": np.sin(t)}
    if change is None:
        table["m2"] = np.where(rng.random(len(t)) < 0.01, np.nan, table["m2"])
    log = aw.identification.read_log(written(tmp_path, TWO, {"arm.csv": table}))
    assert log.run().census.pieces > 20
    assert any("preparation makes 1" in str(each) for each in log.findings)
    chosen = aw.identification.choose_preparation(log, cutoff=10.0)
    data = aw.identification.prepare_log(log, None, chosen)
    assert set(data["stretch"].values) == {0}
    assert np.ptp(np.diff(data["time"])) < 1e-9
    q, _, qdd, _ = motion(data["time"].values + t[0])
    assert np.abs(data["q"] - q).max() < 1e-3
    assert float(((data["qdd"] - qdd) ** 2).mean() / (qdd**2).mean()) < 0.02**2
    parts = [block.values["q"] for _, block in prepared_blocks(log, "run1", chosen, rows=500)]
    np.testing.assert_allclose(np.concatenate(parts), data["q"], atol=1e-7)


def test_gaps_of_commands_are_not_bridged(tmp_path):
    """What was commanded in the gap is not known."""
    table = columns(20.0)
    table = {name: np.delete(each, [1000]) for name, each in table.items()}
    held = TWO.replace('quantity = "torque"', 'quantity = "torque"\nheld = true')
    log = aw.identification.read_log(written(tmp_path, held, {"arm.csv": table}))
    assert set(
        aw.identification.prepare_log(log, None, aw.identification.choose_preparation(log, cutoff=10.0))[
            "stretch"
        ].values
    ) == {0, 1}
