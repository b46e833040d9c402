"""Whatever a file holds, reading it gives a description or a DescriptionError of one line: never another exception."""

from __future__ import annotations

import copy
from importlib import resources
from typing import Any

import pytest
import tomlkit
from hypothesis import given, settings, strategies as st

from armwright.description.database import parse
from armwright.errors import DescriptionError
from armwright.model import build_model

KEYS = sorted(
    {
        "name",
        "joints",
        "links",
        "frames",
        "sources",
        "source",
        "type",
        "parent",
        "child",
        "axis",
        "frame",
        "dh",
        "modified_dh",
    }
    | {
        "motor",
        "friction",
        "limits",
        "command",
        "side",
        "law",
        "value",
        "std",
        "date",
        "kind",
        "text",
        "base",
        "tip",
        "xx",
    }
    | {"mass_kg", "com_m", "inertia_kg_m2", "xyz_m", "rpy_rad", "gear_ratio", "gear_efficiency", "alpha_rad", "basis"}
    | {"smoothing_m_per_s", "viscous_n_s_per_m", "viscous_n_m_s_per_rad", "accept_impossible", "a b", "", "é\n"}
)
WORDS = [
    "revolute",
    "prismatic",
    "fixed",
    "base",
    "link1",
    "link2",
    "elbow",
    "motor",
    "sigmoid",
    "torque",
    "voltage",
    "\n",
    "",
]
numbers = st.floats() | st.integers() | st.sampled_from([0, -1, 10**400])
leaves = (
    numbers | st.booleans() | st.sampled_from(WORDS) | st.text(max_size=4) | st.dates() | st.datetimes() | st.times()
)
values = st.recursive(
    leaves,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(KEYS), inner, max_size=5),
    max_leaves=20,
)
BUILTIN = {
    name: tomlkit.parse((resources.files("armwright.robots") / f"{name}.toml").read_text()).unwrap()
    for name in ("puma560", "panda", "two-link")
}


def places(data: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every entry of a document."""
    inner = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    return [path, *(place for key, value in inner for place in places(value, (*path, key)))]


def read(data: dict[str, Any]) -> None:
    """Parse and build; anything but a model or a DescriptionError of one line a problem fails the test."""
    refusal, count = "", 0
    try:
        build_model(parse(data, "arm.toml"))
    except DescriptionError as error:
        refusal, count = str(error), len(error.problems)
    assert len(refusal.splitlines()) == count + (count > 1)
    assert len(refusal) < 1000 * max(count, 1)


@settings(max_examples=80)
@given(st.dictionaries(st.sampled_from(KEYS), values, max_size=8))
def test_any_document(data):
    """Documents of known keys with anything below them."""
    read(data)


@pytest.mark.study
@settings(max_examples=200)
@given(st.sampled_from(sorted(BUILTIN)), st.lists(st.tuples(st.integers(0, 10**6), values), min_size=1, max_size=3))
def test_any_change_of_a_good_file(name, changes):
    """A built-in file with one to three entries replaced by anything: deep inside, where most checks are."""
    data = copy.deepcopy(BUILTIN[name])
    for where, value in changes:
        every = places(data)[1:]
        if not every:
            break
        *path, last = every[where % len(every)]
        at = data
        for key in path:
            at = at[key]
        at[last] = value
    read(data)


@settings(max_examples=200)
@given(
    st.lists(st.tuples(st.sampled_from("abcde"), st.sampled_from(["base", *"abcde"])), min_size=1, max_size=6),
    st.lists(st.sampled_from("abcde"), max_size=6),
)
def test_any_tree(edges, links):
    """Joints between any links, listed or not: trees are read, loops and strays are refused."""
    zero = {"xyz_m": [0, 0, 0], "rpy_rad": [0, 0, 0]}
    tensor = {"xx": 1, "xy": 0, "xz": 0, "yy": 1, "yz": 0, "zz": 1}
    joints = [
        {"name": f"j{k}", "type": "revolute", "parent": parent, "child": child, "frame": zero, "axis": [0, 0, 1]}
        for k, (child, parent) in enumerate(edges)
    ]
    bodies = [{"name": name, "mass_kg": 1, "com_m": [0, 0, 0], "inertia_kg_m2": tensor} for name in links]
    data = {"name": "any", "source": "definition", "command": "torque", "joints": joints, "links": bodies}
    parents = dict(edges)
    reached, grown = {"base"}, True
    while grown:
        more = {child for child, parent in edges if parent in reached} - reached
        reached, grown = reached | more, bool(more)
    is_tree = (
        len(parents) == len(edges)
        and len(set(links)) == len(links)
        and set(links) == set(parents) == reached - {"base"}
    )
    if is_tree:
        assert build_model(parse(data, "arm.toml")).n == len(edges)
    else:
        with pytest.raises(DescriptionError):
            build_model(parse(data, "arm.toml"))
