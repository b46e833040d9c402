"""The picture of docs/how-to/pictures.md, made by the commands of that page.  To make it again:

PYTHONPATH=tests python -m pictures.docs_picture
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from pictures.browser import Browser

PICTURE = Path(__file__).resolve().parents[2] / "docs" / "images" / "player.png"
COMMANDS = (
    "simulate cmu-dd --voltage 8,12,8,4,2,1 --duration 2 -o run.nc",
    "graphic run.nc --robot cmu-dd -o run.html",
)


def taken(browser: Browser, folder: Path) -> np.ndarray:
    """(height, width, 3) what a reader sees 1 s into the run, 0 to 255."""
    for command in COMMANDS:
        subprocess.run(
            [sys.executable, "-m", "armwright", *command.split()], cwd=folder, check=True, capture_output=True
        )
    browser.open(folder / "run.html", "#t=1&pause&light", (980, 760))
    return browser.picture()


def main() -> None:
    """Writes the picture, in few colours."""
    from PIL import Image

    with tempfile.TemporaryDirectory() as folder:
        browser = Browser(Path(folder))
        picture = taken(browser, Path(folder))
        browser.close()
    few = Image.fromarray(picture.astype(np.uint8)).quantize(96, dither=Image.Dither.NONE)
    few.save(PICTURE, optimize=True)


if __name__ == "__main__":
    main()
