"""Lossless hops of linear mechanisms of three masses, of many topologies, against matrix exponentials in 30 digits."""

import flint
import mpmath as mp
import numpy as np
import pytest
from mechanisms import linear_hops
from scipy.linalg import expm as expm_in_doubles

from orbits import InputError, NoOrbit
from orbits.model import half_angle
from orbits.periodic.linear_hops import LinearHop
from problems import Chain

GROUND = None
# The ends of the springs, and the weights of the gap.
TOPOLOGIES = {
    "chain": ([(0, 1), (1, 2)], (0, 0, 1)),
    "hopper on a sprung plate": ([(0, 1), (2, GROUND)], (0, 1, -1)),
    "juggler on a chain": ([(1, 2), (2, GROUND)], (1, -1, 0)),
    "body with two coupled feet": ([(0, 1), (0, 2), (1, 2)], (0, 1, 0)),
    "absorber on the body": ([(0, 1), (0, 2)], (0, 1, 0)),
    "absorber on the foot": ([(0, 1), (1, 2)], (0, 1, 0)),
    "ball on a spring in the hand": ([(0, 2), (1, 2), (2, GROUND)], (1, -1, 0)),
    "two masses held by the ground": ([(0, GROUND), (1, GROUND), (0, 2)], (1, -1, 0)),
    "lever to the ground": ([(0, 1), (1, 2)], (0, -0.5, 1.5)),
}


def mechanism(topology: str, seed: int):
    """Inertia, stiffness, load and gap with random masses, springs, lengths at rest and, for odd seeds, inerters."""
    (springs, gap), rng = TOPOLOGIES[topology], np.random.default_rng(seed)
    masses = rng.uniform(0.3, 3.0, 3)
    inertia, stiffness, load = np.diag(masses), np.zeros((3, 3)), -masses
    for upper, lower in springs:
        extension = np.eye(3)[upper] - (0.0 if lower is GROUND else np.eye(3)[lower])
        slope, length = rng.uniform(0.3, 3.0), rng.uniform(-0.5, 0.5)
        stiffness, load = stiffness + slope * np.outer(extension, extension), load + slope * length * extension
        inertia = inertia + (seed % 2) * rng.uniform(0.0, 0.5) * np.outer(extension, extension)
    return inertia, stiffness, load, np.array(gap, dtype=float)


def expm(matrix: mp.matrix) -> mp.matrix:
    """The exponential of a matrix by FLINT, which encloses it in an eighth of the time that mpmath takes."""
    digits, before = 50, flint.ctx.dps
    flint.ctx.dps = digits + 10
    try:
        enclosed = flint.arb_mat([[mp.nstr(x, digits) for x in row] for row in matrix.tolist()]).exp()
        assert all(float(each.rad()) < 1e-40 * (1 + float(abs(each))) for each in enclosed.entries())
        return mp.matrix([[mp.mpf(x.str(digits, radius=False)) for x in row] for row in enclosed.tolist()])
    finally:
        flint.ctx.dps = before


class Exactly:
    """A linear mechanism in 30 digits, with states (y, y', 1). In contact `gone` follows from the others."""

    def __init__(self, inertia, stiffness, load, gap):
        n, self.gone = len(gap), int(np.abs(gap).argmax())
        m, k, f, self.gap = (mp.matrix(np.asarray(values).tolist()) for values in (inertia, stiffness, load, gap))
        self.size, self.kept = n, [i for i in range(n) if i != self.gone]
        self.embed = mp.zeros(n, n - 1)
        for column, i in enumerate(self.kept):
            self.embed[i, column], self.embed[self.gone, column] = 1, -self.gap[i] / self.gap[self.gone]
        self.acceleration = lambda y: m**-1 * (f - k * y)
        e = self.embed
        self.flight, self.contact = self.generator(m, k, f), self.generator(e.T * m * e, e.T * k * e, e.T * f)

    @staticmethod
    def generator(m, k, f):
        n, a = len(f), mp.zeros(2 * len(f) + 1)
        a[:n, n : 2 * n], a[n : 2 * n, :n], a[n : 2 * n, 2 * n] = mp.eye(n), -(m**-1) * k, m**-1 * f
        return a

    def of_gap(self, y):
        return (self.gap.T * y)[0]

    def lifted(self, rest, half_contact):
        """The flight state a time after rest (n - 1,) in contact."""
        n, x = self.size, expm(self.contact * half_contact) * mp.matrix([*rest, *[0] * (self.size - 1), 1])
        return mp.matrix([*(self.embed * x[: n - 1]), *(self.embed * x[n - 1 : 2 * n - 2]), 1])

    def lacking(self, *unknowns):
        """The gap's acceleration at lift-off, and the speeds in mid-flight."""
        state, n = self.lifted(unknowns[:-2], unknowns[-2]), self.size
        middle = expm(self.flight * unknowns[-1]) * state
        return [self.of_gap(self.acceleration(state[:n])), *middle[n : 2 * n]]

    def hop(self, near: LinearHop):
        """The rest in mid-contact and the half times of the hop near a computed one."""
        contact, flight = mp.mpf(near.half_contact), mp.mpf(near.half_flight)
        start = [mp.mpf(near.liftoff[2 * i + speed]) for speed in (0, 1) for i in self.kept]
        rest = (expm(-self.contact * contact) * mp.matrix([*start, 1]))[: self.size - 1]
        return mp.findroot(self.lacking, [*rest, contact, flight], tol=mp.mpf("1e-48"))


