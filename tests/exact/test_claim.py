"""What an orbit claims is measured anew, and held to its digits."""

import dataclasses

import pytest

from orbits import InputError, Orbit, find, prove
from orbits.exact import claim_of
from problems import HeavyHand, hopper_in_si


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("loss_coefficient", lambda value: 1.001 * value), ("landing_jerk", lambda value: 1.001 * value),
        ("largest_contact_force", lambda value: 1.001 * value), ("smallest_separation", lambda value: 1.001 * value),
        ("clearance", lambda value: 0.1), ("bounce_side", lambda value: "above"), ("stable_side", lambda value: None),
    ],
)  # fmt: skip
def test_numbers_of_a_certificate_are_measured_anew(cubic_hop, name, change):
    certificate = dataclasses.replace(cubic_hop.certificate, **{name: change(getattr(cubic_hop.certificate, name))})
    (said,) = claim_of(dataclasses.replace(cubic_hop, certificate=certificate), cubic_hop.source).contradictions
    assert said.startswith(f"{name}: the orbit states")
    assert not claim_of(cubic_hop, cubic_hop.source).contradictions


@pytest.mark.parametrize("name", ["flight_time", "contact_time", "liftoff_extension"])
def test_times_and_places_are_held_to_their_digits(cubic_hop, name):
    moved = dataclasses.replace(cubic_hop, **{name: getattr(cubic_hop, name) * (1 + 1e-9)})
    proof = prove(moved)
    assert not proof.proved
    assert any(reason.startswith(f"{name}: the orbit states") for reason in proof.reasons)


def test_an_unchanged_file_says_the_same(cubic_hop, tmp_path):
    assert prove(Orbit.load(cubic_hop.save(tmp_path / "hop.json")), machine=cubic_hop.source, motion=False).proved


def test_masses_in_si_are_told():
    orbit = find(hopper_in_si(3.0, 2.0, stiffness=500.0))
    assert not claim_of(orbit, orbit.source).contradictions
    said = dataclasses.replace(orbit, machine={**orbit.machine, "body_mass": 4.0})
    assert claim_of(said, orbit.source).contradictions[0].startswith("body_mass: the orbit states 4.0")


def changed(orbit, **changes):
    """The orbit with other numbers in its certificate."""
    return dataclasses.replace(orbit, certificate=dataclasses.replace(orbit.certificate, **changes))


@pytest.mark.parametrize("name", ["smallest_separation", "largest_contact_force", "landing_jerk", "loss_coefficient"])
@pytest.mark.parametrize("side", [-1, 1])
def test_numbers_are_measured_to_a_millionth(cubic_hop, name, side):
    """Lengths as a share of the way that the launch speed leads in the flight, forces of the largest one; the loss
    coefficient to ten times its error too."""
    c = cubic_hop.certificate
    sizes = {
        "smallest_separation": cubic_hop.alpha * cubic_hop.flight_time,
        "largest_contact_force": c.largest_contact_force,
    }
    value = getattr(c, name)
    room = 1e-6 * (sizes.get(name, 0.0) + abs(value)) + (10 * c.loss_error if name == "loss_coefficient" else 0.0)
    for share, fine in ((0.9, True), (1.1, False)):
        said = claim_of(changed(cubic_hop, **{name: value + side * share * room}), cubic_hop.source).contradictions
        assert [each.partition(":")[0] for each in said] == ([] if fine else [name])


@pytest.mark.parametrize("phase", ["flight", "contact"])
def test_the_motion_is_that_of_the_launch(cubic_hop, phase):
    path = getattr(cubic_hop, phase)
    for share, fine in ((1e-8, True), (1e-4, False)):
        moved = dataclasses.replace(path, coefficients=path.coefficients * (1 + share))
        said = claim_of(dataclasses.replace(cubic_hop, **{phase: moved}), cubic_hop.source).contradictions
        assert [each[:10] for each in said] == ([] if fine else ["the motion"])
    shorter = dataclasses.replace(path, times=path.times * (1 + 1e-4))
    assert claim_of(dataclasses.replace(cubic_hop, **{phase: shorter}), cubic_hop.source).contradictions


def test_a_claim_is_the_orbits_numbers(cubic_hop):
    claim = claim_of(cubic_hop, None)
    assert claim.machine is cubic_hop.source
    assert (claim.alpha, claim.error, claim.family) == (cubic_hop.alpha, cubic_hop.error, cubic_hop.family)
    assert (claim.flight_time, claim.contact_time) == (cubic_hop.flight_time, cubic_hop.contact_time)
    assert claim.places == dict(zip(("y1", "y2"), cubic_hop.state_mid_flight[::2], strict=True))
    unknowns = {"alpha": cubic_hop.alpha, "liftoff": cubic_hop.liftoff_extension}
    unknowns |= {"duration": cubic_hop.flight_time / 2, "contact_duration": cubic_hop.contact_time / 2}
    assert claim.unknowns == pytest.approx(unknowns, rel=1e-15)
    unending = claim_of(dataclasses.replace(cubic_hop, contact_time=None), cubic_hop.source)
    assert unending.contact_time is None
    assert unending.contradictions


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"spring": "r"}, "spring: the orbit states 'r'"), ({"gravity": "2"}, "gravity: the orbit states '2'"),
        ({"mass_ratio": 2.0}, "mass_ratio: the orbit states 2.0"), ({"restitution": 0.5}, None),
        ({"parameters": {"beta": 0.4}}, "beta: the orbit states 0.4, but the machine 0.3"),
        ({"parameters": {}}, "beta: the orbit states None"), ({"parameters": {"beta": 0.3, "k": 1.0}}, "k: the orbit"),
    ],
)  # fmt: skip
def test_machines_are_compared_by_all_that_their_hops_depend_on(cubic_hop, change, words):
    other = dataclasses.replace(cubic_hop, machine={**cubic_hop.machine, **change})
    said = claim_of(other, cubic_hop.source).contradictions
    assert [each[: len(words or "")] for each in said] == ([words] if words else [])
    if words:
        assert claim_of(other, cubic_hop.source, [words.partition(":")[0]]).contradictions == ()


def test_units_of_parameters_are_compared():
    orbit = find(hopper_in_si(3.0, 2.0, stiffness=500.0))
    name, unit = next(iter(orbit.machine["units"].items()))
    other = dataclasses.replace(orbit, machine={**orbit.machine, "units": {**orbit.machine["units"], name: "ft"}})
    assert claim_of(other, orbit.source).contradictions == (
        f"the unit of {name}: the orbit states 'ft', but the machine {unit!r}",
    )


def test_whose_orbit_it_is(cubic_hop):
    with pytest.raises(InputError, match="does not know its machine"):
        claim_of(dataclasses.replace(cubic_hop, source=None), None)
    with pytest.raises(InputError, match="orbit belongs to another machine, with the states y1, y1', y2, y2'"):
        claim_of(cubic_hop, HeavyHand())
