"""The juggler against the hopper: one machine under constant gravity, two where it varies."""

import numpy as np
import pytest

from orbits import find, simulate
from problems import Hopper, Juggler
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
