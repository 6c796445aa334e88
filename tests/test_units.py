"""Machines stated in SI answer in SI: every public number against the dimensionless machine's, to rounding."""

import json
from dataclasses import fields

import numpy as np
import pytest
from conftest import slow_after
from machines_in_si import LEG, ROVER, THROWER

from orbits import (
    Family,
    InputError,
    Orbit,
    ReturnMap,
    find,
    find_all,
    follow,
    multiplier,
    optimize,
    orbit_at,
    pareto,
    quantities,
    sensitivities,
    simulate,
)
from orbits.units import DIMENSIONS, SPEED, Units, saved_units, unit_text
from problems import hopper_in_si

SCHEDULE = "; it must be a list of times, and lists of parameter values by name"
MACHINES = {"leg": LEG, "thrower": THROWER, "rover": ROVER}
# By hand, of masses m1 over m2, gravity g and stiffness k (eq. 2): weight, length, time of hopper and juggler.
HAND = {
    name: (m2 * g, m2 * g / k, (m2 / k / (1 + m2 / m1 if hopper else 1)) ** 0.5, m1 * g * m2 * g / k)
    for name, m1, m2, g, k, hopper in (
        ("leg", 60.0, 3.0, 9.80665, 5000.0, True),
        ("thrower", 0.3, 0.2, 3.7, 40.0, False),
        ("rover", 2.5, 0.5, 1e-4, 0.05, True),
    )
}
# The unit of each public number by its name, as a formula of length L, time T, force F and energy E.
BY_HAND = {
    **dict.fromkeys(("alpha", "error", "launch", "next", "robustness"), "L/T"),
    **dict.fromkeys(("flight_time", "contact_time", "period", "landing_sensitivity"), "T"),
    "frequency": "1/T",
    **dict.fromkeys(("liftoff_extension", "stroke", "clearance", "smallest_separation"), "L"),
    **dict.fromkeys(("smallest_contact_force", "largest_contact_force", "largest_spring_force"), "F"),
    "landing_jerk": "L/T**3",
    **dict.fromkeys(("loss_coefficient", "loss_error"), "(L/T)**(-1/3)"),
}


def sizes_of(name: str) -> dict[str, float]:
    """The unit of each public number, computed by hand."""
    F, L, T, E = HAND[name]
    return {key: eval(text, {"L": L, "T": T, "F": F, "E": E}) for key, text in BY_HAND.items()}


@pytest.fixture(params=MACHINES)
def case(request):
    """Name, machine in SI, its dimensionless self, and the units by hand."""
    machine = MACHINES[request.param]
    return request.param, machine, machine.dimensionless(), sizes_of(request.param)


def agree(found, bare, size, rel=1e-14):
    """Numbers in SI against dimensionless ones: None to None, the others to rounding of the largest."""
    if bare is None:
        assert found is None
        return
    found, expected = np.asarray(found, dtype=float), np.asarray(bare, dtype=float) * size
    assert np.array_equal(np.isnan(found), np.isnan(expected))
    largest = np.nanmax(np.abs(expected), initial=0.0)
    assert np.nanmax(np.abs(found - expected), initial=0.0) <= rel * largest


def states_agree(found, bare, sizes, rel=1e-14):
    """States of alternating lengths and speeds, to rounding of the largest."""
    agree(found / np.array([sizes["stroke"], sizes["alpha"]] * 2), bare, 1.0, rel)


def test_the_units_are_those_of_equation_2(case):
    name, machine, _, _ = case
    units = machine.units
    assert [units.force, units.length, units.time, units.energy] == pytest.approx(HAND[name], rel=1e-15)


