"""Threads take turns with CasADi, children of `fork` go on, and what is kept is bounded.

Calls in threads are made by a process of their own, which a fault ends by a signal.
"""

import os
import subprocess
import sys
import threading
from pathlib import Path

import casadi as ca
import pytest

from orbits import find, trace
from orbits.running.exclusive import _DYING, LOCK, exclusive
from orbits.symbolic import kept
from problems import Hopper

HERE = Path(__file__).parent


def run(script: str, *numbers: int) -> None:
    environment = {**os.environ, "PYTHONPATH": str(HERE.parent.parent)}
    command = [sys.executable, str(HERE / script), *map(str, numbers)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=HERE.parent.parent, env=environment)
    assert done.returncode == 0, done.stdout[-500:] + done.stderr[-3000:]


def test_calls_in_threads_and_a_child_give_the_sequential_answers():
    run("concurrent_calls.py", 8, 16)


@pytest.mark.slow
def test_many_calls_in_threads_give_the_sequential_answers():
    run("concurrent_calls.py", 8, 80)


@pytest.mark.slow
def test_many_laws_take_little_memory():
    run("many_laws.py", 12, 400)


def in_thread(function):
    """What a function returns in another thread; None where it has not ended within a second."""
    results = []
    thread = threading.Thread(target=lambda: results.append(function()), daemon=True)
    thread.start()
    thread.join(1.0)
    return results[0] if results else None


def free() -> bool:
    """Whether this thread can take the lock now."""
    if taken := LOCK.acquire(blocking=False):
        LOCK.release()
    return taken


def test_the_lock_is_held_in_a_call_and_not_between_orbits():
    assert in_thread(free)
    assert exclusive(lambda: in_thread(free))() is False
    orbits = trace(Hopper("r + b*r**3", parameters={"b": 0.1}), "b", 0.3)
    next(orbits)
    assert in_thread(free)


def test_graphs_that_end_in_another_thread_are_released_under_the_lock():
    x = ca.SX.sym("x")
    held = [ca.Function("f", [x], [ca.sin(x)])]
    with LOCK:
        in_thread(held.clear)
        assert len(_DYING) > 0  # it waits, as this thread may be using the graph
        del x
        assert len(_DYING) == 0


def test_what_an_object_refers_to_ends_while_the_lock_is_held():
    owned = []

    class Graph:
        def __del__(self):
            owned.append(LOCK._is_owned())

    x = ca.SX.sym("x")
    x.__dict__["this"] = Graph()
    del x
    assert owned == [True]


def test_what_is_kept_is_let_go_of_when_it_grows(monkeypatch):
    monkeypatch.setattr(kept, "BUDGET", 3e6)
    most = 0.0
    for k in range(6):
        find(Hopper(f"r + 0.1{k}*r**3"))
        most = max(most, kept._built)
    assert 0.5e6 < most <= 3e6
    assert find(Hopper("r + 0.3*r**3")).alpha == find(Hopper("r + 0.3*r**3")).alpha
