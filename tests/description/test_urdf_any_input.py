"""Whatever a URDF holds, reading it gives a description or a DescriptionError of one line: never another exception."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from armwright.description.urdf import read_urdf
from armwright.errors import DescriptionError
from armwright.model import build_model
from description.urdf_files import AXIS, INERTIAL, LIMIT, joint, link, robot
from raises_at import raises_at

VISUAL = '<visual><origin xyz="0 0 1"/><geometry><mesh filename="package://a/b.stl"/></geometry><material name="m"/></visual>'
SEED = '<?xml version="1.0" encoding="utf-8"?>\n' + robot(
    '<material name="m"><color rgba="1 0 0 1"/></material>',
    link("base", VISUAL),
    link("upper"),
    link("fore", INERTIAL + '<visual><geometry><box size="1 1 1"/></geometry></visual>'),
    joint("j1", "base", "upper", AXIS + LIMIT + '<dynamics damping="1" friction="2"/>'),
    joint("j2", "upper", "fore", AXIS + LIMIT + '<mimic joint="j1" multiplier="2" offset="0.1"/>', "prismatic"),
    '<transmission name="t"><type>x</type><joint name="j1"/><actuator name="m"><mechanicalReduction>50'
    "</mechanicalReduction></actuator></transmission>",
)
VALUES = ["", "0", "-1", "1e9", "1e-300", "1e300", "nan", "inf", "1 2 3", "0 0 0", "base", "upper", "t", "é", "\U0001f600", "a b",
          "../x.stl", "package://", "file:///etc/x", "\x85", "9" * 400, "floating", "fixed", "continuous"]  # fmt: skip
MIMIC = st.sampled_from(["coupled", "independent", "fixed"])


@st.composite
def mutated(draw) -> bytes:
    """The seed with attribute values replaced, and with stretches taken out, doubled, or overwritten by any bytes."""
    data = SEED
    for _ in range(draw(st.integers(0, 3))):
        starts = [k for k, letter in enumerate(data) if letter == '"'][::2]
        start = draw(st.sampled_from(starts)) + 1
        end = data.index('"', start) if '"' in data[start:] else start
        value = draw(st.sampled_from(VALUES) | st.text(max_size=6) | st.floats().map(repr))
        data = data[:start] + value.replace('"', "").replace("<", "&lt;") + data[end:]
    raw = data.encode("utf-8", "surrogatepass")
    for _ in range(draw(st.integers(0, 2))):
        a, b = sorted(draw(st.tuples(*[st.integers(0, len(raw))] * 2)))
        raw = raw[:a] + draw(st.sampled_from([b"", raw[a:b] * 2]) | st.binary(max_size=5)) + raw[b:]
    return raw


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("any") / "arm.urdf"


def check(place: Path, data: bytes, mimic: str) -> None:
    """Reads and builds; anything but a description or a refusal of one line a problem fails the test by itself."""
    place.write_bytes(data)
    text, count = "one line", 1
    try:
        build_model(read_urdf(place, mimic=mimic, smoothing=0.01), on_impossible="warn")
    except DescriptionError as error:
        text, count = str(error), len(error.problems)
    assert len(text.splitlines()) == count + (count > 1)


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=mutated(), mimic=MIMIC)
def test_mutated_files(place, data, mimic):
    check(place, data, mimic)


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.binary(max_size=200), head=st.sampled_from([b"", b"<robot name='a'>", b"\xff\xfe", b"\xef\xbb\xbf<a>"]))
def test_any_bytes(place, data, head):
    check(place, head + data, "independent")


def test_the_seed_loads(place):
    place.write_text(SEED, encoding="utf-8")
    arm = build_model(read_urdf(place, mimic="independent", smoothing=0.01))
    assert arm.names == ["j1", "j2"]


def test_much_of_everything_ends(place):
    """Long chains and many tags are read or refused in good time."""
    many = 500
    names = ["base", *(f"l{k}" for k in range(many))]
    parts = [link(name, "") for name in names]
    parts += [joint(f"j{k}", names[k], names[k + 1]) for k in reversed(range(many))]
    check(place, robot(*parts).encode(), "refuse")
    place.write_text(robot(*(link(f"l{k}", "") for k in range(2001))))
    with raises_at(DescriptionError, "robot 'arm'", "2000 links"):
        read_urdf(place)
    place.write_bytes(b"<robot name='a'>" + b"<x/>" * 100_000 + b"</robot>")
    with raises_at(DescriptionError, "<x>", "carry physics"):
        read_urdf(place)


DRIVE = """source = "measurement"
command = "current"
gravity_m_s2 = [0.0, 0.0, -9.81]
tip = "upper"
[joints.j1]
command = "torque"
motor = { gear_ratio = 50, rotor_inertia_kg_m2 = 1e-4, torque_constant_n_m_per_a = 0.05 }
friction = { viscous_n_m_s_per_rad = 2.0 }
limits = { voltage_v = 24, torque_n_m = 7, position_rad = [-1, 1] }
[joints.j2]
motor = { rotor_inertia_kg_m2 = 1e-4, gear_ratio = { value = 300, std = 2 }, torque_constant_n_m_per_a = 0.05 }
"""
WORDS = [
    "0",
    "-1",
    "1e300",
    "nan",
    '""',
    "[]",
    "{}",
    "[1, 2]",
    "true",
    "2020-01-01",
    '"measurement"',
    "{ value = 1 }",
    "[[]]",
]


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    changes=st.lists(
        st.tuples(st.integers(0, 400), st.sampled_from(WORDS) | st.text(max_size=3)), min_size=1, max_size=3
    )
)
def test_mutated_drive_files(place, changes):
    """Values of the drive file replaced by others, at any place where one begins."""
    text = DRIVE
    for where, word in changes:
        starts = [k + 2 for k in range(len(text)) if text.startswith("= ", k)]
        if not starts:
            break
        start = starts[where % len(starts)]
        end = next(k for k in range(start, len(text) + 1) if text[k : k + 1] in (",", "}", "\n", ""))
        text = text[:start] + word + text[end:]
    drive = place.with_name("arm.drive.toml")
    drive.write_text(text, encoding="utf-8", errors="surrogatepass")
    try:
        check(place, SEED.encode(), "independent")
    finally:
        drive.unlink()


def test_the_drive_file_loads(place):
    drive = place.with_name("arm.drive.toml")
    drive.write_text(DRIVE, encoding="utf-8")
    check(place, SEED.encode(), "independent")
    assert build_model(read_urdf(place, mimic="independent")).bodies[1].drive.gear_ratio == 300
    drive.unlink()
