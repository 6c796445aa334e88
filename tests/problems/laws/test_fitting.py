"""The parameters of a formula fitted to rows: against closed forms, NumPy's polynomials, SciPy and drawn rows."""

import numpy as np
import pytest
from legibility import faults
from scipy.optimize import curve_fit
from scipy.stats import multivariate_normal, norm

from orbits import InputError, find, sensitivities, uncertainty
from problems import Hopper, springs
from problems.laws.fitting import SpringFit

R = np.linspace(-6.0, 5.0, 60)
CUBIC = R + 0.05 * R**3


def noisy(force, size: float, seed: int = 0):
    return force + size * np.random.default_rng(seed).normal(size=np.shape(force))


class TestLinear:
    """Formulas that are linear in their parameters."""

    @pytest.mark.parametrize("shares", [None, np.linspace(0.5, 2.0, 60)])
    def test_is_the_polynomial_of_numpy(self, shares):
        """With weights and without; `polyfit` has the covariance from the residuals unless the weights are absolute."""
        force = noisy(CUBIC, 0.1)
        deviations = None if shares is None else 0.1 * shares
        found = springs.fit((R, force), "a + k*r + c*r**2 + b*r**3", noise=deviations)
        weights, scale = (None, True) if shares is None else (1 / deviations, "unscaled")
        values, covariance = np.polyfit(R, force, 3, w=weights, cov=scale)
        order = [3, 0, 1, 2]  # a, b, c, k among the falling powers
        assert [*found.parameters] == ["a", "b", "c", "k"]
        assert [*found.parameters.values()] == pytest.approx(values[order], rel=1e-10)
        assert found.covariance == pytest.approx(covariance[np.ix_(order, order)], rel=1e-9)
        assert [*found.deviations.values()] == pytest.approx(np.sqrt(np.diag(covariance))[order], rel=1e-9)
        assert found.residuals == pytest.approx(force - np.polyval(values, R), abs=1e-12)
        assert (found.noise < 0.15, found.lack) == (True, "")

    def test_is_the_closed_form_through_the_origin(self):
        force = noisy(R, 0.2)
        found = springs.fit((R, force), "k*r", noise=0.2)
        assert found.parameters["k"] == pytest.approx(R @ force / (R @ R), rel=1e-12)
        assert found.covariance == pytest.approx(0.04 / (R @ R), rel=1e-12)

    def test_repeated_rows_weigh_as_many(self):
        """Means of repeated rows with their numbers as weights give what all rows give one by one."""
        r, force = np.repeat(R[::4], 5), noisy(np.repeat(CUBIC[::4], 5), 0.1)
        found = springs.fit((r, force), "k*r + b*r**3")
        matrix = np.column_stack([r**3, r])
        values, (squares,), *_ = np.linalg.lstsq(matrix, force, rcond=None)
        covariance = squares / (len(r) - 2) * np.linalg.inv(matrix.T @ matrix)
        assert [*found.parameters.values()] == pytest.approx(values, rel=1e-10)
        assert found.covariance == pytest.approx(covariance, rel=1e-9)
        assert found.weights.tolist() == [5.0] * 15


class TestNonlinear:
    @pytest.mark.parametrize("start", [None, {"b": 0.2}])
    def test_is_that_of_scipy(self, start):
        force = noisy(9.0 * np.tanh(0.25 * R), 0.05)
        found = springs.fit((R, force), "a*tanh(b*r)", start)
        values, covariance = curve_fit(lambda r, a, b: a * np.tanh(b * r), R, force, [9.0, 0.25])
        assert [*found.parameters.values()] == pytest.approx(values, rel=1e-6)
        assert found.covariance == pytest.approx(covariance, rel=1e-3)

    @pytest.mark.parametrize("in_si", [False, True])
    def test_exact_rows_give_back_their_law(self, in_si):
        """A law with a pole beside the rows, in the numbers of a machine without units and of a leg in m and N."""
        r, scale = (0.01 * R, 2000.0) if in_si else (R, 1.0)
        length, exponent = 9.0 * r[-1] / R[-1], 1.4
        force = scale * length / exponent * (1 - (1 + r / length) ** -exponent)
        found = springs.fit((r, force), "k*length/exponent*(1 - (1 + r/length)**(-exponent))")
        assert found.law(r) == pytest.approx(force, rel=1e-6, abs=1e-6 * np.ptp(force))
        assert found.parameters["exponent"] == pytest.approx(1.4, rel=1e-3)

    def test_starts_from_a_law(self):
        force = springs.air(length=8.0, exponent=1.2)(R)
        found = springs.fit((R, force), springs.air())
        assert found.parameters == pytest.approx({"exponent": 1.2, "length": 8.0}, rel=1e-6)