def assert_exact(hop: LinearHop, matrices, tolerance: float = 1e-12):
    """The hop against that of `Exactly`, which lands without gap, speed or acceleration and comes back mirrored."""
    with mp.workdps(30):
        exactly = Exactly(*matrices)
        root = list(exactly.hop(hop))
        n, (contact, flight) = exactly.size, root[-2:]
        start = exactly.lifted(root[: n - 1], contact)
        landed = expm(exactly.flight * 2 * flight) * start
        y, v = landed[:n], landed[n : 2 * n]
        zeros = [exactly.of_gap(y), exactly.of_gap(v), exactly.of_gap(exactly.acceleration(y))]
        assert max(map(abs, zeros)) < mp.mpf("1e-20") * (1 + max(map(abs, start)))
        standing = mp.matrix([*(y[i] for i in exactly.kept), *(v[i] for i in exactly.kept), 1])
        back = expm(exactly.contact * 2 * contact) * standing
        returned = [*(exactly.embed * back[: n - 1]), *(exactly.embed * back[n - 1 : 2 * n - 2])]
        assert max(abs(a - b) for a, b in zip(returned, start, strict=False)) < mp.mpf("1e-20") * max(map(abs, start))
        liftoff = np.array([float(start[i + speed]) for i in range(n) for speed in (0, n)])
    assert hop.half_contact == pytest.approx(float(contact), rel=tolerance)
    assert hop.half_flight == pytest.approx(float(flight), rel=tolerance)
    np.testing.assert_allclose(hop.liftoff, liftoff, atol=tolerance * np.abs(liftoff).max())


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_hops_of_three_masses(topology):
    matrices = mechanism(topology, 0)
    hops = linear_hops(*matrices, 5.0, 5.0)
    assert hops
    assert_exact(hops[-1], matrices)


@pytest.mark.slow
@pytest.mark.parametrize("topology", [*TOPOLOGIES][::2])
def test_every_hop_of_random_masses_springs_and_inerters(topology):
    matrices = mechanism(topology, 1)
    for hop in linear_hops(*matrices, 6.0, 6.0):
        assert_exact(hop, matrices)


@pytest.mark.parametrize("ratio", [0.01, 1.0, 100.0])
def test_two_masses_have_the_roots_of_alpha_equal_to_its_tangent(ratio):
    """The half flight is b / omega with b = tan b; mid-contact, in its own frequency, is opposite to lift-off."""
    equations = Chain((1.0, ratio)).mechanism.linear_equations()
    hops, omega = (
        linear_hops(*equations, [0.0, 1.0], 30.0, 9.0 * np.sqrt(ratio / (1 + ratio)) + 1e-9),
        np.sqrt(1 + 1 / ratio),
    )
    found = sorted({round(hop.half_flight * omega, 12) for hop in hops})
    assert found == pytest.approx([half_angle(1), half_angle(2)], abs=2e-12)
    for hop in hops:
        extension, speed = hop.liftoff[:2]
        assert extension == pytest.approx(ratio, rel=1e-13)  # the weight of the lower mass
        # It swings about -1 with frequency 1 from rest, so that speed and distance have the ratio -tan.
        assert speed == pytest.approx(-(extension + 1) * np.tan(hop.half_contact), rel=1e-10)


def test_a_symmetric_machine_hops_symmetrically():
    """A body on a foot between two equal weights on equal springs: both are motions of the same mode in contact and in
    flight, in which they swing against each other, and which no hop needs."""
    stretches = np.array([[1.0, -1.0, 0.0, 0.0], [1.0, 0.0, -1.0, 0.0], [1.0, 0.0, 0.0, -1.0]])
    masses, gap = np.array([1.0, 0.4, 0.6, 0.6]), np.array([0.0, 1.0, 0.0, 0.0])
    matrices = np.diag(masses), stretches.T @ np.diag([1.0, 2.0, 2.0]) @ stretches, -masses, gap
    hops = linear_hops(*matrices, 4.0, 4.0)
    assert hops
    for hop in hops:
        np.testing.assert_allclose(hop.liftoff[4:6], hop.liftoff[6:], atol=1e-10 * np.abs(hop.liftoff).max())
    merged = np.diag([1.0, 0.4, 1.2]), np.array([[5.0, -1, -4], [-1, 1, 0], [-4, 0, 4]]), -np.array([1.0, 0.4, 1.2])
    one = linear_hops(*merged, gap[:3], 4.0, 4.0)
    np.testing.assert_allclose([hop[:2] for hop in hops], [hop[:2] for hop in one], rtol=1e-10)
    assert_exact(one[0], (*merged, gap[:3]))


