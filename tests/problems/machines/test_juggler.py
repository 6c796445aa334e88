"""The juggler against the hopper: one machine under constant gravity, two where it varies."""

import numpy as np
import pytest

from orbits import InputError, ReturnMap, find, simulate
from problems import HeavyHand, Hopper, Juggler
from problems.laws import gravity


class TestJuggler:
    @pytest.mark.parametrize("mass_ratio", [0.4, 1.0, 6.0])
    @pytest.mark.parametrize(("force", "beta"), [("r", 0.0), ("r + beta*r**3", 0.3)])
    def test_is_the_hopper_under_equation_6(self, mass_ratio, force, beta):
        """w1 = (y1 - rho) + M y2, w2 = (y1 - rho) - y2, one clock; the hand's force is phi(w2 + rho) - 1.

        Contact too is one motion up to the clock of its own: eq. (6) with y2 = 0.
        """
        M = mass_ratio
        hopper = find(Hopper(force, mass_ratio=M, parameters={"beta": beta} if beta else {}), 2)
        rho = hopper.liftoff_extension
        shifted = f"(r + rho) + {beta}*(r + rho)**3 - 1" if beta else "r"
        juggler = find(Juggler(shifted, mass_ratio=M, parameters={"rho": rho} if beta else {}), 2)
        assert juggler.alpha == pytest.approx(hopper.alpha, rel=1e-12)
        t = np.linspace(0, hopper.flight_time, 301)
        y1, v1, y2, v2 = hopper(t).T
        expected = [y1 - rho + M * y2, v1 + M * v2, y1 - rho - y2, v1 - v2]
        assert juggler(t) == pytest.approx(np.stack(expected, axis=1), abs=1e-11 * hopper.alpha**2)
        assert juggler.contact_time == pytest.approx(hopper.contact_time, rel=1e-12)
        t = hopper.flight_time + np.linspace(0, hopper.contact_time, 101)
        assert juggler(t)[:, 0] == pytest.approx(hopper(t)[:, 0] - rho, abs=1e-11 * hopper.alpha**2)
        assert juggler.certificate.loss_coefficient == pytest.approx(hopper.certificate.loss_coefficient, rel=1e-9)

    def test_the_printed_clock_scaling_is_wrong(self):
        """Section 7 scales the clocks by sqrt(M/(1 + M)); the flight times agree only without it."""
        hopper, juggler = find(Hopper(mass_ratio=0.5)), find(Juggler(mass_ratio=0.5))
        assert juggler.flight_time == pytest.approx(hopper.flight_time, rel=1e-14)
        assert juggler.flight_time != pytest.approx(np.sqrt(0.5 / 1.5) * hopper.flight_time, rel=0.1)

    def test_they_are_two_machines_when_gravity_varies(self):
        law = gravity.inverse_square(R=60.0)
        hopper = find(Hopper("r", law, rest_length=10.0))
        juggler = find(Juggler("r", law, rest_length=10.0))
        assert juggler.alpha != pytest.approx(hopper.alpha, rel=1e-3)
        assert juggler.alpha == pytest.approx(
            find(Juggler("r", law, rest_length=10.0), method="shooting").alpha, rel=1e-12
        )


@pytest.mark.parametrize("law", ["{}", "{} + 0.1*{}**3"])
def test_hopper_and_juggler_move_alike(law):
    """Eq. (6): the juggler with force phi(r + rho) - 1 has the hopper's launches, in flights, impacts and contacts."""
    hopper = Hopper(law.format("r", "r"))
    (rho,) = hopper.model.release(np.array([1.0]), hopper.values)
    moved = f"(r + {float(rho)!r})"
    juggler = Juggler(law.format(moved, moved) + " - 1")
    one, two = (simulate(machine, 7.3, hops=3) for machine in (hopper, juggler))
    assert [event.kind for event in one.events] == [event.kind for event in two.events]
    assert two.launches == pytest.approx(one.launches, rel=1e-9)


class TestHeavyHand:
    """The infinitely heavy hand: what stays of the map, and bouncing against Schaal and Atkeson's bound."""

    def test_launches_come_back_or_bounce_for_ever(self):
        alpha = np.array([2.0, 3.1, 3.2, 3.55, 3.8, 4.4, 4.6, 9.0])
        hops = ReturnMap(HeavyHand(), cap=50)(alpha)
        assert hops.status.tolist() == ["lifts_off"] * 2 + ["cap"] * 2 + ["lifts_off"] * 4
        np.testing.assert_array_equal(hops.next, np.where(hops.status == "cap", np.nan, alpha))

    @pytest.mark.parametrize("alpha", [3.2, 3.4, 3.55, 3.65])
    def test_period_one_bouncing_is_stable_up_to_the_bound(self, alpha):
        """A deviation is multiplied by 1 + w'' at each bounce, w'' the hand's acceleration when its speed is pi."""
        run = simulate(HeavyHand(), alpha, hops=1, cap=400)
        speeds = np.array([event.after[3] for event in run.events])
        assert run.status == "cap"
        if alpha < np.sqrt(np.pi**2 + 3):
            assert speeds[-1] == pytest.approx(np.pi, abs=1e-6)
            off = np.abs(speeds - np.pi)
            n = np.flatnonzero(off > 1e-7)[-1]
            factor = 1 - np.sqrt(1 + alpha**2 - np.pi**2)
            assert (speeds[n] - np.pi) / (speeds[n - 1] - np.pi) == pytest.approx(factor, rel=1e-3)
        else:
            assert speeds[-1] == pytest.approx(speeds[-3], abs=1e-9)
            assert abs(speeds[-1] - speeds[-2]) > 0.5

    def test_is_the_limit_of_heavy_jugglers(self):
        alpha = np.array([3.1, 3.9, 5.0, 8.0])
        limit = ReturnMap(HeavyHand())(alpha)
        gaps = [np.abs(ReturnMap(Juggler(mass_ratio=M))(alpha).next - limit.next).max() for M in (1e4, 1e5)]
        assert gaps[0] / gaps[1] == pytest.approx(10, rel=1e-2)
        assert find(HeavyHand()).alpha == find(Juggler()).alpha

    def test_takes_no_mass_ratio(self):
        with pytest.raises(InputError, match="no mass ratio"):
            HeavyHand(mass_ratio=2.0)
        assert find(HeavyHand()).machine["mass_ratio"] is None
