# SPDX-License-Identifier: BSD-3-Clause
"""Comparing two commits: what counts as a difference, on made-up folders, and which package is run."""

import json
import subprocess
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.experiments import commit_cases, compare_commits
from coclo_vio.experiments.commit_cases import CaseRecord, Recordings, record

CASE = "sample_coclo"
COUNT = 20
VELOCITY = [f"velocity_world_{axis}" for axis in "xyz"]
COVARIANCE = [f"pose_covariance_{row}{column}" for row in range(6) for column in range(row, 6)]


def write_case(  # noqa: PLR0913 -- one call describes a case
    folder: Path,
    *,
    position: float = 0.0,
    angle: float = 0.0,
    first_digit: int = 0,
    covariance: float = 0.0,
    rows: slice = slice(None),
    name: str = "coclo",
    recording: str = "one",
    columns: tuple[str, ...] = (),
) -> None:
    """A case as ``record`` leaves it, the pose and state of row 7 changed by what is given."""
    case = folder / CASE
    case.mkdir(parents=True, exist_ok=True)
    (case / "case.json").write_text(json.dumps(asdict(CaseRecord(CASE, ("run",), "", recording, 0, 1.0, {}))))
    poses, states = [], [",".join(["stamp_ns", *VELOCITY, *COVARIANCE, *columns])]
    for row in range(COUNT):
        changed = row == 7
        half = 0.5 * (0.1 * row + angle * changed)
        place = 0.05 * row + position * changed
        poses.append(f"1700000000.{row:09d} {place:.12g} 2 0 0 0 {np.sin(half):.12g} {np.cos(half):.12g}")
        diagonal = {f"pose_covariance_{axis}{axis}": 4e-6 for axis in range(6)}
        diagonal["pose_covariance_03"] = 1e-9 + 4e-6 * covariance * changed
        speed = (123456789 + first_digit * changed) * 1e-9
        values = [speed, 0.0, 0.0, *(diagonal.get(entry, 0.0) for entry in COVARIANCE), *(0.5 for _ in columns)]
        states.append(f"{1700000000 * 10**9 + row}," + ",".join(f"{value:.9g}" for value in values))
    (case / f"{name}.tum").write_text("\n".join(poses[rows]) + "\n")
    (case / f"{name}_state.csv").write_text("\n".join([states[0], *states[1:][rows]]) + "\n")


def write_simulated(folder: Path, sha256: str) -> None:
    """The case of a simulated recording with these bytes."""
    (folder / "simulate").mkdir(parents=True, exist_ok=True)
    done = CaseRecord("simulate", ("simulate",), "", "", 0, 1.0, {"recording.mcap": sha256})
    (folder / "simulate" / "case.json").write_text(json.dumps(asdict(done)))


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    first, second = tmp_path / "first", tmp_path / "second"
    write_case(first)
    return first, second


def status(folders: tuple[Path, Path], *options: str) -> int:
    return compare_commits.main(["compare", str(folders[0]), str(folders[1]), *options])


def written(path: Path) -> list[dict[str, object]]:
    """The comparisons of the JSON file."""
    rows: list[dict[str, object]] = json.loads(path.read_text())["compared"]
    return rows


def test_equal_folders_agree(folders: tuple[Path, Path], tmp_path: Path) -> None:
    write_case(folders[1])
    assert status(folders, "--json", str(tmp_path / "out.json")) == 0
    (row,) = written(tmp_path / "out.json")
    assert row["poses"] == [COUNT, COUNT]
    assert row["largest"] == {"position_m": 0.0, "rotation_rad": 0.0, "velocity_mps": 0.0, "covariance": 0.0}


