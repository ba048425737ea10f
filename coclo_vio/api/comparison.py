# SPDX-License-Identifier: BSD-3-Clause
"""Several modes over several recordings, side by side against ground truth."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from coclo_vio.api.recording import Recording, open_recording
from coclo_vio.api.run import Run, existing_of, mode_names, run
from coclo_vio.evaluation.evaluation import Evaluation
from coclo_vio.evaluation.ranking import Ranking, rank
from coclo_vio.evaluation.table_one import TableOne
from coclo_vio.runs import run_folder
from coclo_vio.runs.comparison_report import Compared, report_title, write_comparison, write_comparisons
from coclo_vio.runs.observers import Progress
from coclo_vio.runs.run_folder import Existing
from coclo_vio.runs.running import Ending
from coclo_vio.runs.stop_request import RunStopped, StopRequest
from coclo_vio.values.errors import CocloError, ConfigError, DatasetError
from coclo_vio.views.view import View


@dataclass(frozen=True, slots=True, eq=False)
class ComparedRecording:
    """One recording through several modes.

    Attributes:
        name: of the recording.
        recording: the recording.
        run: its modes.
        metrics: by trajectory.
        failures: by trajectory or mode, why there are no metrics, or why it stopped early.
    """

    name: str
    recording: Recording
    run: Run
    metrics: Mapping[str, Evaluation]
    failures: Mapping[str, str]

    @property
    def rankings(self) -> tuple[Ranking, ...]:
        """Which trajectory drifts less, pair by pair, as far as the ground truth can tell."""
        return rank(self.metrics, self.recording.config.evaluation)

    @property
    def title(self) -> str:
        """Name of the recording and of its robot."""
        return report_title(self.name, self.recording.config)

    @property
    def has_failed(self) -> bool:
        """Whether no mode went through, or nothing could be evaluated."""
        return not self.metrics or len(self.run.failures) == len(self.run.record.by_mode())

    def write_report(self) -> Path:
        """Write ``compare.json``, ``ranking.json``, figures and ``report.html`` into the run folder; the page's path.

        Raises:
            DatasetError: a file cannot be written.
        """
        return write_comparison(self.run.folder, self.title, self.metrics, self.recording.config)

    @property
    def compared(self) -> Compared:
        """The same for a page over several recordings."""
        return Compared(self.run.folder, self.metrics, self.recording.config)


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Several recordings, each through several modes.

    Attributes:
        recordings: by name, those that could be run.
        failures: why the others could not, by name.
    """

    recordings: Mapping[str, ComparedRecording]
    failures: Mapping[str, str] = field(default_factory=dict)

    @property
    def metrics(self) -> Mapping[str, Mapping[str, Evaluation]]:
        """By recording and trajectory."""
        return {name: compared.metrics for name, compared in self.recordings.items()}

    @property
    def table(self) -> TableOne:
        """In the form of the paper's Table I."""
        return TableOne.of(self.metrics)

    def write_index(self, folder: str | Path) -> Path:
        """Write ``compare.json``, ``ranking.json`` and ``report.html`` over recordings whose reports are written.

        Args:
            folder: above the run folders.

        Raises:
            DatasetError: a file cannot be written.
        """
        count = len(self.recordings)
        title = "1 recording" if count == 1 else f"{count} recordings"
        return write_comparisons(Path(folder), title, {name: one.compared for name, one in self.recordings.items()})


