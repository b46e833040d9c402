"""The bar: silent without a terminal, silent for quick work, there for the rest."""

import os
import sys

import pytest

from armwright.cli.progress import PATIENCE, progress, rate


def test_silent_without_a_terminal(capfd):
    with progress("working") as tell:
        tell(1, 2)
    assert capfd.readouterr() == ("", "")


@pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")
@pytest.mark.parametrize(("seconds", "seen"), [(0.0, False), (1.4 * PATIENCE, True)])
def test_on_a_terminal(seconds, seen):
    import pty
    import subprocess

    leader, follower = pty.openpty()
    script = (
        "import time\nfrom armwright.cli.progress import progress\n"
        f"with progress('working', 'steps') as tell:\n    tell(1, 2)\n    time.sleep({seconds})"
    )
    environment = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "CI")} | {"TERM": "xterm"}
    subprocess.run([sys.executable, "-c", script], stderr=follower, env=environment, check=True)
    os.set_blocking(leader, False)
    try:
        shown = os.read(leader, 100000)
    except BlockingIOError:
        shown = b""
    os.close(leader)
    os.close(follower)
    assert (b"working" in shown) == seen


@pytest.mark.parametrize(
    ("speed", "said"), [(None, ""), (12.3456, "12.3 steps/s"), (2.4e6, "2.4 M steps/s"), (7e9, "7 G steps/s")]
)
def test_rates(speed, said):
    assert rate(speed, "steps") == said