@pytest.mark.parametrize(
    ("change", "quantity", "size"),
    [
        ({"position": 1e-8}, "position_m", 1e-8),
        ({"angle": 1e-8}, "rotation_rad", 1e-8),
        ({"first_digit": 10}, "velocity_mps", 1e-8),
        ({"covariance": 1e-7}, "covariance", 1e-7),
    ],
)
def test_a_difference_is_found_and_measured(
    folders: tuple[Path, Path], tmp_path: Path, change: dict[str, float], quantity: str, size: float
) -> None:
    write_case(folders[1], **change)  # type: ignore[arg-type]
    assert status(folders, "--json", str(tmp_path / "out.json")) == 1
    (row,) = written(tmp_path / "out.json")
    largest, faults = row["largest"], row["faults"]
    assert isinstance(largest, dict)
    assert isinstance(faults, list)
    assert largest[quantity] == pytest.approx(size, rel=1e-3)
    assert all(value == 0.0 for name, value in largest.items() if name != quantity)
    assert [quantity in fault and "1700000000000000007 ns" in fault for fault in faults] == [True]


@pytest.mark.parametrize("change", [{"position": 5e-10}, {"angle": 5e-10}, {"first_digit": 1}, {"covariance": 5e-9}])
def test_a_difference_within_tolerance_or_the_last_digit_is_none(
    folders: tuple[Path, Path], change: dict[str, float]
) -> None:
    write_case(folders[1], **change)  # type: ignore[arg-type]
    assert status(folders) == 0


def test_a_larger_tolerance_is_used(folders: tuple[Path, Path]) -> None:
    write_case(folders[1], position=1e-8)
    assert status(folders, "--tolerance", "2e-8") == 0


def test_the_last_digit_of_a_far_position_is_no_difference(tmp_path: Path) -> None:
    """At 2 km twelve digits end at 1e-8 m."""
    folders = tmp_path / "first", tmp_path / "second"
    write_case(folders[0], position=2000.0)
    write_case(folders[1], position=2000.0 + 1e-8)
    assert status(folders) == 0
    write_case(folders[1], position=2000.0 + 4e-8)
    assert status(folders) == 1


@pytest.mark.parametrize(
    ("first_rows", "second_rows", "strict", "allowing"),
    [
        (slice(None), slice(0, 17), 1, 1),
        (slice(0, 17), slice(None), 1, 0),
        (slice(0, 17), slice(1, None), 1, 1),
        (slice(0, 5), slice(5, None), 1, 1),
    ],
    ids=["lost", "extra", "both", "disjoint"],
)
def test_only_extra_poses_of_the_second_can_be_allowed(
    tmp_path: Path, first_rows: slice, second_rows: slice, strict: int, allowing: int
) -> None:
    folders = tmp_path / "first", tmp_path / "second"
    write_case(folders[0], rows=first_rows)
    write_case(folders[1], rows=second_rows)
    assert status(folders) == strict
    assert status(folders, "--allow-extra", "--json", str(tmp_path / "out.json")) == allowing
    (row,) = written(tmp_path / "out.json")
    stamps = set(range(COUNT)[first_rows]), set(range(COUNT)[second_rows])
    assert row["only_in"] == [len(stamps[0] - stamps[1]), len(stamps[1] - stamps[0])]


def test_poses_are_compared_by_stamp_where_one_has_more(folders: tuple[Path, Path]) -> None:
    write_case(folders[0], rows=slice(0, 17))
    write_case(folders[1], position=1e-8)
    assert status(folders, "--allow-extra") == 1


