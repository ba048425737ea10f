# SPDX-License-Identifier: BSD-3-Clause
"""A way to ask a run to stop between two measurements, from a signal handler or another thread."""

from collections.abc import Iterator
from contextlib import contextmanager


class RunStopped(KeyboardInterrupt):
    """The run was asked to stop; its files are written, its record says so."""


class StopRequest:
    """Asks whoever polls it to stop; the run that does finishes its files.

    Attributes:
        is_requested: whether it was asked.
        is_polled: whether a run looks at it now, so that it will stop by itself.
    """

    def __init__(self) -> None:
        self.is_requested = False
        self.is_polled = False

    def __call__(self) -> bool:
        """Whether the run is to stop."""
        return self.is_requested

    def request(self) -> None:
        """Ask the run to stop."""
        self.is_requested = True

    @contextmanager
    def polled(self) -> Iterator[None]:
        """While a run looks at it before each measurement."""
        self.is_polled = True
        try:
            yield
        finally:
            self.is_polled = False
