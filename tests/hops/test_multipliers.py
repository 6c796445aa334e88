"""Multipliers of launches of several numbers, against differences of the map and the exact flow of linear machines."""

import numpy as np
import pytest
from columns import CUBIC, column, hop_of
from scipy.linalg import expm

from orbits import HopMultipliers, InputError, NoOrbit, ReturnMap, find, find_all, multiplier, multipliers, starts
from orbits.mechanics import Ground
from problems import HeavyHand, Hopper, chain_hand, hopper_in_si, inerter_hopper, plate_hopper

STENCIL = np.array([-2.0, -1.0, 1.0, 2.0])


def slopes(machine, launch, h):
    """The derivative (d, d) of the map, by differences."""
    found = []
    for direction in np.eye(len(launch)):
        x = ReturnMap(machine)(launch + h * STENCIL[:, None] * direction).next
        found.append((x[0] - 8 * x[1] + 8 * x[2] - x[3]) / (12 * h))
    return np.array(found).T


@pytest.mark.parametrize(
    ("machine", "launch", "h"),
    [
        (column(), (6.4, -1.2, 1.1), 1e-4), (column(), (6.1, -1.4, 0.9), 1e-4), (column(CUBIC), (6.4, -0.9, 0.4), 1e-4),
        (column(restitution=0.3), (6.4, -1.2, 1.1), 1e-4), (column(CUBIC, 0.01), (6.4, -0.9, 0.4), 1e-4),
        (plate_hopper(), (6.6, -0.006, 0.04), 1e-6), (chain_hand((1, 1, 1)), (2.95, -1.4, -14.0), 1e-4),
    ],
)  # fmt: skip
def test_multipliers_are_those_of_the_slopes_of_the_map(machine, launch, h):
    found = multipliers(machine, launch)
    expected = slopes(machine, np.array(launch), h)
    assert np.abs(found.matrix - expected).max() <= 1e-6 * np.abs(expected).max()
    assert np.linalg.det(found.matrix) == pytest.approx(np.prod(found.values), rel=1e-9)
    assert found.following == pytest.approx(ReturnMap(machine)(launch).next, rel=1e-12)
    assert found.stability == "not periodic"


@pytest.mark.parametrize("kind", ["column", "cubic column", "chain_hand"])
@pytest.mark.parametrize("side", [1, -1])
def test_the_map_has_a_derivative_at_a_lossless_hop(kind, side):
    """Beside it the next launch is a power series of the cube root s of the distance, which begins with s**3."""
    machine, orbit = hop_of(kind)
    found = multipliers(machine, orbit)
    assert found.lossless
    assert found.returns
    direction = side * np.array([0.6, 0.5, -0.4])
    s = np.linspace(0.012, 0.06, 13)
    change = ReturnMap(machine)(found.launch + s[:, None] ** 3 * direction).next - found.launch
    fit = np.linalg.lstsq(s[:, None] ** np.arange(10), change / s[:, None] ** 3, rcond=None)[0]
    assert np.abs(fit[0] - found.matrix @ direction).max() <= 1e-5
    # Differences come to the derivative with the cube root of the distance.
    distances = 10.0 ** -np.arange(3, 9)
    change = ReturnMap(machine)(found.launch + distances[:, None] * direction).next - found.launch
    errors = np.abs(change / distances[:, None] - found.matrix @ direction).max(1)
    assert np.log10(errors[-4:-1] / errors[-3:]) == pytest.approx(1 / 3, abs=0.03)


def test_the_multipliers_of_a_linear_column_in_closed_form():
    """Matrix exponentials of flight and contact, the projection onto the contact, and the lift-off at y2 = 1."""
    machine, orbit = hop_of()
    K = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    flight, contact = (np.kron(np.eye(n), [[0, 1], [0, 0]]) - np.kron(K[:n, :n], [[0, 0], [1, 0]]) for n in (3, 2))
    launched = np.array([[0, 1, 0], [0, 0, 1], [0, 0, 0], [1, 0, 0]] + [[0, 0, 0]] * 2, dtype=float)
    after = expm(contact * orbit.contact_time) @ np.eye(4, 6) @ expm(flight * orbit.flight_time) @ launched
    y1, v1, y2, v2 = orbit(0.0)[:4]
    rates = np.array([v1, -(y1 - y2) - 1, v2, (y1 - y2) - y2 - 1])
    matrix = (after - np.outer(rates, after[2]) / v2)[[3, 0, 1]]
    found = multipliers(machine, orbit)
    assert found.matrix == pytest.approx(matrix, abs=1e-8)
    assert found.values == pytest.approx(sorted(np.linalg.eigvals(matrix), key=abs, reverse=True), abs=1e-8)
    assert found.values[0] == pytest.approx(1, abs=1e-8)
    assert found.stability == "neutral"


