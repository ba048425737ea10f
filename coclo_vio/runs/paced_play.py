# SPDX-License-Identifier: BSD-3-Clause
"""A recording played to one mode by its stamps into a run folder, with ``latency.json`` beside ``run.json``."""

from pathlib import Path

from coclo_vio.runs import run_folder
from coclo_vio.runs.latency import LatencyRecord
from coclo_vio.runs.modes.registry import mode_of
from coclo_vio.runs.observers import Observers
from coclo_vio.runs.paced_feed import MAX_LAG_S, PacedFeed
from coclo_vio.runs.paced_source import Pace
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.runs.run_folder import Existing
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.runs.running import Ending, run_modes
from coclo_vio.runs.warm_up import warm_up
from coclo_vio.values.errors import ConfigError

LATENCY_JSON = "latency.json"


def play_mode(
    path: Path,
    mode: str,
    config: RunConfig,
    folder: Path,
    feed: PacedFeed,
    *,
    observers: Observers | None = None,
    ending: Ending | None = None,
) -> tuple[RunRecord, LatencyRecord]:
    """Play a recording to one mode; what ``run.json`` and ``latency.json`` hold.

    Frames of ``combined`` are processed beside the filter unless ``bridge.vision`` says otherwise.

    Args:
        path: the recording.
        mode: name.
        config: resolved configuration.
        folder: run folder, made if needed.
        feed: what plays it.
        observers: who is shown what the mode reads and gives.
        ending: what becomes of earlier results, and what stops it; earlier results are refused if None. A play cannot
            be resumed.

    Raises:
        CocloError: the folder holds results, the recording, the robot or the configuration is at fault, or the mode
            lacks what it needs.
    """
    if ending is not None and ending.existing is Existing.RESUME:
        raise ConfigError(f"the play in {folder} cannot be resumed, as time has gone on; play it anew with --overwrite")
    config = for_use_online(config)
    if mode_of(mode).has_legs:
        warm_up(config)
    record = run_modes(path, [mode], config, folder, observers=observers, ending=ending, feed=feed)
    latency = feed.record(mode, config)
    with run_folder.writing(folder):
        latency.write(folder / LATENCY_JSON)
    return record, latency


def paced_feed(rate: float, seconds: float | None = None, *, max_lag_s: float = MAX_LAG_S) -> PacedFeed:
    """What plays a recording at a rate.

    Args:
        rate: seconds of recording per second.
        seconds: of the recording to play; all of it if None.
        max_lag_s: an image that has waited for longer is left out, s.

    Raises:
        ConfigError: one of them is not positive.
    """
    for what, value in (("rate", rate), ("seconds", seconds), ("max_lag_s", max_lag_s)):
        if value is not None and not 0.0 < value < 1e6:
            raise ConfigError(f"{what} = {value}: give a number above 0, such as rate = 1 for the speed of the sensors")
    return PacedFeed(Pace(rate=rate, seconds=seconds), max_lag_s=max_lag_s)


def for_use_online(config: RunConfig) -> RunConfig:
    """The configuration without checkpoints, and with frames beside the filter where it leaves that open."""
    config = config.model_copy(update={"checkpoints": config.checkpoints.model_copy(update={"interval_s": 0.0})})
    if config.bridge.vision != "auto":
        return config
    return config.model_copy(update={"bridge": config.bridge.model_copy(update={"vision": "beside"})})
