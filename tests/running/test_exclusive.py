"""Threads take turns with CasADi, and children of `fork` go on.

Calls in threads are made by a process of their own, which a fault ends by a signal."""

import threading

import casadi as ca
import pytest
from scripts import run

from orbits import InputError, find_all, multiplier, trace
from orbits.running import LOCK, apart, exclusive, in_threads
from orbits.running.exclusive import _DYING, MOST_DYING
from problems import Hopper


@pytest.mark.slow
def test_calls_in_threads_and_a_child_give_the_sequential_answers():
    """Each kind of call, by more threads than there are cores; the script by hand takes any number of both."""
    run("running/concurrent_calls.py", 6, 12)


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


@pytest.mark.parametrize("progress", [True, 3, "x"])
def test_a_progress_that_is_no_function_is_refused(progress):
    with pytest.raises(InputError, match="it must be a function of the share that is done"):
        find_all(Hopper("cubic", parameters={"beta": 0.3}), progress=progress)


def test_graphs_that_end_in_another_thread_are_released_under_the_lock():
    x = ca.SX.sym("x")
    held = [ca.Function("f", [x], [ca.sin(x)])]
    with LOCK:
        in_thread(held.clear)
        assert len(_DYING) > 0  # it waits, as this thread may be using the graph
    multiplier(Hopper(), 4.6)
    assert len(_DYING) == 0


@pytest.mark.parametrize("use", [lambda f: f(1.0), lambda f: ca.SX(1.0)], ids=["call", "new object"])
def test_a_program_of_casadi_alone_keeps_few_objects_that_ended(use):
    x = ca.SX.sym("x")
    f, most = ca.Function("f", [x], [ca.sin(x)]), 0
    for _ in range(1000):
        use(f)
        most = max(most, len(_DYING))
    assert most <= MOST_DYING + 9


def test_what_an_object_refers_to_ends_while_the_lock_is_held():
    owned = []

    class Graph:
        def __del__(self):
            owned.append(LOCK._is_owned())

    x = ca.SX.sym("x")
    x.__dict__["this"] = Graph()
    del x
    multiplier(Hopper(), 4.6)
    assert owned == [True]


@pytest.mark.parametrize("threads", ["1", "3"])
def test_threads_share_the_items_of_a_call(monkeypatch, threads):
    """They have the lock one at a time, except where they are apart; errors and results are those of one thread."""
    monkeypatch.setenv("ORBITS_THREADS", threads)
    inside, most, meet = [], [], threading.Barrier(int(threads))

    def square(item: int) -> int:
        inside.append(item)
        most.append(len(inside))
        inside.remove(item)
        with apart():
            meet.wait(10.0)  # all threads come here together
        if item == 100:
            raise InputError("one item fails")
        return item**2

    with LOCK:
        assert in_threads(square, range(6)) == [0, 1, 4, 9, 16, 25]
        assert max(most) == 1
        with pytest.raises(InputError, match="one item fails"):
            in_threads(square, [1, 100, 3])
        assert in_threads(square, []) == []
