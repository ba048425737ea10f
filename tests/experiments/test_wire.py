# SPDX-License-Identifier: BSD-3-Clause
"""The account of a trial on a wire: what was sent is received, lost, or sent before the first one that came."""

from pathlib import Path

import pytest

from coclo_vio.experiments.wire import loopback


def _topic(received: int, lost: int, earlier: int) -> dict[str, object]:
    counts = {"received": received, "lost": lost, "earlier": earlier, "late": 0, "dropped": 2}
    return {**counts, "refused": {"cannot be decoded": 1}, "latency": None}


@pytest.mark.parametrize(("sent", "unaccounted"), [(100, 0), (103, 3)])
def test_what_is_not_accounted_for_is_found(sent: int, unaccounted: int) -> None:
    counted = {"topics": {"/imu": _topic(90, 4, 6)}, "estimates": {}, "published": {}}
    trial = loopback.WireTrial("zenoh", 1.0, "coclo", Path("out"))
    found = loopback._summary(trial, {"/imu": sent, "/left": 5}, counted, [(1.0, 100.0), (2.0, 110.0), (3.0, 111.0)])
    assert found["topics"]["/imu"]["unaccounted"] == unaccounted
    assert found["topics"]["/imu"]["refused"] == 1
    assert found["resident_mb"] == {"half": 110.0, "end": 111.0}


def test_the_two_processes_of_a_wire_meet_at_one_place() -> None:
    zenoh, dds = loopback._place("zenoh"), loopback._place("dds")
    assert zenoh.live[1] == zenoh.player[1]
    assert zenoh.live[1].startswith("tcp/127.0.0.1:")
    assert dds.live == dds.player
