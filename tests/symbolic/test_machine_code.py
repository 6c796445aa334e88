"""Machine code against CasADi's virtual machine, number for number, and what runs without it."""

import pickle
import sys

import casadi as ca
import numpy as np
import pytest
from kernel_functions import assert_equal, both, countdown, once, starts

from orbits import find
from orbits.errors import NoMachineCode
from orbits.symbolic import CodedFunction, Kernel, machine_code, vector_code
from orbits.symbolic.machine_code import coded
from problems import Hopper

x, y = ca.SX.sym("x"), ca.SX.sym("y")
# Every operation that has machine code, by its code, with its expression.
TRIGONOMETRIC = [start + name + end for start in ("", "A") for name in ("SIN", "COS", "TAN") for end in ("", "H")]
UNARY = ["NEG", "EXP", "LOG", "SQRT", "SQ", "TWICE", "FLOOR", "CEIL", "NOT", "FABS", "SIGN", "ERF", "INV"]
UNARY += [*TRIGONOMETRIC, "LOG1P", "EXPM1"]
BINARY = ["ADD", "SUB", "MUL", "DIV", "POW", "CONSTPOW", "LT", "LE", "EQ", "NE", "AND", "OR", "FMOD", "REMAINDER"]
BINARY += ["COPYSIGN", "IF_ELSE_ZERO", "FMIN", "FMAX", "ATAN2", "HYPOT"]
SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, 2.0, -3.0, 1e-300, 1e300, np.inf, -np.inf, np.nan, 0.1, 7.0]


@pytest.mark.parametrize("lanes", [2, 4, 8])
def test_every_operation(monkeypatch, lanes):
    """On numbers of all kinds and vectors of all lengths: each operation is the virtual machine's to the last bit."""
    llvm, _ = machine_code.target()
    monkeypatch.setattr(machine_code, "target", lambda: (llvm, lanes))
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


@pytest.mark.parametrize("seed", range(6))
def test_random_graphs(seed):
    rng = np.random.default_rng(seed)
    assert_equal(*both(once(*random_graph(rng, 200)), rng.normal(0, 2, (37, 3))))


def test_a_function_that_the_c_library_lacks_is_interpreted(monkeypatch):
    monkeypatch.setitem(vector_code._LIBRARY, ca.OP_ERF, "no_such_function")
    kernel = Kernel(once([x], [ca.erf(x)]))
    assert not kernel.compile()
    assert kernel(np.array([[0.5]])).records[0] == pytest.approx(0.5204998778130465)


@pytest.fixture
def unsaid():
    """Nothing has been said of machine code that cannot be made, in this test and after it."""
    for function in (machine_code.target, machine_code.say_interpreted):
        function.cache_clear()
    yield
    for function in (machine_code.target, machine_code.say_interpreted):
        function.cache_clear()


def test_without_machine_code_it_is_interpreted(monkeypatch, unsaid):
    """Where LLVM is missing, which is said once."""
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    monkeypatch.setitem(sys.modules, "llvmlite.binding", None)
    kernel = Kernel(countdown())
    kernel.interpretation_budget = -1.0
    with pytest.warns(RuntimeWarning, match="machine code, which cannot be made here"):
        few = kernel(starts(5, 6), np.ones((1, 1)))
    assert (few.counts == starts(5, 6)[:, 1] // 2).all()
    assert not Kernel(countdown()).compile()  # without a second warning
    for _ in range(2):  # of a law that nothing else has, so that no machine code is there
        with pytest.raises(NoMachineCode, match="install llvmlite"):
            find(Hopper("r + c*r**7", parameters={"c": 0.1}))


def test_an_operation_without_machine_code_is_interpreted():
    kernel = Kernel(once([x], [ca.SX.unary(ca.OP_ERFINV, x)]))
    kernel.interpretation_budget = -1.0
    assert kernel(np.full((3, 1), 0.5)).records[0] == pytest.approx(0.4769362762044699)
    assert not kernel.compiled


def test_llvm_fails(monkeypatch, unsaid):
    """Which is said once for all kernels; what is coded alone is refused."""
    one = Kernel(countdown())(starts(5, 6), np.ones((1, 1)))

    def failing(*_):
        raise RuntimeError("LLVM says no")

    monkeypatch.setattr("llvmlite.binding.Target.from_default_triple", failing)
    kernel = Kernel(countdown())
    with pytest.warns(RuntimeWarning, match="machine code, which cannot be made here") as said:
        assert not kernel.compile()
    assert not Kernel(countdown()).compile()
    assert len(said) == 1
    assert_equal(kernel(starts(5, 6), np.ones((1, 1))), one)
    alone = Kernel(CodedFunction([1], [1, 1, 1], lambda code, arguments: [arguments[0]] * 3))
    for _ in range(2):
        with pytest.raises(NoMachineCode, match="LLVM cannot make machine code: LLVM says no"):
            alone(np.zeros((1, 1)))


def test_code_from_another_process(monkeypatch):
    """Received code is used where the text is the same, and another text is compiled here."""
    monkeypatch.setattr(machine_code, "_received", {})
    first = machine_code.MachineCode(coded(countdown()))
    machine_code.receive(pickle.loads(pickle.dumps(machine_code.compiled_here())))
    again = machine_code.MachineCode(coded(countdown()))
    assert again.compiled is machine_code._received[first.key]
    assert machine_code.MachineCode(coded(once([x], [x**2]))).key not in machine_code._received
