"""Kernels: machine code against CasADi's virtual machine, number for number, and what does not depend on it."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import casadi as ca
import numpy as np
import pytest

from orbits.errors import InputError
from orbits.flow import taylor
from orbits.flow.flow import flow_of
from orbits.symbolic import kernels, machine_code
from orbits.symbolic.kernels import Kernel
from problems import Hopper

x, y = ca.SX.sym("x"), ca.SX.sym("y")
# Every operation that has machine code, by its code, with its expression.
TRIGONOMETRIC = [start + name + end for start in ("", "A") for name in ("SIN", "COS", "TAN") for end in ("", "H")]
UNARY = ["NEG", "EXP", "LOG", "SQRT", "SQ", "TWICE", "FLOOR", "CEIL", "NOT", "FABS", "SIGN", "ERF", "INV"]
UNARY += [*TRIGONOMETRIC, "LOG1P", "EXPM1"]
BINARY = ["ADD", "SUB", "MUL", "DIV", "POW", "CONSTPOW", "LT", "LE", "EQ", "NE", "AND", "OR", "FMOD", "REMAINDER"]
BINARY += ["COPYSIGN", "IF_ELSE_ZERO", "FMIN", "FMAX", "ATAN2", "HYPOT"]
SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, 2.0, -3.0, 1e-300, 1e300, np.inf, -np.inf, np.nan, 0.1, 7.0]


def once(arguments: list, results: list) -> ca.Function:
    """A function of one step that is recorded, as a kernel iterates it."""
    z = ca.vertcat(*arguments)
    return ca.Function("once", [z], [z, ca.vertcat(*results), 1, 0])


def both(function: ca.Function, *arguments) -> tuple:
    """What a kernel makes of it in machine code, and interpreted."""
    compiled, interpreted = Kernel(function), Kernel(function)
    assert compiled.compile()
    interpreted.interpretation_budget = np.inf
    found = compiled(*arguments), interpreted(*arguments)
    assert not interpreted.compiled
    return found


def assert_equal(one, other):
    """Both are the same to the last bit, and zeros have the same sign."""
    assert (one.counts == other.counts).all()
    assert (one.going == other.going).all()
    for mine, theirs in zip([one.z, *one.records], [other.z, *other.records], strict=True):
        assert np.array_equal(mine, theirs, equal_nan=True)
        signed = ~np.isnan(mine)
        assert (np.signbit(mine) == np.signbit(theirs))[signed].all()


def test_every_operation():
    """On numbers of all kinds: each operation is the virtual machine's to the last bit."""
    results = [ca.SX.unary(getattr(ca, f"OP_{name}"), x) for name in UNARY]
    results += [ca.SX.binary(getattr(ca, f"OP_{name}"), x, y) for name in BINARY]
    function = once([x, y], results)
    found = {function.instruction_id(i) for i in range(function.n_instructions())}
    wanted = {getattr(ca, f"OP_{name}") for name in (*UNARY, *BINARY)}
    assert len(wanted - found) <= 2  # CasADi writes some powers otherwise
    special = np.array([[a, b] for a in SPECIAL for b in SPECIAL])
    points = np.concatenate([special, np.random.default_rng(1).normal(0, 3, (200, 2))])
    assert_equal(*both(function, points))


def random_graph(rng, size: int) -> tuple[list, list]:
    """Symbols and the last expressions of a chain of random operations on them."""
    symbols = [ca.SX.sym("z", 1) for _ in range(3)]
    known = [*symbols, *map(ca.SX, rng.normal(size=3).tolist())]
    for _ in range(size):
        a, b = (known[i] for i in rng.integers(len(known), size=2))
        names = UNARY if rng.random() < 0.4 else BINARY
        op = getattr(ca, f"OP_{names[rng.integers(len(names))]}")
        known.append(ca.SX.unary(op, a) if names is UNARY else ca.SX.binary(op, a, b))
    return symbols, known[-40:]


@pytest.mark.parametrize("seed", range(12))
def test_random_graphs(seed):
    rng = np.random.default_rng(seed)
    assert_equal(*both(once(*random_graph(rng, 200)), rng.normal(0, 2, (37, 3))))


def countdown() -> ca.Function:
    """Adds up the halves of a number, as often as the second entry says, and records every other sum."""
    z, step = ca.SX.sym("z", 3), ca.SX.sym("step")
    after = ca.vertcat(z[0] + step * z[2], z[1] - 1, z[2] / 2)
    return ca.Function("countdown", [z, step], [after, ca.vertcat(after, z), step, ca.fmod(z[1], 2) == 0, after[1] > 0])


