# SPDX-License-Identifier: BSD-3-Clause
"""A run folder is read back as it was written; a malformed file is named in one sentence."""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.geometry import se3, so3
from coclo_vio.runs import run_folder
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.recorder import failed_records
from coclo_vio.runs.run_record import GroundTruthRecord, RunRecord
from coclo_vio.runs.state_writer import StateWriter
from coclo_vio.values.errors import CocloError, DatasetError
from coclo_vio.values.estimates import FootState, NavState, StateEstimate
from coclo_vio.values.trajectory import GroundTruth, Trajectory

LEGS = ("FL", "FR", "RL", "RR")
START_NS = 1_700_000_000_123_456_789  # no float of seconds or nanoseconds holds it


def _estimates(count: int = 20, *, has_feet: bool = True) -> list[StateEstimate]:
    rng = np.random.default_rng(8)
    estimates = []
    for number in range(count):
        vectors = rng.normal(0.0, 0.3, (4, 3))
        pose = se3.transform(so3.exp(rng.normal(0.0, 1.0, 3)), rng.normal(0.0, 50.0, 3))
        root = rng.normal(0.0, 0.01, (9, 9))
        feet = FootState(rng.normal(size=(4, 3)), rng.uniform(size=4), rng.uniform(size=4) > 0.5)
        nav = NavState(pose, *vectors)
        estimates.append(StateEstimate(START_NS + 2_500_003 * number, nav, root @ root.T, feet if has_feet else None))
    return estimates


@pytest.fixture
def written(tmp_path: Path) -> list[StateEstimate]:
    return _write(tmp_path, "coclo", LEGS, _estimates())


def _write(folder: Path, name: str, legs: tuple[str, ...], estimates: list[StateEstimate]) -> list[StateEstimate]:
    with closing(StateWriter(folder, name, legs)) as writer:
        for estimate in estimates:
            writer.write(estimate)
    return estimates


def test_a_run_is_read_back_as_it_was_written(written: list[StateEstimate], tmp_path: Path) -> None:
    run = run_folder.read_estimates(tmp_path, "coclo")
    got = run.trajectory
    assert run.name == "coclo"
    assert run.leg_names == LEGS
    assert got.stamps_ns.tolist() == [estimate.stamp_ns for estimate in written]
    poses = np.array([estimate.nav.T_world_body for estimate in written])
    np.testing.assert_allclose(got.T_world_body, poses, rtol=1e-10, atol=1e-11)
    velocity = np.array([estimate.nav.velocity_world for estimate in written])
    np.testing.assert_allclose(got.velocity_world, velocity, rtol=1e-8)
    covariance = np.array([estimate.covariance[:6, :6] for estimate in written])
    np.testing.assert_allclose(got.covariance, covariance, rtol=1e-8)
    probability = np.array([estimate.feet.contact_probability for estimate in written if estimate.feet])
    np.testing.assert_allclose(run.contact_probability, probability, rtol=1e-8)


def test_the_trajectory_has_every_nanosecond(written: list[StateEstimate], tmp_path: Path) -> None:
    first, second = (tmp_path / "coclo.tum").read_text(encoding="ascii").splitlines()[:2]
    assert first.split()[0] == "1700000000.123456789"
    assert second.split()[0] == "1700000000.125956792"


def test_the_state_file_has_biases_rates_and_stance(written: list[StateEstimate], tmp_path: Path) -> None:
    header, first = (tmp_path / "coclo_state.csv").read_text(encoding="utf-8").splitlines()[:2]
    cells = dict(zip(header.split(","), first.split(","), strict=True))
    nav, feet = written[0].nav, written[0].feet
    assert feet is not None
    assert cells["stamp_ns"] == str(START_NS)
    assert float(cells["angular_velocity_body_z"]) == pytest.approx(nav.angular_velocity_body[2], rel=1e-8)
    assert float(cells["gyroscope_bias_y"]) == pytest.approx(nav.gyroscope_bias[1], rel=1e-8)
    assert float(cells["accelerometer_bias_x"]) == pytest.approx(nav.accelerometer_bias[0], rel=1e-8)
    assert [bool(float(cells[f"{leg}.is_stance"])) for leg in LEGS] == feet.is_stance.tolist()


@pytest.mark.parametrize("legs", [(), LEGS], ids=["without legs", "of a robot with legs"])
def test_estimates_without_feet_have_no_contact_columns(legs: tuple[str, ...], tmp_path: Path) -> None:
    _write(tmp_path, "vins", legs, _estimates(3, has_feet=False))
    run = run_folder.read_estimates(tmp_path, "vins")
    assert run.leg_names == ()
    assert run.contact_probability.shape == (3, 0)


