"""Families of oscillations along their energy against closed forms, published values, and DOP853."""

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.special import ellipk

from orbits import InputError, Mechanism, Oscillation, OscillationFamily, find, follow
from orbits.mechanics import Potential, Spring
from problems import Hopper, hopper_in_si
from tests.free_machines import chain_of_carts, double_pendulum, duffing, henon_heiles, pendulum

WIDE = {"longest": 0.5}  # few points


def period_of_duffing(amplitude):
    """The period of u'' + u + u**3 = 0."""
    return 4 * ellipk(amplitude**2 / (2 * (1 + amplitude**2))) / np.sqrt(1 + amplitude**2)


def test_the_backbone_curve_of_the_free_duffing_oscillator():
    """The question of BifurcationKit.jl's issue 232, in one call, against elliptic integrals."""
    backbone = follow(duffing(), "energy", (1e-3, 100.0), at=[1.0], **WIDE)
    amplitudes, energies = backbone.column("u"), backbone.column("energy")
    assert np.abs(amplitudes**2 / 2 + amplitudes**4 / 4 - energies).max() < 1e-13 * energies.max()
    exact = period_of_duffing(amplitudes)
    assert np.abs(backbone.column("frequency") * exact - 1).max() < 2e-15
    assert (np.abs(backbone.periods - exact) <= backbone.errors).all()
    assert backbone.errors.max() < 1e-13
    (event,) = backbone.events
    assert (event.kind, event.energy, backbone.energies[event.after]) == ("value", 1.0, 1.0)
    assert (backbone.end.kind, backbone.end.reason) == ("reached", "100")
    assert backbone.energy_drifts.max() < 1e-14


@pytest.mark.slow
def test_a_pendulum_in_si_up_to_its_separatrix():
    backbone = follow(pendulum(), "energy", (1e-3, 25.0), **WIDE)
    known = backbone.energies < 19.6
    share = backbone.energies / (2 * 2.0 * 9.80665 * 0.5)
    exact = 4 * np.sqrt(0.5 / 9.80665) * ellipk(share)
    assert np.abs(backbone.periods / exact - 1)[known].max() < 1e-12
    assert backbone.end.kind == "homoclinic"
    assert "the last energy found is 19.613" in backbone.end.reason
    assert " J" in backbone.end.reason
    assert (backbone.unit_of("energy"), backbone.unit_of("q'"), backbone.unit_of("period")) == ("J", "rad/s", "s")


@pytest.mark.parametrize("family", [1, 2])
def test_normal_modes_of_linear_machines_have_one_period(family):
    chain = follow(chain_of_carts(1.0, 0.7, 0.4), "energy", (1e-2, 10.0), family=family, **WIDE)
    frequencies = np.sqrt(np.linalg.eigvalsh([[1.7, -0.7], [-0.7, 1.1]]))
    assert np.abs(chain.periods * frequencies[family - 1] / (2 * np.pi) - 1).max() < 1e-14
    assert chain.events == ()
    assert not chain.unstable.any()


def test_a_hopper_stands_up_to_the_energy_at_which_its_foot_lifts():
    """A straight spring of the mass ratio M: the amplitude is 1 + 1/M there, and the energy (1 + M)**2/(2M)."""
    standing = follow(Hopper("r", mass_ratio=0.5, rest_length=30), "energy", (0.1, 3.0), **WIDE)
    (event,) = standing.events
    assert event.kind == "contact pulls"
    assert abs(event.energy - 1.5**2) < 1e-12
    assert np.abs(standing.periods - 2 * np.pi * np.sqrt(3.0)).max() < 1e-13
    orbit = find(Hopper("r", mass_ratio=0.5, rest_length=30), at={"energy": 2.5})
    assert not orbit.admissible
    assert orbit.smallest_contact_force < 0
    leg = follow(hopper_in_si(60.0, 3.0, stiffness=8000.0, rest_length=0.8), "energy", (1.0, 60.0), **WIDE)
    amplitude = 63.0 * 9.80665 / 8000.0
    assert abs(leg.events[0].energy - 4000.0 * amplitude**2) < 1e-10
    assert np.abs(leg.periods - 2 * np.pi * np.sqrt(60.0 / 8000.0)).max() < 1e-14


