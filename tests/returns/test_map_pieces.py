"""The pieces of a map, against maps in closed form and the map of the machine."""

import numpy as np
import pytest

from orbits import ReturnMap, find, multiplier
from orbits.returns import Hops
from orbits.returns.limited_hops import PlainMap, Resolution
from orbits.returns.resolution import map_pieces
from orbits.returns.return_map import pieces_between
from problems import Hopper


def hops_of(function, impacts, rests=lambda x: np.zeros(x.shape, bool)):
    """A map in closed form."""

    def hops(x, cap):
        ends = rests(x)
        following = np.where(ends, np.nan, function(x))
        return Hops(x, following, 0 * x, impacts(x).astype(int), np.where(ends, "rests", "lifts_off"))

    return PlainMap(hops)


def at(pieces, x):
    last = np.full(len(x), len(pieces.edges) - 1)
    return pieces.cell(x, 0 * last, last)


def test_a_graze_a_jump_and_a_rest_are_found_with_their_powers():
    def function(x):
        return np.where(x < 2.3, 3 * x, np.where(x < 3.7, 6.9 - np.sqrt(np.maximum(x - 2.3, 0)), np.sin(x) + 2))

    step = hops_of(function, lambda x: np.digitize(x, [2.3, 3.7]), lambda x: x > 5.1)
    pieces = map_pieces(step, 1.0, 6.0, 50)
    kinds = [(border.kind, border.powers) for border in pieces.borders]
    assert kinds == [("graze", (1, 2)), ("jump", (1, 1)), ("rests", (1, 1))]
    assert [border.alpha for border in pieces.borders] == pytest.approx([2.3, 3.7, 5.1], rel=1e-15)
    assert not pieces.unresolved
    x = np.random.default_rng(2).uniform(1, 5.1, 300)
    assert pieces.next(x, at(pieces, x)) == pytest.approx(function(x), abs=1e-13)
    assert pieces.slope(np.array([2.3 + 1e-6]), np.array([at(pieces, np.array([2.31]))[0]])) == pytest.approx(-500)
    assert pieces.extrema() == pytest.approx([1.5 * np.pi])


def test_borders_that_the_grid_does_not_show_are_found_where_no_polynomial_fits():
    step = hops_of(lambda x: np.where(np.abs(x - 1.50123) < 1e-3, 2.0, x), lambda x: 1 + (np.abs(x - 1.50123) < 1e-3))
    pieces = map_pieces(step, 1.0, 2.0, 500)
    assert [border.alpha for border in pieces.borders] == pytest.approx([1.50023, 1.50223], rel=1e-14)


@pytest.fixture(scope="module")
def of_hopper():
    return pieces_between(ReturnMap(Hopper()), 4.3, 5.3, 50)


def test_the_law_of_the_power_four_thirds_is_exact_beside_the_lossless_launch(of_hopper):
    (star,) = of_hopper.borders
    assert (star.kind, star.powers) == ("lossless", (3, 3))
    step, d = ReturnMap(Hopper()), np.array([1e-9, 1e-6, 1e-3])
    for side in (1, -1):
        x = star.alpha + side * d
        slopes = of_hopper.slope(x, at(of_hopper, x))
        # The loss of launch speed is C d^(4/3) (10 C on the side of the bounce), so that the slope is 1 - 4/3 loss/d.
        loss = x - np.sqrt(x**2 - step(x).loss)
        assert (1 - slopes[:2]) * side == pytest.approx(4 / 3 * loss[:2] / d[:2], rel=0.03)
        assert of_hopper.next(x, at(of_hopper, x)) == pytest.approx(step(x).next, rel=3e-15)
    tops = of_hopper.extrema()
    assert tops == pytest.approx([4.50018238959], abs=1e-10)


def test_slopes_are_those_of_saltation(of_hopper):
    x = np.array([4.35, 4.49, 4.5, 4.7, 5.2])
    assert of_hopper.slope(x, at(of_hopper, x)) == pytest.approx([multiplier(Hopper(), each) for each in x], abs=1e-10)


def test_a_law_in_pieces_is_resolved_beside_the_lossless_launch():
    """Rounding of its flights decides on the number of impacts there; the map has the slope 1 from both sides."""
    machine = Hopper("bilinear")
    hop = find(machine)
    star = hop.alpha
    pieces = pieces_between(ReturnMap(machine), star - 0.02, star + 0.02, 40)
    (border,) = pieces.borders
    assert (border.kind, pieces.unresolved) == ("lossless", ())
    assert border.alpha == pytest.approx(star, abs=hop.error)  # from two starts, the last digit may differ
    assert pieces.slopes_at(border) == pytest.approx((1.0, 1.0), abs=1e-12)
    x = star + np.array([-1e-2, -1e-4, 1e-4, 1e-2])
    following, slopes, _ = pieces.hops(x)
    assert following == pytest.approx(ReturnMap(machine)(x).next, abs=1e-12)
    assert slopes == pytest.approx([multiplier(machine, each) for each in x], abs=1e-7)


@pytest.mark.slow
def test_cells_end_at_the_rounding_of_the_map():
    """The cubic hopper rounds a launch speed by some 1e-13: fewer than 100 cells, all hops up to that, and no launch
    where the machine rests."""
    step = ReturnMap(Hopper("r+0.3*r**3"))
    pieces = pieces_between(step, 2.0, 8.0, 400)
    assert len(pieces.edges) < 100
    assert not pieces.unresolved
    x = np.linspace(2.0, 8.0, 701)
    hops, (following, _, impacts) = step(x), pieces.hops(x)
    assert following == pytest.approx(hops.next, abs=1e-11, nan_ok=True)
    lifts = np.isfinite(hops.next)
    assert (~lifts).any()
    assert (impacts[lifts] == hops.impacts[lifts]).all()


def test_the_search_ends_where_borders_are_dust():
    """A map with a border at each 2^-k, on both sides of which there is a next launch or none: what is left after the
    last impact that the search may follow is unresolved, and the rest is the map."""
    launches = []

    def rests(x):
        launches.append(len(x))
        return np.floor(-np.log2(np.maximum(x - 1.0, 1e-300)) * 40) % 2 == 1

    step = hops_of(lambda x: 2.0 + np.sin(x), lambda x: np.where(x < 1.5, 50, 1), rests)
    pieces = map_pieces(step, 1.0, 2.0, 50, options=Resolution(effort=2e5))
    assert sum(launches) < 1e5
    assert sum(b - a for a, b in pieces.unresolved) > 0.01
    x = np.random.default_rng(2).uniform(1.0, 2.0, 300)
    inside = np.any([(a <= x) & (x <= b) for a, b in pieces.unresolved], axis=0)
    following = np.where(rests(x), np.nan, 2.0 + np.sin(x))
    assert pieces.hops(x)[0][~inside] == pytest.approx(following[~inside], abs=1e-12, nan_ok=True)
