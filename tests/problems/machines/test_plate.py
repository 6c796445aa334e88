"""The hopper on a sprung plate against the plain hopper, and against equations by hand."""

import numpy as np
import pytest
from conftest import slow_after
from scipy.integrate import solve_ivp

from orbits import InputError, Orbit, find, find_all, follow, simulate, starts
from problems import Hopper, plate_hopper

PLAIN = find(Hopper())  # two equal masses
X0, ALPHA = PLAIN.alpha, PLAIN.alpha * np.sqrt(2)  # with gravity 1, mass 1 and stiffness 1
HALF_FLIGHT, HALF_CONTACT = PLAIN.flight_time / np.sqrt(8), PLAIN.contact_time / np.sqrt(8)


def linear_plate(mass: float, stiffness: float):
    return plate_hopper((1.0, 1.0, mass), parameters={"plate_stiffness": stiffness})


def near_plain(mass: float, stiffness: float, sink: float) -> Orbit:
    """The hop that is found from the plain one, on a plate that rests so low."""
    launch = {"liftoff": 1 + sink, "alpha": ALPHA, "plate": sink, "plate'": 0.0}
    start = launch | {"duration": HALF_FLIGHT, "contact_duration": HALF_CONTACT}
    return find(linear_plate(mass, stiffness), start=start)


def phases_of_stiff(n: int, flight: float, contact: float, halves=(HALF_FLIGHT, HALF_CONTACT)) -> tuple[float, float]:
    """Mass and frequency in flight of a plate that turns by (n + flight) pi in half a plain flight, and by
    (n/2 + contact) pi in half a plain contact."""
    flown, stood = (n + flight) * np.pi / halves[0], (n / 2 + contact) * np.pi / halves[1]
    return stood**2 / (flown**2 - stood**2), flown


class TestLimits:
    @pytest.mark.parametrize("phases", [(0.25, 0.25), (0.35, 0.35)])
    def test_on_a_stiff_plate_it_is_the_plain_hopper(self, phases):
        """To first order in 1/frequency, the relative error of that order falling like 1/frequency."""
        errors = []
        for n in (16, 32, 64, 128):
            mass, frequency = phases_of_stiff(n, *phases)
            orbit = near_plain(mass, mass * frequency**2, -1 / frequency**2)
            flown = np.tan(frequency * orbit.flight_time / 2)
            stood = np.tan(frequency * np.sqrt(mass / (1 + mass)) * orbit.contact_time / 2)
            law = ALPHA / (X0**2 * mass * frequency * (flown + np.sqrt(1 + 1 / mass) * stood))
            errors.append((orbit.alpha / ALPHA - 1) / law - 1)
            assert orbit.admissible
            assert abs(orbit.alpha / ALPHA - 1) < 0.06 / frequency
        assert np.divide(errors[1:], errors[:-1]) == pytest.approx(0.5, abs=0.03)


@pytest.fixture(scope="module")
def machine():
    laws = {"b": 0.05, "c": 0.2, "k": 6.0}
    return plate_hopper(TestEquationsByHand.m, "r + b*r**3", "k*sinh(c*r)/c", laws)


@pytest.fixture(scope="module")
def orbits(machine):
    return find_all(machine, starts(machine, 3.0, 3.0))


