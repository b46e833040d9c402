"""Identification of servos: numbers that simulated logs return, what is refused, the record, and the command."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.identification.servo import identify as identify_module, search as search_module
from armwright.identification.servo.bench import PATHS
from armwright.identification.servo.orders import OFFSET, Scales, order_of
from armwright.identification.servo.output_error import BenchProblem
from cli.test_commands import run
from raises_at import raises_at

LOOP = aw.identification.ServoLoop(0.166, 0.97)
TRUE = {"kt": 1.2, "R": 2.7, "J": 0.02, "viscous": 0.06, "coulomb": 0.05, OFFSET: 0.03}
MOTIONS = (lambda t: np.sin(t * t), lambda t: -np.pi / 4 * (1 - np.cos(1.5 * t)), lambda t: 0.8 * np.sin(3 * t))


def bench_log(motion, p, mass, k=0, **more):
    """A log of which all but the position is known."""
    t = np.arange(0.0, 3.0, 5e-3) + np.random.default_rng(k).uniform(0.0, 1e-3, 600)
    on = (t < 1.5).astype(float) if k == 1 else np.ones(600)
    log = {"arm_mass": 0.05, "servo": "sts3215", **more}
    return aw.identification.BenchLog(
        f"log{k}", t, 0.0 * t, MOTIONS[motion](t), on, 7.4 - 0.5 * np.sin(t) ** 2, p, mass, 0.12, **log
    )


@pytest.fixture(scope="module")
def logs():
    """Logs as the simulator has them, in counts."""
    blank = [bench_log(k % 3, p, mass, k) for k, (p, mass) in enumerate([(8, 1.0), (32, 1.0), (16, 0.5), (32, 0.5)])]
    order = order_of("M1", LOOP, Scales.of(blank), ("offset",))
    problem = BenchProblem(tuple(blank), LOOP, order)
    values = order.matrix @ np.array([TRUE[name] for name in order.names]) + order.fixed
    q, count = problem.predictions(values[None])[0], 2 * np.pi / 4096
    counted = np.floor(q / count + 0.5) * count
    return [replace(log, position=counted[part]) for log, part in zip(blank, problem.parts, strict=True)]


@pytest.fixture(scope="module")
def fit(logs):
    return aw.identification.identify_servo(
        logs, LOOP, search=aw.identification.ServoSearch(orders=("M1", "M3")), progress=False
    )


def as_json(log, folder, **more):
    """The log as BAM writes it."""
    entries = [
        {
            "timestamp": t,
            "position": q,
            "goal_position": goal,
            "torque_enable": bool(on),
            "input_volts": volts,
            "load": 3,
        }
        for t, q, goal, on, volts in zip(log.t, log.position, log.goal, log.on, log.supply, strict=True)
    ]
    document = {
        "mass": log.mass,
        "arm_mass": log.arm_mass,
        "length": log.length,
        "kp": log.p,
        "vin": 7.4,
        "motor": log.servo,
    }
    path = folder / f"{log.name}.json"
    path.write_text(json.dumps(document | {"entries": entries} | more), encoding="utf-8")
    return path


def test_logs_return_the_numbers_that_they_were_simulated_with(fit):
    assert fit.order == "M1"
    assert fit.good
    assert fit.error < 1.2e-3  # counts are 1.5e-3 rad
    for name, value in TRUE.items():
        low, high = fit.estimate.interval(PATHS.get(name, name))
        assert high - low < 0.3 * abs(value)
        assert low - 0.5 * (high - low) < value < high + 0.5 * (high - low), name
    assert [each.order for each in fit.orders] == ["M1", "M3"]
    assert fit.orders[0].chosen
    assert np.isfinite([each.held_out for each in fit.orders]).all()


def test_the_record_has_the_numbers_with_their_deviations(fit, tmp_path):
    arm = aw.load(fit.write(tmp_path / "servo.toml"))
    found = arm.parameters["servo.motor.resistance_ohm"]
    assert found.value == pytest.approx(fit.estimate["servo.motor.resistance_ohm"], rel=1e-9)
    assert found.std == pytest.approx(fit.estimate.std[1], rel=1e-3)
    assert arm.record.sources["fit"].kind == "fit"
    run_ = aw.simulate(aw.Scenario(arm, 1.0, command=[0.5]))
    assert 0.2 < run_.q.values[-1, 0] < 0.5
    picture, page = tmp_path / "servo.png", tmp_path / "servo.html"
    fit.plot(picture)
    fit.report(page)
    assert "log0" in page.read_text(encoding="utf-8")
    assert picture.stat().st_size > 1000


def test_the_model_is_the_published_bench(logs):
    """Gravity at q + q_offset: where a servo that is off comes to rest without friction, and the pendulum's inertia."""
    order = order_of("M1", LOOP, Scales.of(logs), ("offset",))
    arm = BenchProblem((replace(logs[0], arm_mass=0.2),), LOOP, order).arm
    mass, rod, length, offset = 1.0, 0.2, 0.12, 0.1  # the arm's own offset
    for q in (-0.7, 0.0, 1.2):
        g = aw.gravity_torques(arm.replace(firmware=None), [q])[0]
        assert g == pytest.approx((mass + rod / 2) * 9.80665 * length * np.sin(q + offset), rel=1e-12)
    inertia = aw.mass_matrix(arm, [0.3])[0, 0] - arm.parameters["servo.motor.rotor_inertia_kg_m2"].value
    assert inertia == pytest.approx((mass + rod / 3) * length**2, rel=1e-9)


