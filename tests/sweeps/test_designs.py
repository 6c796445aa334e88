"""Designs of experiments: their values, their reproducibility, and what is refused."""

import numpy as np
import pytest
from scipy.stats import norm, uniform

from orbits.errors import InputError
from orbits.sweeps.designs import Axis, members_of

NAMES = ("beta", "mass_ratio", "rest_length")


def members(over, samples=None, sampling=None, seed=0):
    return members_of(over, samples, sampling, seed, NAMES)


def test_a_grid_has_every_combination_in_order():
    grid = members({"beta": (0.0, 1.0), "mass_ratio": (0.1, 10.0, "log")}, (3, 2))
    assert grid.shape == (3, 2)
    np.testing.assert_allclose(grid.values, [[b, m] for b in (0, 0.5, 1) for m in (0.1, 10)], rtol=1e-15)


@pytest.mark.parametrize("sampling", ["sobol", "lhs", "random"])
def test_samples_fill_their_ranges_and_follow_their_seed(sampling):
    over = {"beta": (2.0, 4.0), "mass_ratio": (0.01, 100.0, "log"), "rest_length": norm(10, 0.5)}
    one, again, other = (members(over, 1000, sampling, seed) for seed in (1, 1, 2))
    assert len(one) == 1000
    assert one.values.tobytes() == again.values.tobytes() != other.values.tobytes()
    beta, ratio, length = one.values.T
    assert 2 <= beta.min() < 2.05 < 3.95 < beta.max() <= 4
    assert abs(np.mean(np.log10(ratio))) < 0.1
    assert abs(length.mean() - 10) < 0.1
    assert abs(length.std() - 0.5) < 0.05


def test_sobols_sequence_is_more_even_than_chance():
    """The mean of a product over the unit cube is 1/4; 1,000 points of the sequence miss it by far less than 1/100."""
    points = members({"beta": (0.0, 1.0), "mass_ratio": (0.0, 1.0)}, 1024, "sobol").values
    assert abs(points.prod(axis=1).mean() - 0.25) < 1e-3


def test_a_distribution_on_a_grid_has_the_middles_of_equal_shares():
    grid = members({"beta": norm(1, 2)}, 4, "grid")
    np.testing.assert_allclose(grid.values[:, 0], norm(1, 2).ppf([0.125, 0.375, 0.625, 0.875]), rtol=1e-15)
    np.testing.assert_allclose(members({"beta": uniform(1, 2)}, 3, "grid").values[:, 0], [1, 2, 3], rtol=1e-15)


def test_tables_are_taken_from_mappings_frames_and_files(tmp_path):
    file = tmp_path / "designs.csv"
    file.write_text("\ufeffbeta, mass_ratio\n0.25,1\n0.5,2e0\n", encoding="utf-8")
    columns = {"beta": [0.25, 0.5], "mass_ratio": [1, 2]}
    expected = [[0.25, 1.0], [0.5, 2.0]]
    assert members(None, columns).values.tolist() == expected
    assert members(None, file).values.tolist() == members(None, str(file)).values.tolist() == expected
    assert members(["mass_ratio"], file).values.tolist() == [[1.0], [2.0]]


@pytest.mark.parametrize(
    ("over", "samples", "sampling", "said"),
    [
        ({}, None, None, "over"),
        (None, None, None, "over"),
        ({"gamma": (0, 1)}, 5, None, "no parameter 'gamma'"),
        ({"beta": (1.0, 1.0)}, 5, None, "low must be below high"),
        ({"beta": (1.0, 0.5)}, 5, None, "low must be below high"),
        ({"beta": (0.0, 1.0, "log")}, 5, None, "above 0"),
        ({"beta": (0.0, 1.0, "ln")}, 5, None, "it must be a range"),
        ({"beta": (0.0, np.nan)}, 5, None, "nan"),
        ({"beta": []}, None, None, "no values"),
        ({"beta": "0:1"}, 5, None, "it must be a range"),
        ({"beta": (0, 1)}, 0, None, "samples = 0"),
        ({"beta": (0, 1)}, 2.5, None, "samples = 2.5"),
        ({"beta": (0, 1)}, 5, "halton", "sampling = 'halton'"),
        ({"beta": (0, 1)}, (2, 3), "grid", "numbers of values"),
        ({"beta": (0, 1), "mass_ratio": (1, 2)}, 100_000, "grid", "more than"),
        ({"beta": (0, 1)}, {"beta": [1.0]}, None, "over must then be"),
        (None, {"beta": [1.0]}, "sobol", "has them already: leave it out"),
        (["beta", "mass_ratio"], {"beta": [1.0]}, None, "no column 'mass_ratio'"),
        (None, {"beta": [1.0, np.nan]}, None, "row 2 of column 'beta'"),
        (None, {"beta": ["1", "x"]}, None, "'x'"),
        (None, {"beta": [1.0], "mass_ratio": [1.0, 2.0]}, None, "different lengths"),
        (None, {}, None, "no columns"),
        (None, {"beta": []}, None, "from 1 to"),
        (None, 3.5, None, "over"),
    ],
)
def test_what_cannot_be_meant_is_refused(over, samples, sampling, said):
    with pytest.raises(InputError, match=said):
        members(over, samples, sampling)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "first line"),
        ("beta,beta\n1,2\n", "each once"),
        ("beta,mass_ratio\n1\n", "line 2"),
        ("beta\nnan\n", "row 1"),
    ],
)
def test_a_table_that_is_none_is_refused(tmp_path, text, said):
    file = tmp_path / "designs.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=said):
        members(None, file)


def test_a_table_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"not a table of designs.*nothing\.csv"):
        members(None, tmp_path / "nothing.csv")


@pytest.mark.parametrize(
    "arguments", ["(" * 900, "(" * 3000, "-" * 900 + "1", "-" * 50_000 + "1", "1", "(1, 2, 3, 4)", "nan"]
)
def test_arguments_of_a_distribution_that_no_store_states_are_refused(arguments):
    assert Axis.of_stated("distribution", Axis(distribution=norm(1, 2)).stated).at(np.array([0.5])) == 1.0
    with pytest.raises(InputError, match="norm"):
        Axis.of_stated("distribution", ["norm", arguments, "{}"])


@pytest.mark.parametrize(
    ("kind", "stated"),
    [("distribution", ["norm"]), ("distribution", ["__doc__", "()", "{}"]), ("distribution", [[], "()", "{}"]),
     ("values", None), ("range", [1.0]), ("range", {"low": 1.0})],
)  # fmt: skip
def test_data_that_state_no_axis_are_refused(kind, stated):
    with pytest.raises(InputError, match=r"states no|not a distribution"):
        Axis.of_stated(kind, stated)
