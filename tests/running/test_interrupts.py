"""Keyboard interrupts while CasADi and Ipopt compute."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from browser import PATIENCE
from conftest import slow_after

SEARCH = "find(Hopper('r + 0.1*r**3', mass_ratio=0.5), 40, method='shooting')"


def processor_seconds(process: subprocess.Popen) -> float:
    """The processor time of a process so far; NaN where there is no `/proc`."""
    stat = Path(f"/proc/{process.pid}/stat")
    if not stat.exists():
        return float("nan")
    user, system = map(int, stat.read_text(encoding="utf-8").rpartition(")")[2].split()[11:13])
    return (user + system) / os.sysconf("SC_CLK_TCK")


def of_ended() -> float:
    """The processor time of all processes that this one has started and that have ended."""
    return sum(os.times()[2:4])


@pytest.mark.posix
@pytest.mark.parametrize(
    ("moment", "work"),
    [
        *slow_after(1, [(moment, SEARCH) for moment in (0.3, 1.3)]),
        (0.4, "steering.start_up(Hopper(), 3, stroke=2.0)"),
    ],
)
@pytest.mark.slow
def test_an_interrupt_ends_the_program_at_once(moment, work):
    """CasADi and Ipopt swallow the signal; the program must not go on, whatever it does just then."""
    code = "from orbits import find; from problems import Hopper, steering; print('go', flush=True)\n"
    code += f"while True: {work}"
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n" + code  # some shells ignore it
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "go\n"
        time.sleep(moment)
        ended, used = of_ended(), processor_seconds(process)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=PATIENCE)
        assert not of_ended() - ended - used > 2  # of processor time, as the machine may do much else
    finally:
        process.kill()
        process.communicate()
    assert process.returncode != 0
    assert "KeyboardInterrupt" in errors