@pytest.mark.slow
class TestEquationsByHand:
    m = (1.5, 1.0, 0.8)

    @staticmethod
    def leg(r):
        return r + 0.05 * r**3

    @staticmethod
    def below(r):
        return 6.0 * np.sinh(0.2 * r) / 0.2

    def flight(self, t, x):
        pull, push, (m1, m2, m3) = self.leg(x[0] - x[2]), self.below(x[4]), self.m
        return [x[1], -pull / m1 - 1, x[3], pull / m2 - 1, x[5], -push / m3 - 1]

    def contact(self, t, x):
        pull, push, (m1, m2, m3) = self.leg(x[0] - x[2]), self.below(x[2]), self.m
        return [x[1], -pull / m1 - 1, x[3], (pull - push) / (m2 + m3) - 1]

    def test_every_hop_is_one(self, orbits):
        assert len(orbits) == 4
        tight = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-13, "dense_output": True}
        for orbit in orbits:
            x = orbit(0.0)
            assert (x[2], x[3]) == pytest.approx((x[4], x[5]), abs=1e-14)
            flown = solve_ivp(self.flight, (0, orbit.flight_time), x, **tight)
            np.testing.assert_allclose(flown.y[:, -1], x * [1, -1, 1, -1, 1, -1], atol=1e-9)
            stood = solve_ivp(self.contact, (0, orbit.contact_time), flown.y[:4, -1], **tight)
            np.testing.assert_allclose(stood.y[:, -1], x[:4], atol=1e-9)
            gap = flown.sol(np.linspace(0, orbit.flight_time, 2000))
            body, _, foot, _ = stood.sol(np.linspace(0, orbit.contact_time, 2000))
            force = self.m[1] * (self.contact(0, [body, 0, foot, 0])[3] + 1) - self.leg(body - foot)
            rounded = -1e-9 - 1e-12 * np.abs(self.leg(body - foot)).max()
            assert orbit.admissible == bool((gap[2] - gap[4]).min() > -1e-9 and force.min() > rounded)

    def test_a_simulated_hop_and_an_impact(self, machine, orbits):
        orbit, (_, m2, m3) = next(o for o in orbits if o.admissible and o.error < 1e-9), self.m
        launch = dict(zip(("liftoff", "alpha", "plate", "plate'"), orbit(0.0)[[0, 1, 4, 5]], strict=True))
        run = simulate(machine, launch, hops=3)
        assert run.status == "done"
        assert sum(event.loss for event in run.events) < 1e-12
        hard = simulate(machine, {**launch, "alpha": 1.1 * orbit.alpha}, hops=1)
        lands = lambda t, x: x[2] - x[4]  # noqa: E731
        lands.terminal, lands.direction = True, -1
        start = orbit(0.0) * [1, 1.1, 1, 1, 1, 1]
        flown = solve_ivp(self.flight, (0, 20.0), start, "DOP853", rtol=1e-13, atol=1e-13, events=lands, first_step=0.1)
        landing = hard.events[0]
        assert landing.time == pytest.approx(flown.t[-1], abs=1e-9)
        x = flown.y[:, -1]
        together = (m2 * x[3] + m3 * x[5]) / (m2 + m3)
        np.testing.assert_allclose(landing.after, [x[0], x[1], x[2], together, x[4], together], atol=1e-9)
        assert landing.loss == pytest.approx(0.5 * m2 * m3 / (m2 + m3) * (x[3] - x[5]) ** 2, rel=1e-9)


class TestEndsOfFamilies:
    """Closed forms for masses 1, 1, 2 and a leg of stiffness 1. Where the plate's frequency is that of the leg, K = 4,
    foot and plate may swing alike without a force between them, however far: the launch speed grows without bound, of
    either sign. Where the two frequencies of contact are as 1 : 2 or 1 : 3, all comes to rest at once there, and no
    flight is left: with the sum (4 + K)/3 and the product K/3 of their squares, (4 + K)^2 = 3 (n + 1/n)^2 K for
    1 : n."""

    @staticmethod
    def family(half_flight, half_contact, stiffness, stop):
        machine = linear_plate(2.0, stiffness)
        found = starts(machine, 1.1 * half_contact, 1.1 * half_flight)
        near = min(found, key=lambda s: abs(s["duration"] - half_flight) + abs(s["contact_duration"] - half_contact))
        return follow(machine, "plate_stiffness", stop, start=find(machine, start=near), longest=0.2)

    @staticmethod
    def at_rest_together(n: int) -> np.ndarray:
        """The stiffnesses at which the frequencies of contact are as 1 : n."""
        return np.sort(np.roots([1, 8 - 3 * (n + 1 / n) ** 2, 16]))

    @pytest.mark.parametrize(
        ("stiffness", "half_flight", "half_contact"), [(3.0, 2.5430, 2.1551), (10.0, 3.2741, 1.9534)]
    )
    @pytest.mark.slow
    def test_foot_and_plate_swing_alike(self, stiffness, half_flight, half_contact):
        family = self.family(half_flight, half_contact, stiffness, 3.99 if stiffness > 4 else 4.01)
        assert family.end.limit == pytest.approx(4.0, abs=1e-7)
        assert abs(family[-1].alpha) > 100
        assert np.sign(family[-1].alpha) == np.sign(4 - stiffness)  # its sign changes on the way from above

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("n", "which", "stiffness", "half_flight", "half_contact"),
        slow_after(1, [(2, 0, 3.0, 2.5430, 2.1551), (3, 1, 8.0, 2.4787, 2.3733)]),
    )
    def test_no_flight_is_left(self, n, which, stiffness, half_flight, half_contact):
        expected = self.at_rest_together(n)[which]
        family = self.family(half_flight, half_contact, stiffness, 0.1 if expected < stiffness else 30.0)
        assert family.end.kind == "degenerate"
        assert "shrinks to zero" in family.end.reason
        assert family.end.limit == pytest.approx(expected, abs=1e-6)


def test_what_is_no_hopper_on_a_plate():
    with pytest.raises(InputError, match="there are 3 masses, not 2"):
        plate_hopper((1.0, 1.0))
    with pytest.raises(InputError, match="m3 = 0"):
        plate_hopper((1.0, 1.0, 0.0))
    with pytest.raises(InputError, match="'stiffnes'"):
        plate_hopper(parameters={"plate_stiffness": 1.0, "stiffnes": 2.0})
