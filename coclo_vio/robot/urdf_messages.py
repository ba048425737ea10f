# SPDX-License-Identifier: BSD-3-Clause
"""What the URDF parser writes to the terminal, as text: it has no other way to say what is wrong with a file.

The parser is C++ and writes to file descriptor 2, which Python's ``sys.stderr`` does not see.
"""

import os
import re
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_STDERR = 2
_LOCK = threading.Lock()  # the descriptor belongs to the process: one redirection at a time
_MESSAGE = re.compile(rb"^(?:Error|Warning):\s+(.*)\n(?:\s+at line \d+ in .*(?:\n|\Z))?", re.MULTILINE)


@contextmanager
def caught_messages() -> Iterator[list[str]]:
    """The errors and warnings of the parser while the context is open, in the list once it is left.

    Anything else that is written meanwhile, such as by another thread, is written to the terminal when the context is
    left. Where the process has no descriptor 2 nothing is caught.
    """
    messages: list[str] = []
    with _LOCK:
        try:
            terminal = os.dup(_STDERR)
        except OSError:
            yield messages
            return
        with tempfile.TemporaryFile() as file:
            os.dup2(file.fileno(), _STDERR)
            try:
                yield messages
            finally:
                os.dup2(terminal, _STDERR)
                os.close(terminal)
                file.seek(0)
                written = file.read()
                messages += [" ".join(found.decode(errors="replace").split()) for found in _MESSAGE.findall(written)]
                others = _MESSAGE.sub(b"", written)
                if others:
                    os.write(_STDERR, others)
