"""The curve of a family as a problem: Newton's method against each step alone, points that are certified together, and
what goes on where Newton fails."""

import pytest
from families import GOLDEN

from orbits import follow
from orbits.continuation import StepControl
from orbits.curves.curve_steps import step
from orbits.running import TimeOver
from orbits.shooting import Shooting
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


def test_a_family_may_end_with_its_first_orbit(monkeypatch):
    family = follow(Hopper("cubic"), "beta", 0.5, 0.0, most=1)
    assert (len(family), family.end.kind) == (1, "stopped")

    def over():
        raise TimeOver("it takes more than 1 s")

    monkeypatch.setattr("orbits.curves.curve_run.heed", over)
    family = follow(Hopper("cubic"), "beta", 0.5, 0.0)
    assert (len(family), family.end.kind) == (1, "interrupted")
