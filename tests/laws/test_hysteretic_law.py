"""Two branches as one law: their mean, whose pieces are those of both, and the key that has the keys of both."""

import pickle

import numpy as np
import pytest

from orbits.errors import InputError
from orbits.laws import from_key, hysteretic_law, merged_pieces
from orbits.laws.hysteretic_law import mean_of
from problems import springs

R = np.linspace(-1.9, 1.9, 41)
TABLE = springs.table(([-2.0, -1.0, 0.0, 1.0, 2.0], [-3.0, -1.2, 0.1, 1.2, 3.0]), noise=0)
OTHER = springs.table(([-3.0, -0.5, 0.5, 3.0], [-4.0, -1.0, 0.2, 3.5]), noise=0)


@pytest.mark.parametrize(
    "branches",
    [
        (springs.formula("r + a", a=0.1), springs.formula("r - a", a=0.1)),
        (TABLE, OTHER),
        (OTHER, TABLE),
        (springs.formula("a*r", a=1.2), TABLE),
        (springs.bilinear(gap=0.3), springs.end_stops(gap=0.7)),
        (springs.bilinear(), springs.bilinear()),
    ],
)
def test_the_mean_is_half_the_sum(branches):
    if branches[0].text == "bilinear" and branches[1].text == "end_stops":
        branches = branches[0], branches[1].with_parameters(gap=0.3)
    law = hysteretic_law("both", *branches)
    value, slope = law.mean.with_slope(R)
    values, slopes = zip(*(each.with_slope(R) for each in branches), strict=True)
    assert value == pytest.approx(sum(values) / 2, abs=1e-14)
    assert slope == pytest.approx(sum(slopes) / 2, abs=1e-13)
    assert law(R) == pytest.approx(value, abs=0)
    ends = [each.range() for each in branches]
    assert law.range() == (max(low for low, _ in ends), min(high for _, high in ends))
    again = pickle.loads(pickle.dumps(law))
    assert again.key == law.key
    assert [from_key(key, law.parameters)(R).tolist() for key in law.key.branches] == [x.tolist() for x in values]


def test_parameters_and_units_are_those_of_the_branches():
    law = hysteretic_law("both", springs.formula("k*r + a", k=2.0, a=0.1), springs.formula("k*r", k=2.0))
    other = law.with_parameters(a=0.3)
    assert dict(other.parameters) == {"a": 0.3, "k": 2.0}
    assert [float(each(1.0)) for each in (other.extending, other.shortening, other)] == pytest.approx([2.3, 2.0, 2.15])
    scaled = law.scaled(0.5, 4.0)
    assert [float(each(1.0)) for each in (scaled.extending, scaled.shortening, scaled)] == pytest.approx(
        [1.1 / 4, 1.0 / 4, 1.05 / 4]
    )
    with pytest.raises(InputError, match="has no parameter 'aa'"):
        law.with_parameters(aa=1.0)


def test_branches_that_do_not_go_together_are_refused():
    with pytest.raises(InputError, match="'k' has two values in the branches, 1 and 2"):
        hysteretic_law("both", springs.formula("k*r", k=1.0), springs.formula("k*r", k=2.0))
    far = springs.table(([3.0, 4.0, 5.0, 6.0], [1.0, 2.0, 3.0, 4.0]), noise=0)
    with pytest.raises(InputError, match="have no extension in common"):
        mean_of(TABLE, far)
    shifted = springs.table(([-2.0, -1.0, 0.0, 1.0], [-3.0, -1.2, 0.1, 1.2]), noise=0, shift="d")
    with pytest.raises(InputError, match="have different shifts"):
        merged_pieces(TABLE, shifted)
