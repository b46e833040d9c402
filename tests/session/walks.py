"""The session that walks through everything: its script, the files it names, and its transcript."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from armwright.errors import ArmwrightError
from armwright.session import Session

FOLDER = Path(__file__).parent
SCRIPT = FOLDER / "walk.sim"
TRANSCRIPT = FOLDER / "walk.txt"
NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e[+-]?\d+)?(?![\w.])")
ADDRESS = re.compile(r"http://127\.0\.0\.1:\d+/[0-9a-f]{32}/")  # of the live page: another one each time
JOINTS = [f"joint{k}" for k in range(1, 7)]


def write_files(folder: Path) -> None:
    """The files that the script reads."""
    rows = [
        "t [s]," + ",".join(f"{joint} [V]" for joint in JOINTS),
        "0,1,2,3,4,5,6",
        "0.0505,0,0,0,0,0,0",
        "0.1,6,5,4,3,2,1",
    ]
    (folder / "volts.csv").write_text("\n".join(rows))
    heads = [f"{quantity}_{joint}" for quantity in ("q", "qd", "qdd") for joint in JOINTS]
    sets = [",".join(str(0.01 * (k + row)) for k in range(18)) for row in range(3)]
    (folder / "sets.csv").write_text("\n".join([",".join(heads), *sets]))
    (folder / "more.sim").write_text("# a script in a script\nomega = 0\ntheta[1] = 0.25\nquit\ntheta = 99\n")


def same_text(text: str, expected: str) -> str | None:
    """The first line in which two transcripts differ; numbers may do so in their last digits, words not at all."""
    ours, theirs = ADDRESS.sub("ADDRESS", text).splitlines(), expected.splitlines()
    for k, (a, b) in enumerate(zip(ours, theirs, strict=False), 1):
        if " ".join(NUMBER.sub("#", a).split()) != " ".join(NUMBER.sub("#", b).split()):
            return f"line {k}: {a!r}, not {b!r}"
        for x, y in zip(NUMBER.findall(a), NUMBER.findall(b), strict=True):
            if abs(float(x) - float(y)) > 2e-5 * max(abs(float(x)), abs(float(y)), 1e-5):
                return f"line {k}: {x}, not {y} in {b!r}"
    return None if len(ours) == len(theirs) else f"{len(ours)} lines, not {len(theirs)}"


def refused(session: Session, line: str) -> ArmwrightError:
    """The error of a line, which is one line a problem as text; the session is as it was before."""
    before, past = session.state, session.undo_stack
    with pytest.raises(ArmwrightError) as error:
        session.run(line)
    assert session.state is before
    assert session.undo_stack == past
    assert len(str(error.value).splitlines()) == len(error.value.problems) + (len(error.value.problems) > 1)
    return error.value
