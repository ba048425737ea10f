# SPDX-License-Identifier: BSD-3-Clause
"""Processes on this computer: one plays a recording on a wire, another one runs the estimator."""

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from coclo_vio.live.live_record import LiveRecord
from coclo_vio.live.open_wire import configured_for, open_wire
from coclo_vio.live.session import LiveSettings, run_live
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.warm_up import warm_up
from coclo_vio.values.calibration import SensorCalibrations

LOOPBACK_DDS = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces></General>"
    "<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>40</MaxAutoParticipantIndex>"
    "<Peers><Peer address='localhost'/></Peers></Discovery></Domain></CycloneDDS>"
)


def free_port() -> int:
    """A TCP port of the loopback that nobody uses now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def environment() -> dict[str, str]:
    """That of a process: DDS on the loopback only."""
    return {**os.environ, "CYCLONEDDS_URI": LOOPBACK_DDS}


def run_beside(
    publisher: Sequence[str], source: str, folder: Path, *, endpoint: str | None = None, domain: int = 0
) -> tuple[Mapping[str, int], LiveRecord]:
    """What another process sent, by topic, and what came here, where leg odometry ran on it.

    Args:
        publisher: arguments of ``publish_recording``.
        source: as of ``--source``.
        folder: of the run.
        endpoint: on which the publisher listens.
        domain: of DDS.
    """
    command = [sys.executable, "-m", "coclo_vio.live.publish_recording", *publisher]
    end_s = time.monotonic() + 90.0
    with subprocess.Popen(command, env=environment(), stdout=subprocess.PIPE, text=True) as player:
        try:
            while endpoint is not None and not _listens(endpoint) and time.monotonic() < end_s:
                time.sleep(0.05)
            config = configured_for(source, resolve("daisy", settings=["live.idle_s=1", "live.first_messages_s=0.3"]))
            warm_up(config)
            wire = open_wire(source, endpoint, domain, config)
            settings = LiveSettings(
                mode_of("coclo"), config, folder, SensorCalibrations(), stops=lambda: time.monotonic() > end_s
            )
            _, counted = run_live(wire.source, wire.sinks, wire.types, settings)
            said, _ = player.communicate(timeout=60)
        finally:
            player.kill()
    return json.loads(said)["sent"], counted


def _listens(endpoint: str) -> bool:
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    with socket.socket() as probe:
        return probe.connect_ex((host, int(port))) == 0


def children_of(pid: int) -> list[int]:
    """The processes that a process has started and that go on (Linux)."""
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()]


def is_alive(pid: int) -> bool:
    """Whether there is such a process."""
    return Path(f"/proc/{pid}").exists()
