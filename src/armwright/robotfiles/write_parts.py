"""Files of an arm that is built from parts: its robot file, and the audit page."""

from __future__ import annotations

import os
from pathlib import Path

from armwright.description.database import read_toml
from armwright.description.robot import RobotDescription
from armwright.description.writer import to_toml
from armwright.entry import as_path
from armwright.errors import DescriptionError, OutputError
from armwright.output import check_destination, whole_file
from armwright.parts.build import PartsBuild, build_parts


def write_parts(
    parts: str | os.PathLike[str], arm: str | os.PathLike[str], audit: str | os.PathLike[str] | None = None
) -> PartsBuild:
    """Builds an arm from its parts and writes its file, and on request an audit of all sums.

    Args:
        parts: the *.parts.toml file.   arm: the file to write.   audit: an HTML page to write; it also lists what changed
            since the arm's file that was there.
    Returns:
        build: the arm with its weighed links, its warnings and what was measured.
    Raises:
        DescriptionError: the parts are invalid.   OutputError: a file cannot be written; then none is.
    Example:
        >>> parts = aw.__path__[0] + "/robots/cmu-dd.parts.toml"
        >>> build = aw.robotfiles.write_parts(parts, "own.toml")
        >>> [link.link.name for link in build.links][:2]
        ['link1', 'link2']
    """
    parts, arm = Path(as_path(parts, "parts", DescriptionError)), Path(as_path(arm, "arm", OutputError))
    if os.path.realpath(arm) == os.path.realpath(parts):
        raise OutputError("this is the parts file itself", file=arm, expected="another file for the arm")
    check_destination(arm, (".toml",))
    if audit is not None and os.path.realpath(check_destination(audit, (".html", ".htm"))) == os.path.realpath(arm):
        raise OutputError(file=audit, expected="another file than the arm's")
    build = build_parts(parts, arm.parent)
    text = to_toml(build.description, arm.parent)
    page = None
    if audit is not None:
        from armwright.robotfiles.audit_page import audit_page

        page = audit_page(build, _previous(arm))
    with whole_file(arm) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    if audit is not None and page is not None:
        with whole_file(audit) as temporary:
            temporary.write_text(page, encoding="utf-8", newline="\n")
    return build


def _previous(path: Path) -> RobotDescription | None:
    """The arm in a file, if there is one."""
    try:
        return read_toml(path)
    except DescriptionError:
        return None
