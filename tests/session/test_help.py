"""Help and the tour: every letter and source is explained, every gain has its unit, and what the tour says is what it shows."""

from __future__ import annotations

import re
import unicodedata
from pathlib import Path

import numpy as np
import pytest

from armwright.control import Cascade, ComputedTorque, JointPID
from armwright.session import Session
from armwright.session.commands import TABLE as COMMANDS
from armwright.session.controllers import gain_names, laws
from armwright.session.help import KEY, REPORT, SOURCES, SYMBOLS, gains
from armwright.session.listing import Sheet, TextLine
from armwright.session.variables import TABLE as VARIABLES
from session.walks import refused

LETTERS = re.compile(r"[A-Za-zα-ωΑ-Ω]+(?:_\w+)?")
WORDS = {"of", "by", "it", "as", "a", "s", "k", "dθ", "dt", "Σ"}  # of sentences, Kutta's, a count, a rate, a sum
SAID = {"scale", *(variable.name for variable in VARIABLES)}
HELPED = Session()


def lines(topic):
    return [part.text for part in HELPED.run(f"help {topic}") if isinstance(part, TextLine)]


def sheets(topic):
    return [part for part in HELPED.run(f"help {topic}") if isinstance(part, Sheet)]


def letters(text):
    """θ̇ → θ: the symbols of an equation, without dots and indices of sums."""
    bare = "".join(mark for mark in unicodedata.normalize("NFD", text) if not unicodedata.combining(mark))
    return {word for word in LETTERS.findall(bare) if word not in WORDS}


@pytest.mark.parametrize("entry", [e for e in (*COMMANDS, *VARIABLES) if e.equation], ids=lambda entry: entry.name)
def test_every_letter_of_an_equation_is_explained(entry):
    explained = {letter for symbol, _, _ in SYMBOLS for letter in letters(symbol)}
    symbols = {letter for letter in letters(entry.equation) if len(letter) <= 2 or "_" in letter}
    assert symbols - SAID <= explained
    assert "letters   help symbols" in lines(entry.name)


def test_the_example_of_gravity_is_the_arms_own():
    assert "example   gravity = -9.80621" in lines("gravity")
    session = Session("puma560")
    session.run("gravity = 1.6")
    said = [part.text for part in session.run("help gravity") if isinstance(part, TextLine)]
    assert "example   gravity = 9.81" in said


def test_symbols_are_a_page_that_help_names():
    (sheet,) = sheets("symbols")
    symbols = " ".join(row[0] for row in sheet.rows)
    assert {"M", "C", "g", "n", "Kt", "Ke", "R", "U", "J", "τ", "θ"} <= letters(symbols)
    assert all(unit and meaning for _, unit, meaning in sheet.rows)
    assert "help symbols" in " ".join(part.text for part in HELPED.run("help") if isinstance(part, TextLine))
    assert refused(HELPED, "help symbol").choices[0] == "symbols"


@pytest.mark.parametrize(
    "topic", [*(e.name for e in (*COMMANDS, *VARIABLES) if e.source), "joint-pid", "computed-torque"]
)
def test_every_source_is_told_in_full(topic):
    shown = lines(topic)
    (source,) = [line for line in shown if line.startswith("source")]
    keys = KEY.findall(source)
    assert keys or REPORT in source
    for key in keys:
        assert f"          [{key}]: {SOURCES[key]}" in shown
    assert any(line.strip().startswith(f"{REPORT}: N. M. Swartz") for line in shown) == (REPORT in source)


def test_sources_are_those_of_the_references():
    page = (Path(__file__).parents[2] / "docs" / "references.md").read_text(encoding="utf-8")
    for key, text in SOURCES.items():
        entry = page.partition(f"**{key}.**")[2].partition("\n\n")[0].replace("*", "").replace("\\", "")
        assert " ".join(entry.split()).startswith(text), key
        assert key == "SwartzReport" or " ".join(entry.split()) == text, key


@pytest.mark.parametrize("law", laws().values(), ids=lambda law: law.__name__)
def test_every_gain_that_may_be_typed_is_explained(law):
    shown = gains(law)
    assert list(shown) == gain_names(law)
    assert all(shown.values()), shown


def test_gains_have_their_units():
    assert gains(JointPID)["kp"] == "[U/rad | U/m]"
    assert gains(JointPID)["speed_feedforward"] == "kv [U s/rad | U s/m]"
    assert gains(ComputedTorque) == {"kp": "[1/s²]", "kd": "[1/s]", "ki": "[1/s³]"}
    assert gains(Cascade)["position_every"] == gains(Cascade)["speed_every"] != ""
    shown = dict(sheets("controller")[-1].rows)
    assert set(shown) == set(laws())
    assert "kp [U/rad | U/m]" in shown["joint-pid"]
    assert "speed_feedforward [U s/rad | U s/m]" in shown["joint-pid"]
    assert "position_kp [1/s]" in shown["cascade"]
    assert any("U is the unit" in line for line in lines("controller"))


def test_a_law_is_a_topic():
    shown = lines("joint_pid")
    assert shown[0] == "joint-pid"
    assert any(line.startswith("u = kp e + ki ∫ e dt + kd d") for line in shown)
    assert 'example   controller joint-pid kp=… scale="10 deg"' in shown
    assert "cutoff_hz" in [row[0] for row in sheets("joint-pid")[0].rows]


@pytest.fixture(scope="module")
def toured():
    """(line, what it said) of the tour, with the words before each step."""
    shown: list[tuple[str, str]] = []
    for part in Session().run("tour"):
        if isinstance(part, TextLine) and part.text.startswith("sim> "):
            shown.append((part.text.removeprefix("sim> "), ""))
        elif shown:
            rows = [" ".join(row) for row in part.rows] if isinstance(part, Sheet) else [part.text]
            shown[-1] = shown[-1][0], "\n".join([shown[-1][1], *rows])
    return shown


def number(text):
    return float(re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", text.partition("=")[2])[0])


def test_in_the_tour_speed_eats_volts_up(toured):
    torques = [number(printed) for line, printed in toured if line == "torque[2]"]
    volts = [number(printed) for line, printed in toured if line == "voltage[2]"]
    assert volts[0] == volts[1] != 0.0
    assert np.sign(torques[0]) == np.sign(torques[1]) == np.sign(volts[0])
    assert abs(torques[1]) < abs(torques[0])  # less torque is left
    assert any(line.startswith("omega[2] =") for line, _ in toured)


def test_in_the_tour_the_sum_of_energies_falls(toured):
    before, after = (
        dict(row.split(" ") for row in printed.split("\n") if row.startswith(("kinetic", "potential", "sum")))
        for line, printed in toured
        if line == "energy"
    )
    assert float(before["kinetic"]) == 0.0 < float(after["kinetic"])
    assert float(after["potential"]) < float(before["potential"])
    assert float(after["sum"]) < float(before["sum"])


def test_show_tells_of_gravity_to_the_side_and_of_the_payload():
    session = Session("two-link")

    def notes():
        return [part.text for part in session.run("show") if isinstance(part, TextLine)]

    assert notes() == ["this arm's gravity has other components too: (0, -9.81, 0) m/s² in base axes"]
    session.run('payload 2 com="0 0 5 cm" inertia="1e-3 1e-3 1e-3"')
    assert notes()[1:] == [
        "payload: 2 kg at (0, 0, 0.05) m in the axes of hand, principal moments (0.001, 0.001, 0.001) kg m²"
    ]
    session.run("payload none")
    assert len(notes()) == 1
    assert [part for part in Session().run("show") if isinstance(part, TextLine)] == []