class TestOpenParameters:
    """What rows do not determine runs off to infinity, or to 0, and is named."""

    @pytest.mark.parametrize("law", [springs.air(), springs.air(stiffness=8000.0, length=0.1)])
    def test_a_hardening_spring_has_no_air(self, law):
        """Air is softer in tension than in compression, and the sample is not."""
        message = r"the rows do not determine exponent and length: exponent = .* equally well"
        with pytest.raises(InputError, match=message):
            springs.fit(springs.SAMPLE, law, in_si=True)

    @pytest.mark.parametrize(
        ("law", "name"),
        [
            (springs.rubber(stiffness=8000.0, length=0.1), "length"),
            (springs.tanh(stiffness=8000.0, b=10.0), "b"),
            (springs.morse(stiffness=8000.0, a=10.0), "a"),
        ],
    )
    def test_a_law_that_becomes_a_straight_line(self, law, name):
        message = f"do not determine {name}: .* give it a value in the formula, or fit another law$"
        with pytest.raises(InputError, match=message):
            springs.fit(springs.SAMPLE, law, in_si=True)

    def test_an_exponential_is_air_of_no_exponent(self):
        """With exponent and length in the same ratio, which is all that the rows determine."""
        with pytest.raises(InputError, match="exponent and length"):
            springs.fit((R, noisy(-np.expm1(-0.3 * R) / 0.3, 0.02)), springs.air())
        found = springs.fit((R, noisy(-np.expm1(-0.3 * R) / 0.3, 0.02)), springs.toda())
        assert found.parameters["b"] == pytest.approx(0.3, abs=4 * found.deviations["b"])

    def test_a_length_stays_above_0(self):
        """Where the formula has no value at 0, on all of 6 noisy records."""
        for seed in range(6):
            found = springs.fit((R, noisy(springs.air(length=7.0)(R), 0.03, seed)), springs.air())
            assert 0 < found.parameters["exponent"] < 10
            assert found.parameters["length"] == pytest.approx(7.0, abs=5 * found.deviations["length"])

    def test_stated_values_are_what_the_message_asks_for(self):
        formula = "stiffness*length/1.4*(1 - (1 + r/length)**(-1.4))"
        force = noisy(20.0 * springs.air(length=8.0)(R), 0.05)
        assert springs.fit((R, force), formula, {"length": 5.0}).parameters["length"] == pytest.approx(8.0, rel=0.02)


class TestFit:
    """What the result is good for."""

    FOUND = springs.fit((R, noisy(CUBIC, 0.1)), "k*r + b*r**3")

    def test_its_law_is_a_spring_like_any_other(self):
        orbit = find(Hopper(self.FOUND.law, rest_length=20.0))
        assert orbit.alpha == find(Hopper("k*r + b*r**3", rest_length=20.0, parameters=self.FOUND.parameters)).alpha
        assert sensitivities(orbit.source, orbit, ["k"], ["alpha"])["alpha"]["k"] < 0

    def test_is_saved_and_loaded(self, tmp_path):
        again = SpringFit.load(self.FOUND.save(tmp_path / "fit.json"))
        assert again.document() == self.FOUND.document()
        assert again.law == self.FOUND.law
        assert str(again) == str(self.FOUND)
        self.FOUND.save(tmp_path / "fit.csv")
        assert np.genfromtxt(tmp_path / "fit.csv", delimiter=",", skip_header=1)[:, 3] == pytest.approx(again.residuals)

    def test_is_printed_and_drawn(self):
        text = str(self.FOUND)
        assert "k*r + b*r**3 fitted to 60 rows" in text
        assert f"+- {self.FOUND.deviations['k']:.2g} (one standard deviation)" in text
        axes = self.FOUND.plot()
        assert axes.get_legend_handles_labels()[1] == ["measured", "k·r + b·r³"]
        assert not faults(axes.figure)
        assert "<img" in self.FOUND._repr_html_()

    @pytest.mark.parametrize("over", [{("b", "k"): norm(1.0, 0.1)}, {("b", "k"): multivariate_normal([1.0], [[0.1]])}])
    def test_a_distribution_of_other_numbers_is_refused(self, over):
        with pytest.raises(InputError, match="multivariate_normal of 2 numbers"):
            uncertainty(Hopper(self.FOUND.law), over)


