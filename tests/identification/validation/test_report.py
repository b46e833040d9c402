"""The page holds all it shows: verdict first, no address of another file, colours of the page alone."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import numpy as np
import pytest

import armwright as aw
from armwright.errors import OutputError
from armwright.identification.estimate import Estimate
from armwright.identification.validation.report import report_blocks, write_report
from armwright.identification.validation.validate import validate
from armwright.results.page_parts import report_html
from armwright.results.svg import page_svg, words
from identification.validation.made_logs import driven, motor_file, random_steps, written_log

ESTIMATE = Estimate(
    ("motor.motor.resistance_ohm", "motor.motor.torque_constant_n_m_per_a", "delay_s"),
    np.array([2.0, 0.04, 0.003]),
    np.array([[1e-4, 0.99e-5, 0.0], [0.99e-5, 1e-6, 0.0], [0.0, 0.0, 1e-8]]),
    "ab" * 32,
    "output error, 16 starts",
    ("Ω", "N m/A", "s"),
    np.array([False, False, True]),
    None,
    ("R & Kt <cannot> be told apart",),
    1234.0,
    {"prbs": {"fit_percent": 80.3}},
    "not identified",
    "made.log.toml",
)


def report_page(title, estimate=None, validation=None, sections=()):
    return report_html(title, report_blocks(estimate, validation, sections))


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    record = motor_file(folder)
    t = 2e-3 * np.arange(2000)
    q = np.sin(3.0 * t)[:, None] + 0.3 * np.sin(11.0 * t)[:, None]
    qd = 3.0 * np.cos(3.0 * t)[:, None] + 3.3 * np.cos(11.0 * t)[:, None]
    qdd = -9.0 * np.sin(3.0 * t)[:, None] - 36.3 * np.sin(11.0 * t)[:, None]
    tau = aw.compile(aw.load(record)).inverse_dynamics(q, qd, qdd)
    table = {"t": t, "position": q, "speed": qd, "current": tau / 0.4}
    return validate(
        motor_file(folder, coulomb="", name="smooth.toml"),
        written_log(folder, ["motor"], {"fit": table, "held": table}),
    )


def test_the_page_of_a_validation(found, tmp_path):
    text = write_report(tmp_path / "report.html", "A motor & its log", validation=found).read_text(encoding="utf-8")
    assert (
        text.index("fails its limits")
        < text.index("Every joint")
        < text.index("What to do next")
        < text.index('id="motor"')
    )
    assert re.search(r"Coulomb friction of 0\.1[45]", text)
    assert "A motor &amp; its log" in text
    outside = re.findall(r'(?:src|href)="([^"#][^"]*)"', text)
    assert outside == []
    assert not re.search(r"#0[0-9]0[0-9]0[0-9]\b", text)  # stand-ins of colours that are the page's own
    pictures = re.findall(r"<svg.*?</svg>", text, re.DOTALL)
    assert len(pictures) >= 4  # over time, spectrum, friction, correlations
    for picture in pictures:
        ElementTree.fromstring(picture)
        assert "var(--" in picture
        assert "<image" not in picture


def test_the_page_of_an_estimate(found):
    text = report_page("Fit", ESTIMATE, found, [("Of its own", "<p>more</p>")])
    assert text.index("Not identified") < text.index("Parameters") < text.index("Of its own")
    for phrase in ("at its bound", "Strong correlations", "R &amp; Kt &lt;cannot&gt;", "80.3", "0.990"):
        assert phrase in text
    alone = report_page("Fit", ESTIMATE)
    assert "Every joint" not in alone
    assert "made.log.toml" in alone


def test_only_pages_are_written(tmp_path):
    with pytest.raises(OutputError, match=r"\.html"):
        write_report(tmp_path / "report.pdf", "Fit", ESTIMATE)
    assert list(tmp_path.iterdir()) == []


def test_marks_of_the_ljung_box_table(found):
    assert "&lt; 0.001" in report_page("Fit", validation=found)


def test_runs_at_rest_are_shown_apart(tmp_path):
    record = motor_file(tmp_path)
    arm = aw.load(record)
    table = driven(arm, random_steps(600, 60, [6.0], 0), 4e-3, ("speed", "voltage"), 0.005)
    still = {"t": table["t"], "speed": 0.0 * table["speed"], "voltage": 0.1 + 0.0 * table["voltage"]}
    log = written_log(tmp_path, ["motor"], {"fit": table, "held": still})
    found = validate(record, aw.identification.read_log(log, on_error="keep"))  # which says that nothing moves
    assert not found.passed
    assert "at rest" in report_page("Rest", validation=found)
    assert "nothing moved" in str(found)


def test_names_of_axes_stand_inside_the_picture_beside_long_numbers():
    def draw(figure):
        axis = figure.subplots()
        axis.plot([0.0, 1.0], [-4e-5, 4e-5])
        axis.yaxis.set_major_formatter("{x:g}")
        words(axis, "time [s]", "residual [N m]")

    label = re.search(r'x="([-\d.]+)"[^>]*rotate\(-90[^>]*>residual', page_svg(draw, (4.3, 2.6)))
    assert label is not None
    assert float(label[1]) > 8.0  # the height of the letters above their line, in points
