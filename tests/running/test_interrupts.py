"""Keyboard interrupts while CasADi and Ipopt compute."""

import dis
import os
import random
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import CodeType

import casadi as ca
import pytest
from browser import PATIENCE
from conftest import slow_after

from orbits import ReturnMap, find, follow, multiplier, optimize, simulate, sweep
from orbits.errors import InputError
from orbits.running import LOCK, exclusive, interrupts
from problems import Hopper

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


def test_an_interrupt_that_is_lost_while_arguments_are_checked_is_raised_again():
    """The check of a machine builds its model, if it has none yet."""

    class Built:
        values, units, describe = (), None, dict

        @property
        def model(self):
            with suppress(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)

    @exclusive
    def computes(machine: Built):
        return machine

    with pytest.raises(KeyboardInterrupt):
        computes(Built())


def test_an_interrupt_just_before_the_end_is_not_left_for_the_next_call(monkeypatch):
    """Python raises it from the call that would bring its own handler back."""
    install, late = signal.signal, [True]

    def interrupted(number, handler):
        if handler is signal.default_int_handler and late:
            late.clear()
            signal.raise_signal(number)
        return install(number, handler)

    monkeypatch.setattr(signal, "signal", interrupted)
    with pytest.raises(KeyboardInterrupt), interrupts.never_lost():
        pass
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert not interrupts.pending()


@cache
def interruptible(code: CodeType) -> set[int]:
    """The places of the instructions at which Python handles signals: where a function begins or goes on, behind calls,
    and in loops."""
    instructions = [*dis.get_instructions(code)]
    begins = {each.offset for each in instructions if each.opname in ("RESUME", "JUMP_BACKWARD")}
    return begins | {after.offset for each, after in pairwise(instructions) if each.opname.startswith("CALL")}


@pytest.mark.posix
def test_an_interrupt_at_any_instruction_of_a_call_leaves_nothing_behind():
    """Around a public call, whichever instruction: it is raised, and the next call is as before."""

    @exclusive
    def computes():
        return signal.getsignal(signal.SIGINT) is not signal.default_int_handler and ca.SX(1.0).is_one()

    def interrupting(frame, event, _):
        nonlocal left
        frame.f_trace_opcodes = True
        if event == "opcode" and frame.f_lasti in interruptible(frame.f_code):
            left -= 1
            if left == 0:
                signal.raise_signal(signal.SIGINT)
        return interrupting

    def too_late(*_):
        raise AssertionError("the call waits for ever")

    traced, before, moment, left = sys.gettrace(), signal.signal(signal.SIGALRM, too_late), 0, 0
    try:
        while left == 0:
            moment = left = moment + 1
            signal.setitimer(signal.ITIMER_REAL, 60.0)
            with suppress(KeyboardInterrupt):
                sys.settrace(interrupting)
                computes()
                sys.settrace(traced)
                assert left > 0, f"the interrupt at instruction {moment} is lost"
            sys.settrace(traced)
            assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
            assert not interrupts.pending()
            with ThreadPoolExecutor(1) as pool:  # another thread, which waits for the lock if this one still has it
                assert pool.submit(LOCK.acquire, timeout=1.0).result()
                pool.submit(LOCK.release).result()
            assert computes()
    finally:
        sys.settrace(traced)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert moment > 50


CUBIC = Hopper("cubic", rest_length=20.0, parameters={"beta": 0.3})
LONG = {
    "find": lambda: find(Hopper("cubic", parameters={"beta": 0.3}), 30).alpha,
    "follow": lambda: follow(CUBIC, "beta", 0.6, longest=0.1).points[-1].alpha,
    "fixed points": lambda: ReturnMap(Hopper(), 0.03).fixed_points(4.0, 12.0)[-1].alpha,
    "multipliers": lambda: [multiplier(Hopper(), 4.0 + 0.1 * i) for i in range(9)],
    "simulate": lambda: simulate(CUBIC, 4.0, hops=12).launches[-1],
    "sweep": lambda: sweep(CUBIC, {"beta": (0.1, 0.3)}, 16, seed=1)["alpha"].sum(),
    "optimize": lambda: optimize(CUBIC, minimise="alpha", over={"beta": (0.1, 0.5)}).objective,
}


@pytest.mark.posix
@pytest.mark.parametrize("name", LONG)
@pytest.mark.slow
def test_an_interrupt_at_any_moment_is_nothing_else(name):
    """Long calls are interrupted at random moments of their processor time, and give the same results afterwards."""
    work, rng = LONG[name], random.Random(name)
    expected, began = work(), time.process_time()
    assert work() == expected
    lasts, before = time.process_time() - began, signal.getsignal(signal.SIGVTALRM)
    signal.signal(signal.SIGVTALRM, lambda *_: signal.raise_signal(signal.SIGINT))
    try:
        for _ in range(6):
            with suppress(KeyboardInterrupt):
                signal.setitimer(signal.ITIMER_VIRTUAL, rng.uniform(0.0, lasts) + 1e-6)
                work()
            with suppress(KeyboardInterrupt):
                signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        assert work() == expected
    finally:
        signal.signal(signal.SIGVTALRM, before)
