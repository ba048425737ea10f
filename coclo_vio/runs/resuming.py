# SPDX-License-Identifier: BSD-3-Clause
"""Whether the run in a folder can go on with this recording and configuration."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from coclo_vio import __version__
from coclo_vio.runs import run_folder
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.runs.run_record import RunRecord
from coclo_vio.values.config import read_yaml
from coclo_vio.values.errors import ConfigError, DatasetError, listing

_MAY_DIFFER = ("checkpoints", "evaluation")


def earlier_run(folder: Path, recording: Path, config: RunConfig) -> RunRecord | None:
    """The record of the run in a folder, which goes on; None where there is none yet.

    Args:
        folder: of the run.
        recording: that is to be run.
        config: resolved; it may have other checkpoints and another comparison with ground truth.

    Raises:
        DatasetError: the run is one over another recording, or of another version.
        ConfigError: it was configured otherwise; names the keys.
    """
    if not (folder / run_folder.RUN_JSON).is_file():
        return None
    record = RunRecord.read(folder / run_folder.RUN_JSON)
    anew = "begin anew with --overwrite, or choose another folder with -o"
    if record.version != __version__:
        raise DatasetError(f"{folder} holds a run of version {record.version}, this is version {__version__}; {anew}")
    if Path(record.dataset).resolve() != recording.resolve():
        raise DatasetError(f"{folder} holds a run over {record.dataset}, not over {recording}; {anew}")
    file = folder / "config.yaml"
    if file.is_file():
        before = RunConfig.parse(read_yaml(file), str(file))
        differing = [
            key
            for key in _differing(before.model_dump(), config.model_dump(), "")
            if key.partition(".")[0] not in _MAY_DIFFER
        ]
        if differing:
            raise ConfigError(f"the run in {folder} was configured otherwise ({listing(differing, 5)}); {anew}")
    return record


def _differing(before: Mapping[str, Any], after: Mapping[str, Any], prefix: str) -> Iterator[str]:
    """The keys whose values differ."""
    for key in sorted(before.keys() | after.keys()):
        one, other = before.get(key), after.get(key)
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            yield from _differing(one, other, f"{prefix}{key}.")
        elif one != other:
            yield f"{prefix}{key}"
