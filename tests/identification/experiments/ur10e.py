"""A UR10e and the motion of 50 s by which it was identified. [MamedovMikhel2020]

Kinematics of its makers' URDF, and twelve sines and cosines of speed for each joint, found by pattern search for the least
condition number: github.com/shamilmamedov/dynamic_calibration, commit 3afa267a, trajectory_optmzn/coeffs4_UR.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.interpolate import BPoly

PERIOD = 50.0  # [s]
START = (0.0, -np.pi / 2, 0.0, -np.pi / 2, 0.0, 0.0)  # [rad], where it begins and ends at rest
JOINTS = (  # xyz [m], rpy [rad] of the joint's origin, and its axis
    ("0 0 0.181", "0 0 0", "0 0 1"), ("0 0.176 0", "0 1.57079632679 0", "0 1 0"), ("0 -0.137 0.613", "0 0 0", "0 1 0"),
    ("0 0 0.571", "0 1.57079632679 0", "0 1 0"), ("0 0.135 0", "0 0 0", "0 0 1"), ("0 0 0.12", "0 0 0", "0 1 0"),
)  # fmt: skip
A = (  # of cosines of speed [rad/s], a row for each joint
    (-3.974481729, -0.1263495593, -0.4067543235, 0.01745835125, -0.1796686892, -0.2380602704,
     0.1848183571, 0.1111534751, 0.1410606719, -0.1188737254, 0.204341082, 0.08596264769),
    (-2.879402505, -0.2289470597, -0.06954506711, -0.2848223507, -0.1062309611, 0.3852371141,
     -0.06828043869, 0.04329703184, -0.1658631864, 0.06520792009, 0.1317506179, 0.1089594315),
    (-15.48327905, -0.9624320655, -0.2938480256, 0.1029311099, 0.1229936523, -0.1747752232,
     -0.1249713243, -0.0289180248, -0.2055965047, 0.1022627615, -0.00471635562, 0.1057880618),
    (5.48381531, 0.2539851576, -0.0966234675, 0.1034346666, 0.2802400541, 0.09354399279,
     0.04664159028, 0.1417473342, 0.08747729151, -0.118674041, -0.2021042497, -0.1188666917),
    (-3.457531933, -0.02541007691, 0.04787478494, 0.1399078032, -0.03943158005, 0.1568844436,
     0.08727102279, -0.3505478601, -0.2097099887, 0.0731556096, -0.08965735876, -0.0001165922718),
    (15.56779926, 0.9466292359, 0.1124677763, -0.1784619549, 0.03998879987, 0.009266604668,
     0.02877817151, -0.1009716712, 0.1881795823, 0.1255953629, 0.11153501, 0.01357831564),
)  # fmt: skip
B = (  # of sines of speed [rad/s]
    (-4.983486462, -0.6646498568, 0.0696294451, -0.3263522735, 0.2748071868, 0.08897728028,
     -0.03995933275, -0.289819589, 0.05410070653, 0.1583118304, -0.1142001099, -0.08114596991),
    (-1.579210055, -0.3321490577, -0.03358183824, -0.1007133875, -0.04294468737, 0.1379136671,
     -0.05488468231, 0.2250829443, -0.004463852945, 0.05901332247, -0.1185737897, -0.1002952046),
    (16.19067969, 2.111171971, 0.6044306836, 0.1298165628, 0.188193796, 0.1389974498,
     0.3463904142, 0.03915189273, -0.08019820825, 0.004420793493, -0.05068760844, 0.06117448896),
    (-3.336393249, -0.4553697064, 0.1293391526, -0.2799145946, -0.07875538921, -0.1136321062,
     0.1184144644, -0.007733498579, -0.1495017066, 0.06496210931, 0.02866627605, 0.01673143292),
    (-7.360036037, -0.8058649422, -0.2171924267, 0.006336341544, -0.1781437793, -0.2281202047,
     -0.1201023722, 0.01281586982, 0.07224526478, 0.03602901236, 0.001639835072, -0.037521979),
    (-0.5312438088, -0.1227335589, 0.0469799162, 0.5145122936, -0.3587586725, -0.1211934596,
     -0.1937368106, 0.07565619836, 0.06878238849, 0.03166549201, -0.04415950475, 0.04416693807),
)  # fmt: skip


def ur10e_urdf(folder: Path) -> Path:
    """Path of the URDF, kinematics alone, which it writes."""
    text = ['<robot name="ur10e"><link name="link0"/>']
    for k, (xyz, rpy, axis) in enumerate(JOINTS, start=1):
        text.append(f'<link name="link{k}"/><joint name="joint{k}" type="continuous"><parent link="link{k - 1}"/>')
        text.append(f'<child link="link{k}"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/></joint>')
    path = folder / "ur10e.urdf"
    path.write_text("\n".join([*text, "</robot>"]))
    return path


def published_motion(t: np.ndarray) -> list[np.ndarray]:
    """q, q̇, q̈ (rows, 6) of the published motion: the series, and a polynomial of degree 5 that begins and ends at rest."""
    w = 2.0 * np.pi / PERIOD * np.arange(1, 13)
    a, b = np.array(A), np.array(B)

    def series(t: np.ndarray) -> list[np.ndarray]:
        sine, cosine = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
        return [
            sine @ (a / w).T - cosine @ (b / w).T,
            cosine @ a.T + sine @ b.T,
            cosine @ (b * w).T - sine @ (a * w).T,
        ]

    ends = [START - series(np.zeros(1))[0][0], *(-part[0] for part in series(np.zeros(1))[1:])]
    polynomial = BPoly.from_derivatives([0.0, PERIOD], [ends, ends])  # the series is the same at both ends
    return [part + polynomial(t, k) for k, part in enumerate(series(t))]
