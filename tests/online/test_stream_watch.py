# SPDX-License-Identifier: BSD-3-Clause
"""A stream that falls silent is reported once, and so is its end; nothing else is."""

import pytest
from damaged_streams import NotingEstimator, S, recorded

from coclo_vio.online.config import OnlineConfig
from coclo_vio.online.guarded_estimator import GuardedEstimator
from coclo_vio.values.measurements import ImuSample, JointSample, Measurement, StereoTracks
from coclo_vio.values.outputs import Event

T0 = 1_700_000_000 * S
KINDS = ("stream_silent", "stream_resumed")


def reported(measurements: list[Measurement], **values: float) -> list[Event]:
    guard = GuardedEstimator(NotingEstimator, OnlineConfig(**values))
    outputs = [output for measurement in measurements for output in guard.push(measurement)]
    return [output for output in [*outputs, *guard.finish()] if isinstance(output, Event) and output.kind in KINDS]


def without(kind: type, start_s: float, end_s: float, seconds: float = 6.0) -> list[Measurement]:
    return [
        each
        for each in recorded(seconds)
        if type(each) is not kind or not start_s * S <= each.stamp_ns - T0 < end_s * S
    ]


@pytest.mark.parametrize(
    ("kind", "name"), [(JointSample, "joints"), (ImuSample, "imu"), (StereoTracks, "stereo_tracks")]
)
def test_a_silent_stream_is_reported_when_it_stops_and_when_it_goes_on(kind: type, name: str) -> None:
    stops, goes_on = reported(without(kind, 2.0, 4.0))
    assert (stops.kind, goes_on.kind) == ("stream_silent", "stream_resumed")
    assert stops.detail.startswith(f"no sample of {name} has come for ")
    assert "(online.silent_s = 0.5): the estimator goes on without" in stops.detail
    latest_s = 1.2 if kind is StereoTracks else 0.6  # ten periods
    assert 0.4 <= (stops.stamp_ns - T0) / S - 2.0 <= latest_s
    assert goes_on.detail == f"{name} goes on after {goes_on.detail.split()[-4]} s of silence"
    assert float(goes_on.detail.split()[-4]) == pytest.approx(2.0, abs=0.15)
    assert (goes_on.stamp_ns - T0) / S == pytest.approx(4.0, abs=0.1)


def test_a_stream_that_ends_early_is_reported_once() -> None:
    assert [each.kind for each in reported(without(JointSample, 2.0, 9.0))] == ["stream_silent"]


def test_short_pauses_lost_frames_and_a_pause_of_all_are_not_reported() -> None:
    assert reported(recorded()) == []
    assert reported(without(JointSample, 2.0, 2.4)) == []
    assert reported([each for each in recorded() if not 2 * S <= each.stamp_ns - T0 < 4 * S]) == []
    assert reported(without(JointSample, 2.0, 4.0), silent_s=0.0) == []
    assert reported(without(StereoTracks, 2.0, 2.9)) == []
