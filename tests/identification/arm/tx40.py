"""The Staubli TX40 of the measured log: its kinematics alone, as a URDF without masses and motors."""

from __future__ import annotations

from math import pi
from pathlib import Path

# xyz [m], rpy [rad] of every joint's origin, of modified Denavit-Hartenberg rows with d3 = 0.225, r3 = 0.035, r4 = 0.225 m
ORIGINS = (
    ((0, 0, 0.32), (0, 0, 0)), ((0, 0, 0), (-pi / 2, 0, 0)), ((0.225, 0, 0.035), (0, 0, 0)),
    ((0, -0.225, 0), (pi / 2, 0, 0)), ((0, 0, 0), (-pi / 2, 0, 0)), ((0, 0, 0), (pi / 2, pi, 0)),
)  # fmt: skip


def tx40_urdf(folder: Path) -> Path:
    """Path of the URDF, which it writes."""
    text = ['<robot name="tx40">', '<link name="base"/>']
    parent = "base"
    for k, (xyz, rpy) in enumerate(ORIGINS, start=1):
        text.append(f'<joint name="joint{k}" type="continuous"><parent link="{parent}"/><child link="link{k}"/>')
        text.append(f'<origin xyz="{" ".join(map(repr, xyz))}" rpy="{" ".join(map(repr, rpy))}"/>')
        text.append(f'<axis xyz="0 0 1"/></joint><link name="link{k}"/>')
        parent = f"link{k}"
    path = folder / "tx40.urdf"
    path.write_text("\n".join([*text, "</robot>"]))
    return path
