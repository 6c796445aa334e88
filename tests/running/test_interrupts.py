"""Keyboard interrupts while CasADi and Ipopt compute."""

import signal
import subprocess
import sys
import time

import pytest
from conftest import slow_after

SEARCH = "find(Hopper('r + 0.1*r**3', mass_ratio=0.5), 40, method='shooting')"


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
        process.send_signal(signal.SIGINT)
        began = time.monotonic()
        _, errors = process.communicate(timeout=30)
        assert time.monotonic() - began < 2
    finally:
        process.kill()
        process.communicate()
    assert process.returncode != 0
    assert "KeyboardInterrupt" in errors
