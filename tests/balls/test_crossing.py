"""Laws in pieces, proved across their breakpoints, against closed forms of the pieces."""

import dataclasses
import itertools
from functools import cache

import mpmath as mp
import numpy as np
import pytest
from conftest import slow_after
from flint import arb

from orbits import find, find_all, prove
from orbits.balls.crossing import Breakpoints
from orbits.check_proof import check
from orbits.exact import Unproved, claim_of
from orbits.laws import Written
from orbits.proof import prove_claims
from problems import Chain, Hopper, Juggler
from problems.laws import springs
from studies.false_claims import REFUSED, _tables


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


# In the last one the launch is at the breakpoint.
@pytest.mark.parametrize(("gap", "ratio"), slow_after(1, [(0.5, 2.0), (1.0, 2.0)]))
def test_a_bilinear_spring(gap, ratio):
    proof = prove(find(Hopper(springs.bilinear(gap=gap, ratio=ratio), rest_length=20.0)))
    assert proof.proved, proof.reasons
    with mp.workdps(40):
        low, high = (mp.mpf(bound) for bound in (proof.alpha.low, proof.alpha.high))
        assert mp.sign(lateness(low, gap, ratio)) * mp.sign(lateness(high, gap, ratio)) == -1


@pytest.mark.slow
@pytest.mark.parametrize(
    "machine",
    [
        Hopper(springs.bilinear(gap=1.2, ratio=3.0), rest_length=10.0),
        Hopper(springs.end_stops(gap=2.0, stop=5.0), "exp(-z/H)", 1.0, 20.0, parameters={"H": 90.0}),
        Juggler(springs.end_stops(gap=1.3, stop=5.0)),
    ],
    ids=["a gap beyond lift-off", "gravity that varies", "juggler"],
)
def test_other_laws_in_pieces(machine):
    orbit = find(machine)
    proof = prove(orbit)
    assert proof.proved, proof.reasons
    assert orbit.alpha - orbit.error <= float(proof.alpha.high)
    assert orbit.alpha + orbit.error >= float(proof.alpha.low)


LATER_GAPS = ("1.000001", False), ("1.00000000000001", True)


@pytest.mark.parametrize(
    ("gap", "loss"), [("1.00000000001", False), *(pytest.param(*row, marks=pytest.mark.slow) for row in LATER_GAPS)]
)
def test_a_breakpoint_beside_lift_off(gap, loss):
    """The first box holds it. Half the flight is on soft pieces, up to the gap and between both gaps, and on stiff
    ones, to a turn, back, and to the bottom. The loss needs a flight that does not begin on two pieces."""
    proof = prove(find(Hopper(springs.end_stops(gap=float(gap), stop=3.0), rest_length=20.0)), loss=loss)
    assert proof.proved, proof.reasons
    assert proof.digits == (30 if loss else None)

    def late(alpha):
        pace, w = mp.sqrt(1 + alpha**2 - place**2), mp.sqrt(3)
        soft = mp.atan(alpha) - mp.atan2(pace, place) + 2 * mp.atan2(place, pace)
        return soft + 3 * mp.atan2(w * pace, place) / w - alpha

    with mp.workdps(60):
        place = mp.mpf(gap)
        assert mp.nstr(mp.findroot(late, float(proof.alpha.low)), 45) in proof.alpha


@pytest.mark.slow
def test_an_interval_of_gaps():
    """The breakpoint itself is known to an interval only."""
    machine = Hopper(springs.bilinear(gap=0.5, ratio=2.0))
    proof = prove(find(machine), parameters={"gap": ("0.4999", "0.5001")}, motion=False)
    assert proof.proved, proof.reasons
    assert not check(proof.document())
    for gap in (0.4999, 0.5, 0.5001):
        alpha = find(machine.with_values(gap=gap)).alpha
        assert float(proof.alpha.low) < alpha < float(proof.alpha.high)


def softly_late(alpha, gap, ratio):
    """The time of `lateness`, where the launch, at 1, is on the soft piece: up to the gap, above it, to the bottom."""
    pace, w = mp.sqrt(1 + alpha**2 - gap**2), mp.sqrt(ratio)
    up, down = mp.atan(alpha) - mp.atan2(pace, gap), mp.pi - mp.atan2(pace, gap)
    return up + 2 * mp.atan2(w * pace, gap) / w + down - alpha


