"""Orbits of many machines continued from one, against closed forms, families that are followed, and other searches."""

from functools import cache

import numpy as np
import pytest
from mechanisms import linear_hops

from orbits import NoOrbit, find, find_all, follow
from orbits.periodic import continued, continued_orbits
from orbits.periodic.parameter_paths import WayOptions
from problems import Chain

LINEAR = Chain()
CUBIC = Chain(springs="r + b*r**3", parameters={"b": 0.0})
HARDENING = CUBIC.with_values(b=0.01)


@cache
def hops_of_chain() -> list:
    """The hops of three equal masses on linear springs with half times up to 5, by launch speed."""
    return list(find_all(LINEAR, LINEAR.starts(5, 5)))


def with_values(machine, **values) -> np.ndarray:
    """The parameters (m, np) of machines with these values (m,) of some parameters."""
    columns = [values.get(name, value) for name, value in machine.values.items()]
    return np.array(np.broadcast_arrays(*columns), dtype=float).T


def test_linear_chains_have_the_hops_of_the_closed_form():
    """Masses that change together, from every hop of equal masses; launch and times against sums of modes."""
    rng = np.random.default_rng(3)
    masses = {name: rng.uniform(0.9, 1.15, 16) for name in ("m1", "m2", "m3")}
    ps = with_values(LINEAR, **masses)
    for hop in hops_of_chain()[:2]:
        found = continued(LINEAR, hop, ps, tuple(masses))
        assert not found.stopped
        (part,), _ = found.certified()
        for i in range(0, 16, 8):
            chain = LINEAR.with_values(**{name: float(values[i]) for name, values in masses.items()})
            mechanism = chain.mechanism
            known = linear_hops(*mechanism.linear_equations(), mechanism.gap_weights, 6, 6)
            *_, half_flight, half_contact = found.unknowns[i]
            times = np.array([[each.half_contact, each.half_flight] for each in known])
            nearest = np.abs(times - [half_contact, half_flight]).max(1).argmin()
            assert [half_contact, half_flight] == pytest.approx(times[nearest], rel=1e-10)
            launch = chain.model.launch_at(known[nearest].liftoff)
            assert found.unknowns[i, :4] == pytest.approx([*launch.values()], rel=1e-9)
            assert part.certificates[int(part.places[i])].error < 1e-11


@pytest.mark.slow
def test_the_way_ends_at_the_fold_of_the_family():
    """The place of the fold, and machines just before and behind it, against a family followed past it."""
    start = find(HARDENING, start=hops_of_chain()[0])
    family = follow(HARDENING, "m1", 0.8, start=start, longest=0.3)
    (fold,) = (event.point.value for event in family.events if event.kind == "fold")
    shares = np.array([0.5, 0.999, 1 - 1e-6, 1 + 1e-6, 1.001, 1.2, 1.5])
    found = continued(HARDENING, start, with_values(HARDENING, m1=1 + (fold - 1) * shares), ["m1"])
    assert sorted(found.stopped) == [3, 4, 5, 6]
    assert {status for status, _ in found.stopped.values()} == {"ends"}
    for _, reason in found.stopped.values():
        assert float(reason.rpartition("m1 = ")[2]) == pytest.approx(fold, abs=2e-5)


@pytest.mark.slow
def test_a_fold_beside_the_straight_way_is_gone_round():
    """With a light upper mass the orbits end at small b; behind these folds they are reached by one parameter after
    the other, and are the same as by small steps on that way."""
    chain, start = HARDENING, find(HARDENING, start=hops_of_chain()[0])
    ends = with_values(chain, m1=[0.8, 0.8], b=[0.01, 0.05])
    found = continued(chain, start, ends, ["m1", "b"])
    assert list(found.stopped) == [0]
    family = follow(chain, "b", 0.05, start=start)
    above = follow(
        chain.with_values(b=0.05), "m1", 0.8, start=dict(zip(chain.model.half_unknowns, family[-1].u, strict=True))
    )
    assert found.unknowns[1] == pytest.approx(above[-1].u, rel=1e-9)


def test_a_way_that_is_too_hard_is_not_said_to_have_no_orbit():
    start, one = hops_of_chain()[0], WayOptions(most=1)
    found = continued(CUBIC, start, with_values(CUBIC, b=[1e-6, 0.3]), ["b"], options=one)
    assert found.stopped[1][0] == "not reached"
    assert "the way from the start is lost at b = 0" in found.stopped[1][1]
    (near, far) = continued_orbits(CUBIC, start, [CUBIC.with_values(b=b) for b in (1e-6, 0.3)], one)
    assert near.alpha == pytest.approx(start.alpha, rel=1e-2)
    assert isinstance(far, NoOrbit)
