# SPDX-License-Identifier: BSD-3-Clause
"""Units of work on a Dask cluster. The only importer of dask (extra ``cluster``), inside the function.

Every worker has to see the table's folder and that of the recordings under the same paths, and have the package
installed; one thread a worker, and no nanny above those that simulate, which start a process that draws.
"""

from collections.abc import Sequence
from threading import Lock

from coclo_vio.experiments.table.work_unit import Listener, News, WorkUnit, run_unit
from coclo_vio.values.errors import ConfigError, DatasetError

_TOPIC = "coclo-vio-table"
_CONNECT_S = 30.0


def run_on_cluster(work: Sequence[WorkUnit], address: str, tell: Listener) -> None:
    """All units on the workers of a scheduler.

    Args:
        work: what to do.
        address: of the scheduler, such as ``tcp://10.0.0.1:8786``.
        tell: called with what is going on.

    Raises:
        ConfigError: dask is not installed.
        DatasetError: the scheduler does not answer, a worker was lost too often, or a finished job cannot be kept.
    """
    try:
        from distributed import Client, as_completed  # noqa: PLC0415 -- an extra
        from distributed.scheduler import KilledWorker  # noqa: PLC0415
    except ImportError as error:
        raise ConfigError(
            "--scheduler needs Dask, which is an extra: pip install 'coclo-vio[cluster]', or leave it out to work on "
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
        heard = _Heard(tell)
        client.subscribe_topic(_TOPIC, lambda event: heard.tell(News(*event[1])))
        futures = client.map(_work, list(work), pure=False, key=[f"table-{unit.name}" for unit in work])
        try:
            for future in as_completed(futures, loop=client.loop):
                for news in future.result():
                    heard.tell(news)
        except KilledWorker as error:
            raise DatasetError(
                f"workers of {address} died over a recording ({error}); run again, the finished jobs are kept"
            ) from error
        finally:
            client.cancel(futures)
            client.unsubscribe_topic(_TOPIC)


class _Heard:
    """Hands each news on once: it comes by way of the scheduler, and again with the unit, in case that was late."""

    def __init__(self, tell: Listener) -> None:
        self._tell = tell
        self._heard: set[News] = set()
        self._lock = Lock()

    def tell(self, news: News) -> None:
        """Hand it on if it is new."""
        with self._lock:
            if news not in self._heard:
                self._heard.add(news)
                self._tell(news)


def _work(unit: WorkUnit) -> list[News]:
    """What a worker does; what is going on it tells at once, and again at the end."""
    from distributed import get_worker  # noqa: PLC0415 -- an extra

    worker = get_worker()
    told: list[News] = []

    def tell(news: News) -> None:
        told.append(news)
        worker.log_event(_TOPIC, (news.kind, news.name, news.reason))

    run_unit(unit, tell)
    return told