def test_dimensions_have_names():
    assert LEG.units_of_parameters()["b"] == "N/m^3"
    assert LEG.units_of_parameters()["foot_mass"] == "kg"
    saturating = hopper_in_si(1.0, 1.0, force="f*tanh(b*r)", parameters={"f": 9.0, "b": 2.0})
    assert (saturating.units_of_parameters()["f"], saturating.units_of_parameters()["b"]) == ("N", "1/m")
    texts = {name: unit_text(dimension) for name, dimension in DIMENSIONS.items()}
    assert texts["alpha"] == "m/s"
    assert texts["landing_jerk"] == "m/s^3"
    assert texts["largest_contact_force"] == "N"
    assert texts["loss_coefficient"] == "s^(1/3)/m^(1/3)"
    assert unit_text((-1, 2, 1)) == "kg"
    assert unit_text((-1, 1, 1)) == "N s/m"


def test_orbits(case, tmp_path):
    _, machine, bare_machine, sizes = case
    orbit, bare = find(machine, 2), find(bare_machine, 2)
    for name in ("alpha", "liftoff_extension", "flight_time", "contact_time", "period", "error"):
        agree(getattr(orbit, name), getattr(bare, name), sizes[name])
    for field in fields(bare.certificate):
        one, other = getattr(orbit.certificate, field.name), getattr(bare.certificate, field.name)
        if field.name in sizes:
            agree(one, other, sizes[field.name])
        else:
            assert one == other
    for name, rise in bare.rises.items():
        agree(orbit.rises[name], rise, sizes["stroke"])
    t = np.linspace(0, 2 * bare.period, 57)
    states_agree(orbit(t * sizes["period"]), bare(t), sizes, 1e-13)  # times are rounded, states move
    states_agree(orbit.state_mid_flight, bare.state_mid_flight, sizes)
    assert orbit.dimensionless().document() | {"seconds": 0} == bare.document() | {"seconds": 0}
    document = orbit.document()
    assert document["units"]["alpha"] == "m/s"
    assert document["si"]["alpha_m_per_s"] == orbit.alpha
    again = Orbit.load(orbit.save(tmp_path / "hop.json"))
    assert again.document() == document
    assert np.array_equal(again(t), orbit(t))
    assert find(machine, start=again).alpha == pytest.approx(orbit.alpha, rel=1e-13)
    start = {"alpha": orbit.alpha, "liftoff": orbit.liftoff_extension, "duration": orbit.flight_time / 2}
    assert find_all(machine, [orbit, start])[0].alpha == pytest.approx(orbit.alpha, rel=1e-13)
    assert " m/s " in str(orbit)
    assert " kg" in str(orbit)


def test_the_map(case):
    _, machine, bare_machine, sizes = case
    speeds = find(bare_machine).alpha * np.array([[0.8, 0.97], [1.03, 1.6]])
    step, bare = ReturnMap(machine, 0.01 * sizes["alpha"]), ReturnMap(bare_machine, 0.01)
    hops, others = step(speeds * sizes["alpha"]), bare(speeds * sizes["alpha"] / machine.units.of(SPEED))
    agree(hops.alpha, speeds, sizes["alpha"])
    agree(hops.next, others.next, sizes["alpha"])
    agree(hops.loss, others.loss, sizes["alpha"] ** 2)
    assert np.array_equal(hops.impacts, others.impacts)
    assert np.array_equal(hops.status, others.status)
    alpha = float(speeds[0, 0])
    assert multiplier(machine, alpha * sizes["alpha"]) == pytest.approx(multiplier(bare_machine, alpha), rel=1e-12)
    with pytest.raises(InputError, match="alpha = -1;"):
        step(-1.0)


def test_sets_of_the_map():
    sizes, speed = sizes_of("leg"), sizes_of("leg")["alpha"]
    step, bare = ReturnMap(LEG), ReturnMap(LEG.dimensionless())
    low, high = 0.5 * find(LEG).alpha, 1.2 * find(LEG).alpha
    for method, arguments in (("fixed_points", ()), ("basin", (3,))):
        found = getattr(step, method)(low, high, *arguments, samples=80)
        other = getattr(bare, method)(low / speed, high / speed, *arguments, samples=80)
        assert len(found) == len(other) > 0
        if method == "fixed_points":
            agree([point.alpha for point in found], [point.alpha for point in other], sizes["alpha"])
        else:
            agree(found, other, sizes["alpha"])
    edges = [(0.9 * low, high)]
    found = step.preimages(edges, low, high, samples=80)
    agree(found, bare.preimages([(a / speed, b / speed) for a, b in edges], low / speed, high / speed, 80), speed)
    grid = np.linspace(low, high, 100)
    assert np.array_equal(step.jumps(step(grid)), bare.jumps(bare(grid / speed)))


