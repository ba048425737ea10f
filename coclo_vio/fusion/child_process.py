# SPDX-License-Identifier: BSD-3-Clause
"""A Python process that runs one function of this package, and a connection to it.

The process is a fresh interpreter: it inherits no thread and no lock, and imports nothing of the program that started
it, which needs no ``if __name__ == "__main__"``. It is in a session of its own, so that an interruption by keyboard
reaches the program alone, which ends it. Where the program dies, the connection breaks, and the process ends by itself.
"""

import signal
import subprocess
import sys
import weakref
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from select import POLLIN, poll
from typing import Any

from coclo_vio.values.errors import CocloError

ENDS_WITHIN_S = 2.0
"""How long a process may take to end once its connection is closed, before it is killed."""

_START = "import sys; sys.path[:] = {path!r}; from {module} import {function}; {function}({descriptor})"


class ChildProcess:
    """The process, from the moment that this object is made until ``end``, or until this object is gone.

    Attributes:
        connection: to the process; what the function gets is its other end.
    """

    def __init__(self, function: Callable[..., None], *arguments: Any, descriptors: Sequence[int] = ()) -> None:
        """Start it.

        Args:
            function: of a module, called with the process's end of the connection and the arguments.
            arguments: anything that can be pickled.
            descriptors: open files that the process gets too, under the same numbers.

        Raises:
            CocloError: the system starts no process.
        """
        self.connection, theirs = Pipe()
        code = _START.format(path=sys.path, module=__name__, function=run_child.__name__, descriptor=theirs.fileno())
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-c", code],
                pass_fds=(theirs.fileno(), *descriptors),
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
        except OSError as error:
            self.connection.close()
            raise CocloError(f"no process could be started ({error.strerror}); end other processes") from error
        finally:
            theirs.close()
        self._end = weakref.finalize(self, _end, self._process, self.connection)
        self._readable = poll()
        self._readable.register(self.connection.fileno(), POLLIN)
        with suppress(OSError):  # a process that died at once is found when something is received from it
            self.connection.send((function, arguments))

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def status(self) -> int | None:
        """Exit status, negative for a signal; None while it runs."""
        return self._process.poll()

    def has_message(self, timeout_s: float = 0.0) -> bool:
        """Whether something can be received, or the connection is broken; waits for it at most so long."""
        return bool(self._readable.poll(1e3 * timeout_s))

    def end(self, within_s: float = ENDS_WITHIN_S) -> None:
        """Close the connection, and wait for the process's end; it is killed where it does not end in time."""
        if self._end.detach() is not None:
            _end(self._process, self.connection, within_s)


def _end(process: "subprocess.Popen[bytes]", connection: Connection, within_s: float = ENDS_WITHIN_S) -> None:
    connection.close()
    try:
        process.wait(within_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def run_child(descriptor: int) -> None:
    """What the process does: receive a function, call it, end when it returns or the other side is gone.

    A request to stop that is sent to all processes of a service is the program's to answer: it takes what is in process
    here, and ends this process then.
    """
    for request in (signal.SIGINT, signal.SIGTERM):
        signal.signal(request, signal.SIG_IGN)
    connection = Connection(descriptor)
    with suppress(EOFError, ConnectionError):
        function, arguments = connection.recv()
        function(connection, *arguments)
