"""Fuzzes the readers of robot files with atheris, guided by coverage: any exception but ours is a crash.

    pip install atheris
    python tools/fuzz/robot_files.py urdf  CORPUS -max_total_time=3600
    python tools/fuzz/robot_files.py toml  CORPUS -max_total_time=3600

CORPUS is a folder of files to begin with, such as src/armwright/robots for toml. Everything behind it goes to libFuzzer.
"""

from __future__ import annotations

import importlib
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path


def read_urdf_bytes(place: Path, data: bytes) -> None:
    """One URDF, through to the model."""
    from armwright.description.urdf import read_urdf
    from armwright.model import build_model

    place.write_bytes(data)
    build_model(read_urdf(place, mimic="independent", smoothing=0.01), on_impossible="warn")


def read_toml_bytes(place: Path, data: bytes) -> None:
    """One robot file, through to the model."""
    from armwright.description.database import read_toml
    from armwright.model import build_model

    place.write_bytes(data)
    build_model(read_toml(place), on_impossible="warn")


MODULES = ("armwright.description.database", "armwright.description.urdf", "armwright.model")
READERS: dict[str, Callable[[Path, bytes], None]] = {"urdf": read_urdf_bytes, "toml": read_toml_bytes}


def target(kind: str, folder: Path) -> Callable[[bytes], None]:
    """What atheris calls: one reader, whose refusals are no findings while they are one line."""
    from armwright.errors import ArmwrightError

    read, place = READERS[kind], folder / f"robot.{kind}"

    def once(data: bytes) -> None:
        try:
            read(place, data)
        except ArmwrightError as error:
            if len(str(error).splitlines()) != 1:
                raise AssertionError(f"an error of several lines: {error!r}") from error

    return once


def main(arguments: list[str]) -> None:
    """Fuzzes until it is stopped, or a crash is found."""
    if len(arguments) < 2 or arguments[1] not in READERS:
        sys.exit(f"usage: {arguments[0]} {'|'.join(READERS)} [CORPUS] [libFuzzer options]")
    try:
        import atheris
    except ImportError:
        sys.exit("needs atheris: pip install atheris")
    warnings.simplefilter("error")  # numbers that overflow are findings as well
    with atheris.instrument_imports(include=["armwright", "xml", "defusedxml"]):
        for module in MODULES:
            importlib.import_module(module)
    with tempfile.TemporaryDirectory() as folder:
        atheris.Setup([arguments[0], *arguments[2:]], target(arguments[1], Path(folder)))
        atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv)
