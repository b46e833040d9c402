"""URDFs for tests, put together from pieces."""

from __future__ import annotations

from pathlib import Path

INERTIAL = (
    '<inertial><origin xyz="0.1 0 0"/><mass value="1.5"/>'
    '<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>'
)
LIMIT = '<limit lower="-1" upper="1" effort="10" velocity="2"/>'
AXIS = '<axis xyz="0 0 1"/>'


def link(name: str, inside: str = INERTIAL) -> str:
    """A link."""
    return f'<link name="{name}">{inside}</link>'


def joint(name: str, parent: str, child: str, inside: str = AXIS + LIMIT, kind: str = "revolute") -> str:
    """A joint at 0.2 m along x."""
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="0.2 0 0" rpy="0.1 0 0"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{inside}</joint>'


def robot(*parts: str, name: str = "arm") -> str:
    """A robot."""
    return f'<robot name="{name}">\n' + "\n".join(parts) + "\n</robot>"


def one_joint(inside: str = AXIS + LIMIT, kind: str = "revolute", moved: str = INERTIAL, more: str = "") -> str:
    """A base and one link on a joint; the joint is in line 4."""
    return robot(link("base", ""), link("upper", moved), joint("j1", "base", "upper", inside, kind), more)


def written(folder: Path, text: str | bytes, name: str = "arm.urdf") -> Path:
    """The file."""
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path
