# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import IntArray
from coclo_vio.values.errors import DatasetError, EvaluationError, TimestampError
from coclo_vio.values.trajectory import Trajectory, read_tum, seconds_to_ns, write_tum

_START_NS = 1_403_715_273_262_142_976  # as in EuRoC: a float of seconds would lose its last three digits
_TUM_LINE = "1.5 0 0 0 0 0 0 1"


def _walk(stamps_ns: IntArray, seed: int = 3) -> Trajectory:
    rng = np.random.default_rng(seed)
    count = len(stamps_ns)
    rotations = so3.exp(np.cumsum(rng.normal(scale=0.2, size=(count, 3)), axis=0))
    factors = rng.normal(size=(count, 6, 6))
    return Trajectory(
        stamps_ns,
        se3.transform(rotations, np.cumsum(rng.normal(size=(count, 3)), axis=0)),
        rng.normal(size=(count, 3)),
        factors @ np.swapaxes(factors, 1, 2),
    )


@pytest.fixture
def walk() -> Trajectory:
    return _walk(_START_NS + np.arange(20) * 50_000_000)


def test_stamps_must_strictly_increase() -> None:
    with pytest.raises(TimestampError, match=r"pose 2 at 10 ns follows 10 ns; sort the poses and drop repeats"):
        _walk(np.array([0, 10, 10]))
    with pytest.raises(TimestampError, match="at least one stamp"):
        Trajectory(np.array([], dtype=np.int64), np.zeros((0, 4, 4)))


def test_stamps_in_seconds_are_refused_not_truncated() -> None:
    with pytest.raises(TimestampError, match="integer nanoseconds, got float64"):
        Trajectory(np.array([0.0, 1.5, 3.0]), np.tile(np.eye(4), (3, 1, 1)))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("velocity", "covariance", "message"),
    [
        (np.zeros((2, 3)), None, r"velocity_world must have shape \(3, 3\), got \(2, 3\)"),
        (None, np.zeros((3, 9, 9)), r"covariance must have shape \(3, 6, 6\), got \(3, 9, 9\)"),
        (np.full((3, 3), np.nan), None, r"velocity_world must be finite, got nan at index \(0, 0\)"),
    ],
)
def test_arrays_of_wrong_shape_are_named(velocity: object, covariance: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Trajectory(np.arange(3), np.tile(np.eye(4), (3, 1, 1)), velocity, covariance)  # type: ignore[arg-type]


def test_arrays_are_copied_and_read_only() -> None:
    stamps_ns, poses = np.arange(3), np.tile(np.eye(4), (3, 1, 1))
    trajectory = Trajectory(stamps_ns, poses)
    poses[0, 0, 3] = stamps_ns[0] = 7
    assert trajectory.positions[0, 0] == 0.0
    assert trajectory.stamps_ns[0] == 0
    for array in (trajectory.stamps_ns, trajectory.T_world_body, trajectory.positions):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_times_count_from_the_first_pose(walk: Trajectory) -> None:
    np.testing.assert_allclose(walk.times_s, np.arange(20) * 0.05, rtol=0, atol=1e-15)
    assert walk.duration_s == 0.95
    assert len(walk) == 20


def test_path_length_of_a_square() -> None:
    corners = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [0, 0, 0]], dtype=np.float64)
    square = Trajectory(np.arange(5), se3.transform(np.tile(np.eye(3), (5, 1, 1)), corners))
    assert square.path_length_m() == 8.0


def test_select_takes_masks_and_indices(walk: Trajectory) -> None:
    mask = np.zeros(20, dtype=np.bool_)
    mask[[3, 7]] = True
    for chosen in (walk.select(mask), walk.select(np.array([3, 7]))):
        np.testing.assert_array_equal(chosen.stamps_ns, walk.stamps_ns[[3, 7]])
        np.testing.assert_array_equal(chosen.T_world_body, walk.T_world_body[[3, 7]])
        np.testing.assert_array_equal(chosen.velocity_world, walk.velocity_world[[3, 7]])  # type: ignore[index]
        np.testing.assert_array_equal(chosen.covariance, walk.covariance[[3, 7]])  # type: ignore[index]


