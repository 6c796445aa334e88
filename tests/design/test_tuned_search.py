"""The best designs with tuned parameters, against closed forms of linear hoppers and against `find` on grids."""

import numpy as np
import pytest

from orbits import Design, InputError, NoOrbit, find, optimize, pareto, sensitivities
from problems import Hopper, runner

LINEAR = Hopper("k*r", parameters={"k": 1.0})
WITH_FREQUENCY = {"tune": "k", "at": {"frequency": 0.1}}
RUNNER = runner(foot_mass=0.1, rest_length=3.7, inertia=5.7, hip_stiffness=5.4)
AT_SPEED = {"tune": ("inertia", "hip_stiffness"), "at": {"speed": 0.4}}


def stiffness(mass_ratio: float) -> float:
    """That with the frequency 0.1; the period is that of stiffness 1 over the root of the stiffness."""
    return (0.1 * find(LINEAR.with_values(mass_ratio=mass_ratio)).period) ** 2


@pytest.mark.slow
def test_the_best_design_is_that_of_the_closed_form():
    best = optimize(LINEAR, minimise="(k - 2)**2", over={"mass_ratio": (0.5, 3.0)}, **WITH_FREQUENCY)
    assert stiffness(best.parameters["mass_ratio"]) == pytest.approx(2.0, rel=1e-6)
    assert best.parameters["k"] == pytest.approx(stiffness(best.parameters["mass_ratio"]), rel=1e-11)
    assert 1 / best.orbit.period == pytest.approx(0.1, rel=1e-12)
    assert best.orbit.prescribed == {"frequency": 0.1}
    assert best.kkt is None
    assert not best.active
    assert "a search without derivatives" in str(best)


@pytest.mark.slow
def test_bounds_and_constraints_hold():
    over = {"mass_ratio": (0.5, 3.0)}
    bound = optimize(LINEAR, minimise="k", over=over, **WITH_FREQUENCY)
    assert [each.text for each in bound.active] == ["mass_ratio <= 3"]
    assert bound.objective == pytest.approx(stiffness(3.0), rel=1e-11)
    held = optimize(LINEAR, minimise="k", over=over, subject_to=["alpha <= 3.2"], **WITH_FREQUENCY)
    assert [each.text for each in held.active] == ["alpha <= 3.2"]
    assert held.orbit.alpha == pytest.approx(3.2, rel=1e-7)
    with pytest.raises(NoOrbit, match="meets the constraints: it violates the constraints alpha <= 1"):
        optimize(LINEAR, minimise="k", over=over, subject_to=["alpha <= 1"], **WITH_FREQUENCY)


def test_the_best_of_several_starts_and_a_saved_design(tmp_path):
    over = {"mass_ratio": (0.01, 10.0)}
    best = optimize(LINEAR, maximise="k", over=over, starts=2, **WITH_FREQUENCY)
    assert len(best.starts) == 2
    assert best.objective == max(start.objective for start in best.starts)
    assert best.objective == pytest.approx(stiffness(best.parameters["mass_ratio"]), rel=1e-11)
    best.save(tmp_path / "best.json")
    again = Design.load(tmp_path / "best.json", machine=LINEAR)
    assert again.parameters == best.parameters
    assert again.kkt is None


def test_bad_arguments_are_named():
    over = {"mass_ratio": (0.5, 3.0)}
    wrong = [
        ({"subject_to": ["alpha == 3"]}, "'alpha == 3': designs with tuned parameters"),
        ({"starts": "global"}, "starts = 'global'"),
        ({"over": {"k": (1.0, 2.0)}}, "'k' is varied"),
        ({"at": {"clearance": 1.0}}, "at 'clearance': it is found from the whole motion"),
    ]
    for change, words in wrong:
        with pytest.raises(InputError, match=words):
            optimize(LINEAR, **{"minimise": "k", "over": over, **WITH_FREQUENCY, **change})
    for function in (sensitivities, lambda machine: pareto(machine, minimise=("alpha", "stroke"), over=over)):
        with pytest.raises(InputError, match="a runner has no orbits beside this one unless a number of it is tuned"):
            function(RUNNER)
    with pytest.raises(InputError, match="half an orbit of a runner has 10 equations for 9 unknowns"):
        optimize(RUNNER, minimise="friction_needed", over={"rest_length": (3.6, 3.9)})


@pytest.mark.slow
def test_the_runner_of_least_friction_lies_at_an_edge():
    """Where friction at landing and inside the contact are the same: single orbits beside it need more."""
    best = optimize(RUNNER, minimise="friction_needed", over={"rest_length": (3.6, 3.9)}, **AT_SPEED)

    def friction(rest_length: float) -> float:
        return find(RUNNER.with_values(rest_length=rest_length), **AT_SPEED).certificate.friction_needed

    beside = best.parameters["rest_length"] + np.array([-0.05, -3e-4, 3e-4, 0.05])
    assert best.objective < min(map(friction, beside))
    assert best.orbit.certificate.friction_needed == pytest.approx(best.objective, rel=1e-10)
