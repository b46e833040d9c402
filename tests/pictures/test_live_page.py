"""The live page in a real browser: it goes where the program says, plays runs, and reports its sliders."""

from __future__ import annotations

import time

import numpy as np
import pytest

import armwright as aw
from armwright.session import Session
from physics.arms import arm, random_state
from pictures.browser import Browser, needs_browser

pytestmark = needs_browser
LIVE = "document.getElementById('live').textContent == 'live'"
DARK = 90  # mean brightness of a page


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    browser = Browser(tmp_path_factory.mktemp("browser"))
    yield browser
    browser.close()


def until(there, seconds=30.0):
    """Waits until `there()` holds."""
    end = time.monotonic() + seconds
    while not there():
        assert time.monotonic() < end
        time.sleep(0.05)


def shown(browser):
    """Joint positions that the page shows, to 1e-4."""
    return [float(word) for word in browser.text("#q").split(",")]


@pytest.mark.study
@pytest.mark.parametrize(
    ("name", "fragment", "q"),
    [("panda", "#light", [0.2, -0.8, 0.1, -2.0, 0.1, 1.6, 0.7]), ("gripper", "#dark", None)],
)
def test_it_goes_where_the_program_says(browser, name, fragment, q):
    model = arm(name)
    q = [round(float(v), 3) for v in random_state(model, 1)[0]] if q is None else q
    with aw.show(model, live=True) as live:
        browser.open(live.url, fragment, (1000, 700), stands=LIVE)
        before = browser.picture()
        assert (before.mean() < DARK) == (fragment == "#dark")
        live.q = q
        until(lambda: shown(browser) == pytest.approx(q))
        browser.settle()
        assert (np.abs(browser.picture() - before).max(axis=2) > 30).mean() > 0.01
        x = float(browser.text("#place").split()[1])
        assert x == pytest.approx(float(aw.forward_kinematics(model, q)[0, 3]), abs=1e-4)
        sliders = browser.value("[...document.querySelectorAll('#sliders input')].map((slider) => +slider.value)")
        assert sliders == pytest.approx(q)
        assert browser.faults() == []


@pytest.mark.study
def test_its_sliders_tell_the_program_and_other_pages(browser, tmp_path):
    with aw.show(aw.load("two-link"), live=True) as live:
        browser.open(live.url, stands=LIVE)
        second = Browser(tmp_path)
        try:
            second.open(live.url, stands=LIVE)
            for value in (0.1, 0.2, 0.3, 0.75):
                browser.value(
                    f"((slider) => {{ slider.value = {value}; slider.dispatchEvent(new Event('input', {{ bubbles: true }})); }})"
                    "(document.querySelector('#sliders input'))"
                )
            until(lambda: live.q.tolist() == [0.75, 0.0])
            until(lambda: shown(second) == [0.75, 0.0])
            second.value("document.getElementById('zero').click()")
            until(lambda: live.q.tolist() == [0.0, 0.0])
            until(lambda: shown(browser) == [0.0, 0.0])
            assert browser.faults() == second.faults() == []
        finally:
            second.close()


@pytest.mark.study
def test_it_plays_a_run_in_its_own_time(browser):
    model = aw.load("two-link")
    run = aw.simulate(aw.Scenario(model, 1.0, [0.0, 0.0], start=aw.Start([0.3, 0.2])))
    with aw.show(model, live=True) as live:
        browser.open(live.url, stands=LIVE)
        browser.value(
            "window.seen = []; new MutationObserver(() => window.seen.push([performance.now(),"
            " document.getElementById('live').textContent, document.getElementById('q').textContent]))"
            ".observe(document.getElementById('live'), { childList: true }); 0"
        )
        live.play(run)
        until(lambda: shown(browser) == pytest.approx(run["q"][-1].values, abs=1e-4))
        seen = browser.value("window.seen")
        times = [float(time_shown.split()[-2]) for _, time_shown, _ in seen]
        assert times[0] < times[-1] == 1.0
        assert 1e-3 * (seen[-1][0] - seen[0][0]) > times[-1] - times[0] - 0.1
        for t, (_, _, q_shown) in zip(times, seen, strict=True):
            q = [float(word) for word in q_shown.split(",")]
            exact = [np.interp(t, run["time"], run["q"][:, k]) for k in range(2)]
            speed = float(np.abs(run["qd"]).max())
            assert q == pytest.approx(exact, abs=0.005 * speed + 2e-3)  # t is shown to 0.01 s
        live.play(run)
        live.q = [0.5, 0.5]
        until(lambda: shown(browser) == [0.5, 0.5])
        time.sleep(0.2)
        assert shown(browser) == [0.5, 0.5]  # the run does not go on
        assert browser.faults() == []


@pytest.mark.study
@pytest.mark.parametrize("how", ["pose", "run"])
def test_the_view_steps_back_for_where_the_arm_goes(browser, how):
    """From hanging to stretched out sideways and up: all of it is in the picture and above the floor."""
    model = aw.load("cmu-dd")
    with aw.show(model, live=True) as live:
        browser.open(live.url, size=(1000, 700), stands=LIVE)
        browser.value(
            "{ const draw = Stage.prototype.draw; Stage.prototype.draw = function (pose, ...more) {"
            " draw.call(this, pose, ...more); const m = this.camera().matrix, points = this.gltf.boxes(pose);"
            " const at = (p, i) => m[i] * p[0] + m[i + 4] * p[1] + m[i + 8] * p[2] + m[i + 12];"
            " window.seen = { out: Math.max(...points.flatMap((p) => [0, 1].map((i) => Math.abs(at(p, i) / at(p, 3))))),"
            " above: Math.min(...points.map((p) => p[1])) - this.floor }; }; } 0"
        )
        for angle in (np.pi / 2, np.pi, -np.pi / 2):
            q = [0.0, angle, 0, 0, 0, 0]
            if how == "pose":
                live.q = q
            else:
                live.play(aw.simulate(aw.Scenario(model, 0.3, [0.0] * 6, start=aw.Start(q))))
            until(lambda goal=live.q: shown(browser) == pytest.approx(goal, abs=1e-3))
            browser.settle()
            seen = browser.value("window.seen")
            assert seen["out"] <= 1.0
            assert seen["above"] > -1e-6
        assert browser.faults() == []


@pytest.mark.study
def test_a_session_drives_it(browser):
    session = Session("two-link")
    session.run("watch")
    live = session.live
    assert live is not None
    browser.open(live.url, stands=LIVE)
    session.run("theta = 30 deg")
    until(lambda: shown(browser) == pytest.approx([0.5236, 0.5236]))
    session.run("simulate new steps=200")
    until(lambda: shown(browser) == pytest.approx(session.state.q, abs=1e-4))
    assert browser.text("#live") == "live, t = 0.20 s"
    session.run("database-read panda")
    until(lambda: browser.value("document.title == 'panda' && !!document.getElementById('q')"))
    until(lambda: browser.value(LIVE))
    assert len(shown(browser)) == 7
    session.run("watch off")
    until(lambda: browser.text("#live") == "the program has ended")
    assert browser.value("document.querySelectorAll('#sliders input').length") == 7  # it stays, and may be looked at