def compare(
    recordings: Recording | str | Path | Sequence[Recording | str | Path],
    modes: str | Sequence[str] | None = None,
    *,
    output: str | Path | None = None,
    progress: Progress | None = None,
    done: Callable[[ComparedRecording], None] | None = None,
    existing: Existing | str = Existing.REFUSE,
    stop: StopRequest | None = None,
    view: View | None = None,
) -> Comparison:
    """Run several modes on recordings and measure them against ground truth.

    Args:
        recordings: what ``open`` gives, or paths.
        modes: names; by what each recording is enough for if None.
        output: folder for run folders, ``compare.json``, figures and ``report.html``; nothing is kept if None.
        progress: called with the mode and the stamp (ns) of each measurement.
        done: called with each recording once it has run and its report is written.
        existing: what becomes of results in the folder: ``refuse``, ``overwrite``, or ``resume`` their runs.
        stop: asked before each measurement whether to stop.
        view: shown measurements and outputs of all modes; the caller closes it. Of several recordings there is none.

    Raises:
        DatasetError: a recording cannot be read or has no ground truth, none could be run, or the folder holds results
            and ``existing`` refuses them.
        ConfigError: there is no such mode.
        RunStopped: it was asked to stop; what was written stays.
    """
    ending = Ending(existing_of(existing), stop)
    opened = _opened(recordings, modes, has_view=view is not None)
    if output is not None and ending.existing is Existing.REFUSE:
        run_folder.check_free(Path(output))
    compared: list[ComparedRecording] = []
    failures: dict[str, str] = {}
    for recording, name in zip(opened, distinct_names(opened), strict=True):
        folder = None if output is None else result_folder(Path(output), name, count=len(opened))
        try:
            compared.append(
                compare_one(recording, modes, name=name, folder=folder, progress=progress, ending=ending, view=view)
            )
        except CocloError as error:
            if len(opened) == 1:
                raise
            failures[name] = str(error)
            continue
        if output is not None:
            compared[-1].write_report()
        if done is not None:
            done(compared[-1])
    if not compared:
        raise DatasetError("; ".join(f"{name}: {reason}" for name, reason in failures.items()))
    comparison = Comparison({one.name: one for one in compared}, failures)
    if output is not None and len(opened) > 1:
        comparison.write_index(output)
    return comparison


def _opened(
    recordings: Recording | str | Path | Sequence[Recording | str | Path],
    modes: str | Sequence[str] | None,
    *,
    has_view: bool,
) -> list[Recording]:
    """The recordings, each of which can be compared on.

    Raises:
        DatasetError: a recording cannot be read or has no ground truth.
        ConfigError: there is none, no such mode, or a view of several.
    """
    given = [recordings] if isinstance(recordings, Recording | str | Path) else list(recordings)
    opened = [one if isinstance(one, Recording) else open_recording(one) for one in given]
    if has_view and len(opened) > 1:
        raise ConfigError(f"a view shows one recording, not {len(opened)}; compare one at a time, or without a view")
    if not opened:
        raise ConfigError("there is no recording to compare on; give at least one")
    for recording in opened:
        check_comparable(recording, modes)
    return opened


def compare_one(
    recording: Recording,
    modes: str | Sequence[str] | None = None,
    *,
    name: str | None = None,
    folder: Path | None = None,
    progress: Progress | None = None,
    ending: Ending | None = None,
    view: View | None = None,
) -> ComparedRecording:
    """Run several modes on one recording and measure them.

    Raises:
        CocloError: the recording is at fault, or no mode has what it needs.
        RunStopped: it was asked to stop.
    """
    ending = ending or Ending()
    done = run(
        recording,
        recording.modes if modes is None else modes,
        folder=folder,
        progress=progress,
        existing=ending,
        view=view,
    )
    if ending.is_requested:
        raise RunStopped(f"stopped; {done.folder} has what was estimated so far")
    evaluations, failures = done.evaluated(config=recording.config.evaluation)
    stopped = done.failures
    others = {name: why for name, why in failures.items() if done.record.estimators[name].mode not in stopped}
    return ComparedRecording(name or recording.name, recording, done, evaluations, {**others, **stopped})


def check_comparable(recording: Recording, modes: str | Sequence[str] | None) -> None:
    """Find what is wrong before anything runs.

    Raises:
        ConfigError: there is no such mode.
        DatasetError: the recording cannot be read, or has no ground truth.
    """
    if modes is not None:
        mode_names(modes)
    if recording.ground_truth() is None:
        path = recording.path
        raise DatasetError(
            f"{path} has no ground truth to compare with: give it in groundtruth.tum or mocap.csv beside a log, or in "
            f"a pose topic of a bag; coclo-vio run {path} needs none"
        )


def result_folder(output: Path, name: str, *, count: int) -> Path:
    """The run folder of a recording among so many: the output itself where it is the only one."""
    return output if count == 1 else output / name


def distinct_names(recordings: Sequence[Recording]) -> list[str]:
    """The name of each recording, numbered where an earlier one has the same."""
    names: list[str] = []
    for recording in recordings:
        name, number = recording.name, 1
        while name in names:
            number += 1
            name = f"{recording.name}_{number}"
        names.append(name)
    return names