def test_between_includes_both_ends(walk: Trajectory) -> None:
    stamps = walk.stamps_ns
    np.testing.assert_array_equal(walk.between(int(stamps[4]), int(stamps[6])).stamps_ns, stamps[4:7])
    with pytest.raises(EvaluationError, match=f"no pose between 0 and 5 ns: the trajectory spans {stamps[0]} to"):
        walk.between(0, 5)


def test_moved_turns_pose_and_velocity_and_keeps_the_local_covariance(walk: Trajectory) -> None:
    T_new_world = se3.transform(so3.about_z(np.pi / 2), np.array([1.0, 2.0, 3.0]))
    moved = walk.moved(T_new_world)
    np.testing.assert_allclose(moved.positions[5], se3.apply(T_new_world, walk.positions[5]), atol=1e-14)
    velocity, turned = walk.velocity_world, moved.velocity_world
    assert velocity is not None
    assert turned is not None
    np.testing.assert_allclose(turned[:, 0], -velocity[:, 1], atol=1e-14)
    np.testing.assert_allclose(turned[:, 1], velocity[:, 0], atol=1e-14)
    np.testing.assert_array_equal(moved.covariance, walk.covariance)  # type: ignore[arg-type]
    np.testing.assert_allclose(moved.moved(se3.inverse(T_new_world)).T_world_body, walk.T_world_body, atol=1e-14)


def test_restamped_keeps_the_poses(walk: Trajectory) -> None:
    later = walk.restamped(walk.stamps_ns + 5)
    np.testing.assert_array_equal(later.stamps_ns - walk.stamps_ns, np.full(20, 5))
    np.testing.assert_array_equal(later.T_world_body, walk.T_world_body)


def test_interpolation_halfway_is_half_the_turn_and_half_the_way() -> None:
    poses = se3.transform(so3.exp(np.array([[0.0, 0.0, 0.2], [0.0, 0.0, 1.0]])), np.array([[0.0, 0, 0], [2.0, 4, 0]]))
    velocity = np.array([[1.0, 0, 0], [3.0, 0, 0]])
    pair = Trajectory(np.array([_START_NS, _START_NS + 100]), poses, velocity)
    middle = pair.interpolated(np.array([_START_NS + 50]))
    np.testing.assert_allclose(middle.positions[0], [1.0, 2.0, 0.0])
    assert so3.yaw(middle.rotations[0]) == pytest.approx(0.6)
    np.testing.assert_allclose(middle.velocity_world, [[2.0, 0.0, 0.0]])


def test_interpolation_at_its_own_stamps_is_the_trajectory(walk: Trajectory) -> None:
    again = walk.interpolated(walk.stamps_ns)
    np.testing.assert_allclose(again.T_world_body, walk.T_world_body, atol=1e-12)
    np.testing.assert_array_equal(again.covariance, walk.covariance)  # type: ignore[arg-type]


def test_interpolated_covariance_is_that_of_the_nearest_pose(walk: Trajectory) -> None:
    assert walk.covariance is not None
    near = walk.interpolated(walk.stamps_ns[[4, 4]] + np.array([10_000_000, 40_000_000]))
    np.testing.assert_array_equal(near.covariance, walk.covariance[[4, 5]])  # type: ignore[arg-type]


def test_nothing_is_extrapolated(walk: Trajectory) -> None:
    for outside in (walk.stamps_ns[:1] - 1, walk.stamps_ns[-1:] + 1):
        with pytest.raises(EvaluationError, match="cut the stamps to it first"):
            walk.interpolated(outside)


def test_one_pose_can_be_interpolated_at_its_own_stamp(walk: Trajectory) -> None:
    single = walk.select(np.array([2]))
    np.testing.assert_array_equal(single.interpolated(single.stamps_ns).T_world_body, single.T_world_body)