class TestLackOfFit:
    def test_is_said_in_words(self):
        found = springs.fit((R, noisy(CUBIC, 0.05)), "k*r")
        assert "the formula does not fit: its residuals" in found.lack
        assert found.lack in " ".join(str(found).split())

    @pytest.mark.parametrize("force", [np.sinh(R / 2), noisy(np.sinh(R / 2), 1e-3)])
    def test_of_exact_rows_too(self, force):
        assert springs.fit((R, force), "k*r + b*r**3").lack

    def test_against_the_stated_noise(self):
        assert "times the stated noise, 0.1" in springs.fit((R, noisy(CUBIC, 0.4)), "k*r + b*r**3", noise=0.1).lack

    def test_is_not_said_of_formulas_that_fit(self):
        lacks = [
            springs.fit((R[::k], noisy(CUBIC[::k], size, 60 + k)), "k*r + b*r**3").lack
            for k in (1, 2, 3)
            for size in (0.01, 0.1, 1)
        ]
        assert not any(lacks)
        assert not springs.fit((R, CUBIC), "k*r + b*r**3").lack  # rounding is no lack


def test_a_branch_of_a_loop():
    r, force = np.r_[R, R[::-1]], np.r_[CUBIC + 0.5, CUBIC[::-1] - 0.5]
    for branch, offset in (("loading", 0.5), ("unloading", -0.5), ("mean", 0.0)):
        found = springs.fit((r, force), "c + k*r + b*r**3", branch=branch)
        assert found.parameters == pytest.approx({"b": 0.05, "c": offset, "k": 1.0}, abs=1e-9)
    with pytest.raises(InputError, match="is a loop"):
        springs.fit((r, force), "k*r")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("k*r + m*r",), "do not distinguish k and m"),
        (("k*r", {"c": 1.0}), "no parameter 'c'"),
        (("2*r",), "no parameters to fit"),
        (("k*r + b*sqrt(r)",), "not finite at some of the rows"),
        (("k*r + 0*b",), "do not depend on the parameter 'b'"),
        ((5,), "it must be text"),
        ((springs.bilinear(),), "is not a formula of the force"),
    ],
)
def test_what_cannot_be_fitted(arguments, message):
    with pytest.raises(InputError, match=message):
        springs.fit((R, CUBIC), *arguments)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"noise": -1.0}, "above 0"),
        ({"noise": [0.1, 0.2]}, "2 numbers for 60 rows"),
        ({"noise": np.ones(60), "branch": "mean"}, "without a branch"),
    ],
)
def test_options_that_cannot_be(options, message):
    with pytest.raises(InputError, match=message):
        springs.fit((R, CUBIC), "k*r", **options)


def test_few_rows():
    with pytest.raises(InputError, match="4 rows for 4 parameters"):
        springs.fit((R[:4], CUBIC[:4]), "a + b*r + c*r**2 + d*r**3")
    assert springs.fit((R[:4], CUBIC[:4]), "a + b*r + c*r**2 + d*r**3", noise=0.1).noise == 0.1


def test_a_parameter_that_is_found_to_be_zero_is_determined():
    r = np.linspace(-2.0, 2.0, 9)
    found = springs.fit((r, r), "k*r*exp(b*r)", start={"b": 0.0})
    assert found.parameters == pytest.approx({"b": 0.0, "k": 1.0}, abs=1e-12)
