"""The search for common zeros of functions of two variables, against functions whose zeros are known."""

import numpy as np
import pytest

from orbits.numerics import near_common_zeros


def of_two(first, second):
    """A function of places whose four values are sums of two functions, as the minors of a matrix are related."""

    def values_of(places):
        a, b = first(*np.moveaxis(places, -1, 0)), second(*np.moveaxis(places, -1, 0))
        return np.stack([a, b, a + b, 0.3 * a - 2 * b], axis=-1)

    return values_of


def farthest(known, found):
    """The largest distance from a known zero to the nearest place that is found."""
    return np.abs(known[:, None] - found[None]).max(-1).min(1).max()


@pytest.mark.parametrize("count", [12, 41])
def test_all_zeros_of_waves(count):
    found, missed = near_common_zeros(
        of_two(lambda x, y: np.sin(9 * x + 0.4), lambda x, y: np.cos(7 * y + x * x)), count
    )
    xs = (np.arange(4) * np.pi - 0.4) / 9
    xs = xs[(xs > 0) & (xs < 1)]
    known = np.array([(x, (np.pi / 2 + k * np.pi - x * x) / 7) for x in xs for k in range(3)])
    known = known[(known[:, 1] < 1) & (known[:, 1] > 0)]
    assert missed == 0
    assert len(known) == 4
    assert farthest(known, found) < 3e-3
    assert farthest(found[(found < 1).all(1)], known) < 3e-3


def test_two_zeros_in_one_cell():
    apart = 0.02
    found, _ = near_common_zeros(of_two(lambda x, y: x - 0.51 + y / 9, lambda x, y: (y - 0.52) ** 2 - apart**2), 21)
    known = np.array([(0.51 - (0.52 + s) / 9, 0.52 + s) for s in (apart, -apart)])
    assert farthest(known, found) < 3e-3


def test_a_touching_zero():
    found, _ = near_common_zeros(of_two(lambda x, y: x - 0.511, lambda x, y: (y - 0.523) ** 2), 21)
    assert farthest(np.array([(0.511, 0.523)]), found) < 3e-3


def test_none():
    found, _ = near_common_zeros(of_two(lambda x, y: x - 0.5, lambda x, y: x - 0.5 + 0.02 * np.cosh(y)), 11)
    assert len(found) == 0


def test_places_without_values():
    def values_of(places):
        values = of_two(lambda x, y: x - 0.25, lambda x, y: y - 0.25)(places)
        return np.where(places[..., :1] > 0.6, np.nan, values)

    found, missed = near_common_zeros(values_of, 11)
    assert missed == 55
    assert farthest(np.array([(0.25, 0.25)]), found) < 1e-12
