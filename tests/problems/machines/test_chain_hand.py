"""The juggler with a chain for a hand against the plain juggler, and against equations by hand."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from orbits import InputError, NoOrbit, find, find_all, simulate, starts
from problems import Juggler, chain_hand

TIGHT = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-13, "dense_output": True}


class TestLimits:
    @pytest.mark.parametrize("law", ["r", "r + 0.2*r**3"])
    @pytest.mark.parametrize("mass_ratio", [0.5, 2.0])
    def test_with_one_spring_it_is_the_juggler(self, law, mass_ratio):
        plain = find(Juggler(law, mass_ratio=mass_ratio))
        orbit = find(chain_hand((1 / mass_ratio, 1.0), law))
        assert orbit.alpha == pytest.approx(plain.alpha, abs=1e-13)
        assert orbit.flight_time == pytest.approx(plain.flight_time, rel=1e-13)
        assert orbit.contact_time == pytest.approx(plain.contact_time, rel=1e-13)


@pytest.mark.slow
class TestEquationsByHand:
    m = (0.7, 1.0, 0.5)

    @staticmethod
    def upper(r):
        return np.sinh(0.3 * r) / 0.3

    @staticmethod
    def lower(r):
        return 2 * r + 0.1 * r**3

    def flight(self, t, x):
        pull, push, (_, m2, m3) = self.upper(x[2] - x[4]), self.lower(x[4]), self.m
        return [x[1], -1, x[3], -pull / m2 - 1, x[5], (pull - push) / m3 - 1]

    def contact(self, t, x):
        pull, push, (m1, m2, m3) = self.upper(x[0] - x[2]), self.lower(x[2]), self.m
        return [x[1], -pull / (m1 + m2) - 1, x[3], (pull - push) / m3 - 1]

    def test_every_hop_is_one(self, machine, orbits):
        assert len(orbits) == 10  # one of them behind folds near straight springs
        assert any(orbit.admissible for orbit in orbits)
        for orbit in orbits:
            x = orbit(0.0)
            flown = solve_ivp(self.flight, (0, orbit.flight_time), x, **TIGHT)
            np.testing.assert_allclose(flown.y[:, -1], x * [1, -1, 1, -1, 1, -1], atol=2e-9)
            stood = solve_ivp(self.contact, (0, orbit.contact_time), flown.y[2:, -1], **TIGHT)
            np.testing.assert_allclose(stood.y[:, -1], x[2:], atol=2e-9)
            ball, _, hand, *_ = flown.sol(np.linspace(0, orbit.flight_time, 2000))
            place = stood.sol(np.linspace(0, orbit.contact_time, 2000))
            force = -self.upper(place[0] - place[2])  # is positive as the ball is pressed
            assert orbit.admissible == bool((ball - hand).min() > -1e-9 and force.min() > -1e-9)
            assert orbit.flight_time == pytest.approx(2 * orbit.alpha, rel=1e-13)  # the ball flies freely

    def test_catches_lose_what_they_should(self, machine, orbits):
        orbit, (m1, m2, _) = next(o for o in orbits if o.admissible), self.m
        launch = dict(zip(("liftoff", "alpha", "y3", "y3'"), orbit(0.0)[2:], strict=True))
        run = simulate(machine, launch, hops=3)
        assert run.status == "done"
        assert sum(event.loss for event in run.events) < 1e-12
        landing = simulate(machine, {**launch, "alpha": 1.2 * orbit.alpha}, hops=1).events[0]
        lands = lambda t, x: x[0] - x[2]  # noqa: E731
        lands.terminal, lands.direction = True, -1
        start = orbit(0.0) * [1, 1.2, 1, 1.2, 1, 1]
        flown = solve_ivp(self.flight, (0, 30.0), start, events=lands, first_step=0.1, **TIGHT)
        assert landing.time == pytest.approx(flown.t[-1], abs=1e-9)
        x = flown.y[:, -1]
        together = (m1 * x[1] + m2 * x[3]) / (m1 + m2)
        np.testing.assert_allclose(landing.after, [x[0], together, x[2], together, x[4], x[5]], atol=1e-9)
        assert landing.loss == pytest.approx(0.5 * m1 * m2 / (m1 + m2) * (x[1] - x[3]) ** 2, rel=1e-9)


@pytest.fixture(scope="module")
def machine():
    laws = ["sinh(a*r)/a", "2*r + c*r**3"]
    return chain_hand(TestEquationsByHand.m, laws, {"a": 0.3, "c": 0.1})


@pytest.fixture(scope="module")
def orbits(machine):
    return find_all(machine, starts(machine, 4.0, 6.0))


def test_what_is_no_hand():
    with pytest.raises(InputError, match="from 2 to 12 masses, not 1"):
        chain_hand((1.0,))
    with pytest.raises(InputError, match="2 masses has 2 springs, not 1"):
        chain_hand((1.0, 1.0, 1.0), ["r"])
    with pytest.raises(InputError, match="no element has a parameter 'c'"):
        chain_hand((1.0, 1.0, 1.0), "r", {"c": 1.0})
    with pytest.raises(NoOrbit, match="give `find` a start"):
        find(chain_hand())