@pytest.mark.slow
def test_a_tuned_gap():
    """The breakpoint is an unknown of the theorem."""
    proof = prove(find(Hopper(springs.bilinear(ratio=3, gap=1.5), rest_length=20), tune="gap", at={"alpha": 3.7}))
    assert proof.proved, proof.reasons
    with mp.workdps(40):
        gap = mp.findroot(lambda gap: softly_late(mp.mpf("3.7"), gap, 3), 1.65)
        assert mp.nstr(gap, 35) in proof.enclosures["gap"]
    assert proof.enclosures["gap"].width < 1e-20
    assert not check(proof.document())


@pytest.mark.slow
def test_wrong_claims_of_laws_in_pieces():
    orbit = find(Hopper(springs.bilinear(gap=0.5, ratio=2.0)))
    for gap, ratio in ((0.5001, 2.0), (0.5, 2.001)):
        assert not prove(orbit, machine=Hopper(springs.bilinear(gap=gap, ratio=ratio))).proved


CUBIC = springs.cubic(beta=0.004)
ROWS = ([-8.0, -4.5, -1.5, 0.0, 1.25, 4.0, 8.0], [-9.1, -4.8, -1.5, 0.0, 1.3, 4.2, 9.1])


class Rows:
    """The law through rows of value, slope and curvature, its potential and the times between extensions, in mpmath."""

    def __init__(self, rows):
        self.pieces, self.base = [], [mp.mpf(0)]
        rows = [[mp.mpf(repr(float(each))) for each in row] for row in rows]
        for (a, *low), (b, *high) in itertools.pairwise(rows):
            matrix = [[mp.ff(j, k) * (b - a) ** (j - k) for j in range(6)] for k in range(3)]
            parabola = [low[0], low[1], low[2] / 2]
            left = [
                y - sum(m * c for m, c in zip(row, parabola, strict=False)) for y, row in zip(high, matrix, strict=True)
            ]
            rest = mp.lu_solve(mp.matrix([row[3:] for row in matrix]), mp.matrix(left))
            self.pieces.append((a, b, [*parabola, *rest]))
            self.base.append(self.potential(b))

    def piece(self, r):
        return next((k for k, (_, b, _) in enumerate(self.pieces) if r < b), len(self.pieces) - 1)

    def force(self, r):
        a, _, c = self.pieces[self.piece(r)]
        return sum(x * (r - a) ** j for j, x in enumerate(c))

    def potential(self, r):
        k = self.piece(r)
        a, _, c = self.pieces[k]
        return self.base[k] + sum(x * (r - a) ** (j + 1) / (j + 1) for j, x in enumerate(c))

    def time(self, energy, low, high):
        """From one extension to another, on each part in the root of the distance from its end."""
        inside = [b for _, b, _ in self.pieces if low < b < high]
        whole = mp.mpf(0)
        for u, v in itertools.pairwise([low, *inside, high]):
            end, way = (v, -1) if v == high else (u, 1)
            integrand = lambda s, end=end, way=way: 2 * s / mp.sqrt(2 * (energy - self.potential(end + way * s * s)))  # noqa: E731
            whole += mp.quad(integrand, [0, mp.sqrt(v - u)], method="gauss-legendre")
        return whole

    def lateness(self, alpha, liftoff, top, bottom):
        """T(alpha) - alpha of family 1, the roots being near these extensions."""
        rho = mp.findroot(lambda r: self.force(r) - 1, liftoff)
        energy = alpha**2 / 2 + self.potential(rho)
        top, bottom = (mp.findroot(lambda r: self.potential(r) - energy, end) for end in (top, bottom))
        return self.time(energy, rho, top) + self.time(energy, bottom, top) - alpha


@cache
def hop_of_rows():
    """The hop of the table with `ROWS`."""
    return find(Hopper(springs.table(ROWS, noise=0), rest_length=20.0))


@pytest.mark.slow
def test_a_measured_spring():
    """The lateness, by quadratures, changes its sign between the bounds of the enclosure."""
    orbit = hop_of_rows()
    law = orbit.source.spring
    proof = prove(orbit)
    assert proof.proved, proof.reasons
    assert "(-8.0, -9.1, " in proof.statement
    r = orbit(np.linspace(0, orbit.flight_time / 2, 200)) @ [1, 0, -1, 0]
    with mp.workdps(36):
        rows, ends = Rows(law.written.rows()), (orbit.liftoff_extension, r.max(), r.min())
        low, high = (rows.lateness(mp.mpf(bound), *ends) for bound in (proof.alpha.low, proof.alpha.high))
        assert low * high < 0
        assert abs(low) < 1e-18