def test_without_a_state_file_the_poses_stand_alone(written: list[StateEstimate], tmp_path: Path) -> None:
    (tmp_path / "coclo_state.csv").unlink()
    run = run_folder.read_estimates(tmp_path, "coclo")
    assert len(run.trajectory) == len(written)
    assert run.trajectory.velocity_world is None
    assert run.trajectory.covariance is None


def test_a_run_that_is_killed_leaves_all_but_its_last_few_lines(tmp_path: Path) -> None:
    writer = StateWriter(tmp_path, "coclo", LEGS)
    for estimate in _estimates(40):
        writer.write(estimate)
    poses = (tmp_path / "coclo.tum").read_text(encoding="ascii").splitlines()
    states = (tmp_path / "coclo_state.csv").read_text(encoding="utf-8").splitlines()[1:]
    writer.close()
    assert 40 - len(poses) < 16
    assert len(states) == len(poses)


def test_a_writer_that_is_interrupted_leaves_whole_lines(tmp_path: Path) -> None:
    def interrupted() -> None:
        with closing(StateWriter(tmp_path, "coclo", LEGS)) as writer:
            for estimate in _estimates(5):
                writer.write(estimate)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert len(run_folder.read_estimates(tmp_path, "coclo").trajectory) == 5


def _cell(column: str, text: str) -> Callable[[str], str]:
    """Replaces a cell in the third line."""

    def spoil(content: str) -> str:
        lines = content.split("\n")
        cells = lines[2].split(",")
        cells[lines[0].split(",").index(column)] = text
        lines[2] = ",".join(cells)
        return "\n".join(lines)

    return spoil


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda content: content[:-40] + "\n", r"line 21: \d+ cells under a header of 42 columns"),
        (lambda content: "".join(content.splitlines(keepends=True)[:-3]), "17 rows for the 20 poses"),
        (lambda content: "\n" * 21, "lacks the columns"),
        (lambda content: content.splitlines()[0] + "\n", "0 rows for the 20 poses"),
        (lambda content: content.replace("pose_covariance_34", "pose"), "lacks the columns pose_covariance_34"),
        (_cell("velocity_world_y", "nan"), "line 3: velocity_world_y is nan, not finite"),
        (_cell("pose_covariance_00", "inf"), "line 3: pose_covariance_00 is inf"),
        (_cell("velocity_world_x", "fast"), "could not convert string to float: 'fast'"),
        (_cell("stamp_ns", "17"), "other stamps than the poses"),
    ],
)
def test_a_malformed_state_file_is_named(
    spoil: Callable[[str], str], words: str, written: list[StateEstimate], tmp_path: Path
) -> None:
    path = tmp_path / "coclo_state.csv"
    path.write_text(spoil(path.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(DatasetError, match=rf"coclo_state\.csv.*({words}).*run again"):
        run_folder.read_estimates(tmp_path, "coclo")


@pytest.mark.parametrize("cut", [1, 40, 700])
def test_a_last_state_that_was_cut_short_is_left_out_with_its_pose(
    cut: int, written: list[StateEstimate], tmp_path: Path
) -> None:
    path = tmp_path / "coclo_state.csv"
    content = path.read_bytes()
    path.write_bytes(content[:-cut])
    whole = content[:-cut].count(b"\n") - 1
    found = run_folder.read_estimates(tmp_path, "coclo")
    assert found.trajectory.stamps_ns.tolist() == [estimate.stamp_ns for estimate in written[:whole]]
    assert found.notes[0] == f"the last line of coclo_state.csv, line {whole + 2}, was cut short and is left out"
    assert found.notes[1].startswith(f"{20 - whole} of the last estimates are left out")


def test_a_last_pose_that_was_cut_short_is_left_out_with_its_state(
    written: list[StateEstimate], tmp_path: Path
) -> None:
    path = tmp_path / "coclo.tum"
    path.write_bytes(path.read_bytes()[:-1])  # still eight numbers, the last of them perhaps another one
    found = run_folder.read_estimates(tmp_path, "coclo")
    assert len(found.trajectory) == len(written) - 1
    assert "coclo.tum, line 20, was cut short" in found.notes[0]


def test_poses_whose_states_were_not_written_any_more_count_as_damage_unless_the_run_was_stopped(
    written: list[StateEstimate], tmp_path: Path
) -> None:
    path = tmp_path / "coclo_state.csv"
    path.write_text("".join(path.read_text(encoding="utf-8").splitlines(keepends=True)[:-3]), encoding="utf-8")
    run = failed_records(mode_of("coclo"), "it stopped")["coclo"]
    for status in ("running", "interrupted", "failed"):
        stopped = record_with(None).model_copy(
            update={"estimators": {"coclo": run.model_copy(update={"status": status})}}
        )
        run_folder.write_record(tmp_path, stopped)
        assert len(run_folder.read_estimates(tmp_path, "coclo").trajectory) == 17
        found = run_folder.read_record(tmp_path).estimators["coclo"]
        assert (found.estimates, found.last_ns) == (17, written[16].stamp_ns)
    run_folder.write_record(
        tmp_path,
        record_with(None).model_copy(update={"estimators": {"coclo": run.model_copy(update={"status": "finished"})}}),
    )
    with pytest.raises(DatasetError, match="17 rows for the 20 poses"):
        run_folder.read_estimates(tmp_path, "coclo")


def test_a_missing_trajectory_is_named(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"coclo\.tum"):
        run_folder.read_estimates(tmp_path, "coclo")


@pytest.mark.parametrize("has_stamps", [True, False])
def test_ground_truth_is_read_back_with_whether_its_stamps_are_real(has_stamps: bool, tmp_path: Path) -> None:
    rng = np.random.default_rng(9)
    poses = se3.transform(so3.exp(rng.normal(size=(4, 3))), rng.normal(size=(4, 3)))
    truth = GroundTruth(Trajectory(START_NS + np.arange(4), poses), has_stamps, "mocap.csv")
    run_folder.write_ground_truth(tmp_path, truth)
    described = GroundTruthRecord(source=truth.source, has_stamps=truth.has_stamps)
    back = run_folder.read_ground_truth(tmp_path, record_with(described))
    assert back is not None
    assert (back.has_stamps, back.source) == (has_stamps, "mocap.csv")
    assert (back.trajectory.stamps_ns == truth.trajectory.stamps_ns).all()
    np.testing.assert_allclose(back.trajectory.T_world_body, poses, atol=1e-11)
    assert run_folder.read_ground_truth(tmp_path, record_with(None)) is None


def record_with(ground_truth: GroundTruthRecord | None) -> RunRecord:
    return RunRecord(
        version="1",
        dataset="walk",
        robot=None,
        imu_calibration="recording",
        ground_truth=ground_truth,
        faults=None,
    )


def test_the_record_is_read_back(tmp_path: Path) -> None:
    record = record_with(GroundTruthRecord(source="mocap.csv", has_stamps=True))
    run_folder.write_record(tmp_path, record)
    assert run_folder.read_record(tmp_path) == record


def test_a_trajectory_without_a_pose_is_named(tmp_path: Path) -> None:
    """A mode that stops before its first estimate leaves an empty trajectory beside a header."""
    _write(tmp_path, "coclo", LEGS, [])
    assert (tmp_path / "coclo_state.csv").read_text(encoding="utf-8").startswith("stamp_ns,")
    with pytest.raises(DatasetError, match=r"coclo\.tum"):
        run_folder.read_estimates(tmp_path, "coclo")


def test_a_folder_without_run_json_is_no_run_folder(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"no run folder: it has no run\.json; give the folder"):
        run_folder.read_record(tmp_path)


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="ascii")
    for folder in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(DatasetError, match=r"cannot make the folder .*file.* choose another folder$"):
            run_folder.prepare(folder)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has a device that is always full")
def test_a_full_disk_is_reported_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "run.json.part").symlink_to("/dev/full")
    with pytest.raises(CocloError, match="No space left"), run_folder.writing(tmp_path):
        run_folder.write_record(tmp_path, record_with(None))