def test_tum_round_trip_is_exact_to_the_nanosecond(walk: Trajectory, tmp_path: Path) -> None:
    uneven = walk.restamped(walk.stamps_ns + np.arange(20) ** 2)
    write_tum(uneven, tmp_path / "walk.tum")
    back = read_tum(tmp_path / "walk.tum")
    np.testing.assert_array_equal(back.stamps_ns, uneven.stamps_ns)
    np.testing.assert_allclose(back.T_world_body, uneven.T_world_body, atol=1e-11)


def test_tum_round_trip_of_stamps_before_zero(walk: Trajectory, tmp_path: Path) -> None:
    stamps_ns = np.array([-1_000_000_001, -1_000_000_000, -999_999_999, -1, 0, 1])
    write_tum(walk.select(np.arange(6)).restamped(stamps_ns), tmp_path / "walk.tum")
    np.testing.assert_array_equal(read_tum(tmp_path / "walk.tum").stamps_ns, stamps_ns)


@given(st.integers(-(2**62), 2**62))
def test_seconds_to_ns_is_exact(stamp_ns: int) -> None:
    sign = "-" if stamp_ns < 0 else ""
    assert seconds_to_ns(f"{sign}{abs(stamp_ns) // 10**9}.{abs(stamp_ns) % 10**9:09d}") == stamp_ns


@pytest.mark.parametrize(
    ("text", "stamp_ns"),
    [
        ("12", 12 * 10**9),
        (".5", 5 * 10**8),
        ("1.5e9", 15 * 10**17),
        (" 0.1234567896 ", 123_456_790),
        ("-0.25", -25 * 10**7),
    ],
)
def test_seconds_to_ns_accepts_every_notation_of_a_number(text: str, stamp_ns: int) -> None:
    assert seconds_to_ns(text) == stamp_ns


@pytest.mark.parametrize("text", ["", "one", "nan", "inf", "1.2.3", "1e999999999"])
def test_seconds_to_ns_refuses_what_is_not_a_time(text: str) -> None:
    with pytest.raises(ValueError, match="seconds"):
        seconds_to_ns(text)


def test_tum_comments_and_blank_lines_are_skipped(tmp_path: Path) -> None:
    path = tmp_path / "walk.tum"
    path.write_text(f"# t x y z qx qy qz qw\n\n{_TUM_LINE} # the first\n2.5 1 2 3 0 0 0 2\n", encoding="utf-8")
    trajectory = read_tum(path)
    np.testing.assert_array_equal(trajectory.stamps_ns, [1_500_000_000, 2_500_000_000])
    np.testing.assert_allclose(trajectory.T_world_body[1], se3.transform(np.eye(3), np.array([1.0, 2.0, 3.0])))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1 2 3", "3 fields"),
        ("2,0,0,0,0,0,0,1", "1 fields"),
        ("2 0 0 x 0 0 0 1", "'x'"),
        ("2 0 0 nan 0 0 0 1", "a value is not finite"),
        ("inf 0 0 0 0 0 0 1", "'inf' is not a time in seconds"),
        ("2 0 0 0 0 0 0 0", "the quaternion is zero"),
        ("1403715273262142976 0 0 0 0 0 0 1", "is it in nanoseconds, not seconds?"),
    ],
)
def test_a_bad_tum_line_is_named(line: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.tum"
    path.write_text(f"{_TUM_LINE}\n{line}\n", encoding="utf-8")
    with pytest.raises(DatasetError, match=r"bad\.tum, line 2: a TUM line has 8 numbers") as caught:
        read_tum(path)
    assert message in str(caught.value)


def test_a_tum_file_without_poses_or_out_of_order_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "empty.tum"
    path.write_text("# nothing\n", encoding="utf-8")
    with pytest.raises(TimestampError, match=r"empty\.tum holds no pose"):
        read_tum(path)
    path.write_text(f"{_TUM_LINE}\n{_TUM_LINE}\n", encoding="utf-8")
    with pytest.raises(TimestampError, match="strictly increase"):
        read_tum(path)


def test_a_missing_or_binary_tum_file_is_a_dataset_error(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"cannot read the trajectory .*none\.tum"):
        read_tum(tmp_path / "none.tum")
    (tmp_path / "binary.tum").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DatasetError, match=r"cannot read the trajectory"):
        read_tum(tmp_path / "binary.tum")
