# SPDX-License-Identifier: BSD-3-Clause
"""A robot and an estimator as two processes on the loopback: one plays a recording, the other is ``coclo-vio live``."""

import json
import os
import socket
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from coclo_vio.datasets.sample import sample_path
from coclo_vio.values.errors import DatasetError, shortened

_DDS = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces></General>"
    "<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>40</MaxAutoParticipantIndex>"
    "<Peers><Peer address='localhost'/></Peers></Discovery></Domain></CycloneDDS>"
)
_ENDS_S = 120.0  # after the last message, at most
_SAMPLED_S = 5.0


@dataclass(frozen=True, slots=True)
class WireTrial:
    """One trial.

    Attributes:
        wire: ``zenoh``, ``dds`` or ``unitree``.
        seconds: of messages.
        mode: that runs.
        folder: of the run.
        recording: that is played, from its beginning again at its end; the bundled one by default.
        robot: of the recording.
    """

    wire: str
    seconds: float
    mode: str
    folder: Path
    recording: Path = field(default_factory=sample_path)
    robot: str = "daisy"


def run_trial(trial: WireTrial) -> dict[str, Any]:
    """Run it; what was sent, what came, latencies, and the memory of the estimator's process over time.

    Raises:
        DatasetError: one of the processes failed.
    """
    place = _place(trial.wire)
    live = [sys.executable, "-m", "coclo_vio", "live", "-s", trial.wire, *place.live, "-m", trial.mode]
    live += [
        "-r",
        trial.robot,
        "-o",
        str(trial.folder),
        "--overwrite",
        "--set",
        "live.idle_s=5",
        "--set",
        "live.wait_s=180",
    ]
    player = [sys.executable, "-m", "coclo_vio.live.publish_recording", str(trial.recording), "--wire", trial.wire]
    player += [*place.player, "--loop", "--seconds", f"{trial.seconds:g}", "--wait", "120", "--robot", trial.robot]
    environment = {**os.environ, "CYCLONEDDS_URI": _DDS}
    trial.folder.mkdir(parents=True, exist_ok=True)
    resident: list[tuple[float, float]] = []
    with (trial.folder / "live.txt").open("w", encoding="utf-8") as out:
        receiver = subprocess.Popen(live, env=environment, stdout=out, stderr=subprocess.STDOUT)
        sender = subprocess.Popen(player, env=environment, stdout=subprocess.PIPE, text=True)
        try:
            begun_s = time.monotonic()
            while sender.poll() is None:
                time.sleep(_SAMPLED_S)
                resident.append((time.monotonic() - begun_s, _resident_mb(receiver.pid)))
            receiver.wait(timeout=_ENDS_S)
            said = sender.stdout.read() if sender.stdout is not None else ""
        finally:
            for process in (sender, receiver):
                process.kill()
    if sender.returncode or receiver.returncode:
        text = (trial.folder / "live.txt").read_text(encoding="utf-8")
        raise DatasetError(f"the trial of {trial.wire} failed: {shortened(text[-400:])}")
    counted = json.loads((trial.folder / "live.json").read_text(encoding="utf-8"))
    return _summary(trial, json.loads(said)["sent"], counted, resident)


@dataclass(frozen=True, slots=True)
class _Place:
    """Where the two processes meet, as arguments of each."""

    live: tuple[str, ...]
    player: tuple[str, ...]


def _place(wire: str) -> _Place:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    if wire == "zenoh":
        endpoint = f"tcp/127.0.0.1:{port}"
        return _Place(("--endpoint", endpoint), ("--listen", endpoint))
    domain = ("--domain", str(100 + port % 100))
    return _Place(domain, domain)


def _summary(
    trial: WireTrial, sent: dict[str, int], counted: dict[str, Any], resident: list[tuple[float, float]]
) -> dict[str, Any]:
    topics = {}
    for topic, came in counted["topics"].items():
        unaccounted = sent.get(topic, 0) - came["received"] - came["lost"] - came["earlier"]
        topics[topic] = {
            "sent": sent.get(topic, 0),
            **{name: came[name] for name in ("received", "lost", "earlier", "late", "dropped")},
            "refused": sum(came["refused"].values()),
            "unaccounted": unaccounted,
            "latency": came["latency"],
        }
    half = [mb for at_s, mb in resident if mb > 0 and at_s > resident[-1][0] / 2] if resident else []
    return {
        "wire": trial.wire,
        "mode": trial.mode,
        "seconds": trial.seconds,
        "topics": topics,
        "estimates": counted["estimates"],
        "published": counted["published"],
        "resident_mb": {"half": half[0], "end": half[-1]} if half else None,
    }


def _resident_mb(process: int) -> float:
    """Resident memory of a process, MB; 0 where the system does not say so."""
    try:
        fields = Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()
    except OSError:
        return 0.0
    return int(fields[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
