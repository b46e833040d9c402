"""Random robot descriptions: trees of every kind of joint, with drives, visuals, sources and deviations."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from armwright.description.robot import RobotDescription

numbers = st.floats(-1e6, 1e6) | st.sampled_from([0.0, -0.0, 0.1, 1e-310, 1 / 3])
positive = st.floats(1e-9, 1e6)
lengths = st.floats(1e-6, 900.0)
texts = st.text(st.characters(blacklist_categories=("Cs",)), min_size=1, max_size=12)
allowed = st.characters(blacklist_categories=("Cs", "Cc", "Cf", "Zl", "Zp"), blacklist_characters='"[]')
names = st.text(allowed, min_size=1, max_size=6).filter(lambda text: text == text.strip() and text != "t")


def vectors(size: int, items: st.SearchStrategy[float] = numbers) -> st.SearchStrategy[list[float]]:
    """As many numbers."""
    return st.lists(items, min_size=size, max_size=size)


@st.composite
def quantity(draw: Any, values: st.SearchStrategy[Any], sources: list[str]) -> Any:
    """A bare value, or one with its deviation, source and date."""
    value = draw(values)
    if draw(st.booleans()):
        return value
    extra = {
        "source": st.sampled_from(sources),
        "std": st.floats(0, 10),
        "date": st.dates().map(lambda day: day.isoformat()),
    }
    return {"value": value, **{key: draw(some) for key, some in extra.items() if draw(st.booleans())}}


@st.composite
def solids(draw: Any, sources: list[str]) -> dict[str, Any]:
    """Of a few kinds."""
    length = quantity(lengths, sources)
    kinds = {
        "cylinder": {"radius_m": length, "length_m": length},
        "box": {"size_m": quantity(vectors(3, lengths), sources)},
        "cone": {"bottom_radius_m": length, "top_radius_m": st.just(0.0), "length_m": length},
        "prism": {"outline_m": st.just([[0, 0], [1.5, 0], [0, 0.1]]), "length_m": length},
        "mesh": {"file": st.just("meshes/é 1.stl"), "scale": st.just(0.001) | st.just([1.0, -1.0, 1.0])},
    }
    shape = draw(st.sampled_from(sorted(kinds)))
    return {"shape": shape, **{key: draw(some) for key, some in kinds[shape].items()}}


@st.composite
def links(draw: Any, name: str, sources: list[str]) -> dict[str, Any]:
    """A link, plausible or not: writing does not judge."""
    diagonal = {key: draw(quantity(positive, sources)) for key in ("xx", "yy", "zz")}
    link = {
        "name": name,
        "mass_kg": draw(quantity(positive, sources)),
        "com_m": draw(quantity(vectors(3), sources)),
        "inertia_kg_m2": {**diagonal, **{key: draw(numbers) for key in ("xy", "xz", "yz")}},
    }
    if draw(st.booleans()):
        link["accept_impossible"] = draw(texts)
    if draw(st.booleans()):
        place = {"xyz_m": draw(vectors(3)), "rpy_rad": draw(vectors(3))}
        link["visuals"] = [{"name": draw(texts), "solid": draw(solids(sources)), "hole": draw(st.booleans()), **place}]
    return link


@st.composite
def joints(draw: Any, name: str, parent: str, child: str, sources: list[str]) -> dict[str, Any]:
    """A joint of any type and placement."""
    kind = draw(st.sampled_from(["revolute", "prismatic", "fixed"]))
    joint = {"name": name, "type": kind, "parent": parent, "child": child}
    keys = {
        "revolute": ("alpha_rad", "r_m", "a_m", "offset_rad"),
        "prismatic": ("alpha_rad", "theta_rad", "a_m", "offset_m"),
        "fixed": ("alpha_rad", "r_m", "a_m", "theta_rad"),
    }[kind]
    way = draw(st.sampled_from(["dh", "modified_dh", "frame"]))
    if way == "frame":
        joint["frame"] = {"xyz_m": draw(vectors(3)), "rpy_rad": draw(quantity(vectors(3), sources))}
        if kind != "fixed":
            joint["axis"] = draw(vectors(3).filter(any))
    else:
        joint[way] = {key: draw(quantity(numbers, sources)) for key in keys}
    if kind == "revolute" and draw(st.booleans()):
        joint["motor"] = {"gear_ratio": draw(positive), "rotor_inertia_kg_m2": draw(quantity(positive, sources))}
        joint["friction"] = {"side": draw(st.sampled_from(["joint", "motor"])), "viscous_n_m_s_per_rad": draw(positive)}
    if kind == "prismatic" and draw(st.booleans()):
        joint["limits"] = {"position_m": [-1.0, draw(positive)], "source": draw(st.sampled_from(sources))}
    return joint


@st.composite
def descriptions(draw: Any) -> RobotDescription:
    """A tree of one to three links."""
    count = draw(st.integers(1, 3))
    called = draw(st.lists(names, min_size=2 * count + 2, max_size=2 * count + 2, unique=True))
    base, frame, *rest = called
    bodies, hinges = rest[:count], rest[count:]
    keys = draw(st.lists(texts, min_size=1, max_size=2, unique=True))
    sources = [*keys, "estimate"]
    data = {
        "name": draw(names),
        "title": draw(texts),
        "source": draw(st.sampled_from(sources)),
        "sources": {key: {"kind": "cad", "text": draw(texts)} for key in keys},
        "base": base,
        "command": "torque",
        "gravity_m_s2": draw(quantity(vectors(3), sources)),
        "joints": [
            draw(joints(hinges[k], draw(st.sampled_from([base, *bodies[:k]])), bodies[k], sources))
            for k in range(count)
        ],
        "links": draw(st.permutations([draw(links(name, sources)) for name in bodies])),
        "frames": [{"name": frame, "link": bodies[0], "xyz_m": draw(vectors(3)), "rpy_rad": draw(vectors(3))}],
    }
    return RobotDescription.model_validate(data)
