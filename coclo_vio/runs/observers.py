# SPDX-License-Identifier: BSD-3-Clause
"""Who is shown what the modes of a run read and give."""

from collections.abc import Callable
from dataclasses import dataclass

from coclo_vio.runs.recording_view import VIEWED_FRAMES
from coclo_vio.values.outputs import Output, Picture
from coclo_vio.views.view import View

Progress = Callable[[str, int], None]
"""Called with the mode and the stamp (ns) of each measurement."""
Watch = Callable[[str, Output], None]
"""Called with the mode and each of its outputs."""


@dataclass(frozen=True, slots=True)
class Observers:
    """Who is shown what the modes of a run read and give; None: nobody.

    Attributes:
        progress: called with mode and stamp.
        watch: called with mode and output.
        view: shown measurements and outputs, pictures among them; the caller closes it.
        pictures_every: the picture of every n-th frame goes into the run folder; none if None.
    """

    progress: Progress | None = None
    watch: Watch | None = None
    view: View | None = None
    pictures_every: int | None = None

    @property
    def drawn_every(self) -> int | None:
        """The picture of every n-th frame is drawn; none if None."""
        return VIEWED_FRAMES if self.pictures_every is None and self.view is not None else self.pictures_every

    def keep(self, output: Output) -> bool:
        """Whether an output goes into the run folder."""
        return self.pictures_every is not None or not isinstance(output, Picture)

    def take(self, mode: str, output: Output) -> None:
        """An output has come."""
        if self.watch is not None:
            self.watch(mode, output)
        if self.view is not None:
            self.view.take(output)

    def advance(self, mode: str, stamp_ns: int) -> None:
        """A measurement has been processed."""
        if self.progress is not None:
            self.progress(mode, stamp_ns)
