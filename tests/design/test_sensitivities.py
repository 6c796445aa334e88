"""Derivatives of quantities by the parameters of a machine, against differences of neighbouring orbits."""

import numpy as np
import pytest
from designs import CUBIC, VARYING

from orbits import InputError, NoOrbit, find, find_all, quantities, sensitivities, starts
from problems import Chain, Hopper, Juggler, chain_hand, hopper_in_si

PLAIN_LEG = hopper_in_si(60.0, 3.0, stiffness=5000.0, rest_length=0.8)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "family"),
    [
        (CUBIC, 1),
        (CUBIC, 2),
        (VARYING, 1),
        (Juggler("r + b*r**3", mass_ratio=0.7, parameters={"b": 0.2}), 1),
    ],
)
def test_sensitivities_are_those_of_neighbouring_orbits(machine, family):
    orbit = find(machine, family)
    names = ["b", "mass_ratio"]
    exact = sensitivities(machine, orbit, names)
    for name in names:
        h, rows = 1e-3 * machine.values[name], []
        for s in (-2, -1, 1, 2):
            near = machine.with_values(**{name: machine.values[name] + s * h})
            rows.append(np.array(list(quantities(near, find(near, family)).values())))
        slopes = (rows[0] - 8 * rows[1] + 8 * rows[2] - rows[3]) / (12 * h)
        for quantity, slope in zip(exact, slopes, strict=True):
            assert exact[quantity][name] == pytest.approx(slope, rel=1e-7, abs=1e-8), quantity


def motion_of(machine, half_contact: float, half_flight: float):
    """The slowest hop of a machine that is a motion."""
    return next(hop for hop in find_all(machine, starts(machine, half_contact, half_flight)) if hop.admissible)


SEVERAL = {
    "chain": (Chain(springs="r + b*r**3", parameters={"b": 0.01}), lambda machine: motion_of(Chain().stated(), 4, 5)),
    "hand": (chain_hand(), lambda machine: motion_of(machine, 4, 4)),
}


@pytest.mark.slow
@pytest.mark.parametrize(("case", "names"), [("chain", ["m1", "b"]), ("hand", ["m2", "m3"])])
def test_sensitivities_of_launches_of_several_unknowns(case, names):
    """Every quantity, by differences of neighbouring orbits, extrapolated by Richardson."""
    machine, start_of = SEVERAL[case]
    orbit = find(machine, start=start_of(machine))
    exact = sensitivities(machine, names=names, start=orbit)
    assert not {"loss_coefficient", "landing_sensitivity"} & exact.keys()
    for name in names:
        h, rows = 2e-4 * machine.values[name], {}
        for s in (-2, -1, 1, 2):
            near = machine.with_values(**{name: machine.values[name] + s * h})
            rows[s] = np.array(list(quantities(near, find(near, start=orbit), list(exact)).values()))
        slopes = (4 * (rows[1] - rows[-1]) / (2 * h) - (rows[2] - rows[-2]) / (4 * h)) / 3
        for quantity, slope in zip(exact, slopes, strict=True):
            assert exact[quantity][name] == pytest.approx(slope, rel=1e-7, abs=1e-6), quantity
    alone = sensitivities(machine, orbit, names[0], "stroke")
    assert alone == {"stroke": {names[0]: pytest.approx(exact["stroke"][names[0]], rel=1e-12)}}


def test_what_a_launch_of_several_unknowns_does_not_have():
    machine, _ = SEVERAL["chain"]
    with pytest.raises(InputError, match="give an orbit of it"):
        sensitivities(machine)
    hop = find(machine, start=motion_of(Chain().stated(), 4, 5))
    with pytest.raises(InputError, match="'loss_coefficient' here: it is a derivative by the launch speed"):
        sensitivities(machine, hop, "b", "loss_coefficient")
    with pytest.raises(InputError, match="leave one of the two out"):
        sensitivities(machine, hop, "b", start=hop)


def test_no_loss_at_a_corner_of_a_formula():
    """The jerk of the gap jumps at lift-off, as in the certificate of the orbit."""
    with pytest.raises(NoOrbit, match="a law has a corner at lift-off"):
        sensitivities(Hopper("r + 0.5*abs(r - 1)"), 1, ["mass_ratio"], ["loss_coefficient"])


def test_relative_derivatives_are_powers():
    """By dimensions: alpha of sqrt(m g^2/k), times of sqrt(m/k), the stroke of m g/k; the masses together are m."""
    found = sensitivities(PLAIN_LEG, 1, None, ["alpha", "flight_time", "stroke"]).relative()
    for quantity, by_mass, by_gravity, by_stiffness in (
        ("alpha", 0.5, 1.0, -0.5), ("flight_time", 0.5, 0.0, -0.5), ("stroke", 1.0, 1.0, -1.0),
    ):  # fmt: skip
        row = found[quantity]
        assert row["body_mass"] + row["foot_mass"] == pytest.approx(by_mass, abs=1e-9)
        assert row["surface_gravity"] == pytest.approx(by_gravity, abs=1e-9)
        assert row["stiffness"] == pytest.approx(by_stiffness, abs=1e-9)


def test_the_table_has_units():
    table = sensitivities(PLAIN_LEG, 1, ["stiffness", "rest_length"], ["alpha"]).table()
    assert table["unit"] == ["m/s per N/m", "m/s per m"]
    assert table["value of parameter"] == [5000.0, 0.8]
    assert table["relative derivative"] == pytest.approx([-0.5, 0.0], abs=1e-9)
    assert sensitivities(Hopper("cubic"), 1, ["beta"], ["alpha"]).table()["unit"] == [""]
