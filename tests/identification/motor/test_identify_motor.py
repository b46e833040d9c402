"""Motors found again from logs of known ones; what a log cannot tell is said; bad input ends in one line."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ArmwrightError, LogError, ModelError
from armwright.identification import MotorReading, MotorSearch
from identification.motor_truth import DELAY, PATHS, PERIOD, TRUE, true_record, write_log

STARTS = 4
R, KT, J = (PATHS[name] for name in ("R", "Kt", "J"))


@pytest.fixture(scope="module", params=range(2))
def seed(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("seed")
    return aw.identification.identify_motor(write_log(folder, request.param), search=MotorSearch(starts=STARTS))


@pytest.mark.study
def test_every_parameter_is_found(seed):
    estimate = seed.estimate
    assert estimate.verdict == "identified"
    for name, path in PATHS.items():
        assert estimate[path] == pytest.approx(TRUE[name], rel=0.03), name
        assert abs(estimate[path] - TRUE[name]) < 4.5 * estimate.std[estimate.number(path)], name
    assert estimate["delay_s"] / PERIOD == pytest.approx(DELAY, abs=0.02)


def test_predictions_are_returned(seed):
    (run,) = seed.predictions.values()
    error = run.q - run.q_predicted
    assert float(np.sqrt((error**2).mean())) < 1.2 * 2 * np.pi / 4096 / np.sqrt(12), "only the counts are left"
    assert seed.estimate.fit["run1: q"]["r2"] > 0.999


def test_the_record_has_the_numbers_and_their_source(seed, tmp_path):
    record = aw.load(seed.write(tmp_path / "motor.toml")).record
    motor = record.joints[0].motor
    assert motor.resistance_ohm.value == pytest.approx(seed.estimate[R], rel=1e-9)
    assert motor.resistance_ohm.std > 0
    assert record.provenance(R).kind == "fit"
    assert record.fits["fit"].others["delay_s"].value == pytest.approx(DELAY * PERIOD, rel=0.02)
    assert record.fits["fit"].correlation_matrix().shape == (6, 6)


@pytest.mark.study
def test_without_a_current_only_products_are_found_and_it_says_so(tmp_path):
    found = aw.identification.identify_motor(
        write_log(tmp_path, 0, ("qd",)),
        fixed={"viscous": TRUE["viscous"]},
        search=MotorSearch(starts=STARTS),
    )
    estimate = found.estimate
    assert not estimate.identifiable[estimate.number(R)]
    assert estimate[R] == 1.0
    text = str(estimate)
    for words in ("resistance", "rotor inertia", "cannot be distinguished", "a log of the current"):
        assert words in text
    known = aw.identification.identify_motor(
        tmp_path / "log.log.toml",
        fixed={"viscous": TRUE["viscous"], "R": TRUE["R"]},
        search=MotorSearch(starts=STARTS),
    ).estimate
    assert known[KT] == pytest.approx(TRUE["Kt"], rel=0.02)
    assert known[J] == pytest.approx(TRUE["J"], rel=0.03)


def test_what_was_asked_for_and_cannot_be_told_is_not_identified(tmp_path):
    found = aw.identification.identify_motor(
        write_log(tmp_path, 0, ("qd",)),
        free=["R", "Kt", "J", "coulomb"],
        fixed={"delay": DELAY * PERIOD},
        search=MotorSearch(starts=STARTS),
    )
    assert found.estimate.verdict == "not identified"
    assert "R was to be fitted" in str(found.estimate)


def test_numbers_that_stay_at_first_guesses_are_not_identified(tmp_path):
    """J and Kt fit the log whatever R stands at; with R said they are identified."""
    log, options = write_log(tmp_path, 0, ("qd",)), {"free": ["Kt", "J", "coulomb"], "search": MotorSearch(starts=1)}
    known = {"delay": DELAY * PERIOD, "viscous": TRUE["viscous"]}
    found = aw.identification.identify_motor(log, fixed=known, **options).estimate
    assert found.verdict == "not identified"
    assert any("R = 1" in each for each in found.remarks)
    assert (
        aw.identification.identify_motor(log, fixed={**known, "R": TRUE["R"]}, **options).estimate.verdict
        == "identified"
    )


def test_current_that_drives_tells_all_but_the_scale(tmp_path):
    log = write_log(tmp_path, 1, ("current", "qd"))
    text = log.read_text()
    log.write_text(
        text.replace(text[text.index("[[signals]]") : text.index("[[signals]]", text.index("[[signals]]") + 1)], "")
    )
    found = aw.identification.identify_motor(
        log, fixed={"Kt": TRUE["Kt"], "delay": 0.0}, search=MotorSearch(starts=STARTS)
    ).estimate
    assert found[J] == pytest.approx(TRUE["J"], rel=0.05)
    assert found[PATHS["coulomb"]] == pytest.approx(TRUE["coulomb"], rel=0.2), "a current is not held from row to row"


@pytest.mark.study
def test_a_named_robot_keeps_its_file_and_gives_the_first_guess(tmp_path):
    log = write_log(tmp_path, 2)
    robot = true_record(tmp_path, R=2.0, J=5e-5)
    found = aw.identification.identify_motor(log, robot, search=MotorSearch(starts=STARTS))
    path = found.write(tmp_path / "identified.toml")
    assert found.estimate[R] == pytest.approx(TRUE["R"], rel=0.02)
    assert "# with its load" in path.read_text()


def test_a_parameter_of_each_run_and_its_drift(tmp_path):
    for k, coulomb in enumerate((0.012, 0.015)):
        write_log(tmp_path, k, rows=1000, name=f"run{k}", coulomb=coulomb)
    text = (tmp_path / "run0.log.toml").read_text()
    runs = "".join(f'[[runs]]\nname = "r{k}"\nfiles.log = "run{k}.csv"\n' for k in range(2))
    both = tmp_path / "both.log.toml"
    both.write_text(text.replace('path = "run0.csv"', "").replace("[time]", f"{runs}[time]"))
    estimate = aw.identification.identify_motor(both, search=MotorSearch(per_run=["coulomb"], starts=STARTS)).estimate
    path = PATHS["coulomb"]
    assert estimate[f"r0: {path}"] == pytest.approx(0.012, rel=0.02)
    assert estimate[f"r1: {path}"] == pytest.approx(0.015, rel=0.02)
    assert estimate[path] == pytest.approx(0.0135, rel=0.02)
    assert "drifts by" in str(estimate)


@pytest.mark.parametrize(
    "options", [{"starts": 0}, {"most_delay": -1}, {"per_run": "coulomb"}, {"seed": -1}, {"pwm": "x"}]
)
def test_a_search_that_cannot_be_is_refused(options):
    with pytest.raises(ModelError) as caught:
        MotorSearch(**options)
    assert caught.value.place == next(iter(options))


@pytest.mark.parametrize("place", ["runs", "signals"])
def test_one_text_is_no_list_of_names(place):
    with pytest.raises(LogError) as caught:
        aw.identification.MotorReading(**{place: "qd"})
    assert caught.value.place == place


def test_a_delay_may_be_known_like_any_number(tmp_path):
    log = write_log(tmp_path, 0, rows=400)
    found = aw.identification.identify_motor(
        log, fixed={"delay": DELAY * PERIOD}, search=MotorSearch(starts=1)
    ).estimate
    assert "delay_s" not in found.names
    assert found[J] == pytest.approx(TRUE["J"], rel=0.1)


def test_bad_input_is_refused(tmp_path):
    log = write_log(tmp_path, 3, rows=200)
    wrong = [
        {"free": "R"},
        {"free": ["mass"]},
        {"free": ["elasticity.backlash_rad"]},
        {"free": ["R"], "fixed": {"R": 1.0}},
        {"joint": "elbow"},
        {"arm": "cmu-dd"},
        {"reading": MotorReading(runs=["run9"])},
        {"reading": MotorReading(signals=["tau"])},
        {"reading": MotorReading(static=log.parent / "nowhere.log.toml")},
        {"fixed": {"R": -1.0}},
        {"fixed": {"delay": 3.0}},
        {"fixed": {"delay": -0.01}},
        {"fixed": {"R": 1.0}, "search": MotorSearch(per_run=["R"])},
    ]
    with pytest.raises(LogError, match="speed = 'instantly'"):
        MotorReading(speed="instantly")
    for options in wrong:
        with pytest.raises(ArmwrightError):
            aw.identification.identify_motor(log, **options)
    text = log.read_text()
    for signal in ("u", "w"):
        table = np.genfromtxt(tmp_path / "log.csv", delimiter=",", names=True)
        table[signal] = 1.0
        np.savetxt(tmp_path / "log.csv", np.column_stack([table[n] for n in table.dtype.names]), delimiter=",",
                   header=",".join(table.dtype.names), comments="")  # fmt: skip
        with pytest.raises(LogError) as error:
            aw.identification.identify_motor(log)
        assert "never changes" in str(error.value)
        write_log(tmp_path, 3, rows=200)
    log.write_text(
        text.split("[[signals]]")[0]
        + '[[signals]]\nquantity = "speed"\ncolumns = "w"\nunit = "rad/s"\nside = "joint"\n'
    )
    with pytest.raises(LogError) as error:
        aw.identification.identify_motor(log)
    assert "voltage" in str(error.value)
    assert isinstance(ModelError("x"), ArmwrightError)


def test_a_rotor_inertia_at_the_bound_of_its_search_is_marked(tmp_path):
    """A record that is wrong by more than the search reaches: no number is made of it."""
    log = write_log(tmp_path, 4, rows=400)
    found = aw.identification.identify_motor(
        log,
        true_record(tmp_path, J=TRUE["J"] * 2e4),
        free=["J"],
        fixed={"delay": DELAY * PERIOD},
        search=MotorSearch(starts=1),
    ).estimate
    assert found.verdict == "not identified"
    assert found.at_bound[found.number(J)]
    assert not np.isfinite(found.std[found.number(J)])
    assert "stands at a bound of its search" in str(found)
