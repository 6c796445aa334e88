"""What is proved not to be, beside searches that find what there is."""

from fractions import Fraction

import pytest
from ball_systems import fn
from conftest import slow_after

from orbits import InputError, NoOrbit, find, prove_absence, simulate
from orbits.proof.absence import trend_of
from orbits.symbolic import symbol
from problems import Chain, Hopper, Juggler


@pytest.mark.parametrize(("b", "family"), slow_after(1, [(0.3333334, 1), (5.0, 1), (0.2, 2), (0.15, 3)]))
def test_no_orbit_of_a_tanh_spring(b, family):
    machine = Hopper("tanh", parameters={"b": b})
    proof = prove_absence(machine, family)
    assert proof.proved
    assert f"family {family}" in proof.statement
    with pytest.raises(NoOrbit):
        find(machine, family)


@pytest.mark.parametrize(("b", "family"), [(0.33, 1), (0.199, 2), (0.05, 1)])
def test_what_may_be_is_not_proved_absent(b, family):
    proof = prove_absence(Hopper("tanh", parameters={"b": b}), family)
    assert not proof.proved
    assert "force is bounded" in proof.reasons[0]


def test_a_whole_interval_of_springs():
    proof = prove_absence(Hopper("tanh", parameters={"b": 0.3}), 2, parameters={"b": ("0.21", "5")})
    assert proof.proved
    assert "b in [0.21, 5]" in proof.statement


@pytest.mark.parametrize("spring", ["atan(r)/2", "0.4*tanh(r) + 0.3*atan(r)"])
def test_other_bounded_springs(spring):
    assert prove_absence(Hopper(spring), 1).proved


@pytest.mark.parametrize(
    ("spring", "why"), [("r", "force is bounded"), ("sin(r)", "odd"), ("tanh(r - 1)", "odd"), ("exp(r) - 1", "odd")]
)
def test_springs_that_the_theorem_does_not_tell(spring, why):
    proof = prove_absence(Hopper(spring), 1)
    assert not proof.proved
    assert why in proof.reasons[0]


@pytest.mark.parametrize("spring", ["r - 0.5*r**3", "r - 0.2*r**3", "r - 0.3*r**5"])
def test_no_orbit_of_a_weak_spring(spring):
    """The largest tensions at rising force are 0.544, 0.861 and 0.723 of the foot's weight. Far in compression the
    force passes the foot's weight again, but falls with the extension there: a lift-off is possible, and no lossless
    one."""
    proof = prove_absence(Hopper(spring))
    assert proof.proved
    assert "no lossless orbit" in proof.statement
    assert "lift-off from sustained contact" not in proof.statement
    with pytest.raises(NoOrbit, match="never reaches"):
        find(Hopper(spring))


def test_absence_is_proved_where_landings_lose_energy():
    """With the restitution 1 none does: from rest at mid-flight this machine bounces for ever."""
    proof = prove_absence(Hopper("r - 0.5*r**3", restitution=0.5))
    assert proof.proved
    assert proof.stated["restitution"] == "0.5"
    assert "the gap y2, which lands with the restitution 0.5: its rate v becomes -0.5*v" in proof.statement
    machine, foot = Hopper("r - 0.5*r**3", restitution=1.0), 0.2269107764581993
    run = simulate(machine, state=[foot + 1.7, 0.0, foot, 0.0], time=2.0)
    assert abs(run(2 * run.events[0].time) - run(0.0)).max() < 1e-13
    for family in (None, 1):
        proof = prove_absence(machine, family)
        assert not proof.proved
        assert "restitution 1" in proof.reasons[0]
        assert "no lossless orbit" not in proof.statement


@pytest.mark.parametrize("spring", ["r", "r - 0.1*r**3", "r - 0.14*r**3", "sinh(r)"])
def test_an_orbit_is_not_proved_absent(spring):
    """The largest tension of the third is 1.029 times the foot's weight."""
    assert not prove_absence(Hopper(spring)).proved


def test_of_what_nothing_can_be_said():
    for machine in (Hopper(gravity="exp(-z/H)", rest_length=8.0, parameters={"H": 90.0}), Chain([1, 1, 1])):
        with pytest.raises(InputError, match="moves alone"):
            prove_absence(machine, 1)
    assert "odd" in prove_absence(Juggler("tanh"), 1).reasons[0]  # its hand's weight is no odd force
    with pytest.raises(InputError, match="a number from 1"):
        prove_absence(Hopper(), 0)


@pytest.mark.parametrize(
    ("law", "odd", "rises"),
    [
        (lambda r, b, n: fn.tanh(b * r) / b, True, True),
        (lambda r, b, n: r + b * r**3 / n, True, True),
        (lambda r, b, n: r - b * r**3, True, False),
        (lambda r, b, n: r + b * r**4, False, False),
        (lambda r, b, n: r * r * r / n, False, False),
        (lambda r, b, n: fn.exp(b * r), False, True),
        (lambda r, b, n: fn.sin(r), False, False),
        (lambda r, b, n: r * fn.tanh(r), False, False),
        (lambda r, b, n: -r, True, False),
        (lambda r, b, n: b / r, False, False),
        (lambda r, b, n: fn.atan(r) + b, False, True),
    ],
)
def test_trends(law, odd, rises):
    """What the operations show is true; what they do not show may be true all the same."""
    r, b, n = (symbol(name) for name in "rbn")
    trend = trend_of(law(r, b, n), r, {b: (Fraction(3, 10),) * 2, n: (Fraction(2), Fraction(3))})
    assert (trend.odd, trend.rises) == (odd, rises)
