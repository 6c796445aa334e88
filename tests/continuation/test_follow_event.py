"""Curves of events against closed forms, and against single families and orbits at other values of the parameters."""

import numpy as np
import pytest
from conftest import slow_after
from scipy.optimize import brentq

from orbits import Family, InputError, NoOrbit, find, follow, follow_event, follow_fold, multipliers, quantities
from orbits.curves import Event
from problems import Chain, Hopper, hopper_in_si, rimless_wheel, rocking_block, runner

LONG = {"longest": 0.2}
# Near the hop of a chain of masses 1, 2.9 and 1.
CHAIN = {"liftoff": 1.0, "alpha": 5.754, "y1": -1.485, "y1'": -0.304, "duration": 3.344, "contact_duration": 4.27}


@pytest.fixture(scope="module")
def quintic():
    """The hopper of a softening spring whose family collapses and folds."""
    machine = Hopper("r + beta*r**3 + delta*r**5", rest_length=30.0, parameters={"beta": 0.0, "delta": 0.0})
    return follow(machine, "beta", -0.012, start=-0.006, longest=0.1)


@pytest.fixture(scope="module")
def low():
    """The hopper of a low machine, whose masses touch along its family."""
    machine = Hopper("r + beta*r**3 + delta*r**5", rest_length=9.0, parameters={"beta": 0.4, "delta": 0.0})
    return follow(machine, "beta", -0.006)


def value_of(name: str, machine, **values: float) -> float:
    """A quantity of the orbit of a machine with other values."""
    other = machine.with_values(**values)
    return quantities(other, find(other), [name])[name]


def test_folds_of_a_scaled_spring():
    """The spring r + b c^2 r^3 folds where b c^2 is that of the cubic spring, whatever c."""
    machine = Hopper("r + b*c**2*r**3", parameters={"b": 0.0, "c": 1.0})
    folds = follow_event(follow(machine, "b", -0.012, start=-0.01, longest=0.2), "fold", "c", 1.5, **LONG)
    assert folds.column("b") * folds.column("c") ** 2 == pytest.approx(-0.0106952149164040, rel=1e-12)
    assert folds.end.kind == "reached"


def test_masses_touch_at_a_rest_length_that_is_the_smallest_extension():
    """Of a linear spring the extension is known in closed form: the separation is the rest length less its depth."""
    machine = Hopper("k*r", rest_length=9.0, parameters={"k": 1.0})
    separation = find(machine).certificate.smallest_separation
    family = follow(machine, "rest_length", 5.0, at=[])
    (touch,) = [event for event in family.events if event.kind == "masses touch"]
    assert touch.point.value == pytest.approx(9.0 - separation, abs=1e-12)
    curve = follow_event(family, touch, "mass_ratio", 2.0, **LONG)
    for point in curve[:: len(curve) - 1]:
        depth = 9.0 - find(Hopper(rest_length=9.0, mass_ratio=point.value)).certificate.smallest_separation
        assert point.also["rest_length"] == pytest.approx(depth, abs=1e-11)
        assert point.admissible


@pytest.mark.slow
def test_a_collapse_is_where_the_energy_is_that_of_the_barrier(quintic):
    """For a cubic spring the barrier and the energies are known in closed form."""
    curve = follow_event(quintic, "collapse", "mass_ratio", 2.0, **LONG)
    for point in (curve[0], curve[-1]):
        beta, mass, y = point.also["beta"], point.value, point.u[0]
        barrier = min(np.roots([beta, 0.0, 1.0, 1 / mass]).real, key=lambda r: abs(r + 1 / np.sqrt(-beta)))
        work = [mass * (r**2 / 2 + beta * r**4 / 4) + r for r in (y, barrier)]
        assert (1 + mass) * point.alpha**2 / 2 + work[0] == pytest.approx(work[1], rel=1e-12)
        assert point.contact_time is None
        assert point.admissible


@pytest.mark.parametrize(
    ("name", "value"), slow_after(1, [("period", 9.0), ("stroke", 9.0), ("loss_coefficient", 4.0)])
)
def test_a_quantity_at_a_value_is_that_of_single_orbits(low, name, value):
    curve = follow_event(low, {name: value}, "delta", 1e-4, **LONG)
    machine, beta = low.source, curve[-1].also["beta"]
    single = brentq(lambda b: value_of(name, machine, beta=b, delta=1e-4) - value, beta - 1e-3, beta + 1e-3, xtol=1e-15)
    assert beta == pytest.approx(single, abs=1e-10)
    assert f"{name} = {value:g}" in str(curve)


