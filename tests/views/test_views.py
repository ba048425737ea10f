# SPDX-License-Identifier: BSD-3-Clause
"""What a view writes is what it was given: read back from its file, by stamps, counts and values."""

import json
import socket
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.geometry import so3
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.robot.urdf_tree import read_urdf_tree
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import JointSample
from coclo_vio.values.outputs import Calibration, Estimate, Event, Innovation, KeyframeHealth, Picture, WindowSnapshot
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.views import drawn_scene
from coclo_vio.views.canvas import quat_xyzw_of
from coclo_vio.views.drawn_robot import DrawnRobot, mesh_path
from coclo_vio.views.drawn_scene import ellipsoid_of
from coclo_vio.views.foxglove_canvas import _along
from coclo_vio.views.opening import open_view
from coclo_vio.views.view import Setting

pytest.importorskip("foxglove")
pytest.importorskip("rerun")
Rows = Callable[[Path], dict[str, list[tuple[int, dict[str, object]]]]]
Walk = tuple[list[JointSample], list[Estimate]]
NAMES = {
    "foxglove": ("view.mcap", "/coclo/pose", "InstancePoses3D:translations", "/", ""),
    "rerun": ("view.rrd", "/world/coclo/pose", "Transform3D:translation", "/world/", "/plots"),
}


def drawn(kind: str, folder: Path, walk: Walk, setting: Setting, *others: object) -> Path:
    """The file of a view that was given a walk, and other outputs after it."""
    file = folder / NAMES[kind][0]
    view = open_view(kind, setting, file=file)
    for joints, estimate in zip(*walk, strict=True):
        view.measurement(joints)
        view.take(estimate)
    for output in others:
        view.take(output)  # type: ignore[arg-type]
    view.close()
    return file


@pytest.mark.parametrize("kind", NAMES)
def test_every_pose_is_in_the_file_at_its_stamp(kind: str, rows: Rows, walk: Walk, tmp_path: Path) -> None:
    _, entity, component, _, _ = NAMES[kind]
    read = rows(drawn(kind, tmp_path, walk, Setting()))[entity]
    states = [estimate.state for estimate in walk[1]]
    assert [stamp_ns for stamp_ns, _ in read] == [state.stamp_ns for state in states]
    positions = np.array([row[component][0] for _, row in read])  # type: ignore[index]
    assert np.allclose(positions, [state.nav.T_world_body[:3, 3] for state in states], atol=1e-6)


@pytest.mark.parametrize("kind", NAMES)
def test_feet_are_where_the_joints_place_them_and_forces_are_there(
    kind: str, rows: Rows, walk: Walk, tmp_path: Path
) -> None:
    robot, (joints, estimates) = load_robot("daisy"), walk
    read = rows(drawn(kind, tmp_path, walk, Setting(robot)))
    prefix = NAMES[kind][3]
    feet, forces = read[f"{prefix}feet"], read[f"{prefix}forces"]
    assert len(feet) == len(forces) == 25, "25 times a second"
    stamp_ns, row = feet[10]
    index = [joint.stamp_ns for joint in joints].index(stamp_ns)
    T = estimates[index].state.nav.T_world_body
    body = RobotModel(robot).feet(joints[index].position, joints[index].velocity).position_body
    if kind == "foxglove":
        (message,) = row["foxglove.SceneUpdate:message"]  # type: ignore[misc]
        spheres = message["entities"][0]["spheres"]
        found = np.array([[sphere["pose"]["position"][axis] for axis in "xyz"] for sphere in spheres])
        reds = [sphere["color"]["r"] for sphere in spheres]
        (arrows,) = forces[10][1]["foxglove.SceneUpdate:message"]  # type: ignore[misc]
        count = len(arrows["entities"][0]["arrows"])
    else:
        found = np.array(row["Points3D:positions"])
        reds = [(colour >> 24) / 255.0 for colour in row["Points3D:colors"]]  # type: ignore[attr-defined]
        count = len(forces[10][1]["Arrows3D:vectors"])  # type: ignore[arg-type]
    assert np.allclose(found, body @ T[:3, :3].T + T[:3, 3], atol=1e-6)
    assert reds[1] == pytest.approx(0.85, abs=0.01), "swing"
    assert reds[0] == pytest.approx(0.0, abs=0.01), "stance"
    assert reds[2] == pytest.approx(0.425, abs=0.01), "between"
    assert count == len(robot.leg_names)


