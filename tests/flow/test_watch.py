"""What motions are watched for: steps without a zero, and the first zeros in steps, against places on a grid."""

import numpy as np
import pytest

from orbits.flow import TAYLOR, first_events
from orbits.flow.taylor_step import StepSeries
from orbits.flow.watch import _EventSearch, may_change_sign
from orbits.hops import Impacts
from orbits.numerics import HIGHEST_ORDER
from orbits.symbolic import CodedFunction, Kernel, Number
from problems import Hopper


def test_a_step_that_is_excluded_has_no_zero():
    """Random series, most of whose terms soon vanish, after zeros of order 0 to 3: where no sign change is said to be
    possible, there is none in two thousand places; and most of the others have one."""
    rng, size = np.random.default_rng(8), 600
    function = may_change_sign(1, 1, counts=False).map(size)
    orders = rng.integers(0, 4, size)
    c = rng.normal(size=(size, TAYLOR.order + 1)) * rng.uniform(0.1, 0.6, (size, 1)) ** np.arange(TAYLOR.order + 1)
    c[np.arange(TAYLOR.order + 1) < orders[:, None]] = 0.0
    weights, degree = rng.choice([-1.0, 1.0], size), TAYLOR.bound_degree
    head, rest = weights * c.T[: degree + 1 + HIGHEST_ORDER], weights * c.T[degree + 1 :]
    rests = np.vstack([rest.sum(0), np.abs(rest).sum(0)])
    may, after, _ = (np.array(each).ravel() for each in function(head, rests, 1.0, orders, 0.0))
    places = np.linspace(0.0, 1.0, 2001)[1:]
    values = weights[:, None] * (c @ places ** np.arange(TAYLOR.order + 1)[:, None])
    changes = (np.sign(values) != np.sign(values[:, :1])).any(1)
    assert not (changes & (may == 0)).any()
    assert ((values[:, -1] >= 0) == (after > 0)).all()
    assert (may == 0).sum() > 200
    assert changes.sum() > 50


def test_the_first_zero_in_a_step():
    """Of random series with zeros of order 0 to 2 at the start, with a sign before: it is where NumPy's first root is,
    or is said not to be known; and where nothing is searched, the signs stay."""
    rng, count, order = np.random.default_rng(4), 300, TAYLOR.order
    room = -(-(order + 2) // 8) * 8

    def append(code, arguments):
        (z,) = arguments
        place = code.reserve(room)
        for k in range(order + 1):
            code.put(z[k], code.place(place + k))
        h, offset, zeros, sign, wanted = z[order + 1 : order + 6]
        series = StepSeries(code, place, 1, order)
        one = Number(code, code.splat(1))
        search = _EventSearch(series, [([(0, code.splat(1))], offset, sign)], [zeros], one)
        found = search.append(Number(code, h), Number(code, wanted) > 0.0, [code.splat(7)])
        first, which, unknown, there, ends = found
        return [z, [each.name for each in (first, which, unknown, *there, *ends)], [code.splat(1)], [code.splat(0)]]

    c = rng.normal(size=(count, order + 1)) * rng.uniform(0.2, 0.8, (count, 1)) ** np.arange(order + 1)
    zeros, h = rng.integers(0, 3, count), rng.uniform(0.3, 1.5, count)
    c[np.arange(order + 1) < zeros[:, None]] = 0.0
    offset = np.where(zeros > 0, 0.0, rng.normal(0, 0.3, count))
    whole = c + np.outer(offset, np.eye(1, order + 1)[0])
    wanted = rng.random(count) < 0.9
    z = np.column_stack([c, h, offset, zeros, np.zeros(count), wanted])
    found = Kernel(CodedFunction([order + 6], [order + 6, 5, 1, 1], append))(z).records[0]
    known = 0
    for i, (first, which, unknown, there, end) in enumerate(found):
        if not wanted[i]:
            assert (first, end) == (np.inf, 7.0)
            continue
        roots = np.roots(whole[i, zeros[i] :][::-1])
        real = np.sort(roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0) & (roots.real <= h[i])])
        if unknown:
            continue
        known += 1
        assert end == np.sign(np.polyval(whole[i, zeros[i] :][::-1], h[i]))
        assert (first < np.inf) == (len(real) > 0)
        if len(real):
            assert which == 0
            assert abs(first - real[0]) < 1e-9 * h[i]
            assert there == c[i] @ first ** np.arange(order + 1) or abs(there + offset[i]) < 1e-9
    assert known > 150


@pytest.mark.parametrize("spring", ["r + 0.3*r**3", "bilinear"])
def test_no_lane_depends_on_the_others(spring):
    """Lanes wait for each other before events are searched, and for ends of pieces; not a bit depends on which others
    share a vector: neither events nor rows, in another order, alone, or among twice as many."""
    parameters = {"ratio": 3.0, "gap": 0.5} if spring == "bilinear" else {}
    rules = Impacts(Hopper(spring, rest_length=30, restitution=0.5, parameters=parameters))
    rng, count = np.random.default_rng(6), 41
    starts = np.column_stack([*rng.uniform(0.5, 3.0, (2, count)), np.zeros(count), rng.uniform(0.1, 2.0, count)])
    known = first_events(rules.flight, starts, rules.p, rules.flight_watch, 60.0, 1)
    order = rng.permutation(count)
    for which in (order, order[:1], order[:9], np.tile(order, 2)):
        found = first_events(rules.flight, starts[which], rules.p, rules.flight_watch, 60.0, 1)
        assert np.array_equal(found.times, known.times[which], equal_nan=True)
        assert np.array_equal(found.rows, known.rows[which], equal_nan=True)
        assert (found.which == known.which[which]).all()
    assert np.isfinite(known.times).sum() > 30
