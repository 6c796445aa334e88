"""The line of a sweep's progress: what it says, when it is written anew, and where there is none."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from orbits.errors import InputError
from orbits.running import heartbeat
from orbits.sweeps.progress import on_screen


def state(done: int, seconds: float, left: float, **statuses: int) -> SimpleNamespace:
    """The progress of a sweep over 100 members, of which 20 were there before."""
    return SimpleNamespace(done=done, whole=100, before=20, seconds=seconds, left=left, statuses=statuses)


@pytest.mark.parametrize(
    ("seconds", "left", "said"),
    [
        (8.0, 16.0, "60 of 100 members in 8 s (5/s), 16 s left: 55 certified, 5 failed"),
        (120.0, 60.0, "60 of 100 members in 2 min (0/s), 60 s left: 55 certified, 5 failed"),
        (9000.0, 7200.0, "60 of 100 members in 2.5 h (0/s), 2.0 h left: 55 certified, 5 failed"),
    ],
)
def test_what_the_line_says(seconds, left, said, capsys):
    on_screen(True)(state(60, seconds, left, failed=5, certified=55))
    assert capsys.readouterr().err == f"\r{said}"


def test_the_line_is_written_anew_over_the_one_before_and_ends(capsys):
    """What comes too soon after another line is left out, but for the last."""
    show = on_screen(True)
    for done in (60, 61, 100):
        show(state(done, 8.0, 16.0, certified=done))
    first, last = capsys.readouterr().err.removeprefix("\r").split("\r")
    assert first == "60 of 100 members in 8 s (5/s), 16 s left: 60 certified"
    assert last.rstrip() == "100 of 100 members in 8 s (10/s): 100 certified"
    assert last.endswith("\n")
    assert len(last) == len(first) + 1


def test_without_a_terminal_there_is_no_line(capsys, monkeypatch):
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
    for progress in (False, None):
        on_screen(progress)(state(60, 8.0, 16.0))
    assert capsys.readouterr().err == ""
    assert on_screen(print) is print


def test_without_a_terminal_the_messages_say_how_far_it_is(monkeypatch, caplog):
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
    monkeypatch.setattr(heartbeat, "SILENCE", -1.0)
    with heartbeat.running("sweep"):
        on_screen(None)(state(60, 8.0, 16.0, certified=60))
        heartbeat.beat()
    assert caplog.messages == [
        "sweep has been computing for 0 s: 60 of 100 members in 8 s (5/s), 16 s left: 60 certified"
    ]


@pytest.mark.parametrize(("terminal", "notebook"), [(True, False), (False, True), (False, False)])
def test_a_line_is_shown_on_terminals_and_in_notebooks(terminal, notebook, capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
    if notebook:
        monkeypatch.setitem(sys.modules, "ipykernel", SimpleNamespace())
    on_screen(None)(state(60, 8.0, 16.0, certified=60))
    assert bool(capsys.readouterr().err) == (terminal or notebook)


@pytest.mark.parametrize("progress", [np.nan, 1, "bar"])
def test_what_is_no_function_and_no_truth_value_is_refused(progress):
    with pytest.raises(InputError, match=r"progress = .*; it must be True or False"):
        on_screen(progress)
