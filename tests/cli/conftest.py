# SPDX-License-Identifier: BSD-3-Clause
import sys
from pathlib import Path

import pytest
from console import Answer, Coclo

from coclo_vio import cli


@pytest.fixture
def coclo(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Coclo:
    """Runs the entry of the console script in this process, in a folder of its own."""

    def run(*arguments: object) -> Answer:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["coclo-vio", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit_:
            cli.main()
        captured = capsys.readouterr()
        code = exit_.value.code
        return Answer(code if isinstance(code, int) else 0, captured.out, captured.err)

    return run
