# SPDX-License-Identifier: BSD-3-Clause
"""The contract of the command line: status, what goes to which stream, one sentence for what a user can correct."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from console import Answer, Coclo, is_one_sentence

from coclo_vio import __version__
from coclo_vio.api import run as api_run
from coclo_vio.robot.description import robot_names
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.run_record import RunRecord, TrajectoryRecord

CONTRACT_KEYS = {
    *("ate_m", "rpe_1m_percent", "drift_percent", "paper_drift_percent", "velocity_rmse_mps", "yaw_drift_deg"),
    *("path_length_m", "path_length_ratio", "coverage", "anees_pose", "realtime_factor"),
}


@pytest.fixture
def run_out(coclo: Coclo, leg_log: Path, tmp_path: Path) -> Path:
    assert coclo("run", leg_log, "-m", "naive", "-o", "out").status == 0
    return tmp_path / "out"


def test_the_console_script_prints_its_version() -> None:
    script = Path(sys.executable).with_name("coclo-vio")
    done = subprocess.run([script, "--version"], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == (f"{__version__}\n", "")


def test_run_prints_the_drift(coclo: Coclo, leg_log: Path) -> None:
    answer = coclo("run", leg_log, "-m", "naive")
    assert answer.status == 0
    assert "naive" in answer.out
    assert "drift" in answer.out
    assert max(map(len, answer.out.splitlines())) <= 80
    assert "robot daisy; results in out" in answer.err


def test_a_mode_of_two_trajectories_without_any_estimate_is_one_sentence(
    coclo: Coclo, leg_log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    empty = TrajectoryRecord(
        mode="combined",
        sensors=(),
        measurements=7,
        estimates=0,
        compute_s=0.0,
        realtime_factor=None,
        counts={},
        events=(),
        keyframes=None,
        calibration=None,
        pictures=0,
        recording_ns=None,
        failure=None,
    )
    record = RunRecord(
        version=__version__,
        dataset="walk",
        robot="daisy",
        imu_calibration="robot",
        ground_truth=None,
        faults=None,
        estimators={"combined_coclo": empty, "combined_vins": empty},
    )
    monkeypatch.setattr(api_run, "run_modes", lambda *_, **__: record)
    answer = coclo("run", leg_log, "-m", "combined")
    assert (answer.status, answer.out) == (1, "")
    assert "combined gave no estimate for the 7 measurements of " in answer.err


def test_run_writes_its_result_as_a_bag(coclo: Coclo, leg_log: Path, tmp_path: Path) -> None:
    answer = coclo("run", leg_log, "-m", "naive", "--bag", "result.mcap")
    assert answer.status == 0
    assert "bag: result.mcap" in answer.out
    assert (tmp_path / "result.mcap").read_bytes().startswith(b"\x89MCAP")
    again = coclo("run", leg_log, "-m", "naive", "--bag", "result.mcap", "-o", "elsewhere")
    assert (again.status, again.out) == (1, "")
    assert "result.mcap exists already; delete it" in again.err
    assert not (tmp_path / "elsewhere").exists()


def test_json_is_one_object_per_estimator_and_nothing_else(coclo: Coclo, run_out: Path) -> None:
    answer = coclo("evaluate", run_out, "--json")
    assert answer.status == 0
    values = json.loads(answer.out)
    assert set(values) == {"naive"}
    assert set(values["naive"]) >= CONTRACT_KEYS
    assert 0.8 < values["naive"]["coverage"] <= 1.0
    assert values["naive"]["notes"]


@pytest.mark.long
def test_json_stays_json_in_a_pipe_where_colour_is_forced(run_out: Path) -> None:
    """Long notes are not folded, keys not coloured, though the terminal is narrow and colour is forced."""
    environment = {**os.environ, "FORCE_COLOR": "1", "COLUMNS": "40", "TTY_COMPATIBLE": "1"}
    command = [sys.executable, "-c", "from coclo_vio.cli import main; main()", "evaluate", str(run_out), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    values = json.loads(done.stdout)
    assert set(values["naive"]) >= CONTRACT_KEYS
    assert max(map(len, values["naive"]["notes"])) > 40


def test_the_printed_configuration_is_a_configuration_file(coclo: Coclo, tmp_path: Path) -> None:
    first = coclo("config", "-r", "go1", "--set", "filter.profile=paper")
    assert (first.status, first.err) == (0, "")
    (tmp_path / "mine.yaml").write_text(first.out, encoding="utf-8")
    assert coclo("config", "-c", "mine.yaml").out == first.out
    assert resolve(None, tmp_path / "mine.yaml") == resolve("go1", settings=["filter.profile=paper"])


def test_inspect_lists_what_is_there_and_what_is_missing(coclo: Coclo, leg_log: Path) -> None:
    answer = coclo("inspect", leg_log)
    assert (answer.status, answer.err) == (0, "")
    assert "walk: leg log" in answer.out
    assert "all 18 joints found, with torques" in answer.out
    assert max(map(len, answer.out.splitlines())) <= 80
    listed = json.loads(coclo("inspect", leg_log, "--json").out)
    assert listed["robot"] == "daisy"
    assert listed["modes"]["coclo"] == {"ready": True, "missing": []}
    assert listed["modes"]["stereo"] == {"ready": False, "missing": ["stereo images", "calibration of the cameras"]}


def test_robots_lists_them_all(coclo: Coclo) -> None:
    answer = coclo("robots")
    assert answer.status == 0
    assert [name for name in robot_names() if name not in answer.out] == []


@pytest.mark.long
def test_benchmark_gives_figures_as_json(coclo: Coclo, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "7")  # restored afterwards; the command sets its own
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(name, "7")
    answer = coclo("benchmark", "--json", "--seconds", 2, "--rounds", 1, "--vision-seconds", 1)
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"
    assert answer.status == 0
    figures = json.loads(answer.out)
    assert {"filter_cycles_per_s", "filter_vs_filterpy", "realtime_factor", "peak_rss_mb"} <= set(figures)
    assert {"frontend_ms_median", "frontend_ms_p95", "smoother_ms_median", "smoother_ms_p95"} <= set(figures)
    assert figures["filter_cycles_per_s"] > 0.0
    assert figures["filter_vs_filterpy"] is None or figures["filter_vs_filterpy"] > 0.0
    assert figures["vision_ms_per_frame"] > 0.0
    assert figures["peak_rss_mb"] > 20.0


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["run", "nowhere"], 1, "nowhere does not exist; pass the path of a recording"),
        (["run", "{leg_log}", "-r", "go1"], 1, "FL_hip"),
        (["inspect", "nowhere"], 1, "nowhere does not exist; pass the path of a recording"),
        (["inspect", "{leg_log}", "-r", "spot"], 2, "no robot 'spot'; the known robots are: "),
        (["run", "{leg_log}", "-r", "spot"], 2, "no robot 'spot'; the known robots are: "),
        (["run", "{leg_log}", "-m", "cocolo"], 2, "no mode 'cocolo'; the modes are: coclo"),
        (["run", "{leg_log}", "--set", "filter.profil=paper"], 2, "there is no filter.profil; the keys there are: "),
        (["run", "{leg_log}", "-c", "bad.yaml"], 2, "bad.yaml is not YAML"),
        (["run", "{leg_log}", "-c", "none.yaml"], 2, "cannot read the configuration none.yaml"),
        (["run", "{leg_log}", "-o", "bad.yaml/out"], 1, "cannot make the folder bad.yaml/out"),
        (["compare", "{leg_log}", "--modes", " , "], 2, "--modes names no mode; there are: coclo"),
        (["compare", "{leg_log}", "--modes", "cocolo"], 2, "no mode 'cocolo'; the modes are: coclo"),
        (
            ["compare", "{leg_log}", "nowhere", "--modes", "naive"],
            1,
            "nowhere does not exist; pass the path of a recording",
        ),
        (["evaluate", "{leg_log}/groundtruth.tum"], 1, "give one with --vicon FILE"),
        (["evaluate", "missing.tum"], 1, "missing.tum"),
        (["evaluate", "{leg_log}"], 1, "no run folder: it has no run.json"),
        (["evaluate", "{leg_log}/groundtruth.tum", "--vicon", "gone.tum"], 1, "gone.tum"),
        (["evaluate", "nan.tum", "--vicon", "{leg_log}/groundtruth.tum"], 1, "nan.tum, line 1"),
    ],
)
def test_an_error_that_a_user_can_correct_is_one_sentence(
    arguments: list[str], status: int, words: str, coclo: Coclo, leg_log: Path, tmp_path: Path
) -> None:
    (tmp_path / "bad.yaml").write_text("filter: [1, 2", encoding="utf-8")
    (tmp_path / "nan.tum").write_text("0.0 nan 0 0 0 0 0 1\n0.1 0 0 0 0 0 0 1\n", encoding="utf-8")
    answer = coclo(*(argument.format(leg_log=leg_log) for argument in arguments))
    assert answer.status == status
    assert answer.out == ""
    assert words in answer.err
    assert is_one_sentence(answer)


@pytest.mark.long
def test_the_process_itself_shows_no_traceback(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "from coclo_vio.cli import main; main()", "run", str(tmp_path / "nowhere")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert is_one_sentence(Answer(done.returncode, done.stdout, done.stderr))


@pytest.mark.parametrize("arguments", [["run"], ["walk"], ["run", "--depth", "3"], ["benchmark", "--seconds", "0"]])
def test_wrong_usage_is_status_2(arguments: list[str], coclo: Coclo) -> None:
    answer = coclo(*arguments)
    assert answer.status == 2
    assert "Usage" in answer.err


@pytest.mark.parametrize(
    ("file", "content"),
    [("run.json", '{"estimators": {"naive"'), ("run.json", '{"estimators": 3}'), ("groundtruth.tum", "1 2 3\n")],
)
def test_a_malformed_file_in_a_run_folder_is_one_sentence(file: str, content: str, coclo: Coclo, run_out: Path) -> None:
    (run_out / file).write_text(content, encoding="utf-8")
    answer = coclo("evaluate", run_out, "--json")
    assert (answer.status, answer.out) == (1, "")
    assert file in answer.err
    assert is_one_sentence(answer)


def test_a_trajectory_with_a_malformed_state_file_is_left_out(coclo: Coclo, run_out: Path) -> None:
    path = run_out / "naive_state.csv"
    path.write_text(path.read_text(encoding="utf-8")[:-20] + "\n", encoding="utf-8")
    answer = coclo("evaluate", run_out, "--json")
    assert answer.status == 1
    assert json.loads(answer.out) == {}
    assert "naive_state.csv, line " in answer.err
    assert "Traceback" not in answer.err


def test_a_run_without_ground_truth_can_be_evaluated_with_one(coclo: Coclo, leg_log: Path, tmp_path: Path) -> None:
    (tmp_path / "bare").mkdir()
    (tmp_path / "bare" / "leg_log.csv").write_bytes((leg_log / "leg_log.csv").read_bytes())
    assert coclo("run", "bare", "-m", "naive").status == 0
    refused = coclo("evaluate", "out")
    assert refused.status == 1
    assert is_one_sentence(refused)
    assert "--vicon FILE" in refused.err
    given = coclo("evaluate", "out", "--vicon", leg_log / "groundtruth.tum", "--json")
    assert given.status == 0
    assert set(json.loads(given.out)["naive"]) >= CONTRACT_KEYS


def test_a_recording_that_breaks_off_keeps_its_estimates_and_is_status_1(
    coclo: Coclo, leg_log: Path, tmp_path: Path
) -> None:
    lines = (leg_log / "leg_log.csv").read_text(encoding="ascii").splitlines(keepends=True)
    lines[250] = lines[250].replace(",", ",oops,", 1)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "leg_log.csv").write_text("".join(lines), encoding="ascii")
    answer = coclo("run", "broken", "-m", "naive")
    assert answer.status == 1
    assert "the run stopped early, its estimates up to there are in out: " in answer.err
    assert "line 251" in answer.err
    run = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))
    assert "line 251" in run["estimators"]["naive"]["failure"]
    assert len((tmp_path / "out" / "naive.tum").read_text(encoding="ascii").splitlines()) > 150


def test_names_that_look_like_markup_are_printed_as_they_are(coclo: Coclo, leg_log: Path, tmp_path: Path) -> None:
    odd = tmp_path / "walk [red]x"
    odd.mkdir()
    for file in leg_log.iterdir():
        (odd / file.name).write_bytes(file.read_bytes())
    answer = coclo("run", odd, "-m", "naive", "-o", "out [bold]y")
    assert answer.status == 0
    assert "results in out [bold]y" in answer.err
    assert "walk [red]x, daisy" in answer.out
    assert "out [bold]y" in coclo("evaluate", "out [bold]y").out


def test_stamps_are_written_to_the_nanosecond(coclo: Coclo, run_out: Path) -> None:
    stamps = [line.split()[0] for line in (run_out / "naive.tum").read_text(encoding="ascii").splitlines()]
    assert {len(stamp.partition(".")[2]) for stamp in stamps} == {9}
    assert stamps[-1] == "3.000000000"


def test_the_configuration_of_a_run_repeats_it(coclo: Coclo, leg_log: Path, run_out: Path, tmp_path: Path) -> None:
    assert coclo("run", leg_log, "-m", "naive", "-c", run_out / "config.yaml", "-o", "again").status == 0
    for file in ("naive.tum", "naive_state.csv", "config.yaml"):
        assert (tmp_path / "again" / file).read_bytes() == (run_out / file).read_bytes()
    assert yaml.safe_load((run_out / "config.yaml").read_text(encoding="utf-8"))["robot"]["name"] == "daisy"
