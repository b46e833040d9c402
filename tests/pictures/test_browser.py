"""Pages in a real browser, without a network: the arm is there and moves, curves answer to the reader's hand."""

import time

import numpy as np
import pytest

import armwright as aw
from pictures.browser import Browser, needs_browser
from simulation.runs import invented

pytestmark = needs_browser
CANVAS = ".panel canvas"
LEFT, RIGHT = 58, 10  # [px] of a panel's canvas beside its curves


@pytest.fixture(scope="module")
def run():
    arm = aw.load("cmu-dd")
    return aw.simulate(aw.Scenario(arm, command=[8, 12, 8, 4, 2, 1], duration=2.0, solver=aw.Solver(step=2e-3)))


@pytest.fixture(scope="module")
def player(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("player") / "run.html"
    aw.animate(run.assign(q_reference=0.7 * run["q"]), aw.load("cmu-dd"), path)
    return path


@pytest.fixture(scope="module")
def curves(run, tmp_path_factory):
    path = tmp_path_factory.mktemp("curves") / "run.html"
    aw.plot({"run": run}, path)
    return path


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    browser = Browser(tmp_path_factory.mktemp("browser"))
    yield browser
    browser.close()


def scene(browser):
    """The part of the player's picture that the arm is in."""
    box = browser.value(
        "(() => { const b = document.getElementById('stage').getBoundingClientRect();"
        " return [b.left, b.top, b.right, b.bottom]; })()"
    )
    left, top, right, bottom = (round(v) for v in box)
    return browser.picture()[top:bottom, left:right]


@pytest.mark.study
@pytest.mark.parametrize("size", [(700, 620), (360, 640)])
def test_the_arm_is_seen_and_moves(browser, player, size):
    browser.open(player, "#t=0.5&pause&light", size)
    pictures = [scene(browser), scene(browser)]
    browser.value("const at = document.getElementById('time'); at.value = 0.9; at.dispatchEvent(new Event('input'))")
    browser.settle()
    first, again, later = [*pictures, scene(browser)]
    assert np.abs(first - again).mean() < 0.1  # a pause is one
    assert (np.abs(first - later).max(axis=2) > 30).mean() > 0.005
    grey = (np.ptp(first, axis=2) < 24) & (first.max(axis=2) > 40) & (first.max(axis=2) < 190)
    ghost = (first[..., 0] - first[..., 2]) > 60  # the reference is orange
    assert grey.mean() > 0.01
    assert ghost.mean() > 0.002
    browser.value("document.getElementById('ghost').click()")
    browser.settle()
    ghost = (later[..., 0] - later[..., 2]) > 60
    without = scene(browser)
    assert ((without[..., 0] - without[..., 2]) > 60).sum() < 0.7 * ghost.sum()
    assert browser.faults() == []


@pytest.mark.study
def test_the_player_plays_and_is_told_where_to_go(browser, player):
    browser.open(player, "#t=0.5&pause")
    now = lambda: float(browser.text("#now").split()[0])  # noqa: E731
    assert now() == 0.5
    begin = time.monotonic()
    browser.value("document.getElementById('speed').value = '0.5'; document.getElementById('speed').onchange()")
    browser.value("document.getElementById('play').click()")
    while now() < 0.7 and time.monotonic() < begin + 60:  # a busy machine may draw its first frame late
        time.sleep(0.1)
    browser.value("document.getElementById('play').click()")
    played, spent = now() - 0.5, time.monotonic() - begin
    assert 0.1 < played <= 0.5 * spent + 0.05
    time.sleep(0.2)
    assert now() - 0.5 == played
    browser.value(
        "const slider = document.getElementById('time'); slider.value = 0.8; slider.dispatchEvent(new Event('input'))"
    )
    assert now() == pytest.approx(1.6, abs=1e-3)
    wide = browser.value(f"document.querySelector('{CANVAS}').clientWidth") - LEFT - RIGHT
    browser.value(f"document.querySelector('{CANVAS}').scrollIntoView({{block: 'center'}})")
    browser.mouse(CANVAS, LEFT + wide / 2, 80, "mouseMoved", "mousePressed", "mouseReleased")
    assert now() == pytest.approx(1.0, abs=0.01)
    assert browser.faults() == []


@pytest.mark.study
def test_the_camera_goes_around(browser, player):
    browser.open(player, "#t=0.5&pause&light")
    before = scene(browser)
    browser.mouse("#stage", 200, 150, "mouseMoved", "mousePressed")
    browser.mouse("#stage", 320, 190, "mouseDragged")
    browser.mouse("#stage", 320, 190, "mouseReleased")
    turned = scene(browser)
    assert (np.abs(turned - before).max(axis=2) > 30).mean() > 0.01
    browser.mouse("#stage", 200, 150, "mouseWheel", deltaX=0, deltaY=-300)
    nearer = scene(browser)
    assert (np.abs(nearer - turned).max(axis=2) > 30).mean() > 0.01
    for view in ("front", "side", "top", "home"):
        browser.value(f"document.getElementById('view').value = '{view}'; document.getElementById('view').onchange()")
        browser.settle()
    assert np.abs(scene(browser) - before).mean() < 0.1
    assert browser.faults() == []


@pytest.mark.study
def test_curves_zoom_and_tell_values(run, browser, curves):
    browser.open(curves, "#light", (1000, 900))
    wide = browser.value(f"document.querySelector('{CANVAS}').clientWidth") - LEFT - RIGHT
    all_times = "[...document.querySelectorAll('.legend button')].at(-1)"
    assert browser.value(f"{all_times}.disabled")
    browser.mouse(CANVAS, LEFT + wide / 2, 60, "mouseMoved")
    head, *rows = [line.replace("−", "-").split() for line in browser.text(".panel .tip").splitlines() if line.strip()]
    assert head == ["t", "=", "1", "s", "[rad]"]
    values = {row[0]: float(row[1]) for row in rows}
    expected = run["q"].sel(time=1.0, method="nearest")
    assert list(values) == [f"joint{k}" for k in range(1, 7)]
    assert values == pytest.approx({name: float(expected.sel(joint=name)) for name in values}, rel=1e-4)
    browser.value("document.querySelector('.legend button').click()")
    browser.mouse(CANVAS, LEFT + wide / 2 + 1, 60, "mouseMoved")
    assert "joint1" not in browser.text(".panel .tip")
    assert "joint2" in browser.text(".panel .tip")
    browser.mouse(CANVAS, LEFT + wide / 4, 60, "mouseMoved", "mousePressed")
    browser.mouse(CANVAS, LEFT + wide / 2, 60, "mouseDragged")
    browser.mouse(CANVAS, LEFT + wide / 2, 60, "mouseReleased")
    assert not browser.value(f"{all_times}.disabled")
    browser.mouse(CANVAS, LEFT + wide, 60, "mouseMoved")  # what was in the middle is the end now
    assert float(browser.text(".panel .tip th").split()[2]) == pytest.approx(1.0, abs=0.005)
    browser.mouse(CANVAS, LEFT + wide / 2, 60, "mouseWheel", deltaX=0, deltaY=2000)
    browser.mouse(CANVAS, LEFT, 60, "mouseMoved")
    assert float(browser.text(".panel .tip th").split()[2]) < 0.5
    browser.value(f"{all_times}.click()")
    browser.settle()
    assert browser.value(f"{all_times}.disabled")
    assert browser.faults() == []


def names(browser):
    """Names of the curves that the legend can hide."""
    return browser.value("[...document.querySelectorAll('.legend [aria-pressed]')].map((button) => button.innerText)")


@pytest.mark.study
def test_of_one_joint_the_colours_are_runs(run, browser, tmp_path):
    aw.plot({"whole": run, "half": run.isel(time=slice(0, 501))}, tmp_path / "two.html", joints=["joint2"])
    browser.open(tmp_path / "two.html", "#light", (1000, 900))
    assert names(browser) == ["whole", "half"]
    picture = browser.picture()
    for colour in ([0x00, 0x72, 0xB2], [0xD5, 0x5E, 0x00]):
        assert (np.abs(picture - colour).max(axis=2) < 30).sum() > 300
    wide = browser.value(f"document.querySelector('{CANVAS}').clientWidth") - LEFT - RIGHT
    for part, half in ((0.25, True), (0.75, False)):  # where a run has ended it has no value
        browser.mouse(CANVAS, LEFT + part * wide, 60, "mouseMoved")
        head, whole, short = (browser.text(f".panel .tip tr:nth-child({k})").split() for k in (1, 2, 3))
        assert head[-2:] == ["joint2", "[rad]"]
        assert (whole[0], short[0]) == ("whole", "half")
        assert whole[1] != "—"
        assert (short[1] != "—") == half
    assert browser.faults() == []


@pytest.mark.study
def test_references_are_named_and_hidden(run, browser, tmp_path):
    only = run.assign(q_reference=2.0 * run["q"])
    aw.plot({"run": only}, tmp_path / "reference.html", joints=["joint2"])
    browser.open(tmp_path / "reference.html", "#light", (1000, 900))
    assert names(browser) == ["joint2", "reference"]
    browser.mouse(CANVAS, LEFT + 200, 60, "mouseMoved")
    assert "reference" in browser.text(".panel .tip")
    browser.value("document.querySelectorAll('.legend button')[1].click()")
    browser.mouse(CANVAS, LEFT + 201, 60, "mouseMoved")
    assert "reference" not in browser.text(".panel .tip")
    browser.value("document.querySelectorAll('.legend button')[1].dispatchEvent(new Event('dblclick'))")
    browser.mouse(CANVAS, LEFT + 202, 60, "mouseMoved")
    assert [line.split()[0] for line in browser.text(".panel .tip").splitlines()] == ["t", "reference"]
    assert browser.faults() == []


@pytest.fixture(scope="module")
def round_trip(tmp_path_factory):
    """A double pendulum that swings round."""
    arm = aw.load("two-link")
    q = np.linspace(0.0, 2.0 * np.pi, 400)
    run = invented(arm, rows=400)
    run["q"].values[:] = np.stack([q, 0.0 * q], axis=1)
    path = tmp_path_factory.mktemp("round") / "round.html"
    aw.animate(run, arm, path)
    return path


@pytest.mark.study
@pytest.mark.parametrize("size", [(1280, 800), (800, 600), (360, 640)])
def test_the_whole_motion_just_fills_the_picture(browser, round_trip, size):
    """The path of the hand comes near an edge of the picture, and never over it."""
    browser.open(round_trip, "#t=1000&pause&light", size)
    for view in ("home", "front", "side", "top"):
        browser.value(f"document.getElementById('view').value = '{view}'; document.getElementById('view').onchange()")
        browser.settle()
        seen = scene(browser)
        inside = seen[6 : round(0.52 * size[1]) - 2, 6:-6]  # without the frame and the buttons
        rows, columns = np.nonzero(np.abs(inside - [0x00, 0x72, 0xB2]).max(axis=2) < 40)
        room = (rows.min(), inside.shape[0] - rows.max(), columns.min(), inside.shape[1] - columns.max())
        assert min(room) > 2, (view, room)
        assert min(room[0] / inside.shape[0], room[2] / inside.shape[1]) < 0.28, (view, room)
    assert browser.faults() == []


@pytest.mark.study
def test_pages_are_drawn_light_dark_and_narrow(browser, curves):
    blue = [0x00, 0x72, 0xB2]  # the first joint's curve
    for fragment, size in (("#light", (900, 900)), ("#dark", (900, 900)), ("#light", (360, 740))):
        browser.open(curves, fragment, size)
        picture = browser.picture()
        assert (picture.mean() < 60) == (fragment == "#dark")
        assert (np.abs(picture - blue).max(axis=2) < 30).sum() > 300
        assert browser.value("document.documentElement.scrollWidth") <= size[0]
        assert browser.faults() == []


def test_all_samples_count_where_many_share_a_pixel(browser, tmp_path):
    arm = aw.load("two-link")
    run = invented(arm, rows=150_001)
    run["q"].values[:, 0] = 0.0
    run["q"].values[77_777, 0] = 1.0  # one sample of many in its column
    aw.plot({"run": run}, tmp_path / "spike.html", joints=[arm.names[0]], quantities=["q"])
    browser.open(tmp_path / "spike.html", "#light", (800, 420))
    blue = np.abs(browser.picture() - [0x00, 0x72, 0xB2]).max(axis=2) < 60
    assert blue[140:290].any(axis=1).mean() > 0.9  # up and down again


@pytest.mark.study
def test_the_path_of_a_long_run_is_round(browser, tmp_path):
    arm = aw.load("two-link")
    run = aw.simulate(aw.Scenario(arm, command=[0, 0], duration=20.0, solver=aw.Solver(step=5e-3)))
    turns = 2 * np.pi * 10 * run["time"].values  # ten rounds a second: 3 of 600 points each would be a zigzag
    run["q"].values[:] = np.column_stack([turns, 0 * turns])
    aw.animate(run, arm, tmp_path / "run.html")
    browser.open(tmp_path / "run.html", "#t=20&pause&light")
    trace = browser.value(
        "new Promise((done) => { const draw = Player.prototype.draw; Player.prototype.draw = function () {"
        " Player.prototype.draw = draw; done([this.trace.times, this.trace.points].map((own) => Array.from(own))); };"
        " document.getElementById('path').click(); })"
    )
    times, points = np.array(trace[0]), np.array(trace[1]).reshape(-1, 3)
    reach = np.ptp(points, axis=0).max() / 2
    assert len(times) == len(points) == 4001
    assert (np.linalg.norm(np.diff(points, axis=0), axis=1) < 0.4 * reach).all()
    assert (np.diff(times) > 0).all()
    assert times[-1] == pytest.approx(20.0)
    run["q"].values[:] = 0.0
    aw.animate(run, arm, tmp_path / "still.html")
    browser.open(tmp_path / "still.html", "#t=20&pause&light")
    assert browser.faults() == []
