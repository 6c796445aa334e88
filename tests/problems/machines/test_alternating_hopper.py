"""The hopper on two feet, against DOP853 in the heights of its masses and the digits of another program."""

import json

import numpy as np
import pytest
from conftest import slow_after
from scipy.integrate import solve_ivp

from orbits import (
    InputError,
    NoOrbit,
    find,
    find_all,
    follow,
    multipliers,
    prove,
    sensitivities,
    simulate,
    starts,
    sweep,
)
from orbits.check_proof import check
from orbits.show.plane import plane_paths
from problems import alternating_hopper
from problems.machines import build, read

CUBIC = {"spring": "stiffness*r + beta*r**3", "parameters": {"beta": 1e-4}}


def heights(orbit, t):
    """Heights and speeds (k, 2) of body, left and right foot in the names of one stance."""
    body, v, mean, w, half, u = orbit(t).T
    return np.array([[body, v], [mean + half, w + u], [mean - half, w - u]])


def by_hand(orbit):
    """The states (6,) of body and both feet after a flight from lift-off of the first one, and after the contact on the
    other one, and the lowest heights of each foot while it is in the air."""
    p = orbit.source.values
    m1, m2, g, k, b = p["body_mass"], p["foot_mass"], p["surface_gravity"], p["stiffness"], p.get("beta", 0.0)

    def rates(held):
        def of(_, x):
            y, v, a, da, c, dc = x
            left, right = (k * r + b * r**3 for r in (y - a, y - c))
            return [v, -(left + right) / m1 - g, da, left / m2 - g, *((0.0, 0.0) if held else (dc, right / m2 - g))]

        return of

    x, ends, lowest = heights(orbit, 0.0).ravel(), [], []
    for held, time in ((False, orbit.flight_time), (True, orbit.contact_time)):
        run = solve_ivp(rates(held), (0, time), x, "DOP853", rtol=1e-13, atol=1e-13, max_step=time / 200)
        x = run.y[:, -1]
        ends.append(x)
        lowest.append(run.y[[2] if held else [2, 4], 1:-1].min())
    return ends, lowest


def assert_lossless(orbit):
    start = heights(orbit, 0.0).ravel()
    (landed, lifted), lowest = by_hand(orbit)
    scale = np.abs(start).max()
    exchanged = [0, 1, 4, 5, 2, 3]
    assert landed == pytest.approx(start[exchanged] * np.tile([1, -1], 3), abs=1e-10 * scale)  # time reversal
    assert lifted == pytest.approx(start[exchanged], abs=1e-10 * scale)
    p = orbit.source.values
    force = p["stiffness"] * start[0] + p.get("beta", 0.0) * start[0] ** 3
    assert force == pytest.approx(p["foot_mass"] * p["surface_gravity"], rel=1e-12)
    assert orbit.admissible == (min(lowest) > -1e-12 * scale)


def test_the_digits_of_another_program():
    """In mid-contact, with the feet's mass 4; a rest length of 39.2 is just enough."""
    orbit = find(alternating_hopper(rest_length=39.2))
    assert orbit.admissible
    body, _, mean, _, half, rate = orbit(orbit.flight_time + orbit.contact_time / 2)
    assert [body, mean - half] == pytest.approx([-24.37191851468650, 14.80378614225997], rel=1e-13)
    halves = orbit.contact_time / 2, orbit.flight_time / 2
    assert halves == pytest.approx([1.05606245324115, 1.06509073076356], rel=1e-13)
    assert abs(rate) < 1e-11
    assert orbit(0.0)[5] == pytest.approx(4.099390809526779, rel=1e-12)
    assert not find(alternating_hopper(rest_length=39.1)).admissible


@pytest.mark.parametrize("mass", slow_after(1, [2.0, 3.0, 6.0, 8.0]))
def test_masses_by_another_integration(mass):
    orbit = find(alternating_hopper(mass, 100.0))
    assert_lossless(orbit)
    assert orbit.admissible


def test_in_si():
    own = {"body_mass": 5.0, "stiffness": 2500.0, "surface_gravity": 3.7, "in_si": True}
    orbit, plain = find(alternating_hopper(20.0, 1.0, **own)), find(alternating_hopper(4.0))
    length, time = 5.0 * 3.7 / 2500.0, (5.0 / 2500.0) ** 0.5
    assert orbit.alpha == pytest.approx(plain.alpha * length / time, rel=1e-12)
    assert orbit.period == pytest.approx(plain.period * time, rel=1e-12)
    assert orbit.units["alpha"] == "m/s"
    assert_lossless(orbit)


@pytest.mark.slow
def test_another_spring():
    stiffening = alternating_hopper(3.0, 45.0, **CUBIC)
    with pytest.raises(NoOrbit, match=r"give `find` a start, such as one of starts\(machine\)"):
        find(stiffening)
    found = find_all(stiffening, starts(stiffening, 2.0, 2.0))
    assert any(each.admissible for each in found)
    for each in found:
        assert_lossless(each)


@pytest.mark.slow
def test_the_family_begins_where_a_frequency_is_twice_another():
    """At the mass ratio 3/2, for which 2 + 1/m = 4/m."""
    family = follow(alternating_hopper(3.0), "foot_mass", 1.3)
    assert family.end.kind == "escaped"
    assert family.end.limit == pytest.approx(1.5, abs=3 * family.end.limit_error)
    assert all(point.admissible for point in family.points)
    assert not find(alternating_hopper(1.5)).admissible