def test_a_log_is_read_as_it_was_written(logs, tmp_path):
    again = aw.identification.read_bench_log(as_json(logs[1], tmp_path))
    for name in ("t", "position", "goal", "on", "supply"):
        np.testing.assert_array_equal(getattr(again, name), getattr(logs[1], name))
    assert (again.p, again.mass, again.arm_mass, again.length, again.servo) == (32, 1.0, 0.05, 0.12, "sts3215")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mass": -1.0}, r"mass = -1\.0: .*number above 0"),
        ({"kp": "high"}, "kp = 'high': .*finite number"),
        ({"entries": []}, "entries: .*rows"),
        ({"entries": [{"timestamp": 0.0, "position": 0.0}]}, r"entries\[0\]\.goal_position: missing"),
        (
            {"entries": [{"timestamp": 0.0, "position": 0.0, "goal_position": 0.0}] * 30},
            r"t\[1\] = 0\.0: not later than",
        ),
    ],
)
def test_a_wrong_log_is_refused_by_file_and_place(logs, tmp_path, change, words):
    path = as_json(logs[0], tmp_path, **change)
    with pytest.raises(aw.ArmwrightError, match=f"log0.json.*{words}"):
        aw.identification.read_bench_log(path)


def test_wrong_options_are_refused(logs):
    identify, search = aw.identification.identify_servo, aw.identification.ServoSearch
    with raises_at(aw.ArmwrightError, "motor", value="mine"):
        identify([replace(each, servo="mine") for each in logs], progress=False)
    with raises_at(aw.ArmwrightError, "motor", "sts3215", value="xl330"):
        identify([logs[0], replace(logs[1], servo="xl330")], progress=False)
    with raises_at(aw.ArmwrightError, "free", value="goal_speed"):
        identify(logs, LOOP, search=search(free=("goal_speed",)), progress=False)
    with pytest.raises(aw.ArmwrightError, match="orders = 'M7'"):
        search(orders=("M7",))


def test_a_rod_of_unknown_mass_is_said(logs, tmp_path):
    silent = [replace(each, arm_mass=None) for each in logs[:1]]
    search = aw.identification.ServoSearch(orders=("M1",))
    found = aw.identification.identify_servo(silent, LOOP, search=search, progress=False)
    assert found.sentences()[0] == found.estimate.verdict
    assert "no log states the mass of the rod" in found.sentences()[1]
    page = found.report(tmp_path / "servo.html").read_text(encoding="utf-8")
    assert f'<p class="verdict{" good" * found.good}">{found.estimate.verdict.capitalize()}.</p>' in page
    assert "simulated" in page


def test_the_command_names_its_own_option(logs, tmp_path):
    done = run("identify", "servo", str(as_json(logs[0], tmp_path)), "--friction-models", "M9", code=2)
    assert "--friction-models = 'M9'" in done.stderr


def test_the_command_shows_and_writes_it(logs, tmp_path):
    paths, record = [str(as_json(each, tmp_path)) for each in logs], tmp_path / "servo.toml"
    options = ["--duty-gain", "0.166", "--max-duty", "0.97", "--friction-models", "M1", "-o", str(record)]
    shown = run("identify", "servo", *paths, *options).stdout
    for words in ("servo.motor.resistance_ohm", "± std", "M1", "identified", "wrote"):
        assert words in shown
    assert aw.load(record).n == 1
    wrong = run("identify", "servo", paths[0], "--max-duty", "0.9", code=2)
    assert wrong.stderr.startswith("armwright: error: ")
    assert "--duty-gain" in wrong.stderr


