"""What a machine in SI says in words: the numbers of the dimensionless machine's messages in SI, each with its unit."""

import json
import pickle
import re

import numpy as np
import pytest

from orbits import (
    InputError,
    NoOrbit,
    Orbit,
    OrbitsError,
    ReturnMap,
    find,
    find_all,
    follow,
    multiplier,
    quantities,
    simulate,
)
from orbits.units import LENGTH, SPEED, Message, Quantity
from problems import hopper_in_si, steering
from problems.laws import springs

FOOT, BODY, STIFFNESS, GRAVITY = 3.0, 60.0, 5000.0, 9.80665
# The units of equation 2, by hand.
LENGTH_IN_M, TIME_IN_S = FOOT * GRAVITY / STIFFNESS, (FOOT / STIFFNESS / (1 + FOOT / BODY)) ** 0.5
SIZES = {
    "m": LENGTH_IN_M, "s": TIME_IN_S, "m/s": LENGTH_IN_M / TIME_IN_S, "N": FOOT * GRAVITY,
    "m/s^3": LENGTH_IN_M / TIME_IN_S**3, "s^(1/3)/m^(1/3)": (LENGTH_IN_M / TIME_IN_S) ** (-1 / 3),
}  # fmt: skip
# A number in a message, and its unit if it has one; of two units that begin alike the longer is tried first.
UNITS = "|".join(re.escape(unit) for unit in sorted(SIZES, key=len, reverse=True))
TOLD = re.compile(rf"(-?\d+\.?\d*(?:e[+-]\d+)?)(?: ({UNITS})(?!\w))?")
PLAIN = hopper_in_si(BODY, FOOT, stiffness=STIFFNESS)
SHORT = hopper_in_si(BODY, FOOT, stiffness=STIFFNESS, rest_length=0.3)
# Its extension comes to the end of its table, 10 lengths of the machine, in a fast flight.
TABLE = hopper_in_si(
    BODY, FOOT, stiffness=STIFFNESS,
    force=springs.table((LENGTH_IN_M * np.linspace(-50, 10, 61), FOOT * GRAVITY * np.linspace(-50, 10, 61))),
)  # fmt: skip
STOPPED = hopper_in_si(
    BODY, FOOT, stiffness=STIFFNESS,
    force=springs.table((LENGTH_IN_M * np.linspace(-10, 50, 61), FOOT * GRAVITY * np.linspace(-10, 50, 61))),
)  # fmt: skip
DAMPED = hopper_in_si(BODY, FOOT, stiffness=STIFFNESS, damping=400.0)
WEAK = hopper_in_si(BODY, FOOT, force="F*tanh(k*r/F)", parameters={"k": STIFFNESS, "F": 0.9 * FOOT * GRAVITY})
BENT = hopper_in_si(BODY, FOOT, force="k*r + b*r**3", parameters={"k": STIFFNESS, "b": 1e6})
STEEP = hopper_in_si(BODY, FOOT, stiffness=STIFFNESS, rest_length=1.0, gravity="1 + 20*z/1.0")
SPEED_IN_SI = SIZES["m/s"]


def said(call, machine) -> str:
    """What a call says of a machine: its answer in words, or its error."""
    try:
        return str(call(machine))
    except OrbitsError as error:
        return str(error)


# A machine, a call that says something of it, and the numbers among what it says that have no dimension.
CASES = {
    "masses pass": (SHORT, lambda m: find(m, 3).violations, ""),
    "out of range": (TABLE, lambda m: find(m, 9), "9"),
    "simulation out of range": (TABLE, lambda m: simulate(m, 40.0 * scale(m), hops=1).reason, ""),
    "no launch": (DAMPED, lambda m: simulate(m, 0.5 * scale(m), hops=1), ""),
    "no multiplier": (DAMPED, lambda m: multiplier(m, 0.5 * scale(m)), ""),
    # So far from the orbit that the speed of landing is more than rounding.
    "one-sided law": (PLAIN, lambda m: multiplier(m, find(m, 1).alpha * (1 + 6e-13)), "4 3 4 3"),
    "weak spring": (WEAK, lambda m: find(m, 1), ""),
    "faster than asked": (PLAIN, lambda m: find_all(m, family=2, fastest=scale(m)), "2"),
    "searched": (BENT, lambda m: find_all(m, family=3, fastest=2.0 * scale(m)), ""),
    "start": (BENT, lambda m: find(m, start={**guess(m), "duration": 2e4 * (TIME_IN_S if m.units else 1.0)}), "0"),
    "no steering": (BENT, lambda m: steering.recover(m, 100.0 * scale(m)), ""),
    "short stroke": (BENT, lambda m: steering.start_up(m, 2, stroke=0.05 * length(m), intervals=8), "2 2 3 3 4"),
    "no stroke": (BENT, lambda m: steering.start_up(m, 2, stroke=-3.0 * length(m)), "0"),
    "gap": (PLAIN, lambda m: simulate(m, state=np.array([1.0, 0.0, -0.5, 0.0]) * length(m), time=1.0), "1 1 2 2"),
    "gravity": (STEEP, lambda m: find(m, 2), "2 37.1"),
}