def test_simulations(case):
    name, machine, bare_machine, sizes = case
    energy = HAND[name][3]
    alpha = 0.9 * find(bare_machine).alpha
    run = simulate(machine, alpha * sizes["alpha"], hops=2)
    bare = simulate(bare_machine, alpha * sizes["alpha"] / machine.units.of(SPEED), hops=2)
    agree(run.launches, bare.launches, sizes["alpha"])
    agree(run.end, bare.end, sizes["period"])
    agree(run.smallest_separation, bare.smallest_separation, sizes["stroke"])
    for event, other in zip(run.events, bare.events, strict=True):
        assert event.kind == other.kind
        agree(event.time, other.time, sizes["period"])
        agree([event.energy, event.loss], [other.energy, other.loss], energy)
        states_agree(event.before, other.before, sizes)
        states_agree(event.after, other.after, sizes)
    t = np.linspace(0, bare.end, 23)
    states_agree(run(t * sizes["period"]), bare(t), sizes, 1e-13)
    for height, function in run.heights.items():
        agree(function(run(0.0)), bare.heights[height](bare(0.0)), sizes["stroke"])
    assert "(J)" in str(run)
    assert run.document()["units"]["energy"] == "J"
    assert len(run.plot().lines) == len(bare.plot().lines)
    again = simulate(machine, state=run(0.25 * run.events[0].time), time=0.1 * run.end)
    agree(again.end, 0.1 * bare.end, sizes["period"])


def test_energy_in_joules():
    """At launch from rest length nearly: kinetic, elastic and potential energy of body and foot, by hand."""
    alpha = 0.9
    impact = simulate(LEG, alpha, hops=1).events[0]
    r = find(LEG).liftoff_extension
    by_hand = 0.5 * 60.0 * alpha**2 + 0.5 * 5000.0 * r**2 + 0.25 * 1e5 * r**4 + 60.0 * 9.80665 * r
    assert impact.energy == pytest.approx(by_hand, rel=1e-12)
    y = impact.before
    lost = 0.5 * 3.0 * y[3] ** 2  # the foot's own kinetic energy
    assert impact.loss == pytest.approx(lost, rel=1e-12)


