"""The table of an orbit: the digits of its numbers are right, and its lines say what belongs together."""

import re
from decimal import Decimal

import numpy as np
import pytest
from conftest import machine_of

from orbits import find
from orbits.periodic.orbit_table import errors_of
from problems import Hopper, Juggler, hopper_in_si, springs

NUMBER = re.compile(r"-?\d+\.?\d*(?:e[+-]\d+)?")
# Machines with a family and two methods, whose roundings have nothing to do with each other.
SOLVED_TWICE = {
    "cubic": (Hopper("r + beta*r**3", mass_ratio=0.2, rest_length=60, parameters={"beta": 3.0}), 1, "relative"),
    "high": (Hopper("r + beta*r**3", mass_ratio=8.0, rest_length=60, parameters={"beta": 0.1}), 18, "relative"),
    "sinh": (Juggler("sinh(r)", mass_ratio=0.5, rest_length=90), 5, "relative"),
    "asteroid": (
        hopper_in_si(2.5, 0.5, stiffness=0.05, rest_length=0.6, surface_gravity=1e-4, body_radius=250.0), 51, "shooting"
    ),
}  # fmt: skip


def numbers_in(orbit) -> dict[str, list[str]]:
    """The numbers in the printed rows of quantities, by row; bounds of errors and what is not computed left out."""
    rows = orbit.rows(15)
    first, last = (next(i for i, row in enumerate(rows) if row[0] == name) for name in ("flight time", "residual"))
    rows = [("alpha", dict(rows)["alpha"]), *rows[first:last]]
    return {name: NUMBER.findall(text.partition("+-")[0]) for name, text in rows}


def last_place(text: str) -> float:
    """The unit of the last digit of a printed number."""
    digits, _, power = text.partition("e")
    return 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))


@pytest.mark.parametrize("name", SOLVED_TWICE)
def test_two_methods_print_the_same_digits(name):
    machine, family, other = SOLVED_TWICE[name]
    found = [numbers_in(find(machine, family, method=method)) for method in ("half orbit", other)]
    assert found[0].keys() == found[1].keys()
    assert len(found[0]) > 9
    for row in found[0]:
        for one, two in zip(found[0][row], found[1][row], strict=True):
            # Both have an error of at most one in the last place, and a zero there is not printed.
            assert abs(float(one) - float(two)) <= 2.01 * max(last_place(one), last_place(two)), row
            least = 7 if row == "loss coefficient C" else 12
            assert name == "asteroid" or float(one) == 0 or len(re.sub(r"\D", "", one).strip("0")) >= least - 3, row


def test_digits_are_those_of_more_accurate_numbers(reference):
    """Alpha and flight time of the references, in 20 digits, and for M = 1 and a linear spring the contact force: in
    contact y1 swings about -1 with the frequency 1/sqrt(2) of that in flight, from y1 = 1 with y1' = alpha."""
    found = numbers_in(find(machine_of(reference), reference["family"]))
    truth = {"alpha": Decimal(reference["alpha"]), "flight time": Decimal(reference["flight_time"])}
    if [reference[name] for name in ("spring", "gravity", "mass_ratio")] == ["r", "1", 1.0]:
        truth["largest contact force"] = 2 + (4 + 2 * truth["alpha"] ** 2).sqrt()
    for row, value in truth.items():
        assert abs(Decimal(found[row][0]) - value) <= Decimal(1.01 * last_place(found[row][0])), row
        assert len(found[row][0]) >= 14, row


def test_digits_follow_the_noise_of_a_table():
    """The noise of the rows moves alpha by 7e-4 of it: the other numbers have its second digit."""
    orbit = find(hopper_in_si(3.0, 1.5, force=springs.table(springs.SAMPLE, in_si=True), rest_length=0.3))
    share = orbit.certificate.alpha_noise / orbit.alpha
    rows = dict(orbit.rows(15))
    assert rows["alpha"].startswith("0.7336210036926")  # by the numerics, which is stated beside it
    for name in ("flight time", "contact time", "largest contact force", "landing jerk"):
        (value, *_) = numbers_in(orbit)[name]
        assert share * abs(float(value)) <= 10 * last_place(value) <= 100 * share * abs(float(value)), name
    assert errors_of(orbit)["flight_time"] == pytest.approx(0.1 * share * orbit.flight_time, rel=1e-6)


def test_rows_say_what_belongs_together():
    leg = find(hopper_in_si(60.0, 3.0, force="8000*r + 2e6*r**3", rest_length=0.8))
    rows, times = dict(leg.rows(6)), np.linspace(0, leg.period, 200_001)
    heights = leg(times)
    assert rows["period"] == f"{leg.period:.6g} s   (frequency {1 / leg.period:.6g} 1/s)"
    assert rows["contact time"] == f"{leg.contact_time:.6g} s   (duty factor {leg.contact_time / leg.period:.6g})"
    stroke = np.ptp(heights[:, 0] - heights[:, 2])
    assert rows["lift-off extension"] == f"{leg.liftoff_extension:.6g} m   (stroke {stroke:.6g} m)"
    assert rows["rise of body"].endswith(f" m   (apex {0.8 + heights[:, 0].max():.6g} m)")
    assert rows["rise of foot"] == f"{heights[:, 2].max():.6g} m"  # from the ground
    peak = leg.certificate.largest_contact_force
    assert rows["largest contact force"] == f"{peak:.6g} N   ({peak / (63 * 9.80665):.6g} weights)"
    assert "clearance" not in rows
    assert find(Hopper()).rows()[2][1] == "up to 0.021 above alpha, to leading order"
    assert rows["launch range"] == "above alpha, beyond the range of the leading order"
    assert len(str(leg).splitlines()) <= 23
