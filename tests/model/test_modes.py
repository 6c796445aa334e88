"""Vibration modes of linear mechanisms against matrix exponentials in 30 digits, and an integrated chain."""

from dataclasses import dataclass, replace

import mpmath as mp
import numpy as np
import pytest

from orbits import InputError, simulate
from orbits.model import Affine, linear_modes
from problems import Chain


def mechanism(n: int, thrown: int, seed: int):
    """Inertia, stiffness and load of n coordinates at random, of which so many modes feel no spring."""
    rng = np.random.default_rng(seed)
    inertia, stretches = rng.normal(size=(n, n)), rng.normal(size=(n - thrown, n))
    return inertia @ inertia.T + np.eye(n), stretches.T @ stretches, rng.normal(size=n)


def generator(inertia, stiffness, load):
    """A of (states, 1)' = A (states, 1), with the states y1, y1', y2, ..., in the digits at work."""
    n = len(load)
    m, k, f = (mp.matrix(np.asarray(values).tolist()) for values in (inertia, stiffness, load))
    rates, pushes, a = m**-1 * k, m**-1 * f, mp.zeros(2 * n + 1)
    for i in range(n):
        a[2 * i, 2 * i + 1], a[2 * i + 1, 2 * n] = 1, pushes[i]
        for j in range(n):
            a[2 * i + 1, 2 * j] = -rates[i, j]
    return a


def floats(matrix) -> np.ndarray:
    return np.array(matrix.tolist(), dtype=float)


def pushed_away(n: int, thrown: int, seed: int):
    """The modes where one is pushed away beside those that swing."""
    inertia, stiffness, load = mechanism(n, thrown, seed)
    along = np.linalg.eigh(stiffness)[1][:, thrown]  # of the weakest spring, which now pushes
    return inertia, stiffness - (along @ stiffness @ along + 0.5) * np.outer(along, along), load


@pytest.mark.parametrize(("n", "thrown"), [(2, 0), (3, 1), (4, 1)])
def test_modes_that_are_pushed_away_are_matrix_exponentials(n, thrown):
    """cosh beside cos, and neither of them where a mode is thrown."""
    m, k, f = pushed_away(n, thrown, n)
    modes, start, times = linear_modes(m, k, f), np.random.default_rng(1).normal(size=2 * n), [0.0, 0.7, -2.0, 6.0]
    assert (modes.pushed, modes.thrown) == (1, thrown)
    assert modes.square == pytest.approx(np.abs(modes.squares).max(), rel=1e-15)
    for t in times:
        with mp.workdps(30):
            exact = floats(mp.expm(generator(m, k, f) * t))
        atol = 2e-13 * np.abs(exact).max()
        np.testing.assert_allclose(modes.transition(t), exact[:-1, :-1], atol=atol)
        np.testing.assert_allclose(modes.state(start, t), exact[:-1] @ [*start, 1.0], atol=10 * atol)
        series = modes.series(start, t, 20)[0]
        np.testing.assert_allclose(series @ 0.01 ** np.arange(21), modes.state(start, t + 0.01), atol=10 * atol)
        along = modes.along(np.ones(2 * n), start, t, 20)[0]
        np.testing.assert_allclose(along, series.sum(0), atol=100 * atol)
    until = modes.positive_between(Affine(tuple(np.ones(2 * n))), start[:, None])
    assert [each.tolist() for each in until] == [[np.inf], [0.0]]
    assert modes.positive_until(Affine(tuple(np.ones(2 * n))), start[:, None], 1).tolist() == [0.0]


CASES = [(1, 0), (2, 0), (2, 1), (3, 1), (4, 0), (4, 2), (6, 1)]


