"""The study of crashes in little: kills of sweeps and of their workers lose nothing and change nothing."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_kills_lose_nothing():
    """It forks, and so has a process of its own, without the threads of the tests."""
    command = [sys.executable, str(ROOT / "studies" / "crashes.py"), "--kills", "6", "--workers", "1"]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=300, env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    assert done.returncode == 0, done.stderr
    assert "6 kills, " in done.stdout
    assert done.stdout.count("0 values different") == 2
    assert ": 0 lost" in done.stdout
