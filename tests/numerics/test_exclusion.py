"""Bernstein exclusion of many polynomials, in machine code and interpreted, against NumPy's Bernstein coefficients."""

from fractions import Fraction
from itertools import pairwise
from math import comb

import numpy as np
import pytest

from orbits.numerics import PiecewisePolynomials, derivative, polynomial_roots, powers
from orbits.numerics.exclusion import sign_changes
from orbits.numerics.polynomial_roots import POLYNOMIALS, bernstein


def test_control_values_in_fractions():
    """A polynomial of degree 4 and its rate, after a zero of order 1: all coefficients worked out in fractions."""
    c, h = [0, -3, 5, -2, 1], Fraction(7, 4)
    for by_rate, order in ((False, 1), (True, 0), (True, 1)):
        series = [k * c[k] for k in range(1, 5)] + [0] if by_rate else c
        series = series[order:] + [0] * order
        values = [sum(Fraction(comb(j, k), comb(4, k)) * series[k] * h**k for k in range(j + 1)) for j in range(5)]
        changes = sum((a >= 0) != (b >= 0) for a, b in pairwise(values))
        found = sign_changes(5)(*(np.array([row], float) for row in (c, [h], [order], [by_rate])))
        assert [float(each[0, 0]) for each in found] == pytest.approx([values[0], values[-1], changes], abs=1e-14)


@pytest.mark.parametrize("compiled", [False, True])
def test_as_numpy_finds_them(compiled):
    """In 500 polynomials the sign changes are those of NumPy's coefficients, which are far enough from 0."""
    rng = np.random.default_rng(12)
    c, h, by_rate = rng.normal(size=(500, 13)), rng.uniform(0.2, 2.0, 500), rng.random(500) < 0.5
    function = sign_changes(13)
    if compiled:
        assert function.kernel.compile()
    begins, ends, changes = (each[:, 0] for each in function(c, *(x[:, None] for x in (h, np.zeros(500), by_rate))))
    rates = np.zeros_like(c)
    rates[:, :-1] = derivative(c)
    values = bernstein(np.where(by_rate[:, None], rates, c), powers(h, 13))
    positive = values >= 0
    far = np.abs(values).min(1) > 1e-9
    assert far.sum() > 400
    assert (changes == (positive[:, 1:] != positive[:, :-1]).sum(1))[far].all()
    assert begins == pytest.approx(values[:, 0], rel=1e-14)
    assert ends == pytest.approx(values[:, -1], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("stationary", [False, True])
@pytest.mark.parametrize("rising", [False, True])
def test_nothing_is_lost_by_exclusion(stationary, rising, monkeypatch):
    """Roots among many pieces, with exclusion, are those without it, whatever the signs with which they begin."""
    rng = np.random.default_rng(13)
    c, steps = rng.normal(size=(300, 9)), rng.uniform(0.3, 1.5, 300)
    counts = np.array([3] * 80 + [60])
    for i in np.delete(np.arange(299), counts.cumsum()[:-1] - 1):  # joined up
        c[i + 1, 0] = c[i] @ steps[i] ** np.arange(9)
        c[i + 1, 1] = derivative(c[i]) @ steps[i] ** np.arange(8)
    # A zero of order 4 is more than the machine code divides out.
    c[::9, :4], orders = (
        0.0,
        np.where(np.isin(counts.cumsum() - counts, range(0, 300, 9)), 4 - stationary, rng.integers(0, 3, 81)),
    )
    before = rng.integers(-1, 2, 81)
    found = []
    for few in (10, 1000):
        monkeypatch.setattr(polynomial_roots, "POLYNOMIALS", POLYNOMIALS._replace(few_pieces=few))
        polynomials = PiecewisePolynomials(c, steps, counts)
        found.append((polynomials.roots(orders, rising, before, stationary), polynomials.after))
    (places, after), (others, after_others) = found
    assert len(places[0]) > 50
    for mine, theirs in zip(places, others, strict=True):
        assert np.array_equal(mine, theirs)
    assert np.array_equal(after, after_others)


def test_no_pieces_and_constant_ones():
    """Where there is no piece, the sign before is the sign after; a constant has no root, and no rate."""
    none = PiecewisePolynomials(np.zeros((0, 5)), np.zeros(0), np.zeros(2, int))
    assert all(len(each) == 0 for each in none.roots(before=np.array([-1, 1])))
    assert none.after.tolist() == [-1.0, 1.0]
    for count in (3, 150):
        constant = PiecewisePolynomials(-np.ones((count, 1)), np.ones(count), np.array([count]))
        assert len(constant.roots()[0]) == 0
        assert constant.after.tolist() == [-1.0]
