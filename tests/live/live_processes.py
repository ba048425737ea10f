# SPDX-License-Identifier: BSD-3-Clause
"""Two processes on this computer: one plays a recording on a wire, the other runs the estimator."""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from coclo_vio.live.live_record import LiveRecord, read_live_record

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


def run_both(publisher: Sequence[str], live: Sequence[str], folder: Path) -> tuple[Mapping[str, int], LiveRecord]:
    """What was sent, by topic, and what came.

    Args:
        publisher: arguments of ``publish_recording``.
        live: arguments of ``coclo-vio live`` but the folder.
        folder: of the run.
    """
    command = [sys.executable, "-m", "coclo_vio", "live", *live, "-o", str(folder)]
    receiver = subprocess.Popen(command, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        played = subprocess.run(
            [sys.executable, "-m", "coclo_vio.live.publish_recording", *publisher],
            env=environment(),
            check=True,
            capture_output=True,
            text=True,
            timeout=120,
        )
        said, _ = receiver.communicate(timeout=120)
    finally:
        receiver.kill()
    assert receiver.returncode == 0, said
    return json.loads(played.stdout)["sent"], read_live_record(folder)


def children_of(pid: int) -> list[int]:
    """The processes that a process has started and that go on (Linux)."""
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()]


def is_alive(pid: int) -> bool:
    """Whether there is such a process."""
    return Path(f"/proc/{pid}").exists()
