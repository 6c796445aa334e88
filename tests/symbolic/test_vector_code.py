"""The text of vector code: rough powers, loops and blocks, in vectors of every length."""

import casadi as ca
import numpy as np
import pytest

from orbits.symbolic import CodedFunction, Kernel, lane_numbers, machine_code, vector_code


def powers(code, arguments):
    """x to the power y."""
    return [arguments[0], [code.rough_power(*arguments[0])], [code.splat(1)], [code.splat(0)]]


@pytest.mark.parametrize("lanes", [2, 4, 8])
def test_rough_powers(monkeypatch, lanes):
    """To 2e-6 of the power; 0 of 0, and what is large of infinity and NaN."""
    llvm, _ = machine_code.target()
    monkeypatch.setattr(machine_code, "target", lambda: (llvm, lanes))
    kernel = Kernel(CodedFunction([2], [2, 1, 1, 1], powers))
    rng = np.random.default_rng(1)
    bases, exponents = 10 ** rng.uniform(-250, 250, 400), 1 / rng.uniform(10, 40, 400)
    found = kernel(np.column_stack([bases, exponents])).records[0][:, 0]
    assert found == pytest.approx(bases**exponents, rel=2e-6)
    zero, infinite, nan = kernel(np.array([[0.0, 0.1], [np.inf, 0.04], [np.nan, 0.04]])).records[0][:, 0]
    assert zero == 0.0
    assert min(infinite, nan) > 1e10


@pytest.mark.parametrize("lanes", [2, 4, 8])
def test_blocks_are_recorded_lane_by_lane(monkeypatch, lanes):
    """Sixteen vectors of the scratch memory as sixteen numbers of each lane that records, and of no other."""
    llvm, _ = machine_code.target()
    monkeypatch.setattr(machine_code, "target", lambda: (llvm, lanes))

    def multiples(code, arguments):
        value, left = (lane_numbers.Number(code, each) for each in arguments[0])
        block = vector_code.Block(code.reserve(16), 16)
        for i in range(16):
            code.put((value * float(i)).name, code.place(block.place + i))
        odd = (left - (left * 0.5)._by(ca.OP_FLOOR, left * 0.5) * 2.0) > 0.5
        return [[(value + 1.0).name, (left - 1.0).name], block, [odd.value()], [(left > 1.0).value()]]

    z = np.column_stack([np.arange(11) * 1e3, np.arange(11) % 5 + 1.0])
    found = Kernel(CodedFunction([2], [2, 16, 1, 1], multiples))(z)
    expected = [start + i for start, left in z for i in range(int(left)) if (left - i) % 2 == 1]
    assert np.array_equal(found.records[0], np.multiply.outer(expected, np.arange(16.0)))


def test_loops_without_a_turn():
    """A loop up to a number that is known at run time alone, also below its first index."""

    def summed(code, arguments):
        last = code(
            f"extractelement {code.indices} {code(f'fptosi {code.vector} {arguments[0][0]} to {code.indices}')}, i32 0"
        )
        (total,) = code.loop(1, last, lambda index, totals: [code.plus(totals[0], code.splat(2))], [code.splat(0)])
        return [arguments[0], [total], [code.splat(1)], [code.splat(0)]]

    kernel = Kernel(CodedFunction([1], [1, 1, 1, 1], summed))
    for last in (-1, 0, 1, 5):
        assert kernel(np.full((1, 1), float(last))).records[0] == 2 * max(last, 0)
