# SPDX-License-Identifier: BSD-3-Clause
"""Logs with units and signs of their own, or without sensors: adopted, with a sentence on what to correct."""

import re

import pytest

from coclo_vio.adoption.adopt import adopt
from coclo_vio.datasets.writer import RecordedJoints
from coclo_vio.robot.description import load_robot


def test_joints_of_the_opposite_sign_are_named(write_walk) -> None:
    def reversed_calves(text: str) -> str:
        header, *rows = text.splitlines()
        columns = [number for number, name in enumerate(header.split(",")) if "calf_joint" in name]
        cells = [line.split(",") for line in rows]
        for row in cells:
            for column in columns:
                row[column] = repr(-float(row[column])) if row[column] else ""
        return "\n".join([header, *(",".join(row) for row in cells)]) + "\n"

    urdf, log, robot = write_walk("go1", edit=reversed_calves)
    adoption = adopt(urdf, log)
    field = next(field for field in adoption.fields if field.key == "joint_signs")
    assert set(re.findall(r"\w+_joint", field.value)) == {f"{leg}_calf_joint" for leg in robot.leg_names}
    (setting,) = adoption.settings
    assert setting.startswith("dataset.corrections.joints.signs={")
    assert set(re.findall(r"(\w+_joint): -1", setting)) == {f"{leg}_calf_joint" for leg in robot.leg_names}


def test_degrees_and_revolutions_are_recognised(write_walk) -> None:
    def in_degrees_and_rpm(text: str) -> str:
        header, *rows = text.splitlines()
        scales = [
            57.29577951 if name.endswith(".position") else 9.54929659 if name.endswith(".velocity") else 1.0
            for name in header.split(",")
        ]
        cells = [[repr(float(cell) * scale) if cell and scale != 1.0 else cell
                  for cell, scale in zip(line.split(","), scales, strict=True)] for line in rows]  # fmt: skip
        return "\n".join([header, *(",".join(row) for row in cells)]) + "\n"

    urdf, log, robot = write_walk("a1", edit=in_degrees_and_rpm)
    adoption = adopt(urdf, log)
    assert adoption.description.joint_names == robot.joint_names
    key = "dataset.corrections.joints."
    assert adoption.settings == (f"{key}position_unit=deg", f"{key}velocity_unit=rpm")


def test_a_log_without_velocities_gives_the_error_of_estimated_ones(write_walk) -> None:
    urdf, log, _ = write_walk("go1", joints=RecordedJoints(with_velocity=False))
    assert adopt(urdf, log).description.joint_velocity_noise_radps > 0.06


def scaled(pattern: str, scale: float, offset: float = 0.0):
    """An edit of a leg log: the columns that a pattern matches times a scale, plus an offset."""

    def edit(text: str) -> str:
        header, *rows = text.splitlines()
        columns = [number for number, name in enumerate(header.split(",")) if re.fullmatch(pattern, name)]
        cells = [line.split(",") for line in rows]
        for row in cells:
            for column in columns:
                row[column] = repr(float(row[column]) * scale + offset) if row[column] else ""
        return "\n".join([header, *(",".join(row) for row in cells)]) + "\n"

    return edit


@pytest.mark.parametrize(
    ("pattern", "scale", "offset", "words"),
    [
        (r"gyro_\w+", 57.29578, 0.0, "the gyroscope reads deg/s"),
        (r"accel_\w+", 1.0 / 9.81, 0.0, "its unit is g"),
        (r"accel_z_mps2", 1.0, -9.81, "gravity was removed"),
        (r".+\.effort", -1.0, 0.0, "the sign of the torques is opposite"),
        (r".+\.effort", 0.0, 0.0, "neither foot sensors nor joint torques"),
    ],
)
def test_a_log_with_a_unit_or_sign_of_its_own_is_adopted_with_a_sentence_on_it(
    pattern, scale, offset, words, write_walk
) -> None:
    urdf, log, robot = write_walk("daisy", edit=scaled(pattern, scale, offset))
    adoption = adopt(urdf, log)
    assert any(words in note for note in adoption.notes), adoption.notes
    assert f"# ? {next(note for note in adoption.notes if words in note)}" in adoption.to_yaml(log.parent)
    assert adoption.description.joint_names == robot.joint_names
    is_tilt_from_nothing = "gravity" in words
    assert is_tilt_from_nothing == any(f.key.startswith("imu.rotation") for f in adoption.questions)


def test_velocities_of_the_opposite_sign_are_estimated_from_the_angles(write_walk) -> None:
    urdf, log, _ = write_walk("daisy", edit=scaled(r".+\.velocity", -1.0))
    assert adopt(urdf, log).settings == ("dataset.corrections.joints.velocity=from_position",)


def test_a_log_without_imu_and_a_massless_world_root(write_walk, tmp_path) -> None:
    def without_imu(text: str) -> str:
        rows = [line.split(",") for line in text.splitlines()]
        kept = [number for number, name in enumerate(rows[0]) if not name.startswith(("gyro", "accel"))]
        return "\n".join(",".join(row[number] for number in kept) for row in rows) + "\n"

    urdf, log, robot = write_walk("go1", edit=without_imu)
    world = '<link name="world"/><joint name="free" type="floating"><parent link="world"/><child link="trunk"/></joint>'
    path = tmp_path / "in_a_world.urdf"
    path.write_text(urdf.read_text("utf-8").replace('<robot name="go1">', f'<robot name="go1">{world}'), "utf-8")
    adoption = adopt(path, log)
    assert adoption.description.body_frame == "trunk"
    assert adoption.description.joint_names == robot.joint_names
    assert any("no IMU" in note for note in adoption.notes)
    assert load_robot(adoption.write(tmp_path / "robot.yaml")).body_frame == "trunk"
