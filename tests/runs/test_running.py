# SPDX-License-Identifier: BSD-3-Clause
"""Modes over a short recording: what is in the run folder afterwards, also where one of them fails."""

import errno
import json
import re
import shutil
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from stand_in_modes import FAILS_AT_NS, FAILURE
from tiny_recordings import FILM_START_NS

from coclo_vio.datasets.read_ahead import THREAD_NAME
from coclo_vio.runs import line_file, run_folder, run_journal
from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.runs.observers import Observers
from coclo_vio.runs.output_logs import read_calibrations
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.run_folder import Existing
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.runs.running import Ending, run_modes
from coclo_vio.runs.stop_request import StopRequest
from coclo_vio.values import whole_files
from coclo_vio.values.errors import ConfigError, DatasetError, TopicNotFound
from coclo_vio.values.outputs import Estimate, Event, KeyframeHealth, Output

CONFIG = resolve("daisy")
END_NS = 3_000_000_000

pytestmark = pytest.mark.usefixtures("stand_ins")


def test_a_run_folder_has_all_that_the_design_lists(leg_log: Path, tmp_path: Path) -> None:
    record = run_modes(leg_log, ["naive", "naive_rolling"], CONFIG, tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        *("naive.tum", "naive_state.csv", "naive_rolling.tum", "naive_rolling_state.csv"),
        *("groundtruth.tum", "config.yaml", "run.json"),
    }
    assert run_folder.read_record(tmp_path / "out") == record
    assert list(record.estimators) == ["naive", "naive_rolling"]
    assert record.estimators["naive"].measurements == 3 * 301
    assert record.recording_ns == (0, END_NS)
    assert record.reader is not None
    assert record.reader.format == "leg log"
    assert resolve(None, tmp_path / "out" / "config.yaml") == CONFIG


@pytest.mark.parametrize("mode", ["naive", "failing"])
def test_a_thread_that_reads_ahead_changes_no_file_and_is_gone_afterwards(
    leg_log: Path, tmp_path: Path, mode: str
) -> None:
    written = []
    for reading_threads in (0, 1):
        folder = tmp_path / str(reading_threads)
        run_modes(leg_log, [mode], resolve("daisy", settings=[f"dataset.reading_threads={reading_threads}"]), folder)
        written.append({path.name: path.read_bytes() for path in folder.iterdir() if path.suffix in {".tum", ".csv"}})
    assert written[0] == written[1]
    assert len(written[0][f"{mode}.tum"]) > 1000
    assert THREAD_NAME not in {thread.name for thread in threading.enumerate()}


def test_a_visual_mode_runs_on_a_recording_without_a_robot(film: Path, tmp_path: Path) -> None:
    record = run_modes(film, ["resting"], resolve(), tmp_path)
    resting = record.estimators["resting"]
    assert (record.robot, resting.measurements, resting.estimates) == (None, 20, 20)
    assert resting.sensors == ("stereo",)
    assert {path.name for path in tmp_path.iterdir()} == {
        *("resting.tum", "resting_state.csv", "resting_keyframes.csv", "resting_calibration.csv"),
        *("groundtruth.tum", "config.yaml", "run.json"),
    }
    assert resolve(None, tmp_path / "config.yaml") == resolve()


def test_a_trajectory_of_a_visual_mode_covers_the_time_of_the_cameras(film: Path, tmp_path: Path) -> None:
    record = run_modes(film, ["resting"], resolve(), tmp_path)
    assert record.recording_ns == (FILM_START_NS, FILM_START_NS + 3_900_000_000)
    assert record.estimators["resting"].recording_ns == (FILM_START_NS, FILM_START_NS + 1_900_000_000)


def test_events_keyframes_and_calibration_of_a_run_are_recorded(film: Path, tmp_path: Path) -> None:
    run_modes(film, ["resting"], resolve(), tmp_path)
    resting = run_folder.read_record(tmp_path).estimators["resting"]
    last = {"time_s": 1.9, "stamp_ns": FILM_START_NS + 1_900_000_000, "kind": "vision_lost", "detail": "it is dark"}
    assert len(resting.events) == 20
    assert resting.events[-1].model_dump() == last
    assert resting.keyframes is not None
    assert resting.keyframes.count == 20
    assert resting.keyframes.compute_ms_p95 == pytest.approx(7.0)
    assert len((tmp_path / "resting_keyframes.csv").read_text(encoding="ascii").splitlines()) == 21
    assert resting.calibration is not None
    assert resting.calibration.stamp_ns == FILM_START_NS + 1_900_000_000
    assert resting.calibration.rotation_sigma_rad == pytest.approx((0.005, 0.005, 0.005))
    assert (resting.calibration.stereo_scale, resting.calibration.stereo_scale_sigma) == (1.02, 0.03)
    assert len(read_calibrations(tmp_path, "resting")) == 20
    assert resting.counts == {"frames": 20}


