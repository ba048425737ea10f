# SPDX-License-Identifier: BSD-3-Clause
"""What child processes run in tests; nothing of the package is loaded for it."""

import os
import time
from multiprocessing.connection import Connection


def echo(connection: Connection, prefix: str) -> None:
    """Send back what comes, with a prefix and the number of the process."""
    while True:
        connection.send((prefix + connection.recv(), os.getpid()))


def sleep(connection: Connection) -> None:
    """Never look at the connection."""
    time.sleep(3600.0)


def stop(connection: Connection) -> None:
    """End with a status."""
    os._exit(7)
