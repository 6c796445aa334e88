"""A long computation says that it goes on."""

import logging
from contextlib import nullcontext
from importlib import import_module

import pytest

from orbits import InputError
from orbits.running import exclusive, interrupts
from problems import Hopper, steering


@pytest.fixture
def clock(monkeypatch):
    """The time that the module sees, in a list of one number."""
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    return now


def test_a_function_says_every_few_seconds_that_it_still_computes(clock, caplog):
    @exclusive
    def inner():
        interrupts.heed()

    @exclusive
    def outer():
        for clock[0] in (0.0, 7.0, 9.0, 16.0, 19.0, 26.0, 28.0, 202.0):
            inner()

    with caplog.at_level(logging.WARNING, logger="orbits"):
        outer()
        clock[0] = 500.0
        inner()  # another call, which has only begun
        interrupts.heed()  # outside of any
    name = outer.__qualname__
    assert caplog.messages == [f"{name} has been computing for {after} s" for after in (9, 19, 28, 202)]


def test_a_function_that_fails_is_no_longer_running(clock, caplog):
    @exclusive
    def failing():
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        failing()
    clock[0] = 100.0
    interrupts.heed()
    assert not caplog.messages


@pytest.mark.parametrize(
    ("function", "options"),
    [(steering.keep_hopping, {}), (steering.start_up, {"pumps": 2}), (steering.recover, {"short": 0.1})],
)
def test_steering_is_one_computation(monkeypatch, function, options):
    """From its first orbit to its last nonlinear program, so that it is not silent between them."""
    names = set()
    started = lambda name: names.add(name) or nullcontext()  # noqa: E731
    monkeypatch.setattr(import_module("orbits.running.exclusive"), "running", started)
    with pytest.raises(InputError, match="stroke = -1"):
        function(Hopper(), stroke=-1.0, **options)
    assert function.__name__ in names
