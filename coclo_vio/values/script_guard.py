# SPDX-License-Identifier: BSD-3-Clause
"""Work that starts processes, called from a script without ``if __name__ == "__main__":``.

A process that Python spawns imports the script first. Without that line it would do the script's work, too, for as long
as it takes to reach the place where Python refuses to spawn yet another process.
"""

import multiprocessing

from coclo_vio.values.errors import CocloError


def refuse_while_imported(call: str) -> None:
    """Refuse work in a spawned process that is still importing the script.

    Args:
        call: what the script called, for the message.

    Raises:
        CocloError: this is such a process.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):  # as multiprocessing's own check has it
        raise CocloError(
            f"{call} starts processes, which import the script that calls it: "
            'put the call under if __name__ == "__main__":'
        )
