"""Laws in pieces, proved across their breakpoints, against closed forms of the pieces."""

import dataclasses

import mpmath as mp
import pytest
from flint import arb

from orbits import NoOrbit, find, prove
from orbits.balls.crossing import Breakpoints
from orbits.exact.refusal import Unproved
from orbits.laws.law import Written
from problems import Hopper, Juggler
from problems.laws import springs


def lateness(alpha, gap, ratio):
    """T(alpha) - alpha of family 1 of the bilinear spring, in closed form: each piece is an oscillator or a line."""
    gap, ratio = mp.mpf(gap), mp.mpf(ratio)
    rho = gap + (1 - gap) / ratio  # beyond the gap, phi = gap + ratio (r - gap)
    w = mp.sqrt(ratio)
    centre = gap - gap / ratio  # phi = ratio (r - centre) beyond the gap
    # Up from rho, and down to the gap, on the stiff piece.
    size = mp.sqrt((rho - centre) ** 2 + alpha**2 / ratio)
    start, end = mp.acos((rho - centre) / size), mp.acos((gap - centre) / size)
    upper = (start + end) / w
    speed = w * size * mp.sin(end)
    # Down from the gap to the bottom, on the soft piece of stiffness 1.
    lower = mp.pi - mp.atan2(speed, gap)
    return upper + lower - alpha


@pytest.mark.parametrize(("gap", "ratio"), [(0.5, 2.0), (0.25, 5.0), (0.75, 1.5)])
def test_a_bilinear_spring(gap, ratio):
    proof = prove(find(Hopper(springs.bilinear(gap=gap, ratio=ratio), rest_length=20.0)))
    assert proof.proved, proof.reasons
    with mp.workdps(40):
        low, high = (mp.mpf(bound) for bound in (proof.alpha.low, proof.alpha.high))
        assert mp.sign(lateness(low, gap, ratio)) * mp.sign(lateness(high, gap, ratio)) == -1


@pytest.mark.parametrize(
    "machine",
    [
        Hopper(springs.end_stops(gap=2.0, stop=20.0)),
        Hopper(springs.bilinear(gap=1.2, ratio=3.0), rest_length=10.0),
        Hopper(springs.end_stops(gap=2.0, stop=5.0), "exp(-z/H)", 1.0, 20.0, parameters={"H": 90.0}),
        Juggler(springs.end_stops(gap=1.3, stop=5.0)),
    ],
    ids=["end stops", "a gap beyond lift-off", "gravity that varies", "juggler"],
)
def test_other_laws_in_pieces(machine):
    orbit = find(machine)
    proof = prove(orbit)
    assert proof.proved, proof.reasons
    assert orbit.alpha - orbit.error <= float(proof.alpha.high)
    assert orbit.alpha + orbit.error >= float(proof.alpha.low)


def test_an_interval_of_gaps():
    """The breakpoint itself is known to an interval only."""
    machine = Hopper(springs.bilinear(gap=0.5, ratio=2.0))
    proof = prove(find(machine), parameters={"gap": ("0.4999", "0.5001")})
    assert proof.proved, proof.reasons
    for gap in (0.4999, 0.5, 0.5001):
        alpha = find(machine.with_values(gap=gap)).alpha
        assert float(proof.alpha.low) < alpha < float(proof.alpha.high)


def test_wrong_claims_of_laws_in_pieces():
    orbit = find(Hopper(springs.bilinear(gap=0.5, ratio=2.0)))
    for gap, ratio in ((0.5001, 2.0), (0.5, 2.001)):
        assert not prove(orbit, machine=Hopper(springs.bilinear(gap=gap, ratio=ratio))).proved


def test_a_table_is_refused():
    rows = ([-8.0, -4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0, 8.0], [-9.1, -4.2, -2.1, -1.0, 0.0, 1.0, 2.1, 4.2, 9.1])
    try:
        orbit = find(Hopper(springs.table(rows, noise=0)))
    except NoOrbit:
        pytest.fail("the table has a hop")
    proof = prove(orbit)
    assert not proof.proved
    assert "table" in proof.reasons[0]


def test_breakpoints():
    points = Breakpoints((arb(1), arb(0)), [arb(-1), arb(2)])
    assert [points.laws_of([arb(x), arb(7)]) for x in (-2, 0, 3)] == [(0,), (1,), (2,)]
    assert points.laws_of([arb(2), arb(0)]) == (1, 2)
    assert not points.holds(1, [arb(2), arb(0)])
    assert not points.holds(1, [arb(2, 1e-3), arb(0)])
    assert [points.beyond(1, [arb(x), arb(0)]) for x in (-0.9, 1.9)] == [0, 2]
    with pytest.raises(Unproved, match="several pieces"):
        points.laws_of([arb(0, 3), arb(0)])


def test_a_force_that_jumps_is_refused():
    """By 1e-6 of the foot's weight, which the orbit itself hardly shows."""
    bilinear = springs.bilinear(gap=0.5, ratio=1.0)
    jumping = Written(("r", "0.5 + 1e-6 + (r - 0.5)"), ("0.5",))
    machine = Hopper(dataclasses.replace(bilinear, written=jumping))
    proof = prove(find(Hopper(bilinear)), machine=machine)
    assert not proof.proved
    assert "continuous" in proof.reasons[0]