def length(machine) -> float:
    """The machine's unit of length."""
    return LENGTH_IN_M if machine.units else 1.0


def scale(machine) -> float:
    """The machine's unit of speed."""
    return SPEED_IN_SI if machine.units else 1.0


def guess(machine) -> dict[str, float]:
    """The unknowns of a start."""
    return {"liftoff": length(machine), "alpha": scale(machine)}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name == "short stroke" else name for name in CASES]
)
def test_the_numbers_are_those_of_the_dimensionless_machine_in_si(name):
    machine, call, pure = CASES[name]
    text, bare = said(call, machine), said(call, machine.dimensionless())
    assert re.sub(TOLD, "#", text)[:150] == re.sub(TOLD, "#", bare)[:150]  # long ones are cut elsewhere
    found, expected = TOLD.findall(text), TOLD.findall(bare)
    assert [number for number, unit in found if not unit] == pure.split()
    assert not any(unit for _, unit in expected)
    assert any(unit for _, unit in found)
    for (number, unit), (other, _) in zip(found, expected, strict=True):
        assert float(number) == pytest.approx(float(other) * SIZES.get(unit, 1.0), rel=6e-3), text


def test_what_is_added_to_launches_is_bounded_in_si():
    with pytest.raises(InputError, match=r"inject = 1e\+300; it must be at most 2\.46145e\+14"):
        ReturnMap(BENT, inject=1e300)


@pytest.fixture(scope="module")
def leaving():
    """A family along gravity that leaves its table."""
    return follow(TABLE, "surface_gravity", start=GRAVITY, stop=40.0, at=[15.0])


@pytest.mark.usefixtures("any_digest")
def test_a_file_whose_violations_disagree_is_refused(tmp_path):
    path = find(SHORT, 3).save(tmp_path / "orbit.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | {"violations": []}))
    with pytest.raises(InputError, match="violations in SI and without units differ in number"):
        Orbit.load(path)


@pytest.mark.usefixtures("any_digest")
def test_the_numbers_of_a_file_of_the_first_version_are_told_without_units(tmp_path):
    bare = find(SHORT, 3).dimensionless()
    old = json.loads(bare.save(tmp_path / "old.json").read_text()) | {"laws_in": "SI"}
    old["motion"]["units"] = {name: getattr(SHORT.units, name) for name in ("length", "time", "force")}
    (tmp_path / "old.json").write_text(json.dumps(old))
    assert Orbit.load(tmp_path / "old.json").violations == (f"{bare.violations[0]} (without units)",)


def test_a_family_tells_its_numbers_with_the_units_of_where_it_is():
    """The unit of length is proportional to the foot's mass, which is followed."""
    heavier = {"start": 3.0, "stop": 5.0, "family": 3}
    family = follow(SHORT, "foot_mass", **heavier)
    for point in family.points:
        told = f"(separation {point.certificate.smallest_separation:.3g} m)"
        assert any(told in violation for violation in point.violations) == (not point.admissible)


@pytest.mark.slow
def test_a_family_that_leaves_its_table_says_where_in_metres(leaving):
    end = leaving.end
    assert end.kind == "stuck"
    assert re.search(r"leaves the law's range, \[-0\.2941\d* m, 0\.05883\d* m\], at 0\.05883\d* m", end.reason)


def test_a_message_within_a_message_is_told_in_si_once():
    inner = NoOrbit(Message("at {x:.3g}", x=Quantity(2.0, LENGTH)))
    outer = Message("{text}; alpha = {alpha:g} of {{family}} {n}", text=inner, alpha=Quantity(3.0, SPEED), n=4)
    assert outer == "at 2; alpha = 3 of {family} 4"
    once = outer.in_units(PLAIN.units)
    assert once == f"at {2 * LENGTH_IN_M:.3g} m; alpha = {3 * SPEED_IN_SI:g} m/s of {{family}} 4"
    assert once.in_units(PLAIN.units) == once == pickle.loads(pickle.dumps(once))
    joined = Message.joined("; ", [inner.args[0], "plain {text}"])
    assert joined.in_units(PLAIN.units) == f"at {2 * LENGTH_IN_M:.3g} m; plain {{text}}"


def test_a_contact_that_leaves_its_table_says_so_to_a_design():
    """The spring of this table ends where the contact has not yet turned."""
    with pytest.raises(NoOrbit, match=r"contact: the extension leaves the law's range, \[-0\.0588\d* m, "):
        quantities(STOPPED, find(STOPPED), ["stroke"])