def test_pictures_are_written_on_request(film: Path, tmp_path: Path) -> None:
    record = run_modes(film, ["resting"], resolve(), tmp_path, observers=Observers(pictures_every=1))
    assert record.estimators["resting"].pictures == 20
    names = sorted(path.name for path in (tmp_path / "debug_images" / "resting").iterdir())
    assert names[0] == f"{FILM_START_NS}.jpg"
    assert len(names) == 20


def test_a_mode_without_images_writes_no_picture(leg_log: Path, tmp_path: Path) -> None:
    record = run_modes(leg_log, ["naive"], CONFIG, tmp_path, observers=Observers(pictures_every=1))
    assert record.estimators["naive"].pictures == 0
    assert not (tmp_path / "debug_images").exists()


def test_a_mode_that_lacks_what_it_needs_leaves_the_others_alone(film: Path, leg_log: Path, tmp_path: Path) -> None:
    record = run_modes(film, ["naive", "resting"], resolve(), tmp_path / "film")
    assert record.estimators["resting"].estimates == 20
    assert "has no joint, so there is no leg odometry" in (record.estimators["naive"].failure or "")
    record = run_modes(leg_log, ["naive", "resting"], CONFIG, tmp_path / "log")
    assert record.estimators["naive"].failure is None
    failure = record.estimators["resting"].failure or ""
    assert failure.endswith("has no stereo images; coclo-vio inspect lists what it has")


