"""Bounds on the error of launch speeds, against references and 30-digit arithmetic."""

import mpmath
import pytest
from conftest import REFERENCES, machine_of, name_of
from scipy.integrate import solve_ivp
from thirty_digits import exact_alpha

from orbits import NoOrbit, find
from orbits.shooting import METHODS, error_bound
from problems import Hopper, springs

mpmath.mp.dps = 30


def applies(method: str | None, reference: dict) -> bool:
    """Whether a method finds the orbit of a reference."""
    if method in ("closed form", "relative") and reference["gravity"] != "1":
        return False
    return method != "closed form" or reference["spring"] == "r"


CASES = [(reference, method) for method in (None, *METHODS) for reference in REFERENCES if applies(method, reference)]


@pytest.mark.parametrize(("reference", "method"), CASES, ids=[f"{method}-{name_of(each)}" for each, method in CASES])
def test_error_bound_on_the_references(reference, method):
    """Never smaller than the true error, never more than 100 times larger unless below 1e-14; a longer way than the
    scene needs rounds more, and may have 3e-14."""
    orbit = find(machine_of(reference), reference["family"], method=method)
    true = abs(float(mpmath.mpf(reference["alpha"]) - mpmath.mpf(orbit.alpha)))
    assert true <= orbit.error
    assert orbit.error <= max(100 * true, 1e-14 if method is None else 3e-14)


@pytest.mark.parametrize(
    ("b", "R", "M", "length", "family"),
    [(-0.008, None, 1.0, 40.0, 1), (0.1, 40.0, 1.0, 15.0, 1), (0.3, None, 1.0, 20.0, 5), (0.05, 500.0, 0.1, 40.0, 3)],
)
@pytest.mark.slow
def test_error_bound_against_30_digits(b, R, M, length, family):
    law = "1/(1 + z/R)**2" if R else "1"
    parameters = {"b": b, "R": R} if R else {"b": b}
    machine = Hopper("r + b*r**3", law, M, length, parameters=parameters)
    orbits = [find(machine, family, method=method) for method in (None, "shooting")]
    exact = exact_alpha(orbits[0], b, R, M, length)
    for orbit in orbits:
        assert float(abs(exact - mpmath.mpf(orbit.alpha))) <= orbit.error < 1e-12


@pytest.mark.parametrize("shift", [1e-12, 1e-4])
def test_two_integrations_that_disagree(monkeypatch, shift):
    """The error is twice the change of alpha that takes the shift of the speed in mid-flight back; a large one is
    refused. The slope of that speed over alpha, at half the time of flight, alpha, is scipy's."""
    machine = Hopper("cubic", parameters={"beta": 0.1})
    orbit, step = find(machine), 1e-4

    def middle(alpha):
        field = lambda _, x: [x[1], -x[0] - 0.1 * x[0] ** 3]  # noqa: E731
        start = [orbit.liftoff_extension, alpha]
        return solve_ivp(field, (0.0, alpha), start, method="DOP853", rtol=1e-12, atol=1e-12).y[1, -1]

    slope = (middle(orbit.alpha + step) - middle(orbit.alpha - step)) / (2 * step)
    by_another_method = error_bound._end_by_another_method
    monkeypatch.setattr(error_bound, "_end_by_another_method", lambda *motion: by_another_method(*motion) + shift)
    error = 2 * shift / abs(slope)
    if shift < 1e-9:
        assert find(machine).error == pytest.approx(error, rel=1e-2)
        return
    with pytest.raises(NoOrbit, match=rf"launch speed 3.41\d* may be off by {error:.1e}"):
        find(machine)


def test_the_error_of_an_uneven_table():
    """The alpha of its exact polynomials, proved by intervals. Some terms of a polynomial are far larger than its sum,
    and their rounding is an error of both integrations, which made a bound without it three times too small."""
    rows = """
    -20 -1501.01 -15.850998814084 -757.28 -11.986737951263 -336.23 -7.169987164829 -80.21 -1.392778470821 -3.2
    -1.283039780845 -2.9 0.052584362342 0.11 1.00185830639 2.17 1.171912879535 2.6 10.146752684784 208.83
    14.310367567724 562.15 18.674073993029 1225.7 20 1501.01
    """
    numbers = [*map(float, rows.split())]
    orbit = find(Hopper(springs.table((numbers[::2], numbers[1::2]), noise=0)))
    true = abs(float(mpmath.mpf("2.80441044493745152608249215974") - mpmath.mpf(orbit.alpha)))
    assert 1e-15 < true <= orbit.error < 10 * true