@pytest.mark.parametrize("kind", NAMES)
def test_every_kind_of_output_is_drawn(kind: str, rows: Rows, walk: Walk, tmp_path: Path) -> None:
    stamp_ns = walk[1][-1].state.stamp_ns + 5
    poses = np.stack([np.eye(4), walk[1][-1].state.nav.T_world_body])
    points = np.arange(12.0).reshape(4, 3)
    others = (
        Event(stamp_ns, "vision_lost", "it is dark"),
        Picture(stamp_ns, np.zeros((4, 4, 3), np.uint8)),
        WindowSnapshot(stamp_ns, poses, points),
        Innovation(stamp_ns, "legs", 21.5, 18),
        KeyframeHealth(stamp_ns, 7, 90, 120, 300, 0.4, 3, 0.02, 9.0),
        Calibration(stamp_ns, np.array([0.001, 0.0, 0.0]), np.ones(3), 1.01, 0.002),
    )
    setting = Setting(load_robot("daisy"), None, lambda image: b"\xff\xd8 pretended")
    read = rows(drawn(kind, tmp_path, walk, setting, *others))
    world, plots = NAMES[kind][3], NAMES[kind][4]
    pictures = read["/tracks"]
    assert [stamp for stamp, _ in pictures] == [stamp_ns]
    (blob,) = pictures[0][1]["EncodedImage:blob"]  # type: ignore[misc]
    assert bytes(blob) == b"\xff\xd8 pretended"
    assert [stamp for stamp, _ in read["/events"]] == [stamp_ns]
    assert "it is dark" in str(read["/events"][0][1])
    (landmarks,) = read[f"{world}landmarks"]
    assert np.allclose(np.reshape(landmarks[1]["Points3D:positions"], (-1, 3)), points)  # type: ignore[arg-type]
    assert len(read[f"{world}keyframes"]) == 1
    for name, value in (("innovation/legs", 21.5), ("window", 90.0), ("calibration", 1.0)):
        (row,) = read[f"{plots}/{name}"]
        if kind == "rerun":
            assert value in np.round(row[1]["Scalars:scalars"], 6)  # type: ignore[call-overload]
        else:
            numbers = json.loads(bytes(row[1]["McapMessage:data"][0]))  # type: ignore[index]
            assert value in [round(each, 6) for each in numbers.values()]
    assert len(read[f"{plots}/velocity/coclo"]) == len(read[f"{plots}/contact/coclo"]) == 100


def test_links_move_with_their_joints(walk: Walk) -> None:
    robot = DrawnRobot(load_robot("daisy"))
    first, last = robot.place(walk[0][0]), robot.place(walk[0][50])
    foot = load_robot("daisy").legs[-1].foot_frame
    assert np.allclose(first["base_link"], np.eye(4))
    assert np.linalg.norm(first[foot][:3, 3] - last[foot][:3, 3]) > 0.01
    expected = RobotModel(load_robot("daisy")).feet(walk[0][50].position, walk[0][50].velocity).position_body[-1]
    assert np.allclose(last[foot][:3, 3], expected, atol=1e-9)
    tree = read_urdf_tree(Path(load_robot("daisy").urdf))
    assert {shape.link for shape in robot.shapes} <= set(tree.links)
    assert {shape.kind for shape in robot.shapes} >= {"box", "sphere", "line"}


def test_a_joint_without_a_reading_stays_where_it_was(walk: Walk) -> None:
    robot = DrawnRobot(load_robot("daisy"))
    before = robot.place(walk[0][50])
    nothing = np.full_like(walk[0][0].position, np.nan)
    after = robot.place(JointSample(0, nothing, nothing, nothing))
    assert all(np.array_equal(before[link], after[link]) for link in before)


def test_meshes_are_found_beside_the_urdf_and_in_its_package(tmp_path: Path) -> None:
    for place in ("dog_description/meshes", "dog_description/urdf"):
        (tmp_path / place).mkdir(parents=True)
    mesh = tmp_path / "dog_description/meshes/hip.stl"
    mesh.write_bytes(b"solid")
    urdf = tmp_path / "dog_description/urdf/dog.urdf"
    assert mesh_path("package://dog_description/meshes/hip.stl", urdf) == mesh
    assert mesh_path("../meshes/hip.stl", urdf).resolve() == mesh  # type: ignore[union-attr]
    assert mesh_path("package://dog_description/meshes/gone.stl", urdf) is None


def test_the_ellipsoid_is_three_sigmas_along_the_axes_of_the_covariance() -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    axes, half_axes = ellipsoid_of(turn @ np.diag([0.01, 0.04, 0.09]) ** 2 @ turn.T)
    assert np.allclose(half_axes, [0.03, 0.12, 0.27])
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert np.allclose(axes @ np.diag(half_axes / 3.0) ** 2 @ axes.T, turn @ np.diag([0.01, 0.04, 0.09]) ** 2 @ turn.T)


