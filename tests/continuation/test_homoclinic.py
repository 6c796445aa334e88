"""Families that end in a homoclinic orbit: its energy, the eigenvalue of its equilibrium, the growth of the period."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from orbits import Family, follow, orbit_at
from orbits.continuation.homoclinic import _decay
from problems import Chain, Hopper, Juggler

CUBIC = Hopper("cubic", rest_length=30.0, parameters={"beta": -0.005})


@pytest.fixture(scope="module")
def contacts() -> Family:
    """A family whose contact lasts ever longer."""
    return follow(CUBIC, "contact_time", 200.0, tune="beta", at=[60.0], longest=0.1)


@pytest.mark.slow
def test_a_contact_that_stays_near_a_barrier(contacts):
    """The body comes to rest where the spring can just carry it, phi(y) = -1/M: by energy and, for the flight, by
    another integrator. A change grows there with the square root of -M phi'(y)/(1 + M)."""
    last, end = contacts[-1], contacts.end
    beta, rho, alpha = last.also["beta"], last.liftoff_extension, last.alpha
    rest = brentq(lambda y: y + beta * y**3 + 1, -1 / np.sqrt(-3 * beta), -1 / np.sqrt(-beta), xtol=1e-15, rtol=1e-15)

    def energy(y, v):
        return v**2 + y**2 / 2 + beta * y**4 / 4 + y

    assert energy(rest, 0.0) == pytest.approx(energy(rho, alpha), rel=1e-12)
    rates = lambda t, x: [x[1], -x[0] - beta * x[0] ** 3]  # noqa: E731
    flight = solve_ivp(rates, (0, alpha), [rho, alpha], method="DOP853", rtol=1e-13, atol=1e-13)
    assert abs(flight.y[1, -1]) < 1e-11 * alpha
    eigenvalue = np.sqrt(-(1 + 3 * beta * rest**2) / 2)
    assert end.kind == "homoclinic"
    assert end.period_growth == pytest.approx(1 / eigenvalue, rel=1e-3)
    assert f"near the equilibrium y1 = {rest:.6g}, whose smallest eigenvalue above 0 is {eigenvalue:.6g}" in end.reason
    assert f"beta = {beta:.10g}" in end.reason
    assert end.limit is None  # the contact time itself has none


def test_what_falls_exponentially_is_measured():
    t = np.linspace(1.0, 20.0, 80)
    rates = 3.0 * np.exp(-1.4 * t) * (1 + np.exp(-1.4 * t))
    assert _decay(t, rates, rates) == pytest.approx(1.4, rel=1e-6)
    assert _decay(t, rates + 1e-13 * np.abs(np.sin(50 * t)), rates) == pytest.approx(1.4, rel=1e-2)
    before = np.concatenate([[3.0, 2.0], t]), np.concatenate([[1e-9, 1.0], rates])
    assert _decay(*before, before[1]) == pytest.approx(1.4, rel=1e-6)
    assert _decay(t, t**-3.0, t**-3.0) is None  # a power of time
    assert _decay(t[:30], rates[:30], 1e4 * rates[:30]) is None  # it has not settled
    assert _decay(t[::-1], rates, rates) is None


@pytest.mark.slow
def test_points_beyond_what_a_launch_determines(contacts):
    """Small changes grow 1e11-fold on the way to the middle of the contact, and the error stays small."""
    (point,) = contacts.at(60.0)
    orbit = orbit_at(CUBIC, point, "contact_time")
    assert orbit.contact_time == pytest.approx(60.0, rel=1e-15)
    assert orbit.admissible
    assert max(orbit.error, point.error) < 1e-12
    assert orbit.certificate.energy_drift < 1e-13
    assert {len(each.u) for each in contacts} == {len(contacts[0].u)}
    assert not contacts.events[1:]
    short = follow(CUBIC, "contact_time", 62.0, tune="beta", most=130)
    resumed = follow(CUBIC, "contact_time", 62.0, tune="beta", resume=short)
    assert (short.end.kind, resumed.end.kind) == ("stopped", "reached")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "tuned", "loaded"),  # and the force of the spring at the equilibrium, but for its sign
    [
        (Juggler("k*sin(r/k)", mass_ratio=0.7, parameters={"k": 9.0}), "k", 1.7 / 0.7),
        (Hopper("r*exp(r/w)", parameters={"w": 30.0}), "w", 1.0),
    ],
)
def test_contacts_that_hang_in_other_laws(machine, tuned, loaded):
    """The period grows by the inverse of the square root of -M phi'(y)/(1 + M), with the slope of the force in closed
    form where it carries the weight: of the hopper that of the foot, of the juggler that of ball and hand over M."""
    end = (found := follow(machine, "contact_time", 400.0, tune=tuned, longest=0.1)).end
    unit, share = found[-1].also[tuned], machine.values["mass_ratio"]
    if tuned == "k":
        slope = -np.sqrt(1 - (loaded / unit) ** 2)
    else:
        rest = brentq(lambda y: y * np.exp(y / unit) + loaded, -60 * unit, -unit, xtol=1e-14)
        slope = (1 + rest / unit) * np.exp(rest / unit)
    assert end.kind == "homoclinic"
    assert end.period_growth == pytest.approx(1 / np.sqrt(-share * slope / (1 + share)), rel=1e-4)


@pytest.mark.slow
def test_a_chain_that_passes_an_equilibrium_twice():
    """Half of its contact passes the equilibrium on the way to its middle, so that the period grows twice as fast. The
    chain stands there with the springs' forces -1/3 and -2/3, up to the side on which they soften."""
    chain = Chain([1.0, 1.0, 1.0], "r + b*r**3", parameters={"b": 0.0})
    start = {"liftoff": 1.0, "alpha": 4.99896, "y1": 1.929151, "y1'": 8.466078, "duration": 4.488346,
             "contact_duration": 3.104718}  # fmt: skip
    end = follow(chain, "b", -0.5, start).end
    assert end.kind == "homoclinic"
    b = end.limit
    assert end.limit_error < 1e-7
    extension = [brentq(lambda r, load=load: r + b * r**3 + load, -1 / np.sqrt(-b), -1 / np.sqrt(-3 * b))
                 for load in (1.0, 2.0)]  # fmt: skip
    upper, lower = (1 + 3 * b * r**2 for r in extension)
    values = np.linalg.eigvalsh(-np.array([[upper, -upper], [-upper, upper + lower]]))
    eigenvalue = float(np.sqrt(values[values > 0].min()))
    assert end.period_growth == pytest.approx(2 / eigenvalue, rel=1e-2)
