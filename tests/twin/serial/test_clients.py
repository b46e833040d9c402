"""The makers' software, each in a process of its own, against servos in theirs."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent
CASES = {
    "sts3215": ("feetech", "scservo_sdk", "needs feetech-servo-sdk, which has no wheel", ("--servo", "sts3215:1-6")),
    "xl330-m288": (
        "dynamixel",
        "dynamixel_sdk",
        "needs dynamixel-sdk",
        ("--servo", "xl330-m288:1-3", "--voltage", "5"),
    ),
    "xl430-w250": (
        "dynamixel",
        "dynamixel_sdk",
        "needs dynamixel-sdk",
        ("--servo", "xl430-w250:1-3", "--voltage", "12"),
    ),
}
NUMBERS = {"sts3215": 777, "xl330-m288": 1200, "xl430-w250": 1060}
BAUD = {"sts3215": "0", "xl330-m288": "3", "xl430-w250": "3"}
LOCK_STEP = ("--period", "0.02")


@pytest.mark.parametrize("words", [(), LOCK_STEP], ids=["real-time", "lock-step"])
@pytest.mark.parametrize("model", CASES)
def test_the_makers_software_drives_servos(serve, tmp_path, model, words):
    program, module, reason, servos = CASES[model]
    if importlib.util.find_spec(module) is None:
        pytest.skip(reason)
    if model == "sts3215" and importlib.util.find_spec("scservo_sdk.protocol_packet_handler") is None:
        pytest.skip(reason)  # ftservo-python-sdk has a package of the same name
    process = serve(*servos, "--set", f"baud_rate={BAUD[model]}", "--patience", "20", *words)
    command = [sys.executable, str(FOLDER / f"client_{program}.py"), str(tmp_path / "port"), str(NUMBERS[model])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path[1:])}
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment, check=False)
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stdout + done.stderr
    assert process.end()["late"] == 0