@pytest.mark.parametrize(("n", "thrown"), CASES)
def test_states_and_transitions_are_matrix_exponentials(n, thrown):
    m, k, f = mechanism(n, thrown, 10 * n + thrown)
    modes, start, times = linear_modes(m, k, f), np.random.default_rng(1).normal(size=2 * n), [0.0, 0.7, -2.0, 31.0]
    assert modes.thrown == thrown
    with mp.workdps(30):
        exact = [floats(mp.expm(generator(m, k, f) * t)) for t in times]
    for t, matrix in zip(times, exact, strict=True):
        np.testing.assert_allclose(modes.transition(t), matrix[:-1, :-1], atol=2e-13 * np.abs(matrix).max())
    expected = np.array([matrix[:-1] @ [*start, 1.0] for matrix in exact]).T
    scale = max(np.abs(matrix).max() for matrix in exact) * np.abs(start).max()
    np.testing.assert_allclose(modes.state(start, np.array(times)), expected, atol=2e-13 * scale)
    each = np.tile(start[:, None, None], (1, 2, 1))
    grid = modes.state(each, np.reshape(times, (2, 2)))
    np.testing.assert_allclose(grid.reshape(2 * n, 4), modes.state(start, np.array(times)), rtol=1e-13, atol=1e-13)
    assert modes.state(np.zeros((2 * n, 0)), np.zeros(0)).shape == (2 * n, 0)
    several = np.column_stack([start, 0.5 * start, -start])
    moved = modes.state(several, 0.7)
    assert moved.shape == several.shape
    np.testing.assert_allclose(moved, exact[1][:-1] @ np.vstack([several, np.ones(3)]), atol=2e-13 * scale)


@pytest.mark.parametrize(("n", "thrown"), CASES)
def test_series_are_the_powers_of_the_generator(n, thrown):
    m, k, f = mechanism(n, thrown, 10 * n + thrown)
    rng, order = np.random.default_rng(2), 8
    weights, start = rng.normal(size=2 * n + 1), rng.normal(size=2 * n)
    seen = rng.normal(size=2 * n), 0.3
    modes = linear_modes(m, k, f, {"a force": seen})
    with mp.workdps(30):
        a = generator(m, k, f)
        at = [mp.expm(a * mp.mpf(t)) * mp.matrix([*start, 1.0]) for t in (0.0, 0.4)]
        powers = [a**j / mp.factorial(j) for j in range(order + 1)]
        exact = np.array([[floats(power * x)[:-1, 0] for power in powers] for x in at])  # (2, order + 1, 2n)
    watched = exact @ seen[0]
    watched[:, 0] += seen[1]
    rows = modes.series(start, np.array([0.0, 0.4]), order)
    np.testing.assert_allclose(rows[:, :-1], exact.swapaxes(1, 2), atol=1e-12 * np.abs(exact).max())
    np.testing.assert_allclose(rows[:, -1], watched, atol=1e-12 * np.abs(exact).max())
    along = modes.along(weights, start, np.array([0.0, 0.4]), order)
    np.testing.assert_allclose(along, exact @ weights[:-1] + weights[-1] * watched, atol=1e-11 * np.abs(exact).max())


@pytest.mark.parametrize("ratio", [1e-8, 1e-3, 1.0, 1e3, 1e8])
def test_two_masses_on_a_spring(ratio):
    """Whatever the masses, all digits of the frequency, of the centre of mass and of the shares in the vibration."""
    stretch = np.array([[1.0, -1.0], [-1.0, 1.0]])
    modes = linear_modes(np.diag([1.0, ratio]), stretch, [-1.0, -ratio])
    np.testing.assert_allclose(modes.squares, [0.0, 1 + 1 / ratio], rtol=1e-15)
    assert modes.shapes[1, 0] / modes.shapes[0, 0] == pytest.approx(1.0, rel=1e-15)
    assert modes.shapes[0, 1] / modes.shapes[1, 1] == pytest.approx(-ratio, rel=2e-15)


def lowest_on_grid(modes, quantity, start, low: float, high: float) -> float:
    return quantity(modes.state(start, np.linspace(low, high, 20_001)[1:-1]).T).min()


