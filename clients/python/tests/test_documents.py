"""What the README and the examples say can be done as it stands there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import ROOT, Server

HERE = ROOT / "clients/python"
EXAMPLES = re.findall(r"```python\n(.*?)```", (HERE / "README.md").read_text(), re.DOTALL)


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_scenario_examples_of_the_readme_work(number: int, server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    code = EXAMPLES[number].replace("http://127.0.0.1:8400", server.url)
    assert server.url in code
    exec(compile(code, f"README example {number + 1}", "exec"), {})


def test_scenario_the_example_program_works(server: Server) -> None:
    command = [sys.executable, str(HERE / "examples/seeds.py"), server.url, "reference-flight", "2"]
    ended = subprocess.run(command, capture_output=True, text=True, env=os.environ, timeout=120)
    assert ended.returncode == 0, ended.stderr
    assert "seed 2: " in ended.stdout and "found after" in ended.stdout, ended.stdout
