# SPDX-License-Identifier: BSD-3-Clause
"""A short walk through several estimators: what is on disk afterwards, also when one of them fails."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
import yaml

from coclo_vio.datasets import images
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.writer import write_euroc_folder, write_leg_log
from coclo_vio.evaluation.evaluate import EvaluationConfig
from coclo_vio.filter.naive import NaiveLegOdometry
from coclo_vio.geometry import se3
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs import comparison, estimators, run_folder
from coclo_vio.runs.comparison_report import told_events
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.estimators import EstimatorKind
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
from coclo_vio.values.arrays import ByteImage
from coclo_vio.values.calibration import CameraCalibration, StereoCalibration, matrix4
from coclo_vio.values.errors import ConfigError, DatasetError, EvaluationError, FilterError, TopicNotFound
from coclo_vio.values.estimates import NavState, StateEstimate
from coclo_vio.values.measurements import LEG_SENSORS, EncodedStereoFrame, ImuSample, Measurement, StereoFrame
from coclo_vio.values.outputs import Estimator, Event, KeyframeHealth
from coclo_vio.values.trajectory import GroundTruth, Trajectory, write_tum

CONFIG = resolve("daisy")
FAILS_AT_NS = 1_500_000_000
END_NS = 3_000_000_000
START_NS = 1_700_000_000_000_000_000
MESSAGE = "the feet went missing; look for them"


class Failing:
    """The naive estimator until half of the way."""

    def __init__(self, robot: RobotModel, config: RunConfig) -> None:
        self._naive = NaiveLegOdometry(robot, config.filter, rolls_feet=True, weighs_load=False)

    @property
    def counts(self) -> Mapping[str, int]:
        return self._naive.counts

    def push(self, measurement: Measurement) -> StateEstimate | None:
        if measurement.stamp_ns >= FAILS_AT_NS:
            raise FilterError(MESSAGE)
        return self._naive.push(measurement)


def _failing(equipment: Equipment, config: RunConfig) -> Estimator:
    return Failing(equipment.legs(), config)


class Watching:
    """Looks at frames, has something to tell at each, and says that the body stays where it is."""

    def __init__(self) -> None:
        self._news: list[Event] = []
        self._health: list[KeyframeHealth] = []
        self._show: tuple[int, Callable[[int, ByteImage], None]] | None = None

    @property
    def counts(self) -> Mapping[str, int]:
        return {}

    def push(self, measurement: Measurement) -> StateEstimate | None:
        if not isinstance(measurement, StereoFrame):
            return None
        stamp_ns = measurement.stamp_ns
        self._news.append(Event(stamp_ns, "blind", "it is dark"))
        self._health.append(KeyframeHealth(stamp_ns, 1, 20, 30, 40, 0.5, 6, 0.007, 8.0))
        if self._show is not None:
            self._show[1](stamp_ns, np.zeros((4, 8, 3), dtype=np.uint8))
        return StateEstimate(stamp_ns, NavState(np.eye(4), *(np.zeros(3) for _ in range(4))), np.eye(9))

    def take_events(self) -> tuple[Event, ...]:
        taken, self._news = tuple(self._news), []
        return taken

    def take_health(self) -> tuple[KeyframeHealth, ...]:
        taken, self._health = tuple(self._health), []
        return taken

    def show(self, every: int, take: Callable[[int, ByteImage], None]) -> None:
        self._show = every, take


def _watching(equipment: Equipment, config: RunConfig) -> Estimator:
    assert equipment.robot is None
    equipment.cameras()
    return Watching()


@pytest.fixture(autouse=True)
def _failing_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    kinds = {
        **estimators.ESTIMATORS,
        "failing": EstimatorKind("fails half-way", LEG_SENSORS, _failing),
        "watching": EstimatorKind("watches", frozenset({StereoFrame}), _watching),
    }
    monkeypatch.setattr(estimators, "ESTIMATORS", kinds)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds of a Daisy that stands and walks, with ground truth."""
    robot = load_robot("daisy")
    body = BodyMotionConfig(rest_s=0.8, walk_s=2.0, stop_s=0.2, ramp_s=0.4)
    trial = generate(AnalyticTrialConfig(body=body), RobotModel(robot), seed=12)
    folder = tmp_path_factory.mktemp("walk")
    write_leg_log(folder, robot, trial.measurements, GroundTruth(trial.truth, True, "truth"))
    return folder


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds of dark pictures, four of an IMU and of a body that stays where it is; no robot."""
    lens = CameraCalibration(width_px=8, height_px=6, focal_px=(5.0, 5.0), principal_point_px=(3.5, 2.5))
    T_body_right = se3.transform(np.eye(3), np.array([0.05, 0.0, 0.0]))
    mountings = {"body_left_camera": matrix4(np.eye(4)), "body_right_camera": matrix4(T_body_right)}
    data = images.encoded(np.zeros((6, 8), dtype=np.uint8), "png")
    stamps_ns = range(START_NS, START_NS + 4_000_000_000, 100_000_000)
    still = Trajectory(np.array(stamps_ns), np.tile(np.eye(4), (len(stamps_ns), 1, 1)))
    contents = RecordingContents(
        load_robot("daisy"),
        [ImuSample(stamp_ns, np.zeros(3), np.array([0.0, 0.0, 9.81])) for stamp_ns in stamps_ns],
        ground_truth=GroundTruth(still, True, "truth"),
        stereo=StereoCalibration(left=lens, right=lens, **mountings),
        frames=[EncodedStereoFrame(stamp_ns, data, data, "png") for stamp_ns in stamps_ns[:20]],
    )
    folder = tmp_path_factory.mktemp("film")
    write_euroc_folder(folder, contents)
    return folder


def test_a_recording_without_a_robot_is_run_by_sight(film: Path, tmp_path: Path) -> None:
    told = comparison.run_all(film, ["watching"], resolve(), tmp_path)
    watching = told["estimators"]["watching"]
    assert (told["robot"], watching["measurements"], watching["estimates"]) == (None, 20, 20)
    assert {path.name for path in tmp_path.iterdir()} == {
        *("watching.tum", "watching_state.csv", "watching_keyframes.csv"),
        *("groundtruth.tum", "config.yaml", "run.json"),
    }
    assert resolve(None, tmp_path / "config.yaml") == resolve()
    evaluations, failures = comparison.evaluate_run(tmp_path, EvaluationConfig())
    assert failures == {}
    assert evaluations["watching"].ate_m == pytest.approx(0.0, abs=1e-9)


def test_an_estimator_that_sees_answers_for_the_time_of_the_cameras(film: Path, tmp_path: Path) -> None:
    told = comparison.run_all(film, ["watching"], resolve(), tmp_path)
    assert told["recording_ns"] == (START_NS, START_NS + 3_900_000_000)
    evaluations, _ = comparison.evaluate_run(tmp_path, EvaluationConfig())
    assert evaluations["watching"].coverage == pytest.approx(1.0)
    assert evaluations["watching"].alignment == "se3", "nothing told it where up is"


def test_events_and_keyframes_of_a_run_are_told(film: Path, tmp_path: Path) -> None:
    comparison.run_all(film, ["watching"], resolve(), tmp_path)
    watching = run_folder.read_run_json(tmp_path)["estimators"]["watching"]
    last = {"time_s": 1.9, "stamp_ns": START_NS + 1_900_000_000, "kind": "blind", "detail": "it is dark"}
    assert len(watching["events"]) == 20
    assert watching["events"][-1] == last
    assert watching["keyframes"]["count"] == 20
    assert watching["keyframes"]["compute_ms_p95"] == pytest.approx(7.0)
    assert len((tmp_path / "watching_keyframes.csv").read_text(encoding="ascii").splitlines()) == 21


def test_pictures_are_drawn_where_they_are_asked_for(film: Path, tmp_path: Path) -> None:
    told = comparison.run_all(film, ["watching"], resolve(), tmp_path, pictures_every=1)
    assert told["estimators"]["watching"]["pictures"] == 20
    names = sorted(path.name for path in (tmp_path / "debug_images" / "watching").iterdir())
    assert names[0] == f"{START_NS}.jpg"
    assert len(names) == 20


def test_a_comparison_shows_how_the_smoother_fared(film: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    comparison.run_all(film, ["watching"], resolve(), tmp_path)
    evaluations, _ = comparison.evaluate_run(tmp_path, EvaluationConfig())
    report = comparison.write_comparison(tmp_path, "film", evaluations, resolve())
    assert (tmp_path / "figures" / "keyframes.png").stat().st_size > 1000
    assert 'alt="keyframes"' in report.read_text(encoding="utf-8")


def test_a_mode_without_images_draws_nothing(log: Path, tmp_path: Path) -> None:
    told = comparison.run_all(log, ["naive"], CONFIG, tmp_path, pictures_every=1)
    assert told["estimators"]["naive"]["pictures"] == 0
    assert not (tmp_path / "debug_images").exists()


def test_a_mode_that_lacks_what_it_needs_leaves_the_others_alone(film: Path, log: Path, tmp_path: Path) -> None:
    told = comparison.run_all(film, ["naive", "watching"], resolve(), tmp_path / "film")
    assert told["estimators"]["watching"]["estimates"] == 20
    assert "has no joint, so no leg can be followed" in told["estimators"]["naive"]["failure"]
    evaluations, failures = comparison.evaluate_run(tmp_path / "film", EvaluationConfig())
    assert (set(evaluations), set(failures)) == ({"watching"}, {"naive"})
    told = comparison.run_all(log, ["naive", "watching"], CONFIG, tmp_path / "log")
    assert told["estimators"]["naive"]["failure"] is None
    assert "no stereo images to see with" in told["estimators"]["watching"]["failure"]


def test_where_no_mode_has_what_it_needs_nothing_is_written(film: Path, log: Path, tmp_path: Path) -> None:
    with pytest.raises(TopicNotFound, match="has no joint, so no leg can be followed"):
        comparison.run_all(film, ["naive", "coclo"], resolve(), tmp_path / "out")
    with pytest.raises(TopicNotFound, match="no stereo images to see with"):
        comparison.run_all(log, ["watching"], CONFIG, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_run_folder_has_all_that_the_design_says(log: Path, tmp_path: Path) -> None:
    told = comparison.run_all(log, ["naive", "naive_rolling"], CONFIG, tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        *("naive.tum", "naive_state.csv", "naive_rolling.tum", "naive_rolling_state.csv"),
        *("groundtruth.tum", "config.yaml", "run.json"),
    }
    on_disk = run_folder.read_run_json(tmp_path / "out")
    assert on_disk == json.loads(json.dumps(told))
    assert set(on_disk["estimators"]) == {"naive", "naive_rolling"}
    assert on_disk["estimators"]["naive"]["measurements"] == 3 * 301
    assert on_disk["recording_ns"] == [0, END_NS]
    assert on_disk["reader"]["format"] == "leg log"
    assert resolve(None, tmp_path / "out" / "config.yaml") == CONFIG


def test_the_same_run_gives_the_same_files(log: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        comparison.run_all(log, ["naive"], CONFIG, tmp_path / name)
    for file in ("naive.tum", "naive_state.csv", "groundtruth.tum", "config.yaml"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_an_estimator_that_fails_leaves_what_it_had_and_the_others_go_on(log: Path, tmp_path: Path) -> None:
    comparison.run_all(log, ["failing", "naive_rolling"], CONFIG, tmp_path)
    run = run_folder.read_run_json(tmp_path)
    assert run["estimators"]["failing"]["failure"] == MESSAGE
    assert run["estimators"]["naive_rolling"]["failure"] is None
    failed, whole = (run_folder.read_estimates(tmp_path, name).trajectory for name in ("failing", "naive_rolling"))
    assert failed.stamps_ns[-1] == FAILS_AT_NS - 10_000_000
    assert whole.stamps_ns[-1] == END_NS
    np.testing.assert_array_equal(failed.T_world_body, whole.T_world_body[: len(failed)])


def test_half_a_run_covers_half(log: Path, tmp_path: Path) -> None:
    """Also where no estimator saw the rest of the recording."""
    comparison.run_all(log, ["failing"], CONFIG, tmp_path)
    assert run_folder.read_run_json(tmp_path)["recording_ns"] == [0, END_NS]
    evaluations, failures = comparison.evaluate_run(tmp_path, CONFIG.evaluation)
    assert failures == {}
    coverage = evaluations["failing"].coverage
    assert coverage is not None
    assert coverage < 0.5


def test_an_estimator_without_any_estimate_says_why(log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(f"{__name__}.FAILS_AT_NS", 0)
    comparison.run_all(log, ["failing", "naive"], CONFIG, tmp_path)
    evaluations, failures = comparison.evaluate_run(tmp_path, CONFIG.evaluation)
    assert set(evaluations) == {"naive"}
    assert failures == {"failing": MESSAGE}


def test_a_recording_that_breaks_is_every_estimator_s_failure(log: Path, tmp_path: Path) -> None:
    lines = (log / "leg_log.csv").read_text(encoding="ascii").splitlines(keepends=True)
    lines[200] = lines[200].replace(",", ",oops,", 1)
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "leg_log.csv").write_text("".join(lines), encoding="ascii")
    run = comparison.run_all(tmp_path / "broken", ["naive", "naive_rolling"], CONFIG, tmp_path / "out")
    assert run["reader"] is None
    for told in run["estimators"].values():
        assert "line 201" in told["failure"]
        assert told["estimates"] > 100


def test_a_misspelt_mode_is_found_before_anything_runs(log: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no mode 'naiv'"):
        comparison.run_all(log, ["naive", "naiv"], CONFIG, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_file_that_cannot_be_written_is_told(log: Path, tmp_path: Path) -> None:
    (tmp_path / "naive.tum").mkdir()
    with pytest.raises(DatasetError, match=r"cannot write .*naive\.tum: .*directory; choose another folder with -o"):
        comparison.run_all(log, ["naive"], CONFIG, tmp_path)


def test_progress_hears_the_estimator_and_the_stamps(log: Path, tmp_path: Path) -> None:
    heard: list[tuple[str, int]] = []
    comparison.run_all(log, ["naive"], CONFIG, tmp_path, lambda name, stamp_ns: heard.append((name, stamp_ns)))
    assert heard[0] == ("naive", 0)
    assert heard[-1] == ("naive", END_NS)
    assert len(heard) == 903


def test_a_run_without_ground_truth_asks_for_one(log: Path, tmp_path: Path) -> None:
    (tmp_path / "log").mkdir()
    (tmp_path / "log" / "leg_log.csv").write_bytes((log / "leg_log.csv").read_bytes())
    run = comparison.run_all(tmp_path / "log", ["naive"], CONFIG, tmp_path / "out")
    assert run["ground_truth"] is None
    with pytest.raises(DatasetError, match=r"no ground truth; give one with .*--vicon FILE"):
        comparison.evaluate_run(tmp_path / "out", CONFIG.evaluation)


def test_another_ground_truth_can_be_given(log: Path, tmp_path: Path) -> None:
    comparison.run_all(log, ["naive"], CONFIG, tmp_path)
    own, _ = comparison.evaluate_run(tmp_path, EvaluationConfig())
    truth = run_folder.read_ground_truth(tmp_path, run_folder.read_run_json(tmp_path))
    assert truth is not None
    doubled = truth.trajectory.T_world_body.copy()
    doubled[:, :3, 3] *= 2.0
    other = GroundTruth(Trajectory(truth.trajectory.stamps_ns, doubled), True, "doubled")
    given, _ = comparison.evaluate_run(tmp_path, EvaluationConfig(), other)
    assert given["naive"].path_length_m == pytest.approx(2.0 * own["naive"].path_length_m, rel=1e-6)


def test_a_trajectory_is_evaluated_by_its_file_name(log: Path, tmp_path: Path) -> None:
    comparison.run_all(log, ["naive"], CONFIG, tmp_path)
    run = run_folder.read_run_json(tmp_path)
    truth = run_folder.read_ground_truth(tmp_path, run)
    alone = comparison.evaluate_tum(tmp_path / "naive.tum", EvaluationConfig(), truth)
    whole, _ = comparison.evaluate_run(tmp_path, EvaluationConfig())
    assert alone["naive"].ate_m == pytest.approx(whole["naive"].ate_m, abs=1e-9)
    assert alone["naive"].anees_pose is None
    with pytest.raises(EvaluationError, match="trajectory without ground truth; give one with --vicon FILE"):
        comparison.evaluate_tum(tmp_path / "naive.tum", EvaluationConfig(), None)
    with pytest.raises(DatasetError, match=r"missing\.tum"):
        comparison.evaluate_tum(tmp_path / "missing.tum", EvaluationConfig(), None)


def test_a_comparison_writes_numbers_figures_and_a_report(log: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    comparison.run_all(log, ["naive", "naive_rolling"], CONFIG, tmp_path)
    evaluations, _ = comparison.evaluate_run(tmp_path, CONFIG.evaluation)
    report = comparison.write_comparison(tmp_path, "a <walk>", evaluations, CONFIG)
    compared = json.loads((tmp_path / "compare.json").read_text(encoding="utf-8"))
    assert set(compared) == {"naive", "naive_rolling"}
    assert compared["naive"]["ate_m"] == evaluations["naive"].ate_m
    assert (tmp_path / "figures" / "contacts.png").stat().st_size > 1000
    page = report.read_text(encoding="utf-8")
    assert "a &lt;walk&gt;" in page
    assert "data:image/png" in page


def test_the_report_tells_what_was_wrong_on_purpose_and_what_happened(film: Path, tmp_path: Path) -> None:
    config = resolve(settings=["faults.frame_loss=0.25"])
    comparison.run_all(film, ["watching"], config, tmp_path)
    evaluations, _ = comparison.evaluate_run(tmp_path, config.evaluation)
    page = comparison.write_comparison(tmp_path, "film", evaluations, config).read_text(encoding="utf-8")
    assert "A body travelled 0.00 m" in page
    assert "Wrong on purpose: frame_loss 0.25." in page
    assert "<td>watching</td><td>blind</td><td>it is dark</td>" in page


def test_an_event_of_a_mode_with_two_answers_is_told_once() -> None:
    event = {"kind": "restart", "stamp_ns": 5}
    told = {"mode": "combined", "events": [event]}
    run = {"estimators": {"combined_coclo": told, "combined_vins": told, "vins": {"mode": "vins", "events": [event]}}}
    assert list(told_events(run)) == [("combined", event), ("vins", event)]


def test_the_written_configuration_is_plain_yaml(log: Path, tmp_path: Path) -> None:
    comparison.run_all(log, ["naive"], CONFIG, tmp_path)
    values = yaml.safe_load((tmp_path / "config.yaml").read_text(encoding="utf-8"))
    assert values["robot"]["name"] == "daisy"
    assert values["filter"]["profile"] == CONFIG.filter.profile


def test_write_tum_is_what_evaluate_tum_reads(log: Path, tmp_path: Path) -> None:
    """The ground truth against itself has no error."""
    comparison.run_all(log, ["naive"], CONFIG, tmp_path)
    truth = run_folder.read_ground_truth(tmp_path, run_folder.read_run_json(tmp_path))
    assert truth is not None
    write_tum(truth.trajectory, tmp_path / "perfect.tum")
    perfect = comparison.evaluate_tum(tmp_path / "perfect.tum", EvaluationConfig(), truth)["perfect"]
    assert perfect.ate_m < 1e-4
    assert perfect.coverage == pytest.approx(1.0)
