"""Curves of folds against a stored value, each other, differences, and the folds of single families."""

import numpy as np
import pytest
from conftest import PROVED, middle

from orbits import InputError, follow, follow_fold
from orbits.model import Arc, Statement
from orbits.periodic.fold_statement import fold_statement
from orbits.shooting.single_shooting import Shooting
from problems import Hopper


def fold_of(family):
    return next(event.point for event in family.events if event.kind == "fold")


def test_the_fold_of_a_scaled_landing_condition():
    """Thrown at m times the half flight: the value at m = 1.5 was computed elsewhere, to 16 digits."""
    spring = Hopper("cubic").model.reduction.statement.arcs[0]
    arc = Arc(
        spring.phase,
        start=lambda u, before, p: [u["liftoff"], p["m"] * u["alpha"]],
        duration=lambda u, p: u["alpha"],
        conditions=lambda u, x, p: [x[1]],
        guard=spring.guard,
    )
    statement = fold_statement(Statement("scaled", ("liftoff", "alpha"), (arc,), ("alpha",)), "beta")
    equations = Shooting(statement, ("mass_ratio", "beta", "m"))
    u = np.array([1.01105, 5.83222, 0.0, -0.0106952])
    for m in np.linspace(1.0, 1.5, 6):
        u, _ = equations.newton(u, np.array([1.0, 0.0, m]))
    assert u[-1] == pytest.approx(-0.004737752512088, abs=1e-14)


@pytest.mark.parametrize("method", ["relative", "half orbit"])
def test_second_derivatives_are_exact(method):
    """The Jacobian of the fold's equations against differences of its residual."""
    machine = Hopper("cubic", rest_length=20.0, parameters={"beta": -0.01})
    from orbits.shooting.formulations import equations_of

    names = tuple(machine.values)
    statement = fold_statement(equations_of(machine.model, method, names).statement, "beta")
    equations = Shooting(statement, names)
    known = {"liftoff": 1.01, "alpha": 5.8, "duration": 5.7, "dliftoff": 0.1, "dduration": 0.9, "beta": -0.0106}
    u = np.array([known[name] for name in statement.unknowns])
    p = np.array(list(machine.values.values()))
    jacobian = equations.evaluate(u, p).jacobian
    for j in range(len(u)):
        step = 1e-6 * np.eye(len(u))[j]
        difference = equations.evaluate(u + step, p).residual - equations.evaluate(u - step, p).residual
        assert jacobian[:, j] == pytest.approx(difference / 2e-6, rel=1e-5, abs=1e-5)


@pytest.fixture(scope="module")
def quintic():
    machine = Hopper("r + beta*r**3 + delta*r**5", parameters={"beta": 0.0, "delta": 0.0})
    return machine, fold_of(follow(machine, "beta", -0.02))


@pytest.mark.slow
def test_the_curve_is_made_of_the_folds_of_single_families(quintic):
    machine, fold = quintic
    curve = follow_fold(machine, fold, "beta", "delta", 3e-5, at=[2e-5])
    (point,) = curve.at(2e-5)
    single = fold_of(follow(machine.with_values(delta=2e-5), "beta", -0.02))
    assert point.also["beta"] == pytest.approx(single.value, abs=1e-12)
    assert point.alpha == pytest.approx(single.alpha, abs=1e-7)
    assert curve.column("beta")[0] == pytest.approx(middle(PROVED["fold"]["beta"]), abs=1e-13)
    assert curve.column("delta")[-1] == 3e-5


@pytest.mark.slow
def test_two_folds_meet_in_a_cusp(quintic):
    machine, fold = quintic
    curve = follow_fold(machine, fold, "beta", "delta", 1e-4)
    (cusp,) = [event.point for event in curve.events if event.kind == "fold"]
    inside = follow(machine.with_values(delta=0.99 * cusp.value), "beta", -0.03)
    outside = follow(machine.with_values(delta=1.01 * cusp.value), "beta", -0.03)
    counts = [[event.kind for event in family.events].count("fold") for family in (inside, outside)]
    assert counts == [2, 0]


@pytest.mark.slow
def test_in_varying_gravity():
    machine = Hopper("cubic", "1 - kappa*z", rest_length=20.0, parameters={"beta": 0.0, "kappa": 0.0})
    curve = follow_fold(machine, fold_of(follow(machine, "beta", -0.02)), "beta", "kappa", 0.004)
    single = fold_of(follow(machine.with_values(kappa=0.004), "beta", -0.03))
    assert curve[-1].also["beta"] == pytest.approx(single.value, abs=1e-11)


def test_bad_questions_are_refused():
    machine = Hopper("r + beta*r**3 + delta*r**5", parameters={"beta": 0.0, "delta": 0.0})
    fold = follow(machine, "beta", -1e-4)[-1]  # no question comes so far that it is looked at
    with pytest.raises(InputError, match="no parameter 'gamma'"):
        follow_fold(machine, fold, "beta", "gamma", 1.0)
    with pytest.raises(InputError, match="along another parameter"):
        follow_fold(machine, fold, "beta", "beta", 1.0)
    with pytest.raises(InputError, match="no way between"):
        follow_fold(machine, fold, "beta", "delta", 0.0)
    with pytest.raises(InputError, match="another method"):
        follow_fold(machine, fold, "beta", "delta", 1.0, method="half orbit")
    with pytest.raises(InputError, match="piecewise"):
        fold_statement(Hopper("bilinear").model.reduction.statement, "ratio")