def test_masses_that_touch_while_a_hopper_stands():
    """A straight spring of the length L: the body rests at L - 1, so that the energy of the touch is (L - 1)**2/2."""
    standing = follow(Hopper("r", rest_length=1.5), "energy", (0.01, 0.5), **WIDE)
    (event,) = standing.events
    assert (event.kind, round(event.energy, 12)) == ("masses touch", 0.125)
    assert np.abs(0.5 - np.sqrt(2 * standing.energies) - standing.column("smallest_separation")).max() < 1e-13
    assert (standing.admissible == (standing.energies < 0.125)).all()
    orbit = find(Hopper("r", rest_length=1.5), at={"energy": 0.5})
    assert abs(orbit.smallest_separation + 0.5) < 1e-13
    assert not orbit.admissible
    assert "not a motion: masses touch" in str(orbit)


def test_bifurcations_of_the_straight_orbit_of_henon_and_heiles():
    """Pitchforks at the shares 0.969309 and 0.986709 of the saddle's energy 1/6 (Brack 2001, Found. Phys. 31)."""
    start = {"y": 0.2, "duration": 6.3}
    family = follow(henon_heiles(), "energy", (0.01, 0.1649), start=start, **WIDE)
    pitchforks = [6 * event.energy for event in family.events if event.kind == "branch point"]
    assert np.abs(np.array(pitchforks) - [0.969309, 0.986709]).max() < 1e-6
    flip = next(event for event in family.events if event.kind == "flip")
    assert family.unstable[family.energies > flip.energy][:-1].any()
    assert not family.unstable[0]

    def field(t, z):  # the orbit along y, and a small change across it
        y, v, *change = z
        return [v, -y + y * y, change[1], -(1 + 2 * y) * change[0], change[3], -(1 + 2 * y) * change[2]]

    for event, trace in ((flip, -2.0), *((e, 2.0) for e in family.events if e.kind == "branch point")):
        y, v = event.states[2:]
        end = solve_ivp(field, (0, event.period), [y, v, 1, 0, 0, 1], method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
        assert np.abs(end[:2] - [y, v]).max() < 1e-10
        assert abs(end[2] + end[5] - trace) < 1e-7


@pytest.mark.slow
def test_a_double_pendulum_against_dop853():
    machine = double_pendulum()
    orbit = find(machine, 2, at={"energy": 1.0})

    def field(t, z):
        a, u, b, v = z
        c, s = np.cos(a - b), np.sin(a - b)
        matrix = [[2, c], [c, 1]]
        return [
            u,
            (rates := np.linalg.solve(matrix, [-v * v * s - 2 * np.sin(a), u * u * s - np.sin(b)]))[0],
            v,
            rates[1],
        ]

    start = orbit(0.0)
    a, _, b, _ = start
    assert abs(3 - 2 * np.cos(a) - np.cos(b) - 1.0) < 1e-13  # all speeds vanish at first
    end = solve_ivp(field, (0, orbit.period), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    assert np.abs(end - start).max() < 1e-11
    assert np.abs(orbit(1.3 + orbit.period) - orbit(1.3)).max() < 1e-14
    assert orbit.stable
    assert abs(np.hypot(*orbit.multipliers[0]) - 1) < 1e-12
    found = find(machine, at={"energy": 1.0}, start=orbit.start)
    assert abs(found.period - orbit.period) < 1e-13


def test_the_longest_period_of_a_spring_that_softens_and_hardens():
    """V = u**2/2 - u**4/4 + u**6/12, against quadrature."""
    machine = Mechanism(("u",), [Spring("u", "r - r**3 + r**5/2")], gap=None, inertia={"u": 1.0})
    (turn,) = follow(machine, "energy", (0.01, 1.0), **WIDE).events
    assert turn.kind == "turn of the period"

    def period(amplitude):
        def rate(angle):
            u2, a2 = (amplitude * np.sin(angle)) ** 2, amplitude**2
            return 1 / np.sqrt(1 - (a2 + u2) / 2 + (a2 * a2 + a2 * u2 + u2 * u2) / 6)

        return 4 * quad(rate, 0, np.pi / 2, epsabs=1e-12, epsrel=1e-12)[0]

    amplitude = turn.states[0]
    assert abs(period(amplitude) - turn.period) < 1e-12
    assert abs(period(amplitude + 1e-3) - period(amplitude - 1e-3)) < 1e-6 * turn.period


def test_a_family_through_a_motion():
    well = Mechanism(("u",), [Potential("u**4/4 - u**2/2")], gap=None, inertia={"u": 1.0})
    across = follow(well, "energy", (0.3, 3.0), start={"u": 2.0, "duration": 5.0}, **WIDE)
    assert across.number is None
    assert (np.diff(across.energies) > 0).all()
    assert across.energies[[0, -1]].tolist() == [0.3, 3.0]
    # Energies are counted from the bottom of the well, u = 1.
    assert np.abs((across.column("u") ** 2 - 1) ** 2 / 4 - across.energies).max() < 1e-14
    for count in (2, 6):  # a duration of several periods
        orbit = find(well, at={"energy": 0.3}, start=across.start(0) | {"duration": count * across.periods[0]})
        assert abs(orbit.period - across.periods[0]) < 1e-13
    inside = follow(well, "energy", (0.01, 0.3), start={"u": 0.8}, **WIDE)
    assert inside.end.kind == "homoclinic"
    assert "the last energy found is 0.2499" in inside.end.reason
    part = follow(well, "energy", (0.02, 0.1), start=inside.start(-2), **WIDE)
    assert part.energies[[0, -1]].tolist() == [0.02, 0.1]
    assert part.end.kind == "reached"


def test_results_are_saved_printed_and_tabulated(tmp_path):
    family = follow(duffing(), "energy", 10.0, start=0.1, at=[1.0], **WIDE)
    loaded = OscillationFamily.load(family.save(tmp_path / "family.json"))
    assert str(loaded) == str(family)
    assert (loaded.states == family.states).all()
    assert (tmp_path / "family.json").exists()
    assert family.save(tmp_path / "family.csv").read_text().startswith("energy,")
    orbit = find(duffing(), at={"energy": 1.0})
    loaded = Oscillation.load(orbit.save(tmp_path / "orbit.json"))
    assert loaded.period == orbit.period
    assert (loaded(0.3) == orbit(0.3)).all()
    assert "period                  4.548330398" in str(orbit)
    assert orbit.table([0.0])["u"] == orbit.start["u"]
    with pytest.raises(InputError, match="the family has no 'periods'; did you mean 'period'"):
        family.column("periods")


@pytest.mark.parametrize(
    ("stop", "options", "text"),
    [
        (10.0, {}, "state the first and the last energy once"),
        ((1.0, 2.0), {"start": 0.5}, "start = 0.5: state the first and the last energy"),
        ((1.0, 1.0), {}, "there is no way between"),
        ((-1.0, 1.0), {}, "an energy is above that at the equilibrium"),
        ((0.1, 1.0), {"at": [2.0]}, "at = 2 is not reached"),
        ((0.1, 1.0), {"families": (1, 2)}, "followed without families="),
        ((0.1, 1.0), {"method": "shooting"}, "followed without method="),
        ((0.1, 1.0), {"start": "hop.json"}, "starts at an energy, or at an oscillation"),
    ],
)
def test_refusals(stop, options, text):
    with pytest.raises(InputError, match=text):
        follow(duffing(), "energy", stop, **options)


def bounce(period, ratio=1.0):
    """The first state of a bounce of the linear hopper with this mass ratio, and its energy above that at rest: the
    centre of mass is thrown up, the spring vibrates as A cos(t - T/2), and the body's speed is continuous."""
    amplitude = -period / (2 * ratio * np.sin(period / 2))
    r, rate = amplitude * np.cos(period / 2), amplitude * np.sin(period / 2)
    body = (period / 2 + ratio * rate) / (1 + ratio)
    energy = (1 + ratio) / 2 * (body**2 + ratio * (body - rate) ** 2) + ratio * r**2 / 2 + r + 1 / (2 * ratio)
    return np.array([r, body, 0 * r, body - rate]), energy


def elastic(**options):
    """A linear hopper whose impacts lose nothing."""
    return Hopper("r", rest_length=60, restitution=1.0, **options)


def test_elastic_bounces_of_a_hopper():
    """From the smallest bounce of the foot on, with one impact a cycle."""
    family = follow(elastic(mass_ratio=0.5), "energy", (1e-2, 20.0), **WIDE)
    states, energies = bounce(family.periods, 0.5)
    assert np.abs(family.states.T - states).max() < 1e-13
    assert np.abs(energies / family.energies - 1).max() < 1e-12
    assert family.title().startswith("bounces of hopper")
    assert np.abs(np.prod(family.multipliers @ [1, 1j], axis=1) - 1).max() < 1e-10  # reciprocal pairs
    (flip,) = family.events
    assert flip.kind == "flip"

    def following(y, v):
        """The place and the speed of the body after the next impact of this energy, by DOP853."""
        m = 0.5
        foot = np.sqrt((2 * (flip.energy - (m * y * y / 2 + y + 1 / (2 * m))) / (1 + m) - v * v) / m)

        def field(t, z):
            r = z[0] - z[2]
            return [z[1], (-m * r - 1) / (1 + m), z[3], (r - 1) / (1 + m)]

        lands = lambda t, z: z[2]  # noqa: E731
        lands.terminal, lands.direction = True, -1
        start = [y, v, 1e-300, foot]
        return solve_ivp(field, (0, 20), start, "DOP853", events=lands, rtol=1e-12, atol=1e-12).y_events[0][0, :2]

    y, v, h = *flip.states[:2], 1e-5
    slopes = [
        (following(y + h, v) - following(y - h, v)) / (2 * h),
        (following(y, v + h) - following(y, v - h)) / (2 * h),
    ]
    assert abs(np.trace(slopes) + 2) < 1e-6


def test_a_family_of_bounces_past_a_fold():
    """Bounces with a second vibration of the spring have a least energy; beyond it the foot dips through the ground."""
    state, energy = bounce(11.0)
    start = dict(zip(("y1", "y1'", "y2", "y2'"), state, strict=True)) | {"duration": 11.0}
    family = follow(elastic(), "energy", (energy, 15.0), start=start, **WIDE)
    assert family.number is None
    assert family.end.kind == "reached"
    assert abs(family.energies[-1] - energy) < 1e-12
    assert family.periods[-1] < 8.0
    fold = next(event for event in family.events if event.kind == "fold")
    assert abs(bounce(fold.period)[1] - fold.energy) < 1e-12
    assert min(bounce(fold.period + h)[1] for h in (-1e-3, 1e-3)) > fold.energy
    graze = next(event for event in family.events if event.kind == "grazing")
    t = graze.period * np.linspace(0.02, 0.98, 200_001)
    amplitude = -graze.period / (2 * np.sin(graze.period / 2))
    first = graze.states[0]
    height = (first + t * (graze.period - t) / 2 - amplitude * np.cos(t - graze.period / 2)) / 2
    assert abs(height.min()) < 1e-8
    assert family.admissible[0]
    assert not family.admissible[-1]


def test_refusals_of_bounces():
    with pytest.raises(InputError, match="family = 2: one family of bounces begins at the equilibrium"):
        follow(elastic(), "energy", (0.1, 1.0), family=2)


def test_an_oscillation_begins_a_search():
    first = find(pendulum(), at={"energy": 1.0})
    second = find(pendulum(), at={"energy": 2.0}, start=first)
    assert second.period == pytest.approx(find(pendulum(), at={"energy": 2.0}).period, rel=1e-13)
    assert follow(pendulum(), "energy", (1.0, 2.0), first).periods[-1] == pytest.approx(second.period, rel=1e-13)


def test_the_energy_alone_determines_an_oscillation():
    with pytest.raises(InputError, match="leave 'period' out"):
        find(pendulum(), at={"energy": 1.0, "period": 2.0})
    with pytest.raises(InputError, match="along its energy alone"):
        follow(Hopper("cubic"), "beta", 0.3, find(pendulum(), at={"energy": 1.0}))
