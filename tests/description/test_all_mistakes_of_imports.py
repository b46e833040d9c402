"""Mistakes of a URDF and of an MJCF are all reported at once, each with its line or its name."""

from __future__ import annotations

import pytest

import armwright as aw
from armwright.errors import DescriptionError
from description.urdf_files import written

URDF = """<robot name="bad">
<link name="base"/>
<material name="red"><color rgba="1 0 x 1"/></material>
<loop_joint name="x"/>
<link name="l1"><inertial>
<mass value="-1"/>
<origin xyz="0 0"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="abc"/>
</inertial></link>
<link name="l2"><inertial>
<mass value="1" unit="kg"/>
<inertia ixx="-0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="1"/>
</inertial><visual><geometry>
<torus/>
</geometry></visual></link>
<joint name="j1" type="revolut">
<parent link="base"/><child link="l1"/></joint>
<joint name="j2" type="revolute">
<parent link="l1"/><child link="l2"/>
<origin xyz="a 0 0"/>
<axis xyz="0 0 0"/>
<limit lower="2" upper="1"/>
<dynamics damping="-1"/>
<spring stiffness="1"/>
</joint>
<link name="l3">
<inertial><mass value="1"/></inertial></link>
<joint name="j3" type="planar">
<parent link="l2"/><child link="l3"/></joint>
<link name="l4"/>
<joint name="j4" type="prismatic">
<parent link="l3"/><child link="l4"/></joint>
<link name="l5"/>
<joint name="j5" type="revolute">
<parent link="l4"/><child link="l5"/><axis xyz="0 0 1" abc="0"/></joint>
<transmission name="t"><joint name="j2"/>
<mechanicalReduction>0</mechanicalReduction></transmission>
<transmission name="t2"><joint name="j1"/>
<mechanicalReduction>x</mechanicalReduction></transmission>
</robot>"""
LINES = [3, 4, 6, 7, 8, 11, 12, 14, 16, 20, 21, 22, 23, 24, 27, 28, 31, 35, 37, 39]

MJCF = """<mujoco>
<worldbody><body name="a">
<freejoint name="float"/>
<geom type="sphere" size="0.1"/>
<body name="b" gravcomp="1"><joint name="ball" type="ball"/><geom type="sphere" size="0.1"/></body>
</body></worldbody>
</mujoco>"""


def test_twenty_mistakes_of_a_urdf(tmp_path):
    with pytest.raises(DescriptionError) as refused:
        aw.load(written(tmp_path, URDF))
    assert sorted({problem.line for problem in refused.value.problems}) == LINES
    assert len(LINES) == 20
    assert f"{len(refused.value.problems)} mistakes" in str(refused.value).splitlines()[0]


def test_all_that_an_mjcf_has_and_an_arm_has_not(tmp_path):
    pytest.importorskip("mujoco", reason="MJCF is read through MuJoCo: pip install mujoco")
    with pytest.raises(DescriptionError) as refused:
        aw.load(written(tmp_path, MJCF, "arm.xml"))
    places = [problem.place for problem in refused.value.problems]
    assert places == ["joint 'float'", "joint 'ball'", "body 'b'"]


def test_all_lines_of_an_mjcf_that_are_refused_before_mujoco_reads_it(tmp_path):
    pytest.importorskip("mujoco", reason="MJCF is read through MuJoCo: pip install mujoco")
    lines = ("<mujoco>", '<option gravity="0 0 nan"/>', '<asset><mesh file="../a.stl"/></asset>', "<deformable>",
             '<flex name="x"/>', "</deformable></mujoco>")  # fmt: skip
    text = "\n".join(lines)
    with pytest.raises(DescriptionError) as refused:
        aw.load(written(tmp_path, text, "arm.xml"))
    assert [problem.line for problem in refused.value.problems] == [2, 3, 5]
