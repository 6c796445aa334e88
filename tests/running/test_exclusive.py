"""Threads take turns with CasADi, and children of `fork` go on.

Calls in threads are made by a process of their own, which a fault ends by a signal."""

import threading

import casadi as ca
import pytest
from scripts import run

from orbits import trace
from orbits.running.exclusive import _DYING, LOCK, exclusive
from problems import Hopper


def test_calls_in_threads_and_a_child_give_the_sequential_answers():
    run("running/concurrent_calls.py", 8, 16)


@pytest.mark.slow
def test_many_calls_in_threads_give_the_sequential_answers():
    run("running/concurrent_calls.py", 8, 80)


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
