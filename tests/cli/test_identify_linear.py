"""`armwright identify linear`: models and pictures from a log, and exit codes that scripts can read."""

from __future__ import annotations

import numpy as np
import pytest

from cli.test_commands import run
from identification.linear.test_records import data, log_file


@pytest.fixture
def log(tmp_path):
    return str(log_file(tmp_path, {"a": ("fit", data(0)), "b": ("hold-out", data(1))}))


@pytest.mark.study
def test_models_are_shown_and_drawn(log, tmp_path):
    picture = tmp_path / "oe.svg"
    shown = run("identify", "linear", log, "--order", "1", "--plot", str(picture)).stdout
    assert "OE of nf 1, nb 1, delay 1 sample " in shown
    assert "b (hold-out): qd: free simulation 9" in shown
    assert picture.stat().st_size > 1000
    for model in ("arx", "armax", "n4sid"):
        assert (
            "time_constant1" in run("identify", "linear", log, "--model", model, "--order", "1", "--delay", "1").stdout
        )
    assert (
        "coherence" in run("identify", "linear", log, "--model", "frequency", "--plot", str(tmp_path / "h.png")).stdout
    )


def test_a_page_is_written(log, tmp_path):
    page = tmp_path / "oe.html"
    words = ["--order", "1", "--delay", "1", "--report", str(page)]
    assert "wrote" in run("identify", "linear", log, *words).stdout
    text = page.read_text(encoding="utf-8")
    assert all(word in text for word in ("Identified", "time_constant1", "Coefficients", "b1"))
    refused = run("identify", "linear", log, "--model", "frequency", "--report", str(tmp_path / "f.html"), code=2)
    assert "--report" in refused.stderr
    assert not (tmp_path / "f.html").exists()


def test_an_output_that_does_not_answer(tmp_path):
    t, u, _ = data(0)
    file = str(log_file(tmp_path, {"a": ("fit", (t, u, np.random.default_rng(3).standard_normal(len(u))))}))
    assert "not identified" in run("identify", "linear", file, "--order", "1", "--delay", "1", code=1).stdout


def test_a_motor_may_be_a_black_box(log):
    same = ["--model", "oe", "--order", "1", "--delay", "1"]
    assert run("identify", "motor", log, *same).stdout == run("identify", "linear", log, *same).stdout
    refused = run("identify", "motor", log, *same, "--fix", "R=1", code=2)
    assert "--fix" in refused.stderr
    assert refused.stderr.count("\n") == 1
    assert "frequency" in run("identify", "motor", log, "--model", "best", code=2).stderr


BAD = [
    "--model best",
    "--order two",
    "--order 0",
    "--delay -2",
    "--select x",
    "--joint knee",
    "--input-signal qd",
    "--plot no/x.png",
    "--report x.pdf",
]


@pytest.mark.parametrize("words", BAD)
def test_bad_words_end_in_one_line(log, words):
    done = run("identify", "linear", log, *words.split(), code=2)
    assert done.stderr.count("\n") == 1
    assert "Traceback" not in done.stderr
