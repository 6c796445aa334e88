"""Shared by the tests that run a script in a process of its own, which a fault ends by a signal."""

import os
import subprocess
import sys
from pathlib import Path

TESTS = Path(__file__).parent


def run(script: str, *numbers: int) -> None:
    environment = {**os.environ, "PYTHONPATH": str(TESTS.parent)}
    command = [sys.executable, str(TESTS / script), *map(str, numbers)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=TESTS.parent, env=environment)
    assert done.returncode == 0, done.stdout[-500:] + done.stderr[-3000:]


def lines_of(said: str) -> list[str]:
    """The lines that a program has said, but for those that it computes still, which it says where the machine does
    much else."""
    return [line for line in said.splitlines() if line.strip() and " has been computing for " not in line]