@pytest.mark.slow
def test_a_chain_with_a_measured_spring():
    """The table has the rows of a cubic spring, so closely that the hop is near that of the formula."""
    r = np.linspace(-12.0, 12.0, 25)
    chain, cubic = (Chain([1, 1, 1], ["r", law]) for law in (springs.table((r, r + 0.004 * r**3), noise=0), CUBIC))
    orbit = find_all(chain, chain.starts(5, 5))[0]
    proof = prove(orbit)
    assert proof.proved, proof.reasons
    assert find(cubic, start=orbit).alpha == pytest.approx(float(proof.alpha.low), rel=1e-6)


@pytest.mark.slow
def test_parameters_of_a_table():
    """Its scale and its shift are numbers or intervals of the theorem, and what they say is so."""
    machine = Hopper(springs.table(ROWS, noise=0, scale="s", shift="d"), rest_length=20.0)
    proof = prove(find(machine.with_values(d=1e-3)), parameters={"s": ("0.999999", "1.000001")}, motion=False)
    assert proof.proved, proof.reasons
    assert "the force (s)*f along r = y1 - y2 - d" in proof.statement
    for s in (0.999999, 1.000001):
        assert float(proof.alpha.low) < find(machine.with_values(s=s, d=1e-3)).alpha < float(proof.alpha.high)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rows", "reason"),
    [
        ((ROWS[0], [*ROWS[1][:-2], 4.2 + 1e-9, 9.1]), "alpha"),
        ((ROWS[0][1:], ROWS[1][1:]), ""),
    ],
    ids=["another row", "a row less"],
)
def test_a_hop_of_another_table_is_not_proved(rows, reason):
    proof = proof_with(springs.table(rows, noise=0))
    assert not proof.proved
    assert reason in proof.reasons[0]


def proof_with(law):
    """The proof of the hop with `ROWS`, said of another law."""
    claim = claim_of(hop_of_rows(), None)
    other = dataclasses.replace(claim, machine=Hopper(law, rest_length=20.0))
    return prove_claims([other], motion=False)[0]


@pytest.mark.parametrize(("end", "proved"), [(-4.43, True), (-4.42, False)])
def test_a_table_has_no_force_beyond_its_rows(end, proved):
    """A law with rows down to an end; the flight comes to -4.423."""
    law = springs.table(ROWS, noise=0)
    piece = np.polynomial.Polynomial(law.pieces.table({})[1][1][1:])
    node = [end, *(piece.deriv(k)(end + 4.5) if k else piece(end + 4.5) for k in range(3))]
    rows = np.vstack([node, law.written.rows()[2:]])
    proof = proof_with(dataclasses.replace(law, written=law.written._replace(rows=lambda: rows)))
    assert proof.proved == proved
    assert proved or "where the spring's table has no value" in proof.reasons[0]


@pytest.mark.slow
def test_a_false_claim_about_a_table_is_refused():
    """One of those of `studies/theorems.py`; 200 others were tried."""
    rng, claim = np.random.default_rng(1), None
    while claim is None:
        claim = _tables(rng)
    assert claim.verdict() == REFUSED, claim.what


@pytest.mark.slow
def test_an_orbit_that_grazes_a_breakpoint_is_refused():
    """The linear hop turns at -+ sqrt(1 + alpha**2), where the stops are."""
    alpha = 4.493409457909064
    orbit = find(Hopper("r", rest_length=20.0))
    stops = Hopper(springs.end_stops(gap=float(np.sqrt(1 + alpha**2)), stop=2.0), rest_length=20.0)
    (proof,) = prove_claims([dataclasses.replace(claim_of(orbit, None), machine=stops)], motion=False)
    assert not proof.proved
    assert "breakpoint" in proof.reasons[0]


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


def test_motions_that_begin_at_a_breakpoint_have_no_loss_coefficient():
    proof = prove(find(Hopper(springs.bilinear(gap=1.0, ratio=2.0), rest_length=20.0)), loss=True)
    assert "begins at a breakpoint" in proof.reasons[0]