def test_where_no_mode_has_what_it_needs_nothing_is_written(film: Path, leg_log: Path, tmp_path: Path) -> None:
    with pytest.raises(TopicNotFound, match="has no joint, so there is no leg odometry"):
        run_modes(film, ["naive", "coclo"], resolve(), tmp_path / "out")
    with pytest.raises(TopicNotFound, match="has no stereo images; coclo-vio inspect"):
        run_modes(leg_log, ["resting"], CONFIG, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_same_run_gives_the_same_files(leg_log: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        run_modes(leg_log, ["naive"], CONFIG, tmp_path / name)
    for file in ("naive.tum", "naive_state.csv", "groundtruth.tum", "config.yaml"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_a_mode_that_fails_keeps_its_estimates_and_the_others_go_on(leg_log: Path, tmp_path: Path) -> None:
    run_modes(leg_log, ["failing", "naive_rolling"], CONFIG, tmp_path)
    record = run_folder.read_record(tmp_path)
    assert record.estimators["failing"].failure == FAILURE
    assert record.estimators["naive_rolling"].failure is None
    failed, whole = (run_folder.read_estimates(tmp_path, name).trajectory for name in ("failing", "naive_rolling"))
    assert failed.stamps_ns[-1] == FAILS_AT_NS - 10_000_000
    assert whole.stamps_ns[-1] == END_NS
    np.testing.assert_array_equal(failed.T_world_body, whole.T_world_body[: len(failed)])


def test_the_record_covers_the_whole_recording_where_every_mode_stopped_early(leg_log: Path, tmp_path: Path) -> None:
    assert run_modes(leg_log, ["failing"], CONFIG, tmp_path).recording_ns == (0, END_NS)


def test_an_estimate_of_an_undeclared_trajectory_stops_the_mode_and_names_the_declared_ones(
    film: Path, tmp_path: Path
) -> None:
    record = run_modes(film, ["undeclared", "resting"], resolve(), tmp_path)
    assert record.estimators["undeclared"].failure == (
        "the mode undeclared gave an estimate of 'elsewhere', but it declares undeclared; name the trajectory in the "
        "mode's declaration"
    )
    assert record.estimators["resting"].estimates == 20


def test_a_recording_that_breaks_is_a_failure_of_every_mode(leg_log: Path, tmp_path: Path) -> None:
    lines = (leg_log / "leg_log.csv").read_text(encoding="ascii").splitlines(keepends=True)
    lines[200] = lines[200].replace(",", ",oops,", 1)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "leg_log.csv").write_text("".join(lines), encoding="ascii")
    record = run_modes(tmp_path / "broken", ["naive", "naive_rolling"], CONFIG, tmp_path / "out")
    assert record.reader is None
    for trajectory in record.estimators.values():
        assert "line 201" in (trajectory.failure or "")
        assert trajectory.estimates > 100


def test_a_misspelt_mode_is_found_before_anything_runs(leg_log: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no mode 'naiv'"):
        run_modes(leg_log, ["naive", "naiv"], CONFIG, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_file_that_cannot_be_written_is_named(leg_log: Path, tmp_path: Path) -> None:
    (tmp_path / "naive.tum").mkdir()
    with pytest.raises(DatasetError, match=r"cannot write .*naive\.tum: .*directory; choose another folder$"):
        run_modes(leg_log, ["naive"], CONFIG, tmp_path)


def test_progress_gets_the_mode_and_the_stamps(leg_log: Path, tmp_path: Path) -> None:
    calls: list[tuple[str, int]] = []
    observers = Observers(progress=lambda name, stamp_ns: calls.append((name, stamp_ns)))
    run_modes(leg_log, ["naive"], CONFIG, tmp_path, observers=observers)
    assert calls[0] == ("naive", 0)
    assert calls[-1] == ("naive", END_NS)
    assert len(calls) == 903


def test_a_watch_gets_every_output_with_its_mode(film: Path, tmp_path: Path) -> None:
    seen: list[tuple[str, Output]] = []
    observers = Observers(watch=lambda name, output: seen.append((name, output)))
    run_modes(film, ["resting"], resolve(), tmp_path, observers=observers)
    assert {name for name, _ in seen} == {"resting"}
    for kind in (Estimate, Event, KeyframeHealth):
        assert sum(isinstance(output, kind) for _, output in seen) == 20


def test_a_recording_without_ground_truth_has_none_in_its_record(leg_log: Path, tmp_path: Path) -> None:
    (tmp_path / "log").mkdir()
    (tmp_path / "log" / "leg_log.csv").write_bytes((leg_log / "leg_log.csv").read_bytes())
    record = run_modes(tmp_path / "log", ["naive"], CONFIG, tmp_path / "out")
    assert record.ground_truth is None
    assert not (tmp_path / "out" / "groundtruth.tum").exists()


def test_the_written_configuration_is_plain_yaml(leg_log: Path, tmp_path: Path) -> None:
    run_modes(leg_log, ["naive"], CONFIG, tmp_path)
    values = yaml.safe_load((tmp_path / "config.yaml").read_text(encoding="utf-8"))
    assert values["robot"]["name"] == "daisy"
    assert values["filter"]["profile"] == CONFIG.filter.profile


def test_the_record_on_disk_is_json_with_its_schema_version(film: Path, tmp_path: Path) -> None:
    run_modes(film, ["resting"], resolve(), tmp_path)
    values = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    assert values["schema_version"] == RunRecord.model_fields["schema_version"].default
    assert values["dataset"] == str(film)


def test_a_second_run_into_a_folder_is_refused_with_the_choices(leg_log: Path, film: Path, tmp_path: Path) -> None:
    run_modes(film, ["resting"], resolve(), tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(DatasetError) as refused:
        run_modes(leg_log, ["naive"], CONFIG, tmp_path)
    assert str(refused.value) == (
        f"{tmp_path} holds the results of an earlier run (run.json), which would be overwritten; give --overwrite to "
        "replace them, --resume to go on with that run, or another folder with -o"
    )
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_second_run_that_may_overwrite_replaces_the_first(leg_log: Path, film: Path, tmp_path: Path) -> None:
    run_modes(film, ["resting"], resolve(), tmp_path, observers=Observers(pictures_every=1))
    run_modes(leg_log, ["naive"], CONFIG, tmp_path, ending=Ending(Existing.OVERWRITE))
    files = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert files == {"naive.tum", "naive_state.csv", "groundtruth.tum", "config.yaml", "run.json"}


def test_results_never_go_into_the_recordings_own_folder(leg_log: Path, tmp_path: Path) -> None:
    copied = tmp_path / "walk"
    shutil.copytree(leg_log, copied)
    before = {path.name: path.read_bytes() for path in copied.iterdir()}
    for recording in (copied, copied / "leg_log.csv"):
        with pytest.raises(DatasetError, match=r"is the folder of the recording itself, .*; choose another folder for"):
            run_modes(recording, ["naive"], CONFIG, copied)
    assert {path.name: path.read_bytes() for path in copied.iterdir()} == before


def test_results_may_go_beside_a_recording_of_one_file(leg_log: Path, tmp_path: Path) -> None:
    shutil.copy(leg_log / "leg_log.csv", tmp_path)
    for _ in range(2):
        run_modes(tmp_path / "leg_log.csv", ["naive"], CONFIG, tmp_path, ending=Ending(Existing.OVERWRITE))
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"leg_log.csv", "naive.tum", "naive_state.csv", "config.yaml", "run.json"}


def test_the_record_is_there_from_the_start_and_renewed(
    leg_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_journal, "_EVERY_S", 0.0)
    seen: list[RunRecord] = []
    run_modes(
        leg_log,
        ["naive"],
        CONFIG,
        tmp_path,
        observers=Observers(progress=lambda name, stamp_ns: seen.append(RunRecord.read(tmp_path / "run.json"))),
    )
    assert {record.status for record in seen} == {"running"}
    assert {record.estimators["naive"].status for record in seen} == {"running"}
    assert [record.estimators["naive"].measurements for record in seen] == list(range(1, 904))
    ended = RunRecord.read(tmp_path / "run.json")
    assert (ended.status, ended.estimators["naive"].status) == ("finished", "finished")
    assert ended.estimators["naive"].last_ns == END_NS
    assert seen[0].updated is not None
    assert ended.updated is not None
    assert seen[0].updated <= ended.updated


def test_a_run_that_is_asked_to_stop_does_between_two_measurements_and_says_so(leg_log: Path, tmp_path: Path) -> None:
    stop = StopRequest()

    def progress(name: str, stamp_ns: int) -> None:
        assert stop.is_polled
        if stamp_ns >= 1_000_000_000:
            stop.request()

    ending = Ending(stop=stop)
    observers = Observers(progress=progress)
    record = run_modes(leg_log, ["naive", "naive_rolling"], CONFIG, tmp_path, observers=observers, ending=ending)
    assert not stop.is_polled
    assert record == run_folder.read_record(tmp_path)
    assert (record.status, list(record.estimators)) == ("interrupted", ["naive"])
    naive = record.estimators["naive"]
    assert (naive.status, naive.failure, naive.measurements) == ("interrupted", None, 301)
    found = run_folder.read_estimates(tmp_path, "naive")
    assert found.trajectory.stamps_ns[-1] == naive.last_ns == 990_000_000
    assert (len(found.trajectory), found.notes) == (naive.estimates, ())


@pytest.mark.parametrize(
    ("error", "status"), [(KeyboardInterrupt(), "interrupted"), (RuntimeError("it broke"), "failed")]
)
def test_a_run_that_is_interrupted_leaves_whole_files_and_says_so(
    error: BaseException, status: str, leg_log: Path, tmp_path: Path
) -> None:
    def progress(name: str, stamp_ns: int) -> None:
        if stamp_ns >= 1_000_000_000:
            raise error

    with pytest.raises(type(error)):
        run_modes(leg_log, ["naive"], CONFIG, tmp_path, observers=Observers(progress=progress))
    record = run_folder.read_record(tmp_path)
    naive = record.estimators["naive"]
    assert (record.status, naive.status) == (status, "interrupted")
    assert record.failure == (None if status == "interrupted" else "RuntimeError: it broke")
    found = run_folder.read_estimates(tmp_path, "naive")
    assert naive.last_ns == found.trajectory.stamps_ns[-1]
    assert 980_000_000 <= naive.last_ns <= 1_000_000_000


def _full_after(monkeypatch: pytest.MonkeyPatch, budget: int) -> None:
    """The disk is full after so many bytes of lines; JSON files cannot be replaced from then on."""
    written = 0
    append, replace = line_file.LineFile.append, whole_files.write_whole

    class Full:
        def __init__(self, out: Any) -> None:
            self._out = out

        def __getattr__(self, name: str) -> Any:
            return getattr(self._out, name)

        def write(self, data: bytes) -> int:
            nonlocal written
            if written >= budget:
                raise OSError(errno.ENOSPC, "No space left on device")
            part = data[: budget - written]
            written += len(part)
            return int(self._out.write(part))

    def limited(self: line_file.LineFile, lines: Any) -> None:
        if not isinstance(self._out, Full):
            self._out = Full(self._out)  # type: ignore[assignment]
        append(self, lines)

    def no_room(path: Path, content: str | bytes) -> None:
        if written >= budget:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        replace(path, content)

    monkeypatch.setattr(line_file.LineFile, "append", limited)
    monkeypatch.setattr("coclo_vio.values.record.write_whole", no_room)


@pytest.mark.parametrize("budget", [1, 700, 40_000, 40_111])
def test_a_full_disk_is_one_sentence_and_what_was_written_can_be_evaluated(
    budget: int, leg_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _full_after(monkeypatch, budget)
    with pytest.raises(DatasetError) as full:
        run_modes(leg_log, ["naive"], CONFIG, tmp_path)
    message = str(full.value)
    assert message.startswith(f"cannot write {tmp_path}/naive")
    assert message.endswith(
        ": No space left on device; what was written before stays: make room and go on with --resume, or choose "
        "another folder"
    )
    for path in tmp_path.iterdir():
        assert path.suffix not in {".tum", ".csv"} or path.read_bytes()[-1:] in {b"\n", b""}, "a line was cut"
        assert path.suffix != ".part"
    evaluations, failures = evaluate_run(tmp_path, CONFIG.evaluation)
    if budget < 1000:
        assert set(failures) == {"naive"}
    else:
        notes = " ".join(evaluations["naive"].notes)
        assert re.search(r"the run of naive was killed, or is still going on: its estimates end \d\.\d\d s", notes)
