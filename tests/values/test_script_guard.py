# SPDX-License-Identifier: BSD-3-Clause
import subprocess
import sys
from pathlib import Path

import pytest

WORK = """
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from coclo_vio.values.script_guard import refuse_while_imported

def work():
    refuse_while_imported("work")
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        print(pool.submit(abs, -7).result())

"""


@pytest.mark.parametrize(("last", "is_refused"), [("work()", True), ('if __name__ == "__main__":\n    work()', False)])
def test_a_script_without_the_guard_fails_with_that_advice(tmp_path: Path, last: str, is_refused: bool) -> None:
    script = tmp_path / "script.py"
    script.write_text(WORK + last, encoding="utf-8")
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode != 0) is is_refused
    assert ("work starts processes" in done.stderr) is is_refused
    assert done.stdout == ("" if is_refused else "7\n")
