# SPDX-License-Identifier: BSD-3-Clause
"""Every member of every kind of contradiction is named, in an inspection and before a run; a sound recording is not."""

from pathlib import Path

import pytest

import coclo_vio as cv
from coclo_vio.experiments.contradictions.content import Form, sample_content
from coclo_vio.experiments.contradictions.members import MEMBERS, Member
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.preflight import preflight, refusal

_IDS = [f"{member.name}, {member.form}".replace(" ", "_").replace("/", "_") for member in MEMBERS]


_CASES = [
    pytest.param(member, id=name, marks=pytest.mark.slow if member.in_full and member.form != "leg log" else ())
    for member, name in zip(MEMBERS, _IDS, strict=True)
]


@pytest.mark.long
@pytest.mark.parametrize("member", _CASES)
def test_a_contradiction_is_named_and_its_run_refused(member: Member, tmp_path: Path) -> None:
    recording = _written(member, tmp_path)
    diagnosis = recording.diagnose().diagnosis if member.in_full else preflight(recording.dataset(), recording.config)
    named = [finding for finding in diagnosis.findings if finding.kind == member.finding]
    assert named, [finding.sentence for finding in diagnosis.findings]
    assert named[0].is_error == member.is_error
    if not member.is_truth:
        mode = mode_of("vins" if named[0].streams <= {"stereo", "stereo_tracks", "camera_imu"} else "coclo")
        assert (refusal(diagnosis, mode.sensors) is not None) == member.is_error


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "mode"), [("body accelerations in g", "coclo"), ("baseline of 0", "vins"), ("no such URDF", "coclo")]
)
def test_a_run_raises_it_before_anything_is_written(name: str, mode: str, tmp_path: Path) -> None:
    recording = _written(next(member for member in MEMBERS if member.name == name), tmp_path)
    with pytest.raises(cv.CocloError, match="allow-partial"):
        cv.run(recording, mode, folder=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def _written(member: Member, folder: Path) -> cv.Recording:
    content = member.change(sample_content(has_frames=member.needs_images))
    return cv.open(content.write(folder / "recording", member.form), robot=content.description or content.robot)


@pytest.mark.long
@pytest.mark.parametrize("form", ["bag", "folder", "leg log"])
def test_a_sound_recording_is_good_in_every_form(form: Form, tmp_path: Path) -> None:
    content = sample_content()
    recording = cv.open(content.write(tmp_path / "recording", form), robot="daisy")
    assert recording.inspect().findings == ()


@pytest.mark.long
def test_what_is_certain_corrects_the_recording(tmp_path: Path) -> None:
    wrong = [member for member in MEMBERS if member.name in {"body accelerations in g", "camera axes turned by 90 deg"}]
    content = sample_content(has_frames=False)
    for member in wrong:
        content = member.change(content)
    path = content.write(tmp_path / "recording", "bag")
    examination = cv.open(path, robot="daisy").diagnose()
    assert set(examination.settings) >= {
        "dataset.corrections.imu.acceleration_unit=g",
        "dataset.corrections.camera_imu.axes=-y x z",
    }
    assert examination.corrected.errors == ()
