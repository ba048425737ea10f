# SPDX-License-Identifier: BSD-3-Clause
"""Processes that run one function: they answer, end with their object, and end by themselves where nobody is left."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from child_functions import echo, sleep, stop

from coclo_vio.fusion.child_process import ChildProcess
from coclo_vio.fusion.shared_images import SharedImages
from coclo_vio.values.measurements import StereoFrame

HERE = Path(__file__).parent


def is_there(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def wait_for_the_end(pid: int) -> None:
    for _ in range(500):
        if not is_there(pid) or Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
            return
        time.sleep(0.02)
    pytest.fail(f"process {pid} is still there after 10 s")


def test_it_answers_until_it_is_ended() -> None:
    child = ChildProcess(echo, "got ")
    assert not child.has_message()
    child.connection.send("this")
    assert child.has_message(20.0)
    assert child.connection.recv() == ("got this", child.pid)
    assert child.status is None
    child.end(20.0)
    child.end()
    assert child.status == 0
    assert not is_there(child.pid)


@pytest.mark.parametrize("request_to_stop", [signal.SIGTERM, signal.SIGINT])
def test_a_request_to_stop_that_goes_to_all_processes_leaves_it_to_the_program(request_to_stop: int) -> None:
    child = ChildProcess(echo, "got ")
    child.connection.send("this")
    assert child.has_message(20.0)
    child.connection.recv()
    os.kill(child.pid, request_to_stop)
    child.connection.send("that")
    assert child.has_message(20.0)
    assert child.connection.recv() == ("got that", child.pid)
    child.end(20.0)
    assert child.status == 0


def test_one_that_does_not_look_at_its_connection_is_killed() -> None:
    child = ChildProcess(sleep)
    child.end(0.1)
    assert child.status == -9


def test_one_that_ends_by_itself_is_seen_by_whoever_receives() -> None:
    child = ChildProcess(stop)
    assert child.has_message(20.0)
    with pytest.raises((EOFError, ConnectionError)):
        child.connection.recv()
    child.end()
    assert child.status == 7


def test_it_ends_with_its_object() -> None:
    child = ChildProcess(echo, "")
    pid = child.pid
    del child
    wait_for_the_end(pid)


def test_it_ends_where_the_program_is_killed_and_needs_no_main_guard(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        f"import sys, time\nsys.path.insert(0, {str(HERE)!r})\nfrom child_functions import echo\n"
        "from coclo_vio.fusion.child_process import ChildProcess\n"
        "child = ChildProcess(echo, '')\nchild.connection.send('x')\nprint(child.connection.recv()[1], flush=True)\n"
        "time.sleep(3600)\n"
    )
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        pid = int(program.stdout.readline())
        assert is_there(pid)
        program.kill()
    wait_for_the_end(pid)


def test_frames_go_through_slots_in_turn_and_a_slot_is_free_once_it_was_read() -> None:
    images = np.random.default_rng(4).integers(0, 255, (3, 2, 4, 5), dtype=np.uint8)
    ours = SharedImages(20, 2)
    theirs = SharedImages(20, 2, os.dup(ours.descriptor))
    frames = [StereoFrame(number, *pair) for number, pair in enumerate(images)]
    first, second = ours.write(frames[0]), ours.write(frames[1])
    assert ours.is_full
    np.testing.assert_array_equal(theirs.read(first).right, images[0, 1])
    assert not ours.is_full
    third = ours.write(frames[2])
    for shared, pair in ((second, images[1]), (third, images[2])):
        read = theirs.read(shared)
        np.testing.assert_array_equal([read.left, read.right], pair)
    assert not ours.fits(StereoFrame(0, *np.zeros((2, 5, 5), dtype=np.uint8)))
