"""The line of a sweep's progress: what it says, when it is written anew, and where there is none."""

import sys
from types import SimpleNamespace

import pytest

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
