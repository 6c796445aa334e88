"""Designs and fronts after their files, and the figure of a front."""

import json

import numpy as np
import pytest

from orbits import Design, Front, InputError, optimize, pareto
from problems import Hopper, hopper_in_si

pytestmark = pytest.mark.usefixtures("any_digest")

LEG = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 5000.0, "b": 1e5}, rest_length=0.8)
OVER = {"k": (500.0, 5e4), "b": (0.0, 1e7)}
CUBIC = Hopper("r + beta*r**3", parameters={"beta": 0.3}, rest_length=10.0)


@pytest.fixture(scope="module")
def leg() -> Design:
    return optimize(LEG, minimise="loss_coefficient", over={"k": (3e3, 9e3)}, subject_to=["stroke <= 0.25"])


@pytest.fixture(scope="module")
def front() -> Front:
    both = "-centre_of_mass_rise", "largest_contact_force"
    return pareto(LEG, minimise=both, over=OVER, subject_to=["stroke <= 0.25"], points=3)


def same_design(one: Design, other: Design) -> bool:
    names = ("source", "parameters", "verb", "text", "objective", "quantities", "active", "idle", "kkt", "starts")
    equal = all(getattr(one, name) == getattr(other, name) for name in (*names, "pair", "share", "seconds"))
    return equal and str(one) == str(other) and np.array_equal(one.orbit([0.0, 0.1]), other.orbit([0.0, 0.1]))


def test_a_design_comes_back(leg, tmp_path):
    """To the last bit, whatever the values of the machine that is given."""
    path = leg.save(tmp_path / "leg.json")
    for machine in (LEG, leg.source, LEG.with_values(k=1e4)):
        again = Design.load(path, machine)
        assert same_design(again, leg)
        assert again.save(tmp_path / "again.json").read_bytes() == path.read_bytes()
    assert json.loads(path.read_text())["orbit"]["alpha"] == leg.orbit.alpha
    for other in (CUBIC, LEG.with_values(body_mass=61.0)):
        with pytest.raises(InputError, match="is not a saved design"):
            Design.load(path, other)


def test_a_front_comes_back(front, tmp_path):
    path = front.save(tmp_path / "front.json")
    again = Front.load(path, LEG)
    assert len(front.designs) == 3
    assert np.array_equal(again.values, front.values)
    assert (again.texts, again.refused, again.seconds) == (front.texts, front.refused, front.seconds)
    assert all(map(same_design, again.designs, front.designs))
    assert str(again) == str(front)
    assert again.save(tmp_path / "again.json").read_bytes() == path.read_bytes()
    with pytest.raises(InputError, match=r"is not a saved front.*has a parameter '[bk]'"):
        Front.load(path, CUBIC)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ({"kkt": None}, "kkt = None"),
        ({"objective": {"value": 1.0}}, "objective.formula is missing"),
        ({"starts": [{"parameters": {}}]}, "objective is missing"),
        ({"active": [{"text": "a", "multiplier": "b"}]}, "multiplier = 'b'"),
        ({"orbit": {}}, "is missing"),
        ({"parameters": {"k": 5000.0}}, "it is of another machine"),
        ({"pair": [1.0]}, "a list of 2"),
    ],
)
def test_a_damaged_design_is_refused(leg, tmp_path, damage, words):
    document = json.loads(leg.save(tmp_path / "leg.json").read_text())
    (tmp_path / "leg.json").write_text(json.dumps(document | damage))
    with pytest.raises(InputError, match=words) as error:
        Design.load(tmp_path / "leg.json", LEG)
    assert "is not a saved design" in str(error.value)


@pytest.mark.parametrize("damage", [{"points": []}, {"points": [3]}, {"objectives": ["-alpha"]}, {"refused": [1]}])
def test_a_damaged_front_is_refused(front, tmp_path, damage):
    document = json.loads(front.save(tmp_path / "front.json").read_text())
    (tmp_path / "front.json").write_text(json.dumps(document | damage))
    with pytest.raises(InputError, match="is not a saved front"):
        Front.load(tmp_path / "front.json", LEG)


def test_the_figure_of_a_front(front):
    axes = front.plot()
    assert axes.lines[0].get_xydata() == pytest.approx(front.values * [-1, 1])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("centre of mass rise (m)", "largest contact force (N)")
    assert front.plot(axes) is axes