@pytest.mark.parametrize(("along", "stop"), slow_after(3, [
    ("body_mass", 45.0), ("foot_mass", 4.5), ("surface_gravity", 3.7), ("rest_length", 0.7), ("b", 3e5), ("k", 7e3),
]))  # fmt: skip
def test_families_along_every_parameter(along, stop, tmp_path):
    """Each point against the machine stated anew, whose units are its own."""
    start = LEG.values[along]
    family = follow(LEG, along, stop, at=[0.5 * (start + stop)], longest=0.2)
    assert family.end.kind == "reached"
    assert family.at(0.5 * (start + stop))
    for point in (family[1], family[len(family) // 2], family[-1]):
        machine = LEG.with_values(**{along: point.value})
        orbit = find(machine)
        for name in ("alpha", "liftoff_extension", "flight_time", "contact_time"):
            agree(getattr(point, name), getattr(orbit, name), 1.0)
        for name in ("smallest_separation", "largest_contact_force", "landing_jerk"):
            agree(getattr(point, name), getattr(orbit.certificate, name), 1.0)
    path = family.save(tmp_path / "family.jsonl")
    assert Family.load(path) == family
    assert orbit_at(LEG, family[-1], along).alpha == pytest.approx(family[-1].alpha, rel=1e-14)
    text = family.save(tmp_path / "family.csv").read_text().splitlines()[0]
    assert "alpha (m/s)" in text
    assert f"{along} (" in text
    half = follow(LEG, along, stop, most=len(family) // 2, longest=0.2)
    assert follow(LEG, along, stop, resume=half, longest=0.2)[-1].alpha == pytest.approx(family[-1].alpha, rel=1e-13)


@pytest.mark.parametrize("name", slow_after(1, ["leg", "thrower", "rover"]))
def test_quantities_and_sensitivities(name):
    machine, bare_machine, sizes = MACHINES[name], MACHINES[name].dimensionless(), sizes_of(name)
    orbit, bare = find(machine), find(bare_machine)
    found, others = quantities(machine, orbit), quantities(bare_machine, bare)
    for name, value in others.items():
        ratio = 1.0 if name in ("duty_factor", "peak_force_in_weights") else sizes["stroke"]
        agree(found[name], value, sizes.get(name, ratio))
    asked = [name for name in others if name in ("alpha", "stroke", "loss_coefficient", "largest_contact_force")]
    slopes = sensitivities(machine, orbit, quantities=asked)
    for name in ("surface_gravity", *machine.masses):
        step = 1e-5 * machine.values[name]
        sides = [machine.with_values(**{name: machine.values[name] + side}) for side in (step, -step)]
        above, below = (quantities(side, find(side, start=orbit), asked) for side in sides)
        for quantity, slope in slopes.items():
            size = abs(found[quantity]) / machine.values[name]
            difference = (above[quantity] - below[quantity]) / (2 * step)
            assert slope[name] == pytest.approx(difference, rel=1e-6, abs=1e-8 * size), (quantity, name)


def test_designs_over_masses(tmp_path):
    limits = {"over": {"k": (2e3, 2e4), "foot_mass": (1.0, 10.0)}, "subject_to": ["centre_of_mass_rise == 0.05"]}
    best = optimize(LEG, minimise="largest_contact_force", **limits)
    assert best.quantities["centre_of_mass_rise"] == pytest.approx(0.05, rel=1e-10)
    assert best.orbit.rises["centre of mass"] == pytest.approx(0.05, rel=1e-10)
    assert best.objective == pytest.approx(find(best.source).certificate.largest_contact_force, rel=1e-10)
    assert "foot_mass" in str(best)
    assert best.document()["orbit"]["units"]["alpha"] == "m/s"
    front = pareto(LEG, minimise=("-centre_of_mass_rise", "largest_contact_force"), points=2,
                   over={"foot_mass": (2.0, 4.0)})  # fmt: skip
    assert len(front.designs) >= 1
    assert front.designs[0].orbit.scales
    head = front.save(tmp_path / "front.csv").read_text().splitlines()[0]
    assert head == "-centre_of_mass_rise (m),largest_contact_force (N),foot_mass (kg)"
    assert [best.unit_of(name) for name in ("body_rise", "stroke/body_rise", "2*foot_rise")] == ["m", "", ""]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: find(m, start={1: 2}), "start has '1'; the unknowns are liftoff, alpha, duration"),
        (lambda m: find(m, start={"alpha": "x"}), "start 'alpha' = 'x' is not a finite number"),
        (lambda m: find(m, 0), "family = 0; a family must be a whole number from 1 to 10000"),
        (lambda m: find_all(m, family=0), "family = 0; a family must be a whole number from 1 to 10000"),
        (
            lambda m: find(m, method="x 2"),
            "method = 'x 2'; it must be one of closed form, relative, half orbit, shooting",
        ),
        (lambda m: simulate(m, 1.5, time=-2.0), "time = -2.0; it must be a number above 0"),
        (lambda m: simulate(m, 1.5, hops=0), "hops = 0; it must be a number of lift-offs, at least 1"),
        (lambda m: simulate(m, -1.5, hops=1), "alpha = -1.5; a launch speed must be above 0"),
        (lambda m: simulate(m, state=[1, 2], hops=1), "state = [1, 2]; it must be 4 numbers, y1, y1', y2, y2'"),
        (lambda m: simulate(m, 1.5, hops=1, schedule=5), f"schedule = 5{SCHEDULE}"),
        (lambda m: simulate(m, 1.5, hops=1, schedule=([0, "x"], {})), f"schedule = ([0, 'x'], {{}}){SCHEDULE}"),
        (lambda m: simulate(m, 1.5, hops=1, schedule=([0, 1], 2)), f"schedule = ([0, 1], 2){SCHEDULE}"),
        (
            lambda m: simulate(m, 1.5, hops=1, schedule=([0, 1], {"k": [1, 2]})),
            "schedule: 'k' has 2 values for 2 times; it must have one value between each two times",
        ),
        (
            lambda m: ReturnMap(m).fixed_points(1, 2, samples=0),
            "samples = 0; it must be a number of launches, at least 2",
        ),
    ],
)
def test_arguments_that_cannot_be_are_told_as_they_were_given(call, message):
    """With units and without, and without a note on units where the numbers have none."""
    for machine in (LEG, LEG.dimensionless()):
        with pytest.raises(InputError) as raised:
            call(machine)
        assert str(raised.value) == message


