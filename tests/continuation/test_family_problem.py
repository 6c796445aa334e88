"""The curve of a family as a problem: Newton's method against each step alone, points that are certified together, and
what goes on where Newton fails."""

from importlib import import_module

import numpy as np
import pytest
from families import GOLDEN
from many_at_once import cubics

from orbits import NoOrbit, find, follow
from orbits.continuation import Options, StepControl
from orbits.continuation.curve import Curve
from orbits.continuation.family_problem import FamilyProblem
from orbits.curves import Border, correct
from orbits.curves.bordered_newton import newton_steps
from orbits.curves.curve_steps import step
from orbits.periodic.certificate import certify
from orbits.running import TimeOver
from orbits.shooting import Shooting, joined
from problems import Hopper


@pytest.mark.parametrize("batch", [640, 1], ids=["in batches", "one by one"])
def test_ipopt_goes_on_where_newton_fails(batch, monkeypatch):
    """A corrector that fails in a window until Ipopt has helped, whose step has no points between its ends."""
    solved, solve = [], Shooting.multiple_shooting

    def failing(problem, lanes, tails, lengths, *others):
        taken = step(problem, lanes, tails, lengths, *others)
        if solved or not 0.2 < tails.xs[0, -1, -1] < 0.6:
            return taken
        none = {name: getattr(taken, name)[:0] for name in ("which", "ends", "rows", "levels", "arrives")}
        return taken._replace(**none, lengths=0.5 * lengths, reasons={0: "it fails"})

    monkeypatch.setattr("orbits.curves.curve_batch.step", failing)
    monkeypatch.setattr(Shooting, "multiple_shooting", lambda *a: solved.append(a) or solve(*a))
    family = follow(Hopper("cubic"), "beta", 1.0, 0.0, step_control=StepControl(largest_batch=batch))
    assert len(solved) == 1
    assert family.end.kind == "reached"
    assert family[-1].alpha == pytest.approx(GOLDEN[1.0], rel=1e-13)


def test_points_are_certified_up_to_the_first_that_cannot_be(monkeypatch):
    """Along the curve, although those that are solved together are checked together."""
    problem, betas = FamilyProblem(Curve(Hopper("cubic"), "beta", "relative", 1.0), Options()), np.arange(1, 7) / 10
    guesses = np.array([[1.0, find(Hopper("cubic", parameters={"beta": beta})).alpha, beta] for beta in betas])
    border = Border.of_component(2, betas, 3)
    _, points = correct(problem, np.zeros(6, int), guesses, border, border.rows, problem.steps)
    certified, errors = problem.certify(points)
    assert not errors
    assert certified.own.column("value") == pytest.approx(betas)
    assert certified.own.column("alpha") == pytest.approx(guesses[:, 1], rel=1e-13)

    def refusing(model, cases):
        certificates, refused = certify(model, cases)
        wrong = np.flatnonzero(cases.p["beta"] > 0.35)
        return certificates, refused | {i: NoOrbit(f"not {cases.p['beta'][i]:.1f}") for i in wrong.tolist()}

    monkeypatch.setattr(import_module("orbits.periodic.certification"), "certify", refusing)
    certified, errors = problem.certify(points)
    assert certified.own[:3].column("value") == pytest.approx(betas[:3])
    assert {i: str(error) for i, error in errors.items()} == {3: "not 0.4", 4: "not 0.5", 5: "not 0.6"}


def test_newton_steps_of_many_points():
    """In one call and one by one; both lead to where the equations hold to second order."""
    equations, xs, ps, _ = cubics(9)
    rows = np.random.default_rng(6).normal(size=xs.shape)
    targets = np.einsum("mi,mi->m", rows, xs) + 1e-6
    found = newton_steps(equations.evaluate_all(xs[:, :3], ps, ("beta",)), xs, rows, targets)
    there = joined([equations.evaluate_all(x[None], p[None], ("beta",)) for x, p in zip(xs[:, :3], ps, strict=True)])
    steps, directions = newton_steps(there, xs, rows, targets)
    assert found[0] == pytest.approx(steps, rel=1e-10)
    assert found[1] == pytest.approx(directions, rel=1e-10)
    assert np.einsum("mi,mi->m", rows, xs + steps) == pytest.approx(targets, rel=1e-12)
    betas = ps.copy()
    betas[ps == xs[:, 3:]] = (xs + steps)[:, 3]
    after = equations.evaluate_all((xs + steps)[:, :3], betas)
    for i in range(9):
        assert after.residual[i] == pytest.approx(np.zeros(3), abs=30 * np.max(np.abs(steps[i])) ** 2)


@pytest.mark.parametrize("refused", [None, 0.0, 0.3], ids=["none refused", "all refused", "refused from 0.3 on"])
def test_the_first_orbit_is_certified_with_the_first_batch(refused, monkeypatch):
    """In one call: its own error is raised, and that of a later orbit ends the family behind it."""
    sizes = []

    def certify_some(model, cases):
        sizes.append(len(cases.p["beta"]))
        certificates, errors = certify(model, cases)
        at = np.flatnonzero(cases.p["beta"] >= (1.0 if refused is None else refused))
        return certificates, errors | {i: NoOrbit("not here") for i in at.tolist()}

    monkeypatch.setattr(import_module("orbits.periodic.certification"), "certify", certify_some)
    if refused == 0.0:
        with pytest.raises(NoOrbit, match="not here"):
            follow(Hopper("cubic"), "beta", 0.5, 0.0)
    else:
        family = follow(Hopper("cubic"), "beta", 0.5, 0.0)
        assert family[0].value == 0.0
        assert family[-1].value == pytest.approx(refused or 0.5, abs=1e-4)
    assert sizes[0] > 10


def test_a_family_may_end_with_its_first_orbit(monkeypatch):
    family = follow(Hopper("cubic"), "beta", 0.5, 0.0, most=1)
    assert (len(family), family.end.kind) == (1, "stopped")

    def over():
        raise TimeOver("it takes more than 1 s")

    monkeypatch.setattr("orbits.curves.curve_run.heed", over)
    family = follow(Hopper("cubic"), "beta", 0.5, 0.0)
    assert (len(family), family.end.kind) == (1, "interrupted")