@pytest.mark.parametrize(("n", "thrown"), [(2, 1), (3, 1), (3, 2), (5, 1)])
@pytest.mark.parametrize("order", [1, 2, 3])
def test_what_is_known_to_be_positive_is(n, thrown, order):
    """On fine grids, from zeros of the quantity of each order, for several sizes of the vibration."""
    modes, known = linear_modes(*mechanism(n, thrown, 3)), []
    rng = np.random.default_rng(order)
    for size in np.geomspace(0.01, 30.0, 12):
        weights = np.zeros(2 * n)
        weights[::2] = rng.normal(size=n)
        quantity, start = Affine(tuple(weights)), size * rng.normal(size=2 * n)
        # The start is changed until the quantity's first derivatives vanish there and the next is positive.
        slopes = modes.along(weights, np.eye(2 * n), np.zeros(2 * n), 3)[:, : order + 1].T
        at_rest = modes.along(weights, np.zeros(2 * n), np.zeros(1), 3)[0, : order + 1]
        slopes -= at_rest[:, None]
        start += np.linalg.pinv(slopes) @ (np.append(np.zeros(order), size) - at_rest - slopes @ start)
        (until,) = modes.positive_until(quantity, start[:, None], order)
        known.append(until > 0)
        if until > 0:
            end = min(until, 50.0)
            assert lowest_on_grid(modes, quantity, start, min(0.01, 0.1 * end), end) > 0
    assert np.mean(known) > 0.25


@pytest.mark.parametrize(
    ("arguments", "telling"),
    [
        (([[1.0]], [[1.0]], [0.0, 0.0]), r"shapes \(1, 1\), \(1, 1\) and \(2,\)"),
        (([[1.0]], [[1.0]], 0.0), "shapes"),
        (([[1.0, 0.0], [0.1, 1.0]], np.eye(2), [0.0, 0.0]), "the inertia is not a symmetric"),
        ((np.eye(2), [[1.0, 0.0], [0.1, 1.0]], [0.0, 0.0]), "the stiffness is not a symmetric"),
        (([[1.0]], [[np.nan]], [0.0]), "stiffness is not a symmetric matrix of finite"),
        (([[0.0]], [[1.0]], [0.0]), "inertia is not positive definite"),
        (([[1.0]], [[0.0]], [0.0]), "without a spring"),
        ((np.eye(2), np.diag([0.0, -0.1]), [0.0, 0.0]), "without a spring"),
        (([[1.0]], [[1.0]], [np.inf]), "the load"),
    ],
)
def test_what_is_no_linear_mechanism_is_refused(arguments, telling):
    with pytest.raises(InputError, match=telling):
        linear_modes(*arguments)


def chain_of_three(p):
    """Inertia, stiffness and load of three masses in a column on springs of unit stiffness."""
    stretches, masses = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]]), np.array([p["m1"], p["m2"], p["m3"]])
    return np.diag(masses), stretches.T @ stretches, -masses


def standing(p):
    inertia, stiffness, load = chain_of_three(p)
    force = {"contact force": ((0.0, 0.0, -1.0, 0.0), p["m3"])}
    return linear_modes(inertia[:2, :2], stiffness[:2, :2], load[:2], force)


INTEGRATED = Chain().model
MODAL = replace(
    INTEGRATED,
    flight=replace(INTEGRATED.flight, closed_form=lambda p: linear_modes(*chain_of_three(p))),
    contact=replace(INTEGRATED.contact, closed_form=standing),
)


@dataclass(frozen=True, repr=False)
class ModalChain(Chain):
    """Three masses whose phases are not integrated."""

    model = MODAL


@pytest.mark.parametrize("masses", [(1.0, 1.0, 1.0), (2.0, 0.5, 1.3)])
def test_impacts_of_three_masses_are_those_of_the_integrated_chain(masses):
    launch = {"y1": 0.5, "y1'": 3.0, "liftoff": masses[2], "alpha": 4.0}
    runs = [simulate(machine(masses, restitution=0.3), launch, time=25.0) for machine in (Chain, ModalChain)]
    assert runs[1].status == "done"
    first, second = ([event.kind for event in run.events] for run in runs)
    assert first == second
    assert {"impact", "lift-off"} <= set(first)
    for mine, other in zip(*(run.events for run in runs), strict=True):
        assert mine.time == pytest.approx(other.time, abs=1e-11)
        np.testing.assert_allclose(mine.after, other.after, atol=1e-10)