def test_an_extremum_of_a_formula(low):
    """A formula of alpha alone is stationary where its derivative vanishes."""
    curve = follow_event(low, "extremum of (alpha - 3)**2", "delta", 1e-4, **LONG)
    assert curve.column("alpha") == pytest.approx(3.0, abs=1e-11)
    same = follow_event(low, {"alpha": 3.0}, "delta", 1e-4, **LONG)
    assert curve[-1].also["beta"] == pytest.approx(same[-1].also["beta"], abs=1e-11)


@pytest.mark.slow
def test_a_curve_has_its_own_events_and_ends(quintic):
    curve = follow_event(quintic, "fold", "delta", (0.0, 1e-4), longest=0.1, within=(-0.0138, 0.0))
    (point,) = [event.point for event in curve.events if event.kind == "fold"]
    assert point.value == pytest.approx(7.132438068202e-05, rel=1e-11)  # the cusp
    assert {"masses touch", "contact pulls"} <= {event.kind for event in curve.events}
    ended = follow_event(quintic, "fold", "delta", 1e-4, longest=0.1, within=(-0.012, 0.0))
    assert (ended.end.kind, ended.end.reason) == ("reached", "beta = -0.012")
    assert ended[-1].also["beta"] == pytest.approx(-0.012, abs=1e-13)
    assert follow_event(quintic, "fold", "delta", -1e-6, locate=False).events == ()


def test_of_a_machine_in_si():
    machine = hopper_in_si(60.0, 3.0, force="8000*r + b*r**3", rest_length=0.8, parameters={"b": 2e6})
    family = follow(machine, "b", 5e5, longest=0.1)
    value = float(np.mean(family.column("smallest_separation")[[0, -1]]))
    curve = follow_event(family, {"smallest_separation": value}, "body_mass", 62.0, **LONG)
    other = machine.with_values(b=curve[-1].also["b"], body_mass=62.0)
    assert find(other).certificate.smallest_separation == pytest.approx(value, abs=1e-14)


@pytest.mark.slow
def test_of_machines_that_step():
    """Friction that just suffices, and the force on a standing foot."""
    block = rocking_block(2.0, 0.1, 0.3, 0.3, 0.3, 20.0, friction=0.4)
    family = follow(block, "stiffness", 30.0, start=15.0, longest=0.2)
    curve = follow_event(family, {"friction_left": 0.0}, "body_inertia", 0.32, **LONG)
    edge = block.with_values(stiffness=curve[-1].also["stiffness"], body_inertia=0.32)
    assert find(edge).certificate.friction_needed == pytest.approx(0.4, abs=1e-13)
    assert all(point.admissible for point in curve)
    wheel = rimless_wheel(mass=2.0, length=0.4, spokes=8, inertia=0.4, body_inertia=0.4, stiffness=20.0)
    family = follow(wheel, "stiffness", 25.0, longest=0.2)
    force = float(np.mean(family.column("smallest_stance_force")[[0, -1]]))
    curve = follow_event(family, {"smallest_stance_force": force}, "body_inertia", 0.42, **LONG)
    other = wheel.with_values(stiffness=curve[-1].also["stiffness"], body_inertia=0.42)
    assert find(other).certificate.smallest_stance_force == pytest.approx(force, rel=1e-12)


@pytest.mark.slow
def test_another_place_of_the_motion_takes_over():
    """The force of a wavy spring is largest at the deepest place of the contact, and then where a wave is largest."""
    machine = Hopper("r + b*sin(1.5*r) + c*r**3", rest_length=60.0, parameters={"b": 0.8, "c": 0.0})
    family = follow(machine, "b", 1.1, longest=0.1)
    force = float(np.mean(family.column("largest_contact_force")[[0, -1]]))
    curve = follow_event(family, {"largest_contact_force": force}, "c", -0.004, longest=0.1)
    (elsewhere,) = (event for event in curve.events if event.kind == "another place")
    b, c = elsewhere.point.also["b"], elsewhere.point.value
    crest = brentq(lambda r: 1 + 1.5 * b * np.cos(1.5 * r) + 3 * c * r**2, -8.4, -8.0)
    assert 1 - (crest + b * np.sin(1.5 * crest) + c * crest**3) == pytest.approx(force, abs=2e-8)
    for i, more in ((elsewhere.after, 0.0), (elsewhere.after + 1, 1e-4)):
        orbit = find(machine.with_values(b=curve[i].also["b"], c=curve[i].value))
        assert more <= abs(orbit.certificate.largest_contact_force - force) < more + 1e-4


