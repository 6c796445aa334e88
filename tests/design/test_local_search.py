"""Local searches: where they end beside what is no motion, and how failures are named."""

import pytest
from designs import CUBIC, RANGE

from orbits import NoOrbit, find, optimize, quantities
from orbits.design import local_search
from orbits.design.design_problem import design_problem
from problems import Hopper


@pytest.mark.slow
def test_an_optimum_stays_admissible():
    """With a short leg the higher hop is that at which the masses almost meet."""
    short = Hopper("r + b*r**3", mass_ratio=0.5, rest_length=6.0, parameters={"b": 1.0})
    best = optimize(short, maximise="centre_of_mass_rise", over={"b": (0.01, 3.0)})
    assert 0 < best.orbit.certificate.smallest_separation < 1e-8
    assert best.orbit.admissible
    assert [active.text for active in best.active] == ["smallest_separation > 0"]


@pytest.mark.parametrize(
    ("machine", "verb", "name", "bounds", "at", "value"),
    [
        (CUBIC, "maximise", "alpha", {"b": (0.02, 1e6)}, 0.02, 4.0233),
        (CUBIC, "minimise", "alpha", {"b": (1e-6, 1e6)}, 1e6, 0.2509),
        (Hopper(mass_ratio=0.5), "maximise", "contact_time", {"mass_ratio": (1e-3, 1e3)}, 1e-3, 189.86),
    ],
)
def test_far_away_is_not_without_bound(machine, verb, name, bounds, at, value):
    """A monotone objective is best on a bound, however many decades away."""
    best = optimize(machine, **{verb: name}, over=bounds)
    (parameter,) = bounds
    assert best.parameters[parameter] == at
    assert best.objective == pytest.approx(value, abs=1e-2 if value > 100 else 1e-4)
    there = machine.with_values(**{parameter: at})
    assert best.objective == pytest.approx(find(there).document()[name], rel=1e-10)


def test_constraints_that_cannot_be_met():
    """Which, and by how much: at the upper bound the stroke is what the family has there."""
    with pytest.raises(NoOrbit) as error:
        optimize(CUBIC, minimise="alpha", over={"b": (0.1, 1.0)}, subject_to=["stroke <= 2"], starts=1)
    stiff = CUBIC.with_values(b=1.0)
    stroke = quantities(stiff, find(stiff), ["stroke"])["stroke"]
    assert f"'stroke <= 2' is missed by {stroke - 2:.4g}, at {stroke:.6g}, with b = 1" in str(error.value)
    constraints = ["stroke <= 6", "centre_of_mass_rise >= 4"]
    with pytest.raises(NoOrbit, match="'centre_of_mass_rise >= 4' is missed by"):
        optimize(CUBIC, minimise="alpha", over={"b": (0.1, 1.0)}, subject_to=constraints, starts=1)


def test_a_formula_without_a_value_on_the_equation(capfd):
    with pytest.raises(
        NoOrbit,
        match=r"'sqrt\(1-b\)' has no finite value or slope on the way: choose bounds",
    ):
        optimize(CUBIC, minimise="sqrt(1-b)", over={"b": RANGE}, starts=1)
    assert not capfd.readouterr().err


def searched(starts, families):
    """The ends of searches for the least sum of loss coefficient and launch speed, from values of b."""
    problem = design_problem(CUBIC, "loss_coefficient + alpha", None, {"b": RANGE}, ())
    machines = [CUBIC.with_values(b=b) for b in starts]
    motions = [(machine, find(machine, family)) for machine, family in zip(machines, families, strict=True)]
    return local_search.local_optima(motions, problem, lambda share: None)


@pytest.mark.parametrize("name", ["design_points", "motions_near"])
def test_an_error_at_one_start_is_no_error_of_the_others(monkeypatch, name):
    """Where orbits of the second family are refused, a search in the first is as it is alone."""
    (alone,) = searched([0.3], [1])
    function = getattr(local_search, name)

    def refusing(items, *others):
        families = others[1] if name == "motions_near" else [case.orbit.family for case in items]
        if 2 in families:
            raise NoOrbit("the family is refused")
        return function(items, *others)

    monkeypatch.setattr(local_search, name, refusing)
    refused, best = searched([0.3, 0.3], [2, 1])
    assert isinstance(refused, NoOrbit)
    assert "the family is refused" in str(refused)
    assert (best.parameters, best.objective, best.kkt) == (alone.parameters, alone.objective, alone.kkt)
