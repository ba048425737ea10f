# SPDX-License-Identifier: BSD-3-Clause
"""Cases run in a forked process with limits of time and memory; a process that dies is a finding too."""

import os
import pickle
import resource
import select
import shutil
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import BinaryIO, NamedTuple

from coclo_vio.experiments.fuzz.reading_cases import Case
from coclo_vio.values.errors import CocloError

TIME_LIMIT_S = 5
MEMORY_LIMIT_MB = 500
_LONGEST_MESSAGE = 3000
_GRACE_S = 10.0  # until a process that does not react to its alarm is killed
_Maker = Callable[[int, Path], Case]


class Outcome(NamedTuple):
    """What became of one case: ``read``, ``refused``, or what is wrong, and where that was."""

    number: int
    kind: str
    result: str
    detail: str = ""

    @property
    def is_finding(self) -> bool:
        """Whether it is neither read nor refused in one sentence."""
        return self.result not in ("read", "refused")


class _TookTooLong(BaseException):
    """The alarm; not an Exception, so that no reader takes it for a defect of its input."""


def outcomes(numbers: range, make: _Maker, folder: Path, kept: Path) -> Iterator[Outcome]:
    """Run the cases of ``numbers``; inputs of findings are moved to ``kept``."""
    following = numbers.start
    while following < numbers.stop:
        for outcome in _of_one_process(range(following, numbers.stop), make, folder, kept):
            following = outcome.number + 1
            yield outcome


def _of_one_process(numbers: range, make: _Maker, folder: Path, kept: Path) -> Iterator[Outcome]:
    """Outcomes until all are done or the process has died, the last of which says how."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(reading)
        with suppress(BrokenPipeError), os.fdopen(writing, "wb") as pipe:  # the time is over
            _work(numbers, make, folder, kept, pipe)
        os._exit(0)
    os.close(writing)
    current = numbers.start
    with os.fdopen(reading, "rb", buffering=0) as pipe:
        while current < numbers.stop:
            is_ready = select.select([pipe], [], [], TIME_LIMIT_S + _GRACE_S)[0]
            length = pipe.read(4) if is_ready else b""
            if not is_ready or not length:
                os.kill(pid, signal.SIGKILL)
                break
            outcome: Outcome = pickle.loads(_exactly(pipe, int.from_bytes(length, "little")))
            current = outcome.number + 1
            yield outcome
    _, status = os.waitpid(pid, 0)
    if current < numbers.stop:
        how = signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else f"exit {os.WEXITSTATUS(status)}"
        _keep(folder / str(current), kept / str(current))
        yield Outcome(current, "?", "hangs" if how == "SIGKILL" else "dies", how)


def _exactly(pipe: BinaryIO, length: int) -> bytes:
    data = b""
    while len(data) < length:
        data += pipe.read(length - len(data))
    return data


def _work(numbers: range, make: _Maker, folder: Path, kept: Path, pipe: BinaryIO) -> None:
    signal.signal(signal.SIGALRM, _too_long)
    for number in numbers:
        own = folder / str(number)
        own.mkdir(parents=True)
        outcome = _run(number, make, own)
        if outcome.is_finding:
            _keep(own, kept / str(number))
        shutil.rmtree(own, ignore_errors=True)
        data = pickle.dumps(outcome)
        pipe.write(len(data).to_bytes(4, "little") + data)
        pipe.flush()


def _too_long(_signal: int, _frame: FrameType | None) -> None:
    raise _TookTooLong


def _run(number: int, make: _Maker, folder: Path) -> Outcome:
    case = make(number, folder)
    is_refused = False
    _limit_memory()
    for name, read in case.readings.items():
        start_s = time.monotonic()
        signal.alarm(TIME_LIMIT_S)
        try:
            read()
        except CocloError as error:
            is_refused = True
            problem = _problem(error)
            if problem:
                return Outcome(number, case.kind, problem, f"{name}: {str(error)[:300]!r}")
        except _TookTooLong:
            return Outcome(number, case.kind, "takes too long", f"{name}: {_place()}")
        except BaseException as error:  # all of them are findings
            return Outcome(number, case.kind, type(error).__name__, f"{name}: {str(error)[:200]} at {_place()}")
        finally:
            signal.alarm(0)
        if time.monotonic() - start_s > TIME_LIMIT_S:
            return Outcome(number, case.kind, "takes too long", name)
    return Outcome(number, case.kind, "refused" if is_refused else "read")


def _limit_memory() -> None:
    """This process may take so much more address space than it has now."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    limit = pages * resource.getpagesize() + MEMORY_LIMIT_MB * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))


def _problem(error: BaseException) -> str:
    """What is wrong with a refusal; empty where nothing is."""
    chain: BaseException | None = error
    while chain is not None:
        if isinstance(chain, MemoryError):
            return "takes too much memory"
        chain = chain.__cause__ or chain.__context__
    text = str(error)
    if "\n" in text:
        return "message of several lines"
    return "message too long" if len(text) > _LONGEST_MESSAGE else ""


def _place() -> str:
    """The innermost line of this package, and the innermost of all, of the error that is being handled."""
    frames = traceback.extract_tb(sys.exc_info()[2])
    own = [frame for frame in frames if "coclo_vio" in frame.filename and "experiments" not in frame.filename]
    chosen = [*own[-1:], *frames[-1:]]
    return " / ".join(f"{Path(frame.filename).name}:{frame.lineno} {frame.name}" for frame in chosen)


def _keep(source: Path, target: Path) -> None:
    if source.exists() and not target.exists():
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(source, target)