def test_what_is_given_decides_what_follows():
    """A result with events of its own, as a diagram of hops, follows them itself."""

    class Diagram:
        def follow_event(self, event, second, stop, **options):
            return event, second, stop

    assert follow_event(Diagram(), "flip", "damping", 0.1) == ("flip", "damping", 0.1)
    with pytest.raises(InputError, match="that `follow` returns"):
        follow_event(3, "fold", "beta", 1.0)


def test_what_is_not_followed_is_refused(low, quintic, tmp_path):
    for text, event, second, stop in (
        ("no event 'grazing'; it has 1 'masses touch'", "grazing", "delta", 1.0),
        ("no event 'flip'; .*follow\\(..., multipliers=True\\)", "flip", "delta", 1.0),
        ("there is no event 'folds'; did you mean 'fold'", "folds", "delta", 1.0),
        ("'clearance' is not an event: follow the quantity at a value", "clearance", "delta", 1.0),
        ("'rest_lenght' to follow; did you mean 'rest_length'", "masses touch", "rest_lenght", 1.0),
        ("unknown quantity 'nix'", {"nix": 1.0}, "delta", 1.0),
        ("passes 100 along the family 0 times", {"alpha": 100.0}, "delta", 1.0),
        ("0 extrema", "extremum of alpha", "delta", 1.0),
        ("one formula with its value", {}, "delta", 1.0),
        ("no parameter 'gamma'", "masses touch", "gamma", 1.0),
        ("along another parameter", "masses touch", "beta", 1.0),
        ("choose another stop", "masses touch", "delta", 0.0),
        ("out of bounds", "masses touch", "rest_length", -1.0),
    ):
        with pytest.raises((InputError, NoOrbit), match=text):
            follow_event(low, event, second, stop)
    with pytest.raises(NoOrbit, match="number = 1: the family has 1 'masses touch'"):
        follow_event(low, "masses touch", "delta", 1.0, number=1)
    with pytest.raises(InputError, match="same value along the whole family"):
        follow_event(low, {"rest_length": 9.0}, "delta", 1.0)
    with pytest.raises(InputError, match="the curve begins at beta"):
        follow_event(low, "masses touch", "delta", 1.0, within=(1.0, 2.0))
    with pytest.raises(InputError, match="at least 0"):
        follow_event(low, "masses touch", "delta", 1.0, number=0.5)
    for event in (quintic.events[0], Event("enters", value=0.5, text="stroke <="), Event("fold")):
        with pytest.raises(InputError, match="does not belong to this family"):
            follow_event(low, event, "delta", 1.0)
    with pytest.raises(InputError, match=r"within = .*; low must be below high"):
        follow_event(low, "masses touch", "delta", 1.0, within=(1.0, 0.0))
    asked = follow(quintic.source, "beta", -5e-3, at=[-5.5e-3])
    with pytest.raises(InputError, match="its parameter has one value"):
        follow_event(asked, "value", "delta", 1.0)
    with pytest.raises(InputError, match=r"Family.load\(path, machine\)"):
        follow_event(Family.load(asked.save(tmp_path / "a.json")), "value", "delta", 1.0)
    curve = follow_event(quintic, "fold", "delta", -1e-7)
    with pytest.raises(InputError, match="on curves of events"):
        follow_event(curve, "fold", "rest_length", 1.0)


@pytest.fixture(scope="module")
def chain():
    """A family of hops of a chain along which a pair of multipliers leaves the unit circle."""
    machine = Chain((1, 2.9, 1))
    first = find(machine, start=CHAIN)
    return follow(machine, "m2", 3.1, start=first, multipliers=True, longest=0.3)


def largest_complex(machine, orbit):
    """By how much the largest modulus of a pair of complex multipliers is above 1."""
    values = multipliers(machine, orbit).values
    return float(np.abs(values[np.abs(values.imag) > 1e-9]).max() - 1)