def test_a_record_that_cannot_be_written_leaves_the_earlier_one(tmp_path: Path) -> None:
    run_folder.write_record(tmp_path, record_with(None))
    (tmp_path / "run.json.part").mkdir()
    with pytest.raises(DatasetError, match=r"cannot write .*run\.json\.part"), run_folder.writing(tmp_path):
        run_folder.write_record(tmp_path, record_with(GroundTruthRecord(source="x", has_stamps=True)))
    assert run_folder.read_record(tmp_path) == record_with(None)


def test_what_an_earlier_run_wrote_is_cleared_and_other_files_stay(tmp_path: Path) -> None:
    _write(tmp_path, "coclo", LEGS, _estimates(2))
    pictures = tmp_path / "debug_images" / "coclo"
    pictures.mkdir(parents=True)
    ours = ("compare.json", "coclo_keyframes.csv", "debug_images/coclo/17.jpg")
    others = ("notes.txt", "walk.csv", "mine.tum", "debug_images/coclo/17.png")
    for name in (*ours, *others):
        (tmp_path / name).write_text("", encoding="ascii")
    before = set(tmp_path.rglob("*"))
    run_folder.clear(tmp_path)
    assert set(tmp_path.rglob("*")) == before, "a folder without run.json is no run folder"
    trajectories = failed_records(mode_of("coclo"), "it stopped")
    run_folder.write_record(tmp_path, record_with(None).model_copy(update={"estimators": trajectories}))
    run_folder.clear(tmp_path)
    assert {path for path in tmp_path.rglob("*") if path.is_file()} == {tmp_path / name for name in others}
