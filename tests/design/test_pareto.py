"""Pareto fronts: no design dominates another, their ends, their files and their figure."""

import json

import numpy as np
import pytest
from designs import CUBIC, LEG, OVER, RANGE

from orbits import Front, InputError, optimize, pareto
from problems import Hopper


def test_a_front_whose_ends_are_the_same_design_has_one():
    (only,) = pareto(CUBIC, minimise=("alpha", "stroke"), over={"b": RANGE}, points=2).designs
    assert only.parameters["b"] == RANGE[1]


@pytest.mark.slow
def test_front():
    """Every design is certified; one objective rises as the other falls, and the slope is the multiplier."""
    front = pareto(CUBIC, minimise=("loss_coefficient", "alpha"), over={"b": RANGE}, points=5)
    assert len(front.designs) == 5
    assert all(design.orbit.admissible for design in front.designs)
    first, second = front.values.T
    assert (np.diff(first) > 0).all()
    assert (np.diff(second) < 0).all()
    assert front.column("b")[0] == RANGE[0]
    with pytest.raises(InputError, match="the designs have no 'z'"):
        front.column("z")
    assert "5 certified designs" in str(front)
    (only,) = pareto(CUBIC, minimise=("loss_coefficient", "-alpha"), over={"b": RANGE}).designs
    assert only.parameters["b"] == RANGE[0]


@pytest.mark.slow
def test_a_front_with_gaps_has_a_curve_for_each_piece():
    """The second objective has several minima over the first: at each level the first place that reaches it is best."""
    second = "cos(4*b) - 0.4*b"
    front = pareto(CUBIC.with_values(b=2.3), minimise=("b", second), over={"b": RANGE}, points=12)
    b = np.linspace(*RANGE, 200_001)
    values = np.cos(4 * b) - 0.4 * b
    for first, level in front.values:
        reached = np.flatnonzero(values <= level + 1e-12)
        assert first == pytest.approx(b[reached[0]], abs=2e-5) if len(reached) else level <= values.min() + 1e-9
    assert front.values[0, 0] == RANGE[0]
    assert front.values[-1, 1] == pytest.approx(values.min(), abs=1e-9)
    assert len(front.designs) == 12
    assert np.diff(front.values[:, 0]).max() > 1.0  # the gap


@pytest.mark.slow
def test_a_front_is_that_of_searches_at_its_levels(front):
    """To 1e-8, and where a bound becomes active the front has an event."""
    options = {"over": OVER, "subject_to": ["stroke <= 0.25"]}
    for design in front.designs[1:-1]:
        _, level = design.pair
        limits = [*options["subject_to"], f"largest_contact_force <= {level!r}"]
        same = optimize(LEG, maximise="centre_of_mass_rise", over=OVER, subject_to=limits)
        assert design.parameters == pytest.approx(same.parameters, rel=1e-8)
        assert design.pair[0] == pytest.approx(-same.objective, rel=1e-10)
        multipliers = [{each.text[:18]: each.multiplier for each in one.active} for one in (design, same)]
        assert multipliers[0] == pytest.approx(multipliers[1], rel=1e-7)


@pytest.fixture(scope="module")
def front() -> Front:
    both = "-centre_of_mass_rise", "largest_contact_force"
    return pareto(LEG, minimise=both, over=OVER, subject_to=["stroke <= 0.25"], points=3)


@pytest.mark.slow
@pytest.mark.usefixtures("any_digest")
@pytest.mark.parametrize("damage", [{"points": []}, {"points": [3]}, {"objectives": ["-alpha"]}, {"refused": [1]}])
def test_a_damaged_front_is_refused(front, tmp_path, damage):
    document = json.loads(front.save(tmp_path / "front.json").read_text())
    (tmp_path / "front.json").write_text(json.dumps(document | damage))
    with pytest.raises(InputError, match="is not a saved front"):
        Front.load(tmp_path / "front.json", LEG)


def test_a_front_saves_a_table_and_refuses_what_it_does_not_know(tmp_path):
    front = pareto(
        Hopper("cubic", parameters={"beta": 0.1}), minimise=("alpha", "-stroke"), over={"beta": (0, 1)}, points=2
    )
    head, *rows = front.save(tmp_path / "front.csv").read_text().splitlines()
    assert head == "alpha,-stroke,beta"
    assert [float(cell) for cell in rows[0].split(",")] == [*front.values[0], front.column("beta")[0]]
    for result in (front, front.designs[0], front.designs[0].orbit):
        with pytest.raises(InputError, match=r"must end in \.json"):
            result.save(tmp_path / "result.xyz")
