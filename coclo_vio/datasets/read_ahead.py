# SPDX-License-Identifier: BSD-3-Clause
"""Measurements read and decoded in another thread, a bounded number of them ahead; their order stays the same."""

from collections.abc import Generator, Iterable
from contextlib import suppress
from queue import Full, Queue
from threading import Event, Thread

from coclo_vio.values.measurements import Measurement

THREAD_NAME = "coclo_vio_reading"
_MOST_AHEAD = 256  # measurements; a few of them are images
_LOOK_AROUND_S = 0.2  # how often a reader that is too far ahead looks whether it is still wanted

_Item = tuple[Measurement | None, BaseException | None]  # neither at the end


def read_ahead(measurements: Iterable[Measurement], most: int = _MOST_AHEAD) -> Generator[Measurement, None, None]:
    """The same measurements, while the next ones are read in a thread.

    What reading raises is raised after the measurements before it. The thread ends with the measurements, with an
    error, or when this iterator is closed.

    Args:
        measurements: read by the thread alone.
        most: number of measurements that are held.
    """
    items: Queue[_Item] = Queue(most)
    is_closed = Event()
    reader = Thread(target=_read, args=(measurements, items, is_closed), name=THREAD_NAME, daemon=True)
    reader.start()
    try:
        while True:
            measurement, error = items.get()
            if error is not None:
                raise error
            if measurement is None:
                return
            yield measurement
    finally:
        is_closed.set()
        reader.join()


def _read(measurements: Iterable[Measurement], items: "Queue[_Item]", is_closed: Event) -> None:
    """Put the measurements into the queue until the end, an error, or until nobody wants them."""
    last: _Item = (None, None)
    try:
        for measurement in measurements:
            if not _put(items, (measurement, None), is_closed):
                return
    except BaseException as error:
        last = (None, error)
    _put(items, last, is_closed)


def _put(items: "Queue[_Item]", item: _Item, is_closed: Event) -> bool:
    """Put an item as soon as there is room; False where the other side is closed."""
    while not is_closed.is_set():
        with suppress(Full):
            items.put(item, timeout=_LOOK_AROUND_S)
            return True
    return False
