# SPDX-License-Identifier: BSD-3-Clause
"""Units of work on a Dask cluster. The only importer of dask (extra ``cluster``), inside the function.

Every worker needs the table's folder and that of the recordings under the same paths, and the package installed; one
thread a worker, and no nanny for those that simulate, which start a process for rendering.
"""

from collections.abc import Sequence
from threading import Lock

from coclo_vio.experiments.table.work_unit import ProgressCallback, WorkProgress, WorkUnit, run_unit
from coclo_vio.values.errors import ConfigError, DatasetError

_TOPIC = "coclo-vio-table"
_CONNECT_S = 30.0


def run_on_cluster(work: Sequence[WorkUnit], address: str, report: ProgressCallback) -> None:
    """All units on the workers of a scheduler.

    Args:
        work: the units.
        address: of the scheduler, such as ``tcp://10.0.0.1:8786``.
        report: called at each step.

    Raises:
        ConfigError: dask is not installed.
        DatasetError: the scheduler does not answer, a worker was lost too often, or a finished job cannot be stored.
    """
    try:
        from distributed import Client, as_completed  # noqa: PLC0415 -- an extra
        from distributed.scheduler import KilledWorker  # noqa: PLC0415
    except ImportError as error:
        raise ConfigError(
            "--scheduler needs Dask, which is an extra: pip install 'coclo-vio[cluster]', or leave it out to run on "
            "this machine"
        ) from error
    try:
        client = Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise DatasetError(
            f"no Dask scheduler answers at {address} ({error}); start one with `dask scheduler`, and workers with "
            f"`dask worker --no-nanny --nthreads 1 {address}`"
        ) from error
    with client:
        once = _Once(report)
        client.subscribe_topic(_TOPIC, lambda event: once.report(WorkProgress(*event[1])))
        futures = client.map(_work, list(work), pure=False, key=[f"table-{unit.name}" for unit in work])
        try:
            for future in as_completed(futures, loop=client.loop):
                for step in future.result():
                    once.report(step)
        except KilledWorker as error:
            raise DatasetError(
                f"workers of {address} died over a recording ({error}); run again, the finished jobs are kept"
            ) from error
        finally:
            client.cancel(futures)
            client.unsubscribe_topic(_TOPIC)


class _Once:
    """Reports each step once: it arrives by way of the scheduler, and again with the unit, in case that was late."""

    def __init__(self, report: ProgressCallback) -> None:
        self._report = report
        self._reported: set[WorkProgress] = set()
        self._lock = Lock()

    def report(self, step: WorkProgress) -> None:
        """Report the step if it is new."""
        with self._lock:
            if step not in self._reported:
                self._reported.add(step)
                self._report(step)


def _work(unit: WorkUnit) -> list[WorkProgress]:
    """Run a unit on a worker; its steps are reported at once, and all of them again at the end."""
    from distributed import get_worker  # noqa: PLC0415 -- an extra

    worker = get_worker()
    steps: list[WorkProgress] = []

    def report(step: WorkProgress) -> None:
        steps.append(step)
        worker.log_event(_TOPIC, (step.kind, step.name, step.reason))

    run_unit(unit, report)
    return steps