def test_ground_truth_begins_at_the_first_estimate(rows: Rows, walk: Walk, tmp_path: Path) -> None:
    """Its world has another origin and heading."""
    states = [estimate.state for estimate in walk[1]]
    own = Trajectory(np.array([each.stamp_ns for each in states]), np.array([each.nav.T_world_body for each in states]))
    c, s = np.cos(1.0), np.sin(1.0)
    moved = own.moved(np.array([[c, -s, 0.0, 5.0], [s, c, 0.0, -2.0], [0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 0.0, 1.0]]))
    read = rows(drawn("rerun", tmp_path, walk, Setting(ground_truth=moved)))
    truth, path = (read[f"/world/{name}/path/0000"][-1][1] for name in ("ground_truth", "coclo"))
    points = np.array(truth["LineStrips3D:strips"][0])  # type: ignore[index]
    assert np.allclose(points[0], [0.0, 0.0, 0.3], atol=1e-5)
    assert np.allclose(points[: len(points)], np.array(path["LineStrips3D:strips"][0])[: len(points)], atol=1e-5)  # type: ignore[index]


def test_what_cannot_be_drawn_is_logged_once_and_ends_nothing(
    walk: Walk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(image: object) -> bytes:
        raise ValueError("no encoder")

    pictures = [Picture(stamp_ns, np.zeros((4, 4, 3), np.uint8)) for stamp_ns in (1, 2)]
    logged: list[str] = []
    monkeypatch.setattr(drawn_scene._log, "warning", lambda text, *values: logged.append(text % values))
    drawn("foxglove", tmp_path, walk, Setting(encode=failing), *pictures)
    assert logged == ["the view could not draw Picture: no encoder"]


def test_a_covariance_that_is_no_number_is_no_reason_to_stop(walk: Walk, tmp_path: Path) -> None:
    state = walk[1][0].state
    joints = JointSample(state.stamp_ns, *[np.full_like(walk[0][0].position, np.nan)] * 3)
    estimate = Estimate("coclo", StateEstimate(state.stamp_ns, state.nav, np.zeros((9, 9)), state.feet))
    for kind in NAMES:
        assert drawn(kind, tmp_path, ([joints], [estimate]), Setting(load_robot("daisy"))).stat().st_size > 0


@pytest.mark.parametrize("kind", NAMES)
def test_a_server_listens_on_this_machine_until_it_is_closed(kind: str, walk: Walk) -> None:
    with socket.socket() as trial:
        trial.bind(("127.0.0.1", 0))
        port = trial.getsockname()[1]
    view = open_view(kind, Setting(load_robot("daisy")), port=port)
    with socket.create_connection(("127.0.0.1", port), timeout=5.0):
        view.take(walk[1][0])
        with pytest.raises(ConfigError, match=f"port {port} cannot be used: .*; choose another one"):
            open_view(kind, Setting(), port=port)
    view.close()


def test_a_view_that_cannot_be_is_refused_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match="there is no view 'rviz'; the views are: animation, foxglove, rerun"):
        open_view("rviz", Setting())
    with pytest.raises(ConfigError, match=r"for the view rerun ends in \.rrd, not 'a\.mcap'; rename it"):
        open_view("rerun", Setting(), file=tmp_path / "a.mcap")
    with pytest.raises(ConfigError, match=r"there is no folder .*gone for the view's file"):
        open_view("rerun", Setting(), file=tmp_path / "gone" / "a.rrd")
    (tmp_path / "is_folder.mcap").mkdir()
    with pytest.raises(ConfigError, match=r"the view cannot use the file .*is_folder\.mcap: .*choose another one"):
        open_view("foxglove", Setting(), file=tmp_path / "is_folder.mcap")
    (tmp_path / "is_folder.rrd").mkdir()
    with pytest.raises(ConfigError, match=r"the view cannot use the file .*is_folder\.rrd: .*choose another one"):
        open_view("rerun", Setting(), file=tmp_path / "is_folder.rrd")
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ConfigError, match=r"needs rerun-sdk, which is not installed: pip install .coclo-vio\[view"):
        open_view("rerun", Setting(), file=tmp_path / "a.rrd")


def test_arrows_of_foxglove_point_along_their_vectors() -> None:
    directions = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [1.0, 0.0, 0.0]])
    T = _along(np.arange(12.0).reshape(4, 3), directions)
    assert np.allclose(T[:, :3, 0], directions)
    assert np.allclose(T[:, :3, 3], np.arange(12.0).reshape(4, 3))
    assert np.allclose(np.swapaxes(T[:, :3, :3], 1, 2) @ T[:, :3, :3], np.eye(3))
    assert np.allclose(np.linalg.det(T[:, :3, :3]), 1.0)


def test_the_quaternion_of_one_pose_is_that_of_many() -> None:
    rng = np.random.default_rng(5)
    turns = [*rng.normal(size=(40, 3)), *(np.pi * np.eye(3)), np.array([np.pi, 1e-9, 0.0]), np.zeros(3)]
    for turn in turns:
        R = so3.exp(turn)
        one, many = np.array(quat_xyzw_of(R)), so3.to_quat_xyzw(R)
        assert abs(one @ many) == pytest.approx(1.0, abs=1e-12)
        assert np.linalg.norm(one) == pytest.approx(1.0, abs=1e-12)
