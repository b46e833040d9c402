"""Names that are not what they look like, refused wherever a name is read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ArmwrightError, Problem
from armwright.parts.build import build_parts
from armwright.printable import is_seen, printable

SEEDS = Path(__file__).parent / "fuzz" / "seeds"
TURNING = [
    0x061C,
    0x200E,
    0x200F,
    *range(0x202A, 0x202F),
    *range(0x2066, 0x206A),
]  # marks that turn the text's direction
INVISIBLE = [0x00AD, 0x200B, 0x200D, 0x2060, 0xE0041, 0x1B, 0x85]  # hyphen, joiners, tags, controls
FILES = {  # seed, name in it, what reads it
    "robot": ("everything.toml", '"slide"', aw.load),
    "robot's link": ("balanced.toml", '"base"', aw.load),
    "URDF": ("arm.urdf", '"upper"', lambda path: aw.load(path, smoothing=0.01)),
    "MJCF": ("arm.xml", '"pedestal"', lambda path: aw.load(path, smoothing=0.01)),
    "parts": ("arm.parts.toml", '"sawn"', build_parts),
    "modules": ("toy.modules.toml", '"toy"', lambda path: aw.modules.assemble(path.parent / "toy.assembly.toml")),
    "assembly": ("toy.assembly.toml", '"arm"', aw.modules.assemble),
    "connector": ("toy.assembly.toml", '"second.out"', aw.modules.assemble),
    "task": ("pick.task.toml", '"pick"', aw.modules.read_task),
    "log's run": ("bench.log.toml", '"first"', aw.identification.read_log),
}
OBSTACLE = '\n[[obstacles]]\nkind = "plane"\npoint_m = [0, 0, -9]\nnormal = [0, 0, 1]\nname = "floor"\n'


def marked(text: str, name: str, letter: str) -> str:
    """The text with a letter behind the first letter of every occurrence of a name."""
    assert name in text, name
    start = name.index('"') + 2
    return text.replace(name, name[:start] + letter + name[start:])


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("code", [0x202E, 0x2066, 0x200B])
def test_of_files(tmp_path, kind, code):
    for seed in SEEDS.iterdir():
        if not seed.name.endswith(".drive.toml"):  # beside an arm it would be read too
            (tmp_path / seed.name).write_bytes(seed.read_bytes())
    file, name, read = FILES[kind]
    path = tmp_path / file
    read(path)
    path.write_text(marked(path.read_text(encoding="utf-8"), name, chr(code)), encoding="utf-8")
    with pytest.raises(ArmwrightError, match=r"invisible characters|unknown") as error:
        read(path)
    assert f"\\u{code:04x}" in str(error.value)


@pytest.mark.parametrize("code", [*TURNING, *INVISIBLE])
def test_in_python(code):
    letter, arm = chr(code), aw.load("two-link")
    assert not is_seen(f"a{letter}b")
    assert letter not in printable(letter)
    for make in (
        lambda name: arm.replace(name=name),
        lambda name: arm.with_payload(1.0, [0, 0, 0], np.eye(3) * 1e-3, name=name),
        lambda name: aw.collision.PlaneObstacle([0, 0, 0], [0, 0, 1], name=name),
        lambda name: aw.collision.SphereObstacle(1.0, [0, 0, 0], name=name),
        lambda name: aw.collision.BoxObstacle([1, 1, 1], [0, 0, 0], name=name),
        lambda name: aw.Signal("x", "m", (2,), labels=("a", name)),
    ):
        make("größe b")
        with pytest.raises(ArmwrightError, match="invisible characters"):
            make(f"a{letter}b")


def test_motion_obstacle(tmp_path):
    path = tmp_path / "one.motion.toml"
    text = (SEEDS / "two.motion.toml").read_text(encoding="utf-8") + OBSTACLE
    for name, taken in (("floor 2", True), ("flo\u202eor", False)):
        path.write_text(text.replace("floor", name), encoding="utf-8")
        if taken:
            aw.trajectories.plan(path)
        else:
            with pytest.raises(ArmwrightError, match="invisible characters"):
                aw.trajectories.plan(path)


def test_a_sentence_is_short_when_it_is_shown():
    """Letters that are escaped count as they are shown."""
    assert len(str(Problem("no such column", "column", "x", choices=("\0" * 3000, "\0a" * 3000)))) < 1500
