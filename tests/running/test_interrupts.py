"""Keyboard interrupts while CasADi and Ipopt compute."""

import signal
import subprocess
import sys
import time
from contextlib import suppress

import casadi as ca
import pytest
from conftest import slow_after

from orbits import multiplier
from orbits.errors import InputError
from orbits.running import interrupts
from orbits.running.exclusive import exclusive
from problems import Hopper

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


def test_an_interrupt_within_a_conversion_of_arrays_is_no_other_error(monkeypatch):
    """CasADi drops what is raised there, and its conversion returns None."""
    convert = ca.DM.toarray

    def interrupted(self, *arguments):
        signal.raise_signal(signal.SIGINT)
        return convert(self, *arguments)

    expected = multiplier(Hopper(), 4.6)
    for _ in range(9):  # some calls are specialised by Python after a few
        with monkeypatch.context() as patched:
            patched.setattr(ca.DM, "toarray", interrupted)
            with pytest.raises(KeyboardInterrupt):
                multiplier(Hopper(), 4.6)
        assert multiplier(Hopper(), 4.6) == expected
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize("end", ["returns", "raises", "heeds"])
def test_an_interrupt_that_is_lost_is_raised_again(end):
    """However the computation goes on; and no interrupt is left for the next one."""

    @exclusive
    def computes(end):
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        if end == "raises":
            raise InputError("an error that comes of it")
        if end == "heeds":
            interrupts.heed()
            pytest.fail("the interrupt is not heeded")

    with pytest.raises(KeyboardInterrupt):
        computes(end)
    interrupts.heed()  # raises nothing
