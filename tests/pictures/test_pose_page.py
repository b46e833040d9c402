"""The page of an arm in a real browser: sliders move it, and the end effector is where kinematics says."""

import re

import numpy as np
import pytest

import armwright as aw
from armwright.pictures.posed_arm import posed_arm
from armwright.pictures.scene import write_html
from physics.arms import arm
from pictures.browser import Browser, needs_browser

pytestmark = needs_browser
STANDS = "!!document.getElementById('q').textContent"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    browser = Browser(tmp_path_factory.mktemp("browser"))
    yield browser
    browser.close()


def slide(browser, q):
    browser.value(
        f"{list(map(float, q))}.forEach((v, k) => {{ const slider = document.querySelectorAll('#sliders input')[k];"
        " slider.value = v; slider.dispatchEvent(new Event('input')); })"
    )
    browser.settle()


def place(browser):
    """(3,) position [m], (3,) angles [rad] and joint positions that the page tells."""
    numbers = [float(re.sub("[^-0-9.e]", "", row.split()[1])) for row in browser.text("#place").splitlines()]
    q = np.array([float(word) for word in browser.text("#q").split(",")])
    return np.array(numbers[:3]), np.radians(numbers[3:]), q


@pytest.mark.study
@pytest.mark.parametrize("name", ["panda", "cmu-dd", "workshop", "gripper", "sprung"])
def test_the_end_effector_is_where_kinematics_says(browser, tmp_path, name):
    model = arm(name)
    write_html(posed_arm(model), tmp_path / "arm.html")
    browser.open(tmp_path / "arm.html", "#light", stands=STANDS)
    random = np.random.default_rng(1)
    for _ in range(3):
        ranges = browser.value("[...document.querySelectorAll('#sliders input')].map((s) => [+s.min, +s.max])")
        slide(browser, random.uniform(*np.array(ranges).T))
        position, angles, q = place(browser)
        pose = np.asarray(aw.forward_kinematics(model, q), dtype=float)
        np.testing.assert_allclose(position, pose[:3, 3], atol=3e-4)  # the page shows q and position to 1e-4
        roll, pitch, yaw = angles
        c, s = np.cos, np.sin
        first = [c(yaw) * c(pitch), s(yaw) * c(pitch), -s(pitch)]
        np.testing.assert_allclose(first, pose[:3, 0], atol=1e-3)
        np.testing.assert_allclose([c(pitch) * s(roll), c(pitch) * c(roll)], pose[2, 1:3], atol=1e-3)
    assert browser.faults() == []


@pytest.mark.study
def test_it_moves_light_and_dark_and_comes_back(browser, tmp_path):
    aw.show(arm("panda"), tmp_path / "arm.html", [0.2, -0.8, 0.1, -2.0, 0.1, 1.6, 0.7])
    for fragment in ("#light", "#dark"):
        browser.open(tmp_path / "arm.html", fragment, (1000, 700), stands=STANDS)
        first = browser.picture()
        assert (first.mean() < 90) == (fragment == "#dark")
        axes = first[60:600, 20:640]
        for colour in ([217, 51, 51], [38, 153, 38], [64, 115, 242]):
            assert (np.abs(axes - colour).max(axis=2) < 40).sum() > 30
        slide(browser, np.zeros(7))
        assert (np.abs(browser.picture() - first).max(axis=2) > 30).mean() > 0.01
        browser.value("document.getElementById('start').click()")
        browser.settle()
        assert place(browser)[2] == pytest.approx([0.2, -0.8, 0.1, -2.0, 0.1, 1.6, 0.7])
        assert browser.faults() == []
    browser.open(tmp_path / "arm.html", "#light", (360, 740), stands=STANDS)
    assert browser.value("document.documentElement.scrollWidth") <= 360


@pytest.mark.study
def test_the_camera_stays_above_the_floor(browser, tmp_path):
    aw.show(arm("panda"), tmp_path / "arm.html")
    browser.open(tmp_path / "arm.html", "#light", stands=STANDS)
    browser.value(
        "{ const camera = Stage.prototype.camera; Stage.prototype.camera = function () {"
        " const seen = camera.call(this); window.seen = [seen.eye[1], this.floor]; return seen; }; }"
    )
    for steps in (-200, -200, -200):
        browser.mouse("#stage", 200, 300, "mouseMoved", "mousePressed")
        browser.mouse("#stage", 200, 300 + steps, "mouseDragged")
        browser.mouse("#stage", 200, 300 + steps, "mouseReleased")
        browser.mouse("#stage", 200, 300, "mouseWheel", deltaX=0, deltaY=300)
        eye, floor = browser.value("window.seen")
        assert eye > floor
    assert eye - floor < 0.1  # it came down to it
    assert browser.faults() == []
