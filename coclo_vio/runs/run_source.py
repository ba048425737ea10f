# SPDX-License-Identifier: BSD-3-Clause
"""Where the measurements of a run come from: a recording, read as fast as it is taken, or played by its stamps."""

from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from coclo_vio.datasets.dataset import Dataset
from coclo_vio.datasets.read_ahead import read_ahead
from coclo_vio.runs.faults import Faults
from coclo_vio.runs.paced_feed import PacedFeed
from coclo_vio.runs.run_config import RunConfig
from coclo_vio.values.measurements import Measurement
from coclo_vio.values.outputs import Estimator


@dataclass(frozen=True, slots=True)
class RunSource:
    """Where an estimator's measurements come from.

    Attributes:
        path: of the recording.
        dataset: its reader.
        config: resolved configuration.
        faults: on the measurements.
        feed: plays them by their stamps, if there is one.
    """

    path: Path
    dataset: Dataset
    config: RunConfig
    faults: Faults
    feed: PacedFeed | None = None

    @contextmanager
    def opened(
        self, estimator: Estimator, sensors: frozenset[type]
    ) -> Iterator[tuple[Estimator, Iterable[Measurement]]]:
        """The estimator, whose pushes are timed where the recording is played, and its measurements."""
        if self.feed is not None:
            stereo = self.dataset.stereo_calibration()
            with self.feed.open(estimator, self.path, self.config, sensors, stereo) as fed:
                yield fed
            return
        measurements = self.faults.measurements(self.dataset.measurements, sensors)
        reads_ahead = self.config.dataset.reading_threads > 0
        with closing(read_ahead(measurements)) if reads_ahead else nullcontext(measurements) as source:
            yield estimator, source
