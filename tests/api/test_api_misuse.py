# SPDX-License-Identifier: BSD-3-Clause
"""A misuse of the API is a ``CocloError`` whose message names the value, the choices and the next step."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import coclo_vio as cv


def bare(leg_log: Path, folder: Path) -> Path:
    """The leg log without its ground truth."""
    folder.mkdir()
    (folder / "leg_log.csv").write_bytes((leg_log / "leg_log.csv").read_bytes())
    return folder


@pytest.mark.parametrize(
    ("misuse", "message"),
    [
        (lambda log, _: cv.run(log, "cocolo"), "no mode 'cocolo'; the modes are: coclo, "),
        (lambda log, _: cv.run(log, ["naive", "cocolo"]), "no mode 'cocolo'; the modes are: "),
        (lambda log, _: cv.run(log, []), "the list of modes is empty; give at least one of coclo, "),
        (lambda log, _: cv.run(log, ""), "no mode ''; the modes are: "),
        (lambda log, _: cv.run(log, "stereo"), "walk has no stereo images; coclo-vio inspect lists what it has"),
        (lambda log, _: cv.compare([log], ["cocolo"]), "no mode 'cocolo'; the modes are: "),
        (lambda log, _: cv.compare([]), "there is no recording to compare on; give at least one"),
        (lambda log, _: cv.open("nowhere"), "nowhere does not exist; pass the path of a recording"),
        (lambda log, _: cv.open(log, robot="spot"), "no robot 'spot'; the known robots are: "),
        (lambda log, _: cv.run(cv.open(log, robot="go1"), "naive"), "FL_hip"),
        (lambda log, _: cv.open(log, settings=["filter.profil=paper"]), "no filter.profil; the keys there are: "),
        (lambda log, _: cv.load_run(log), "no run folder: it has no run.json; give the folder that "),
        (lambda log, _: cv.load_ground_truth(log / "gone.tum"), "gone.tum"),
        (lambda log, _: cv.evaluate(log / "gone.tum", log / "groundtruth.tum"), "gone.tum"),
        (lambda log, _: cv.make_estimator("cocolo"), "no mode 'cocolo'; the modes are: "),
        (
            lambda log, _: cv.make_estimator("coclo"),
            "no robot is given: name one (robot=..., --robot) by ",
        ),
        (lambda log, _: cv.make_estimator("stereo"), "the calibration given has no calibration of its cameras: give "),
        (lambda log, run: run.plot("pth"), "no figure 'pth'; the figures are: "),
        (lambda log, run: run.plot("keyframes"), "keyframes"),
        (lambda log, run: run.estimates("vins"), "no trajectory 'vins'; it has naive"),
        (lambda log, run: run.metrics(vicon=log / "gone.tum"), "gone.tum"),
        (lambda log, run: run.save(log / "leg_log.csv" / "out"), "cannot make the folder "),
    ],
)
def test_a_misuse_is_one_error_with_the_next_step(
    misuse: Callable[[Path, cv.Run], object], message: str, leg_log: Path, naive_run: cv.Run
) -> None:
    pytest.importorskip("matplotlib")
    with pytest.raises(cv.CocloError) as raised:
        misuse(leg_log, naive_run)
    assert message in str(raised.value)


def test_without_ground_truth_metrics_name_the_argument_that_gives_one(leg_log: Path, tmp_path: Path) -> None:
    recording = cv.open(bare(leg_log, tmp_path / "bare"))
    assert recording.ground_truth() is None
    run = cv.run(recording, "naive")
    with pytest.raises(cv.DatasetError, match="has no ground truth; give one"):
        run.metrics()
    with pytest.raises(cv.DatasetError, match=r"bare has no ground truth to compare with: give it in groundtruth\.tum"):
        cv.compare([recording], ["naive"])
    assert set(run.metrics(vicon=leg_log / "groundtruth.tum")) == {"naive"}


def test_a_figure_against_ground_truth_needs_one(leg_log: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    run = cv.run(bare(leg_log, tmp_path / "bare"), "naive")
    with pytest.raises(cv.EvaluationError, match="ground truth"):
        run.plot("position_error")
    assert run.plot("position_error", vicon=leg_log / "groundtruth.tum").axes


def test_without_matplotlib_a_figure_names_the_extra(naive_run: cv.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(cv.EvaluationError, match=r"pip install 'coclo-vio\[viz\]'"):
        naive_run.plot("path")
