"""What is looked at before MuJoCo is given a file: paths that lead out of its folder, and sizes that would not end."""

from __future__ import annotations

from pathlib import Path

from armwright.description.xml_tree import NUMBER, Element, read_xml

FOLDERS = ("meshdir", "texturedir", "assetdir")
SIZES = {"count": 1000, "nrow": 8192, "ncol": 8192, "width": 8192, "height": 8192, "resolution": 8192}
SOFT = ("composite", "flexcomp", "flex", "skin", "plugin", "extension")
NOT_FINITE = ("nan", "inf", "infinity")  # MuJoCo lets some through, and leaves a log file in the working directory
MOST_FILES = 100


def check_file(path: Path) -> None:
    """Refuses an MJCF that names files outside its folder, that includes itself, or that would grow beyond a robot.

    Raises:
        DescriptionError: names file, line and element.
    """
    folder = path.resolve().parent
    _check(path, folder, [])


def _check(path: Path, folder: Path, within: list[Path]) -> None:
    root = read_xml(path)
    if root.tag not in ("mujoco", "mujocoinclude"):
        raise root.error(f"<{root.tag}>: expected an MJCF, whose first element is <mujoco>")
    _check_element(root, folder, [*within, path.resolve()])


def _check_element(element: Element, folder: Path, within: list[Path]) -> None:
    if element.tag in SOFT:
        raise element.error(f"<{element.tag}> is not offered: an arm is made of rigid bodies")
    for name, most in SIZES.items():
        for word in element.attributes.get(name, "").split():
            if not NUMBER.fullmatch(word) or float(word) > most:
                raise element.error(f"<{element.tag} {name}={word[:30]!r}>: expected a number of {most} at most")
    for name, value in element.attributes.items():
        words = value.lower().split()
        if name != "name" and any(word.lstrip("+-") in NOT_FINITE for word in words):
            raise element.error(f"<{element.tag} {name}={value[:60]!r}>: expected finite numbers")
    named = [element.attributes[name] for name in (*FOLDERS, "file") if element.attributes.get(name)]
    for name in named:
        where = folder / name
        if "\0" in name or not where.resolve().is_relative_to(folder):
            raise element.error(f"<{element.tag}>: {name!r} leads out of {str(folder)!r}: expected a path below it")
    if element.tag == "include":
        inner = folder / element.word("file")
        if inner.resolve() in within or len(within) >= MOST_FILES:
            raise element.error(f"{inner.name!r} includes itself: expected files that end")
        _check(inner, folder, within)
    for child in element.children:
        _check_element(child, folder, within)