# Inertia, stiffness, load, gap and the signs under the reversors: a body on two feet, of which the mean of the heights
# and half their difference are coordinates; and a leg with a weightless swing at its foot, which passes through its
# centre in mid-contact and turns in mid-flight.
TURNED = {
    "two feet": (
        np.diag([1.0, 8.0, 8.0]), [[2.0, -2.0, 0.0], [-2.0, 2.0, 0.0], [0.0, 0.0, 2.0]], [-1.0, -8.0, 0.0],
        [0.0, 1.0, 1.0], [[1, 1, -1], [1, 1, 1]],
    ),
    "swing": (
        np.diag([1.0, 0.4, 0.7]), [[1.5, 0.0, -1.5], [0.0, 0.8, -0.8], [-1.5, -0.8, 2.3]], [-1.0, 0.0, -0.7],
        [0.0, 0.0, 1.0], [[1, 1, 1], [1, -1, 1]],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", TURNED)
def test_what_a_reversor_turns_over_passes_its_centre_midway(name):
    inertia, stiffness, load, gap, signs = (np.array(each, dtype=float) for each in TURNED[name])
    hops = linear_hops(inertia, stiffness, load, gap, 5.0, 5.0, signs=signs)
    assert len(hops) > 1
    apart = np.linalg.inv(inertia)
    pull = apart @ gap / (gap @ apart @ gap)  # the direction of a force on the gap, which is scaled

    def after(state, time, turned, held):
        y, v = state[::2], state[1::2]
        keep = np.eye(len(y)) - held * np.outer(pull, gap)
        rates = np.zeros((2 * len(y) + 1, 2 * len(y) + 1))
        rates[: len(y), len(y) : -1] = np.eye(len(y))
        rates[len(y) : -1, : len(y)], rates[len(y) : -1, -1] = -keep @ apart @ stiffness, keep @ apart @ load
        y, v = np.split((expm_in_doubles(rates * time) @ [*y, *v, 1.0])[:-1], 2)
        return np.where(turned > 0, v, y)

    for hop in hops:
        y, scale = hop.liftoff[::2], np.abs(hop.liftoff).max()
        assert abs(gap @ y) < 1e-12 * scale
        assert abs(gap @ hop.liftoff[1::2]) < 1e-12 * scale
        assert abs(gap @ apart @ (load - stiffness @ y)) < 1e-12 * scale
        assert np.abs(after(hop.liftoff, hop.half_flight, signs[0], 0.0)).max() < 1e-10 * scale
        middle = after(hop.liftoff, -hop.half_contact, signs[1], 1.0)
        assert np.abs(middle[signs[1] < 0]).max(initial=0.0) < 1e-10 * scale
        assert np.abs(middle).max() < 1e-10 * scale
    if name == "two feet":  # the hop of `studies/exact_orbits/cases/alternating_hopper.json`
        ((contact, flight),) = [hop[:2] for hop in hops if hop.half_contact < 2 and hop.half_flight < 2]
        assert contact == pytest.approx(1.0560624532411533151, rel=1e-13)
        assert flight == pytest.approx(1.0650907307635620173, rel=1e-13)


@pytest.mark.parametrize(
    ("change", "kind", "telling"),
    [
        ({"gap": [0.0, 0.0, 0.0]}, InputError, "one weight for each of the 3"),
        ({"gap": [1.0, 0.0]}, InputError, "one weight for each of the 3"),
        ({"gap": [np.nan, 0.0, 1.0]}, InputError, "one weight for each of the 3"),
        ({"half_contact": 0.0}, InputError, "above 0"),
        ({"half_flight": np.inf}, InputError, "half_flight = inf is not a finite number"),
        ({"stiffness": np.diag([0.0, 1.0, 0.0])}, NoOrbit, "never comes back"),
        ({"signs": [[-1, -1, -1], [1, 1, 1]]}, NoOrbit, "the reversor turns over, which is thrown"),
        ({"inertia": np.zeros((3, 3))}, InputError, "not positive definite"),
    ],
)
def test_what_has_no_hops_is_refused(change, kind, telling):
    names = ("inertia", "stiffness", "load", "gap")
    told = dict(zip(names, mechanism("chain", 0), strict=True)) | {"half_contact": 1.0, "half_flight": 1.0}
    with pytest.raises(kind, match=telling):
        linear_hops(**told | change)