def test_a_schedule_is_in_si():
    bare, units = LEG.dimensionless(), LEG.units
    times, stiffening = np.array([0.0, 0.1, 0.5]), np.array([2e5, 1.5e5])
    run = simulate(LEG, 1.0, time=0.5, schedule=(times, {"b": stiffening}))
    of_b = LEG.values["b"] / bare.values["b"]
    options = {"time": 0.5 / units.time, "schedule": (times / units.time, {"b": stiffening / of_b})}
    other = simulate(bare, 1.0 * units.time / units.length, **options)
    agree(run(0.4), other(0.4 / units.time), units.of_states(("y1", "y1'", "y2", "y2'")), 1e-13)
    assert abs(run(0.4)[0] - simulate(LEG, 1.0, time=0.5)(0.4)[0]) > 0.01


def test_powers_of_units():
    assert [unit_text((-power, 0, 1)) for power in (1.5, 0.5, 1 / 3, 0.333333333, 2.0, 1.25, 0.123)] == [
        "N/m^(3/2)", "N/m^(1/2)", "N/m^(1/3)", "N/m^(1/3)", "N/m^2", "N/m^(5/4)", "N/m^0.123",
    ]  # fmt: skip
    contact = hopper_in_si(2.0, 1.0, force="k*abs(r)**1.5*sign(r)", stiffness=1e4, parameters={"k": 1e4})
    assert contact.units_of_parameters()["k"] == "N/m^(3/2)"


@pytest.mark.usefixtures("any_digest")
def test_files_of_the_first_version_had_no_results_in_si(tmp_path):
    """A file without units of its own has dimensionless numbers; they are brought to SI."""
    orbit, parts = find(LEG), ("length", "time", "force")
    sizes = {name: getattr(LEG.units, name) for name in parts}
    old = json.loads(orbit.dimensionless().save(tmp_path / "old.json").read_text())
    old |= {"laws_in": "SI"}
    old["motion"]["units"] = sizes
    (tmp_path / "old.json").write_text(json.dumps(old))
    loaded = Orbit.load(tmp_path / "old.json")
    assert loaded.alpha == orbit.alpha
    assert loaded.certificate == orbit.certificate
    assert np.array_equal(loaded(0.1), orbit(0.1))
    family = follow(LEG.dimensionless(), "b", 2e5, longest=0.5)
    lines = family.save(tmp_path / "old.jsonl").read_text().splitlines()
    head = json.loads(lines[0])
    head["machine"] |= {"laws_in": "SI", **{f"unit_{name}": size for name, size in sizes.items()}}
    (tmp_path / "old.jsonl").write_text("\n".join([json.dumps(head), *lines[1:]]) + "\n")
    agree(Family.load(tmp_path / "old.jsonl").column("alpha"), family.column("alpha"), sizes_of("leg")["alpha"])


def test_units_of_states_of_other_kinds_come_back_from_a_file():
    units = Units(1.0, 2.0, 3.0, 4.0, ("knee",), (("f", (1, 0, 1)),))
    assert saved_units(json.loads(json.dumps(units.saved()))) == units
