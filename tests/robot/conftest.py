# SPDX-License-Identifier: BSD-3-Clause
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import pytest

from coclo_vio.robot.description import LegDescription, RobotDescription, load_robot
from coclo_vio.robot.model import RobotModel

_INERTIAL = (
    '<inertial><mass value="0.3"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial>'
)

# A leg of two pitch joints, 0.3 m and 0.2 m; `neck` and `turret` belong to no leg, `knee` turns without limit.
TWO_LINKS = f"""<robot name="two_links">
<link name="root">{_INERTIAL}</link>
<joint name="neck" type="revolute"><parent link="root"/><child link="head"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<link name="head">{_INERTIAL}</link>
<joint name="mount" type="fixed"><parent link="root"/><child link="trunk"/>
  <origin xyz="0.1 0 0.05" rpy="0 0 1.5707963267948966"/></joint>
<link name="trunk"/>
<joint name="turret" type="floating"><parent link="root"/><child link="radar"/></joint>
<link name="radar">{_INERTIAL}</link>
<joint name="hip" type="revolute"><parent link="root"/><child link="upper"/><axis xyz="0 1 0"/>
  <limit lower="-3" upper="3" effort="9" velocity="9"/><dynamics damping="0.2" friction="0.5"/></joint>
<link name="upper">{_INERTIAL}</link>
<joint name="knee" type="continuous"><parent link="upper"/><child link="lower"/>
  <origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/></joint>
<link name="lower">{_INERTIAL}</link>
<joint name="ankle" type="fixed"><parent link="lower"/><child link="foot"/><origin xyz="0 0 -0.2"/></joint>
<link name="foot"/>
</robot>"""


@pytest.fixture
def two_links(tmp_path: Path) -> Callable[..., RobotDescription]:
    """Makes descriptions of a robot with one planar leg; keywords replace the leg's or the robot's own."""
    urdf = tmp_path / "two_links.urdf"
    urdf.write_text(TWO_LINKS, encoding="utf-8")

    def make(
        joints: tuple[str, ...] = ("hip", "knee"), foot: str = "foot", body: str | None = None
    ) -> RobotDescription:
        leg = LegDescription(name="leg", joints=joints, foot_frame=foot)
        return RobotDescription(name="two_links", urdf=str(urdf), body_frame=body, legs=(leg,))

    return make


def has_example_robots() -> bool:
    try:
        metadata.distribution("example-robot-data")
    except metadata.PackageNotFoundError:
        return False
    return True


@pytest.fixture
def preset() -> Callable[[str], RobotModel]:
    """Models of packaged robots; skips those whose URDF is in the extra that is not installed."""

    def make(name: str) -> RobotModel:
        description = load_robot(name)
        if description.urdf.startswith("example-robot-data:") and not has_example_robots():
            pytest.skip("pip install coclo-vio[robots] for this robot's URDF")
        return RobotModel(description)

    return make