def test_a_missing_estimator_is_a_difference(folders: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    write_case(folders[1])
    write_case(folders[0], name="vins")
    assert status(folders) == 1
    assert f"vins is only in {folders[0] / CASE}" in capsys.readouterr().out


def test_a_ground_truth_alone_is_no_comparison(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folders = tmp_path / "first", tmp_path / "second"
    for folder in folders:
        write_case(folder, name="groundtruth")
    assert status(folders) == 1
    assert "no estimate is in either folder" in capsys.readouterr().out


def test_a_stamp_that_occurs_twice_is_a_difference(
    folders: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    write_case(folders[1])
    poses = folders[1] / CASE / "coclo.tum"
    poses.write_text(poses.read_text() + poses.read_text().splitlines()[-1] + "\n")
    assert status(folders) == 1
    assert "coclo.tum has a stamp twice" in capsys.readouterr().out


def test_other_bytes_of_a_simulated_recording_are_a_difference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folders = tmp_path / "first", tmp_path / "second"
    for folder in folders:
        write_simulated(folder, "one")
    assert status(folders) == 0
    write_simulated(folders[1], "another")
    assert status(folders) == 1
    assert "recording.mcap has other bytes" in capsys.readouterr().out


def test_a_missing_case_is_a_difference(folders: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    folders[1].mkdir()
    assert status(folders) == 1
    assert f"the case is not in {folders[1]}" in capsys.readouterr().out


def test_a_missing_state_file_is_a_difference(folders: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    write_case(folders[1])
    (folders[1] / CASE / "coclo_state.csv").unlink()
    assert status(folders) == 1
    assert "only the first has a state file" in capsys.readouterr().out


def test_a_new_column_is_noted_and_a_lost_velocity_is_a_difference(
    folders: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    write_case(folders[1], columns=("leg1.contact_probability",))
    assert status(folders) == 0
    assert "columns that only one state file has: leg1.contact_probability" in capsys.readouterr().out
    states = folders[1] / CASE / "coclo_state.csv"
    states.write_text(states.read_text().replace("velocity_world_x", "speed_x"))
    assert status(folders) == 1
    assert "not in both state files: velocity_world_x" in capsys.readouterr().out


def test_another_recording_is_not_compared(folders: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    write_case(folders[1], recording="another")
    assert status(folders) == 1
    assert "the recordings differ" in capsys.readouterr().out


@pytest.mark.parametrize("value", ["nan", "inf"])
def test_a_value_that_is_not_finite_is_a_difference(folders: tuple[Path, Path], tmp_path: Path, value: str) -> None:
    write_case(folders[1])
    poses = folders[1] / CASE / "coclo.tum"
    poses.write_text(poses.read_text().replace(" 0.35 2 ", f" {value} 2 "))
    assert status(folders, "--json", str(tmp_path / "out.json")) == 1
    (row,) = written(tmp_path / "out.json")
    assert isinstance(row["largest"], dict)
    assert row["largest"]["position_m"] is None


def test_a_folder_without_a_case_is_refused(tmp_path: Path) -> None:
    (tmp_path / "first").mkdir()
    (tmp_path / "second").mkdir()
    with pytest.raises(SystemExit, match="no case is in"):
        status((tmp_path / "first", tmp_path / "second"))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, 3.0])
def test_the_angle_between_two_quaternions_is_exact_and_has_no_sign(angle: float) -> None:
    one = np.array([[0.0, 0.0, 0.0, 1.0]])
    two = np.array([[np.sin(angle / 2.0), 0.0, 0.0, np.cos(angle / 2.0)]])
    for other in (two, -two):
        assert compare_commits.rotation_between(one, other)[0] == pytest.approx(angle, rel=1e-12)


_COMMAND_LINE = """
import sys
from pathlib import Path

def main():
    if "{refused}" in " ".join(sys.argv):
        sys.exit(2)
    folder = Path(sys.argv[sys.argv.index("-o") + 1])
    (folder / "combined.tum").write_text("0.000000001 {place} 0 0 0 0 0 1\\n")
    (folder / "arguments.txt").write_text(" ".join(sys.argv[1:]))
    with (Path(__file__).parent.parent / "calls.txt").open("a") as calls:
        calls.write("called\\n")
"""


def make_checkout(folder: Path, *, refused: str = "refuses nothing", place: float = 0.0) -> Path:
    """A checkout whose package is a command line that writes one pose."""
    (folder / "coclo_vio").mkdir(parents=True, exist_ok=True)
    (folder / "coclo_vio" / "__init__.py").touch()
    (folder / "coclo_vio" / "cli.py").write_text(_COMMAND_LINE.format(refused=refused, place=place))
    (folder / "sample.mcap").write_bytes(b"a recording")
    return folder


def run_case(checkout: Path, output: Path) -> bool:
    recordings = Recordings(checkout / "sample.mcap", output / "recordings", None)
    return record(checkout, output, recordings, ["sample_combined_off"])


def call_count(checkout: Path) -> int:
    return len((checkout / "calls.txt").read_text().splitlines())


def test_the_package_of_the_checkout_is_run_and_a_finished_case_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    checkout, output = make_checkout(tmp_path / "checkout"), tmp_path / "out"
    assert run_case(checkout, output)
    assert (output / "sample_combined_off" / "combined.tum").is_file()
    assert run_case(checkout, output)
    assert call_count(checkout) == 1
    assert "combined 1" in capsys.readouterr().out
    make_checkout(checkout, place=1.0)
    assert run_case(checkout, output)
    assert call_count(checkout) == 2


def test_a_setting_is_tried_by_its_other_names(tmp_path: Path) -> None:
    checkout = make_checkout(tmp_path / "checkout", refused=commit_cases.FEEDBACK_KEYS[0])
    assert run_case(checkout, tmp_path / "out")
    arguments = (tmp_path / "out" / "sample_combined_off" / "arguments.txt").read_text()
    assert f"--set {commit_cases.FEEDBACK_KEYS[1]}=off" in arguments


def test_a_command_that_fails_is_reported_and_run_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    checkout = make_checkout(tmp_path / "checkout", refused="run")
    assert not run_case(checkout, tmp_path / "out")
    assert "status 2" in capsys.readouterr().out
    make_checkout(checkout)
    assert run_case(checkout, tmp_path / "out")


def test_a_folder_that_is_no_checkout_is_refused(tmp_path: Path) -> None:
    (tmp_path / "sample.mcap").touch()
    with pytest.raises(SystemExit, match="is no checkout"):
        run_case(tmp_path, tmp_path / "out")


def test_an_unknown_case_is_refused_with_the_names_there_are(tmp_path: Path) -> None:
    checkout = make_checkout(tmp_path / "checkout")
    with pytest.raises(SystemExit, match="no case is called nonsense; the cases are: sample_coclo, "):
        record(checkout, tmp_path / "out", Recordings(checkout / "sample.mcap", tmp_path, None), ["nonsense"])


def git(repository: Path, *arguments: str) -> str:
    identity = ("-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false")
    command = ["git", *identity, *arguments]
    return subprocess.run(command, cwd=repository, check=True, capture_output=True, text=True).stdout.strip()


@pytest.mark.parametrize(("place", "expected"), [(0.0, 0), (1e-8, 1)])
def test_two_commits_are_compared_in_one_step(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: float, expected: int
) -> None:
    """The second commit has another sample, which is not used, and puts its pose elsewhere."""
    repository = make_checkout(tmp_path / "repository")
    sample = repository / commit_cases.SAMPLE_IN_CHECKOUT
    sample.parent.mkdir(parents=True)
    git(repository, "init", "--quiet")
    for content, where in ((b"one", 0.0), (b"another", place)):
        sample.write_bytes(content)
        make_checkout(repository, place=where)
        git(repository, "add", ".")
        git(repository, "commit", "--quiet", "-m", "a commit")
    monkeypatch.chdir(repository)
    options = ["-o", str(tmp_path / "out"), "--only", "sample_coclo"]
    assert compare_commits.main(["commits", "HEAD~1", "HEAD", *options]) == expected
    assert (tmp_path / "out" / git(repository, "rev-parse", "--short=12", "HEAD") / "sample_coclo").is_dir()
    assert len(git(repository, "worktree", "list").splitlines()) == 1