def test_a_machine_of_one_speed():
    """Its multiplier, and 1 at a lossless hop."""
    assert multipliers(Hopper(), 4.6).values == pytest.approx([multiplier(Hopper(), 4.6)], rel=1e-9)
    found = multipliers(Hopper(), find(Hopper()))
    assert found.values == pytest.approx([1.0], abs=1e-8)
    # With alpha d as the energy, C d**(4/3) is the loss of the launch speed.
    inertia, c = ReturnMap(Hopper()).impacts.launch_inertia * found.launch[0], 3.616942396592945
    assert found.losses[0] == pytest.approx(c * inertia / inertia ** (4 / 3), rel=1e-4)


def test_several_hops_and_injection():
    """Derivatives of hops are multiplied."""
    step = ReturnMap(column(), inject=0.01)
    first = multipliers(column(), (6.4, -1.2, 1.1), inject=0.01)
    both = multipliers(column(), (6.4, -1.2, 1.1), hops=2, inject=0.01)
    assert both.matrix == pytest.approx(multipliers(column(), first.following).matrix @ first.matrix, rel=1e-9)
    assert both.following == pytest.approx(step(step((6.4, -1.2, 1.1)).next).next, rel=1e-12)


def test_a_machine_in_si():
    machine, orbit = column(in_si=True), hop_of()[1]
    found = multipliers(machine, {"alpha": orbit.alpha, "y1": orbit(0.0)[0], "y1'": orbit(0.0)[1]})
    assert found.values == pytest.approx(multipliers(hop_of()[0], orbit).values, abs=1e-6)
    assert found.units["alpha"] == "m/s"


def test_what_multipliers_say():
    def printed(*arguments) -> str:
        return " ".join(str(multipliers(*arguments)).split())

    assert "neutral to first order: 1 of 3 multipliers on the unit circle" in printed(*hop_of())
    assert "launches with less energy than the lossless hop never come to it" in printed(*hop_of())
    assert "unstable: 1 of 3 multipliers outside the unit circle" in printed(*hop_of("chain_hand"))
    assert "do not determine its stability" in printed(column(), (6.4, -1.2, 1.1))
    inside = HopMultipliers(("alpha",), np.ones(1), np.ones(1), np.array([[0.5]]))
    assert inside.stability == "linearly stable"
    assert "linearly stable to first order" in str(inside)


SI = hopper_in_si(2.0, 1.0, force="k*r", parameters={"k": 2000.0}, ground=Ground(1.5, 3000.0))


def test_launches_and_injections_in_messages_are_in_si():
    with pytest.raises(NoOrbit, match=r"alpha = -4 m/s, ground = 0 m, ground' = 0 m/s is not a launch"):
        multipliers(SI, (-4.0, 0.0, 0.0))
    orbit = find_all(SI, starts(SI))[0]
    with pytest.raises(NoOrbit, match=r"inject = -0\.001 m/s removes energy here"):
        ReturnMap(SI, inject=-1e-3).periodic_hop(orbit)


@pytest.mark.parametrize("off", [1e-6, -1e-7])
def test_a_launch_beside_a_lossless_one_is_not_periodic(off):
    """It loses less than the distance within which a launch is taken to come back, and yet hop after hop."""
    alpha = find(Hopper()).alpha + off
    assert abs(ReturnMap(Hopper())(alpha).loss) < 1e-7 * alpha
    assert multipliers(Hopper(), alpha).stability == "not periodic"


def test_a_launch_that_lands_on_a_heavy_hand_is_periodic():
    """A hand of infinite mass moves on as before, so that every launch comes back."""
    found = multipliers(HeavyHand(), 4.0)
    assert found.following == pytest.approx([4.0], rel=1e-14)
    assert (found.stability, found.values) == ("neutral", pytest.approx([1.0]))


@pytest.mark.parametrize(
    ("launch", "error", "message"),
    [
        (4.6, InputError, "an array .* 3.* of alpha, y1, y1'"), ({"alpha": 4.6, "y1": 0.0}, InputError, "needs 'y1''"),
        ((1.0, 0.0, np.nan), InputError, "one launch is 3 numbers"), ("x", InputError, "x is not a saved orbit"),
        ({"alpha": 4.6, "y1": 0.0, "y1'": 0.0, "y9": 1.0}, InputError, "no 'y9'"),
        ((-1.0, 0.0, 0.0), NoOrbit, "not a launch: the contact would not open"),
    ],
)  # fmt: skip
def test_launches_without_multipliers(launch, error, message):
    with pytest.raises(error, match=message):
        multipliers(column(), launch)


def test_a_machine_that_rests_has_no_multipliers():
    with pytest.raises(NoOrbit, match=r"rests|has not ended"):
        multipliers(column("r", 0.5), (3.0, 0.0, 0.0))


@pytest.mark.parametrize("launch", [1e-320, 1e-200, 1e-100, 1e-10])
def test_a_launch_that_rounding_lands_has_no_multipliers(launch):
    with pytest.raises(NoOrbit, match=r"a slower one cannot be varied|so short that rounding decides"):
        multipliers(inerter_hopper(), launch)


def test_one_multiplier_is_refused_where_there_are_several():
    with pytest.raises(InputError, match=r"a column has several numbers: multipliers\(machine, launch\)"):
        multiplier(column(), 4.6)