def test_a_disturbed_hop_and_its_legs():
    machine = alternating_hopper(rest_length=45.0)
    orbit = find(machine)
    run = simulate(machine, {**machine.model.launch_at(orbit(0.0).tolist()), "half": -4.0}, hops=3)
    assert run.status == "done"
    t = np.linspace(0.0, run.end, 20001)
    body, left, right = heights(run, t)[:, 0]
    assert run.smallest_separation == pytest.approx(min((45.0 + body - each).min() for each in (left, right)), abs=1e-4)
    assert simulate(machine, orbit, hops=3).smallest_separation == pytest.approx(
        orbit.certificate.smallest_separation, rel=1e-6
    )
    assert multipliers(machine, orbit).stability == "neutral"


def test_a_foot_below_the_ground_in_contact_is_seen_everywhere():
    """Of light feet the one in the air falls through the ground while the other one stands."""
    machine = alternating_hopper(1.0)
    orbit = find(machine)
    (_, lowest), text = by_hand(orbit)[1], "the right foot touches in contact at t = 3.41243"
    assert orbit.certificate.clearance == pytest.approx(lowest, rel=1e-4)  # which is among the steps
    assert orbit.violations == (f"{text} of the contact (height -12.7)",)
    assert sweep(machine, {"foot_mass": (0.99, 1.01)}, samples=2).statuses() == {"inadmissible": 2}
    run = simulate(machine, orbit, hops=1)
    assert (run.status, run.falls[0]) == ("falls", "right foot")
    assert run.end < orbit.flight_time + 3.41243
    proof, other = (json.loads(json.dumps(prove(each).document())) for each in (orbit, find(alternating_hopper(3.0))))
    assert (other["proved"], check(other)) == (True, [])
    assert (proof["proved"], proof["conditions"]["clearance"]) == (False, "refuted")
    clearance = "both gaps" + other["statement"].partition("both gaps")[2].partition("; each point")[0]
    stated = proof["statement"].replace("Of the motion: ", "It is a motion: ")
    stated = stated.replace("; each point", f"; {clearance}; each point", 1)
    proof |= {"proved": True, "reasons": [], "statement": stated}
    proof["conditions"]["clearance"] = "proved"
    assert check(proof) == ["a sign along the motion cannot be decided"]


def test_sweeps_and_sensitivities_begin_with_its_own_orbit():
    machine = alternating_hopper(3.0)
    swept = sweep(machine, {"foot_mass": [2.999, 3.001]})
    known = [find(alternating_hopper(mass)).alpha for mass in (2.999, 3.001)]
    assert swept["alpha"] == pytest.approx(known, rel=1e-11)
    slope = sensitivities(machine, names="foot_mass", quantities="alpha")["alpha"]["foot_mass"]
    assert slope == pytest.approx((known[1] - known[0]) / 0.002, rel=1e-5)
    with pytest.raises(InputError, match=r"family = \(1, 2\): orbits of a hopper on two feet are continued from one"):
        sweep(machine, {"foot_mass": [2.999, 3.001]}, family=[1, 2])


def test_feet_keep_their_places_in_a_drawing():
    machine = alternating_hopper(rest_length=45.0)
    orbit = find(machine)
    t = np.array([0.0, orbit.flight_time, orbit.period]) + 1e-9
    _, left, right = plane_paths(machine, orbit(t), np.array([0, 1, 1]))
    assert left.points[:, 0] == pytest.approx(np.column_stack([[-9.0] * 3, [0.0, 9.66376, 9.66376]]), abs=1e-4)
    assert right.points[:, 0] == pytest.approx(np.column_stack([[9.0] * 3, [9.66376, 0.0, 0.0]]), abs=1e-4)


def test_files_state_it(tmp_path):
    own = {"body_mass": 5.0, "foot_mass": 20.0, "stiffness": 2500.0, "rest_length": 1.0}
    lines = "\n".join(f"{name} = {value}" for name, value in own.items())
    (tmp_path / "feet.toml").write_text(f'machine = "alternating-hopper"\n[si]\n{lines}\n')
    machine = build(read(tmp_path / "feet.toml"))
    assert machine.in_si
    assert machine.values == own | {"surface_gravity": 9.80665}
    same = build({"machine": "alternating-hopper", "rest_length": 45.0, "parameters": {"foot_mass": 3.0}})
    assert same.describe() == alternating_hopper(3.0, 45.0).describe()
    with pytest.raises(InputError, match="machines that hop: an alternating-hopper has foot_mass"):
        build({"machine": "alternating-hopper", "mass_ratio": 2.0})


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"foot_mass": 0.0}, "foot_mass = 0; for a hopper on two feet it must lie above 0"),
        ({"rest_length": -1.0}, "rest_length = -1; for a hopper on two feet"),
        ({"foot_mass": 3.0, "in_si": True}, r"a hopper on two feet in SI needs body_mass \(kg\), stiffness \(N/m\)"),
        ({"spring": "r + b*r**3"}, "'b' without a value"),
        ({"parameters": {"beta": 1.0}}, "no element has a parameter 'beta'"),
    ],
)
def test_no_hopper_on_two_feet(stated, message):
    with pytest.raises(InputError, match=message):
        alternating_hopper(**stated).model  # noqa: B018
