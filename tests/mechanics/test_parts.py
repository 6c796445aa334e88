"""The parts of a model: tension, gap, landing, and displacements of actuators, against values by hand."""

import pytest

from orbits import Mechanism, check, find, follow, prove, starts
from orbits.check_proof import check as faults_of_proof
from orbits.mechanics import Mass, Spring
from orbits.show import law_data


def plated(gap: str, **names) -> Mechanism:
    """A hopper on a sprung plate, its foot's coordinate being "foot" or half of it."""
    foot = names.get("foot", "foot")
    elements = [Mass("body", 2.0), Mass(foot, 0.5), Mass("plate", 4.0)]
    elements += [Spring(f"body - {foot}", "k*r"), Spring("plate", "h*r")]
    heights = {"body": "body", "foot": foot, "plate": "plate"}
    return Mechanism(("body", "foot", "plate"), elements, gap, {"k": 3.0, "h": 20.0}, heights=heights)


def test_a_gap_along_a_lever_by_substitution():
    """The foot y moves by twice the coordinate z = y/2: the gap "2*z - plate" is y - plate. It is measured along z, so
    that its force, along z, is twice that on the foot, and its jerk half of the foot's."""
    direct, lever = plated("foot - plate"), plated("2*foot - plate", foot="2*foot")
    start = starts(direct, 3.0, 4.0)[0]
    one = find(direct, start=start)
    told = {name: value / 2 if name in ("foot", "foot'") else value for name, value in start.items()}
    two = find(lever, start=told)
    assert two.alpha == pytest.approx(one.alpha, rel=1e-12)
    assert two.period == pytest.approx(one.period, rel=1e-12)
    ratio = two.certificate.largest_contact_force / one.certificate.largest_contact_force
    assert ratio == pytest.approx(2.0, rel=1e-11)
    assert two.certificate.landing_jerk == pytest.approx(one.certificate.landing_jerk / 2, rel=1e-11)
    assert two.certificate.loss_coefficient == pytest.approx(one.certificate.loss_coefficient, rel=1e-9)
    assert check(lever, start=told).largest < 0.1


def long_leg(length: str, **parameters: float) -> Mechanism:
    """A hopper whose body is counted from the ground, as high above the foot as the length when the spring is
    unloaded."""
    elements = [Mass("body", "1"), Mass("foot", "1"), Spring(f"body - foot - {length}", "k*r")]
    return Mechanism(("body", "foot"), elements, "foot", {"k": 1.0, **parameters}, rest={"body": length})


@pytest.mark.slow
@pytest.mark.parametrize(("length", "parameters"), [("l", {"l": 10.0}), ("10", {})])
def test_an_extension_is_that_beyond_the_spring_s_length(length, parameters):
    machine, plain = long_leg(length, **parameters), long_leg("0")
    assert plain.model.extension_offset is None
    orbit, known = find(machine), find(plain)
    assert orbit.alpha == pytest.approx(known.alpha, rel=1e-13)
    assert orbit.liftoff_extension == pytest.approx(1.0, rel=1e-14)
    assert law_data(machine, orbit).liftoff == pytest.approx((1.0, 1.0), rel=1e-13)
    assert law_data(machine, orbit).used == pytest.approx(law_data(plain, known).used, rel=1e-12)
    proof = prove(orbit)
    assert proof.proved
    assert faults_of_proof(proof.saved()) == []


def test_an_extension_along_a_family_is_that_beyond_the_length_there():
    machine = long_leg("l", l=10.0)
    assert {round(point.liftoff_extension, 12) for point in follow(machine, "l", 12.0).points} == {1.0}
    tuned = find(machine, tune="k", at={"liftoff_extension": 0.5})
    assert tuned.source.values["k"] == pytest.approx(2.0, rel=1e-13)
