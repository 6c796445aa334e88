"""Kernels: functions that are iterated at many points, in lanes and threads, within their bounds."""

import signal
import threading

import casadi as ca
import numpy as np
import pytest
from kernel_functions import assert_equal, both, countdown, starts

from orbits import InputError, ReturnMap, find, follow
from orbits.running import interrupts
from orbits.symbolic import Kernel, kernels
from problems import Hopper


@pytest.mark.parametrize("count", [1, 7, 8, 100])
def test_each_lane_until_it_is_done(count):
    """More records than there is room for at first; the data of each point, or one for all."""
    z = starts(count, 3)
    for step in (np.ones((1, 1)), np.linspace(1, 2, count)[:, None]):
        compiled, interpreted = both(countdown(), z, step)
        assert_equal(compiled, interpreted)
        assert (compiled.counts == (z[:, 1] // 2).astype(int)).all()
        assert not compiled.going.any()
        ends = np.broadcast_to(step[:, 0], count) * z[:, 2] * 2 * (1 - 0.5 ** z[:, 1])
        assert compiled.z[:, 0] == pytest.approx(ends, rel=1e-14)
        owner = np.repeat(np.arange(count), compiled.counts)
        assert (compiled.records[0][:, 5] * 2.0 ** (z[owner, 1] - compiled.records[0][:, 4]) == z[owner, 2]).all()


def test_the_most_records():
    """A point with more of them stops there, and says that it would go on."""
    z = starts(50, 4)
    compiled, _ = both(countdown(), z, np.ones((1, 1)))
    for most in (1, 5, 20):
        kernel = Kernel(countdown())
        kernel.compile()
        some = kernel(z, np.ones((1, 1)), most=most)
        assert (some.counts == np.minimum(compiled.counts, most)).all()
        assert (some.going == (z[:, 1] // 2 >= most)).all()


def test_a_graph_is_compiled_once_that_is_repaid():
    """After as much time of interpreting as that takes, however many calls it is divided into, with equal results."""
    kernel, z, step = Kernel(countdown()), starts(20, 5), np.ones((1, 1))
    first, calls = kernel(z, step), 1
    while not kernel.compiled:
        assert_equal(kernel(z, step), first)
        calls += 1
    assert 1 < calls < 5000
    assert_equal(kernel(z, step), first)


def endless() -> ca.Function:
    """Counts for ever, and records the numbers below a bound."""
    z = ca.SX.sym("z", 2)
    return ca.Function("endless", [z], [ca.vertcat(z[0] + 1, z[1]), z[0], z[0] < z[1], 1])


def test_what_never_ends_is_stopped():
    """After the most iterations, with what was recorded until then, and said to be going on."""
    points = np.array([[0.0, 0.0], [0.0, 3.0], [0.0, 7.0]])
    for found in both(endless(), points):
        assert found.going.all()
        assert (found.z[:, 0] == kernels.KERNELS.longest_run).all()
        assert found.counts.tolist() == [0, 3, 7]


@pytest.mark.parametrize("scratch", [kernels.KERNELS.scratch, 100])
def test_the_most_iterations_are_those_of_a_point(monkeypatch, scratch):
    """However many calls they are divided into, as by the room for records, which grows from call to call."""
    monkeypatch.setattr(kernels, "KERNELS", kernels.KERNELS._replace(longest_run=1000, scratch=scratch))
    points = np.column_stack([np.zeros(20), np.linspace(0, 1500, 20)])
    compiled, interpreted = Kernel(endless()), Kernel(endless())
    compiled.compile()
    interpreted.interpretation_budget = np.inf
    for _ in range(2):
        for kernel in (compiled, interpreted):
            found = kernel(points)
            assert (found.z[:, 0] == 1000).all()
            assert (found.counts == np.minimum(np.ceil(points[:, 1]), 1000)).all()
            assert found.going.all()
            assert (np.concatenate([np.arange(count) for count in found.counts]) == found.records[0][:, 0]).all()


def interrupted(kernel: Kernel, *arguments: np.ndarray) -> None:
    """A call while a keyboard interrupt is noted."""
    with interrupts.deferred():
        signal.raise_signal(signal.SIGINT)
        kernel(*arguments)


@pytest.mark.parametrize("threads", ["1", "2"])
def test_an_interrupt_ends_a_long_call(monkeypatch, threads):
    """Within a few short calls of machine code, where one for all iterations of so many points takes seconds."""
    monkeypatch.setenv("ORBITS_THREADS", threads)
    kernel, calls = Kernel(endless()), []
    kernel.compile()
    chunk = Kernel._chunk
    monkeypatch.setattr(Kernel, "_chunk", lambda *arguments: calls.append(arguments[3]) or chunk(*arguments))
    with pytest.raises(KeyboardInterrupt):
        interrupted(kernel, np.tile([0.0, 9.0], (40_000, 1)))
    assert len(calls) <= 4
    assert max(ends[:, 2].sum() for ends in calls) <= kernels.KERNELS.points * kernels.KERNELS.longest_run / 5


def test_scratch_memory_is_bounded(monkeypatch):
    """A point with many records, and as many points as fit beside each other."""
    monkeypatch.setattr(kernels, "KERNELS", kernels.KERNELS._replace(scratch=3000))
    monkeypatch.setattr(kernels, "_memory", memory := threading.local())
    kernel = Kernel(countdown())
    kernel.compile()
    for count in (1, 500):
        z = starts(count, 7)
        z[0, 1] = 10_000
        found = kernel(z, np.ones((1, 1)))
        assert found.counts[0] == 5000
        assert len(memory.records) <= 3000


def test_arguments_of_other_shapes_are_refused():
    """Machine code would read beyond their ends."""
    z, step = starts(5, 1), np.ones((1, 1))
    for compiled in (False, True):
        kernel = Kernel(countdown())
        if compiled:
            kernel.compile()
        for wrong in ((z[:, :2], step), (z, np.ones((4, 1))), (z, np.ones((5, 2))), (z[:0], step), (z,), (z[0], step)):
            with pytest.raises(ValueError, match="arguments of shapes"):
                kernel(*wrong)


def test_any_number_of_threads(monkeypatch):
    """Not a bit depends on it, nor on how the points are divided."""
    kernel, z = Kernel(countdown()), starts(1000, 5)
    kernel.compile()
    one = kernel(z, np.ones((1, 1)))
    monkeypatch.setattr(kernels, "KERNELS", kernels.KERNELS._replace(scratch=5000))
    for threads in ("2", "3", "16"):
        monkeypatch.setenv("ORBITS_THREADS", threads)
        assert_equal(kernel(z, np.ones((1, 1))), one)
    monkeypatch.setenv("ORBITS_THREADS", "")
    assert_equal(kernel(z, np.ones((1, 1))), one)


@pytest.mark.parametrize("threads", ["none", "0", "-1", "2.0", "1_0", "\u0663", "257", " 2", "9" * 5000])
def test_a_number_of_threads_that_is_none(monkeypatch, threads):
    """It is refused where a public function begins, and is no failure of an orbit."""
    machine = Hopper("r + beta*r**3", parameters={"beta": 0.3})
    step = ReturnMap(machine)
    monkeypatch.setenv("ORBITS_THREADS", threads)
    calls = [lambda: find(machine), lambda: follow(machine, "beta", 1.0), lambda: step([4.4])]
    for call in calls:
        with pytest.raises(InputError, match="whole number of threads, from 1 to 256"):
            call()


@pytest.mark.parametrize("line", ["find", "follow --along beta --to 1", "map --alpha 4.4"])
def test_the_command_refuses_a_number_of_threads_that_is_none(monkeypatch, orbits, line):
    monkeypatch.setenv("ORBITS_THREADS", "two")
    done = orbits(f"{line} --spring 'r + beta*r**3' --set beta=0.3")
    assert (done.code, done.out) == (2, "")
    assert "ORBITS_THREADS = 'two': set it to a whole number" in done.err


def test_rows_of_a_table():
    """Each point goes through the rows of its own table, or of one that all share, up to a row that leads to itself."""
    z, row, nothing = ca.SX.sym("z", 2), ca.SX.sym("row", 2), ca.SX.sym("d", 0)
    after = ca.vertcat(z[0] + row[0], row[1])
    function = ca.Function("walk", [z, nothing, row], [after, z[1], 1, row[1] != z[1]])
    rng, tables, starts = np.random.default_rng(4), [], np.zeros((11, 2))
    for _ in starts:
        order = rng.permutation(6)
        table = np.column_stack([rng.normal(size=6), np.full(6, order[-1])])
        table[order[:-1], 1] = order[1:]
        tables.append(table)
    starts[:, 1] = [np.setdiff1d(np.arange(6), table[:, 1])[0] for table in tables]
    own, none = np.array([table.ravel() for table in tables]), np.zeros((1, 0))
    for several in (own, own[:1]):
        compiled, interpreted = Kernel(function, 1), Kernel(function, 1)
        assert compiled.compile()
        interpreted.interpretation_budget = np.inf
        one, other = compiled(starts, none, several), interpreted(starts, none, several)
        assert_equal(one, other)
    assert compiled(starts, none, own).z[:, 0] == pytest.approx([table[:, 0].sum() for table in tables])


def test_one_point_is_computed_as_among_many():
    """In the same bits, with records and after another number of points; and with more records than there is room."""
    z, data = ca.SX.sym("z", 2), ca.SX.sym("data", 1)
    step = ca.vertcat(z[0] * data + ca.sin(z[1]), z[1] + 1)
    kernel = Kernel(ca.Function("step", [z, data], [step, z, z[0] ** 2, 1, z[1] < 40]))
    kernel.compile()
    starts = np.column_stack([np.linspace(0.1, 0.9, 5), np.arange(5) * 7.0])
    many = kernel(starts, np.array([[0.7]]))
    for i, start in enumerate(starts):
        one = kernel(start[None], np.array([[0.7]]))
        assert np.array_equal(one.z[0], many.z[i])
        assert one.counts[0] == many.counts[i]
        own = np.repeat(np.arange(5), many.counts) == i
        for record, among in zip(one.records, many.records, strict=True):
            assert np.array_equal(record, among[own])
    few = kernel(starts[:1], np.array([[0.7]]), most=3)
    assert few.counts[0] == 3
    assert few.going[0]
