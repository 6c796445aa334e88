"""Orbits of machines with the same words and other equations are told apart by their motions."""

import numpy as np
import pytest

from orbits import InputError, Mechanism, Orbit, find, sensitivities
from orbits.flow import is_motion_of
from orbits.mechanics import Mass, Spring
from problems import Hopper, hopper_in_si, rimless_wheel, springs

PLACES = np.linspace(-12.0, 12.0, 241)


def tabled(beta: float) -> Hopper:
    return Hopper(springs.table((PLACES, PLACES + beta * PLACES**3)))


def stated(foot: str) -> Mechanism:
    elements = [Mass("body", "m1"), Mass("foot", foot), Spring("body - foot", "r")]
    return Mechanism(("body", "foot"), elements, "foot", parameters={"m1": 1.0, "m2": 1.0})


def in_si(beta: float):
    return hopper_in_si(60.0, 3.0, force=springs.function(lambda r: 8000 * r + beta * r**3), rest_length=0.8)


@pytest.mark.parametrize(
    "pair",
    [(tabled(0.1), tabled(0.1 + 1e-6)), (stated("m2"), stated("2*m2")), (in_si(1e6), in_si(2e6))],
    ids=["table", "masses", "function in SI"],
)
def test_an_orbit_is_not_taken_for_that_of_another_machine(tmp_path, pair):
    own, other = pair
    assert own.describe() == other.describe()
    orbit, path = find(own), tmp_path / "orbit.json"
    orbit.save(path)
    assert Orbit.load(path, own).source is own
    with pytest.raises(InputError, match="another machine: its motion does not satisfy these equations"):
        Orbit.load(path, other)
    with pytest.raises(InputError, match="another machine: its motion does not satisfy these equations"):
        sensitivities(other, orbit, quantities="alpha")


def test_a_step_is_that_of_its_own_inertia():
    """phi'' = -r in units of J and k, whatever mu is; theta'' = mu (kappa sin(theta - a) + r)."""
    wheel = rimless_wheel(inertia_ratio=1.0, angle=0.3)
    step = find(wheel)
    assert is_motion_of(step.flight, wheel.model.flight, wheel.values)
    nearly = wheel.values | {"inertia_ratio": 1.0 + 1e-8}
    assert not is_motion_of(step.flight, wheel.model.flight, nearly)
    assert is_motion_of(step.contact, wheel.model.contact, nearly)  # theta rests, and phi does not know of mu