def starts(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([np.zeros(count), rng.integers(1, 90, count), rng.normal(size=count)])


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


def test_what_never_ends_is_stopped():
    """After the most iterations, with what was recorded until then, and said to be going on."""
    z = ca.SX.sym("z", 2)
    endless = ca.Function("endless", [z], [ca.vertcat(z[0] + 1, z[1]), z[0], z[0] < z[1], 1])
    points = np.array([[0.0, 0.0], [0.0, 3.0], [0.0, 7.0]])
    for found in both(endless, points):
        assert found.going.all()
        assert (found.z[:, 0] == kernels.LONGEST_RUN).all()
        assert found.counts.tolist() == [0, 3, 7]


def test_optimised_code_gives_the_same():
    kernel, z = Kernel(countdown()), starts(50, 8)
    kernel.compile()
    quick = kernel(z, np.ones((1, 1)))
    kernel.optimise()
    assert_equal(kernel(z, np.ones((1, 1))), quick)


def test_any_number_of_threads(monkeypatch):
    """Not a bit depends on it, nor on how the points are divided."""
    kernel, z = Kernel(countdown()), starts(1000, 5)
    kernel.compile()
    one = kernel(z, np.ones((1, 1)))
    monkeypatch.setattr(kernels, "SCRATCH", 5000)
    for threads in ("2", "3", "16"):
        monkeypatch.setenv("ORBITS_THREADS", threads)
        assert_equal(kernel(z, np.ones((1, 1))), one)
    for threads in ("none", "0", "-1", "2.0"):
        monkeypatch.setenv("ORBITS_THREADS", threads)
        with pytest.raises(InputError, match=f"ORBITS_THREADS = '{threads}'"):
            kernel(z, np.ones((1, 1)))


def test_code_runs_to_its_end_while_another_thread_replaces_it():
    kernel, z = Kernel(countdown()), starts(400, 9)
    kernel.compile()
    one = kernel(z, np.ones((1, 1)))
    with ThreadPoolExecutor(2) as pool:
        waiting = [pool.submit(kernel, z, np.ones((1, 1))) for _ in range(20)]
        kernel.optimise()
        for job in waiting:
            assert_equal(job.result(), one)


def test_a_function_that_the_c_library_lacks_is_interpreted(monkeypatch):
    monkeypatch.setitem(machine_code._LIBRARY, ca.OP_ERF, "no_such_function")
    kernel = Kernel(once([x], [ca.erf(x)]))
    assert not kernel.compile()
    assert kernel(np.array([[0.5]])).records[0] == pytest.approx(0.5204998778130465)


LAWS = [
    "cubic",
    "sinh",
    "tanh",
    "toda",
    "r*exp(0.1*r)",
    "r + r**3/(1 + r**2)",
    "sqrt(1 + r)-1",
    "atan(r)",
    "r + sin(r)/9",
]


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("columns", [0, 3])
def test_steps_along_all_kinds_of_laws(law, columns):
    """The steps of motions, and those that watch for zeros, to the last bit."""
    machine = Hopper(law, "1/(1 + z/90)**2", rest_length=9.0)
    names = tuple(machine.values)
    stepper = flow_of(machine.model.flight, names).stepper(columns)
    p = np.array([list(machine.values.values())])
    z = np.zeros((5, 4 * (1 + columns) + 2))
    z[:, :4], z[:, -2:] = np.linspace([1.1, 2.0, 0.1, 0.0], [1.3, 3.0, 0.0, -0.1], 5), (0.9, 1e9)
    z[:, 4:-2] = np.eye(4)[:, :columns].T.ravel()
    compiled, interpreted = both(stepper.kernel.function, z, np.hstack([p, np.ones((1, 1))]))
    assert_equal(compiled, interpreted)
    assert (compiled.counts > 0).all()
    if not columns:
        watched = stepper.watched_state(z[:, :4], np.zeros(5), np.zeros(5), np.zeros((5, 1)))
        data = np.hstack([p, np.eye(4)[2:3], np.zeros((1, 1)), np.full((1, 1), 5.0), np.ones((1, 1))])
        compiled, interpreted = both(taylor._watch_function(stepper, 1, 0), watched, data)
        assert_equal(compiled, interpreted)
        assert (compiled.counts > 0).all()


def test_nothing_is_compiled_for_a_few_points():
    """But for many: what is interpreted until then takes no longer than compiling."""
    kernel, z = Kernel(countdown()), starts(5, 6)
    few = kernel(z, np.ones((1, 1)))
    assert not kernel.compiled
    while not kernel.compiled:
        kernel(starts(1000, 6), np.ones((1, 1)))
    assert_equal(kernel(z, np.ones((1, 1))), few)


def test_without_machine_code_it_is_interpreted(monkeypatch):
    """Where LLVM is missing, which is said once, and where an operation has no machine code."""
    machine_code.target.cache_clear()
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    monkeypatch.setitem(sys.modules, "llvmlite.binding", None)
    kernel = Kernel(countdown())
    kernel.interpretation_budget = -1.0
    with pytest.warns(RuntimeWarning, match="no machine code can be made here"):
        few = kernel(starts(5, 6), np.ones((1, 1)))
    assert (few.counts == starts(5, 6)[:, 1] // 2).all()
    assert not Kernel(countdown()).compile()  # without a second warning
    monkeypatch.undo()
    machine_code.target.cache_clear()
    kernel = Kernel(once([x], [ca.SX.unary(ca.OP_ERFINV, x)]))
    kernel.interpretation_budget = -1.0
    assert kernel(np.full((3, 1), 0.5)).records[0] == pytest.approx(0.4769362762044699)
    assert not kernel.compiled


def test_memory_is_given_back():
    """Machine code goes with its kernel: forty more of them take little."""
    code = """
import resource, casadi as ca, numpy as np
from orbits.symbolic.kernels import Kernel
from problems import Hopper
z = ca.SX.sym("z", 4)
def used(count):
    for i in range(count):
        w = z
        for j in range(100):
            w = w * z + (i + j)
        kernel = Kernel(ca.Function("f", [z], [w, w, 1, 0]))
        assert kernel.compile()
        kernel(np.ones((9, 4)))
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
first = used(5)
print(used(40) - first)
"""
    more = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert float(more) < 10