def test_ctrl_c_keeps_the_models_that_were_compared(logs, tmp_path, monkeypatch):
    paths, record = [str(as_json(each, tmp_path)) for each in logs], tmp_path / "servo.toml"
    validated, done = search_module._validated, []

    def until_the_second(few, problem, earlier):
        done.append(problem.order.name)
        if len(done) == 2:
            raise KeyboardInterrupt
        return validated(few, problem, earlier)

    monkeypatch.setattr(search_module, "_validated", until_the_second)
    options = ["--duty-gain", "0.166", "--max-duty", "0.97", "--friction-models", "M1,M2", "-o", str(record)]
    found = run("identify", "servo", *paths, *options, code=130)
    assert "note: stopped by Ctrl-C before M2 could be compared; what was found until then is kept" in found.stderr
    assert "stopped by Ctrl-C before M2 could be compared" in found.stdout
    assert aw.load(record).n == 1


def test_rows_in_one_count_weigh_as_what_they_tell(logs):
    """As one row where the count is all that is wrong, fully where the model is wrong by much more."""
    problem = BenchProblem((logs[0],), LOOP, order_of("M1", LOOP, Scales.of(logs)))
    count = 2 * np.pi / 4096
    position, ends = logs[0].position, np.flatnonzero(np.diff(logs[0].position, prepend=np.nan, append=np.nan))
    only_counts = problem.weights(count**2 / 12)
    np.testing.assert_allclose(np.add.reduceat(only_counts**2, ends[:-1]), 1.0, rtol=1e-6)
    assert len(position) == len(only_counts)
    assert problem.weights(1.0).min() > 0.999


def test_parts_start_from_the_measured_state(logs):
    """The numbers of the simulation reproduce parts of its logs, but for the counts from which their states are taken."""
    fast = replace(LOOP, goal_speed_rad_per_s=2.0)
    for loop, bound in ((LOOP, 2e-3), (fast, 4e-3)):
        order = order_of("M1", loop, Scales.of(logs), ("offset",))
        problem = BenchProblem(tuple(logs), loop, order)
        values = order.matrix @ np.array([TRUE[name] for name in order.names]) + order.fixed
        whole = problem.predictions(values[None])[0]
        measured = tuple(replace(log, position=whole[part]) for log, part in zip(logs, problem.parts, strict=True))
        parts = BenchProblem(measured, loop, order, 0.5)
        assert np.abs(parts.predictions(values[None])[0] - whole).mean() < bound
        wrong = BenchProblem(tuple(replace(log, position=log.position + 0.1) for log in measured), loop, order, 0.5)
        used = np.array([[True, False, True, True]])
        errors = wrong.errors(np.array([[each.to_coordinate(TRUE[each.name]) for each in order.unknowns]]), used)[0]
        assert not errors[wrong.parts[1]].any()
        assert errors[wrong.parts[0]].any()


@pytest.mark.parametrize(("count", "folds"), [(1, 1), (2, 2), (4, 4), (6, 6), (8, 4), (16, 2), (40, 2)])
def test_every_log_is_held_out_once(logs, count, folds):
    held = search_module.folds([replace(logs[k % 4], p=1.0 + k // 4) for k in range(count)])
    assert len(held) == folds
    assert sorted(k for each in held for k in each) == list(range(count if count > 1 else 0))


@pytest.mark.study
def test_another_seed_finds_the_same_numbers(logs):
    """Of logs that the model does not describe: friction grows by the load, and M1 has none of that."""
    order = order_of("M3", LOOP, Scales.of(logs))
    problem = BenchProblem(tuple(logs), LOOP, order)
    values = order.matrix @ np.array([TRUE.get(name, 0.4) for name in order.names]) + order.fixed
    whole = problem.predictions(values[None])[0]
    wrong = [replace(log, position=whole[part]) for log, part in zip(logs, problem.parts, strict=True)]
    searches = [aw.identification.ServoSearch(orders=("M1",), seed=seed) for seed in (0, 1)]
    fits = [aw.identification.identify_servo(wrong, LOOP, search=each, progress=False) for each in searches]
    assert fits[0].error > 5e-3
    np.testing.assert_allclose(fits[0].estimate.values, fits[1].estimate.values, rtol=0.02, atol=1e-4)


@pytest.mark.parametrize(
    ("whole", "parts", "name", "way"),
    [
        ((0.10, 0.02), (0.09, 0.03), "M3", 0),  # whole logs predict best, by M3
        ((0.10, 0.05), (0.09, 0.03), "M3", 1),
        ((0.10, 0.05), (0.0303, 0.03), "M1", 1),  # 1 % worse is no worse
    ],
)
def test_what_predicts_held_out_logs_best_is_taken(logs, whole, parts, name, way):
    problem = BenchProblem(tuple(logs), LOOP, order_of("M1", LOOP, Scales.of(logs)))

    def model(error):
        return search_module.Validated(problem, np.zeros((4, 5)), np.full(12, error), np.full(4, error))

    models = {each: (model(whole[k]), model(parts[k])) for k, each in enumerate(("M1", "M3"))}
    chosen, asked = identify_module._chosen(models)
    assert chosen == name
    assert asked == {each: ways[way] for each, ways in models.items()}