def test_multipliers_that_leave_the_unit_circle(chain):
    """Against bisection on single hops, whose motions are followed."""
    machine, (crossing,) = chain.source, [event for event in chain.events if event.kind == "Neimark-Sacker"]
    beyond = lambda m2: largest_complex(here := machine.with_values(m2=m2), find(here, start=CHAIN))  # noqa: E731
    assert crossing.point.value == pytest.approx(brentq(beyond, 2.9, 3.1, xtol=1e-13), abs=1e-11)
    curve = follow_event(chain, "Neimark-Sacker", "m3", 1.02, longest=0.5)
    assert curve.end.kind == "reached"
    edge = machine.with_values(m2=curve[-1].also["m2"], m3=1.02)
    assert largest_complex(edge, find(edge, start=CHAIN)) == pytest.approx(0.0, abs=1e-11)


def test_multipliers_are_refused_where_there_is_one():
    with pytest.raises(InputError, match="which is always 1"):
        follow(Hopper("cubic", rest_length=9.0), "beta", 0.1, multipliers=True)


@pytest.mark.slow
def test_a_flip_of_runs():
    """A family with a tuned number, and a curve on which it is tuned too."""
    machine = runner(foot_mass=0.1, rest_length=3.7)
    run = find(machine, tune=("inertia", "hip_stiffness"), at={"speed": 0.4})
    family = follow(run.source, "foot_mass", 0.3, start=run, tune="inertia", multipliers=True, longest=0.3)
    (flip,) = [event.point for event in family.events if event.kind == "flip"]
    curve = follow_event(family, "flip", "rest_length", 3.8, longest=0.5)
    for point in (flip, curve[-1]):
        moved = {"foot_mass": point.value} if point is flip else {"rest_length": point.value}
        start = dict(zip(machine.model.half_unknowns, point.u, strict=False)) | {"step": point.also["step"]}
        orbit = find(run.source.with_values(**point.also, **moved), start=start, tune="inertia")
        assert np.abs(multipliers(orbit.source, orbit).values + 1).min() == pytest.approx(0.0, abs=1e-9)


@pytest.fixture(scope="module")
def runs():
    """Runs with a stated friction, which is just enough at one speed."""
    machine = runner(foot_mass=0.1, rest_length=3.7, friction=0.4)
    return follow(machine, "speed", 0.7, start=0.5, tune=("inertia", "hip_stiffness"), longest=0.3)


@pytest.mark.slow
def test_a_foot_that_slides_is_an_event_of_runs_and_a_curve(runs, tmp_path):
    (slides,) = [event.point for event in runs.events if event.kind == "foot slides"]
    assert slides.friction_needed == pytest.approx(0.4, abs=1e-12)
    curve = follow_event(runs, "foot slides", "foot_mass", 0.104, longest=0.5)
    assert all(point.admissible for point in curve)
    tuned = {"tune": ("inertia", "hip_stiffness"), "at": {"speed": curve[-1].also["speed"]}}
    orbit = find(runs.source.with_values(foot_mass=0.104), **tuned)
    assert orbit.certificate.friction_needed == pytest.approx(0.4, abs=1e-12)
    assert orbit.source.values["inertia"] == pytest.approx(curve[-1].also["inertia"], rel=1e-11)
    other = runs.source.with_values(inertia=5.0, hip_stiffness=5.0)
    assert Family.load(curve.save(tmp_path / "slides.jsonl"), other) == curve


def test_folds_of_tuned_families():
    """A law that does not depend on the sign of b: the launch speed is extreme where it is that of a linear spring."""
    machine = Hopper("k*r + b**2*r**3", parameters={"b": 0.1, "k": 1.0})
    family = follow(machine, "alpha", 6.0, tune="b")
    curve = follow_event(family, "fold", "k", 1.2, longest=0.5)
    assert curve[-1].also["alpha"] == pytest.approx(4.493409457909064 / np.sqrt(1.2), rel=1e-12)
    fold = next(event.point for event in family.events if event.kind == "fold")
    again = follow_fold(machine, fold, "alpha", "k", 1.2, longest=0.5)
    assert again[-1].also["alpha"] == pytest.approx(curve[-1].also["alpha"], rel=1e-12)
