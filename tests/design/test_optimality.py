"""Designs: the conditions that they meet with gradients by differences, their multipliers, and their files."""

import json

import numpy as np
import pytest
from designs import CUBIC, LEG, RANGE

from orbits import Design, InputError, find, optimize, quantities


def test_two_parameters_meet_the_optimality_conditions():
    """The optimality conditions hold with gradients by differences between orbits that are found anew."""
    text = "loss_coefficient + 0.004*largest_contact_force*contact_time"
    bounds = {"b": (0.01, 3.0), "mass_ratio": (0.05, 0.95)}
    best = optimize(CUBIC, minimise=text, over=bounds, subject_to=["stroke <= 8"])
    assert best.kkt < 1e-9
    gradients = []
    for name in bounds:
        h, x, rows = 1e-4 * best.parameters[name], best.parameters[name], []
        for s in (-2, -1, 1, 2):
            machine = best.source.with_values(**{name: x + s * h})
            rows.append(list(quantities(machine, find(machine), [text, "stroke"]).values()))
        rows = np.array(rows)
        gradients.append((rows[0] - 8 * rows[1] + 8 * rows[2] - rows[3]) / (12 * h))
    slope, stroke = np.array(gradients).T
    multipliers = {active.text: active.multiplier for active in best.active}
    left = slope + multipliers.get("stroke <= 8", 0.0) * stroke
    left[1] -= multipliers.get("mass_ratio >= 0.05", 0.0)
    assert np.abs(left).max() < 1e-7 * np.abs(slope).max()
    assert min(multipliers.values(), default=1.0) > 0


def test_parameters_without_effect_are_reported():
    best = optimize(CUBIC, minimise="alpha", over={"b": RANGE, "rest_length": (15.0, 30.0)})
    assert best.idle == ("rest_length",)
    assert best.parameters["b"] == RANGE[1]
    assert "without effect" in str(best)


@pytest.fixture(scope="module")
def leg() -> Design:
    return optimize(LEG, minimise="loss_coefficient", over={"k": (3e3, 9e3)}, subject_to=["stroke <= 0.25"])


@pytest.mark.usefixtures("any_digest")
@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ({"kkt": "a"}, "kkt = 'a'"),
        ({"objective": {"value": 1.0}}, "objective.formula is missing"),
        ({"starts": [{"parameters": {}}]}, "objective is missing"),
        ({"active": [{"text": "a", "multiplier": "b"}]}, "multiplier = 'b'"),
        ({"orbit": {}}, "is missing"),
        ({"parameters": {"k": 5000.0}}, "it belongs to another machine"),
        ({"pair": [1.0]}, "a list of 2"),
    ],
)
def test_a_damaged_design_is_refused(leg, tmp_path, damage, words):
    document = json.loads(leg.save(tmp_path / "leg.json").read_text())
    (tmp_path / "leg.json").write_text(json.dumps(document | damage))
    with pytest.raises(InputError, match=words) as error:
        Design.load(tmp_path / "leg.json", LEG)
    assert "is not a saved design" in str(error.value)
