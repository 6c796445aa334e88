"""Families against golden values, a known fold, other routes along them and branch points, and what is refused."""

import numpy as np
import pytest
from families import FOLD, FOLD_ALPHA, events
from hanging import quartic_error

from orbits import InputError, NoOrbit, Orbit, find, follow, follow_branch, orbit_at, trace
from orbits.continuation import End, Event
from orbits.show import thumbnails
from problems import Hopper


def test_the_fold_of_the_cubic_spring_and_its_second_sheet(softening_family):
    (fold,) = events(softening_family, "fold")
    assert fold.value == pytest.approx(FOLD, abs=1e-11)
    assert fold.alpha == pytest.approx(FOLD_ALPHA, abs=1e-8)
    assert [round(point.alpha, 4) for point in softening_family.at(-0.005)] == [4.7432, 9.924]
    assert softening_family.end.kind == "escaped"
    assert softening_family.end.limit == pytest.approx(0, abs=1e-4)
    assert abs(softening_family.end.limit) <= 2 * softening_family.end.limit_error < 4e-3
    assert "family" not in [event.kind for event in softening_family.events]
    beta, alpha = softening_family[-1].value, softening_family[-1].alpha
    way = f"beta = {beta:.10g}, alpha = {alpha:.10g}"
    assert softening_family.end.reason == f"the launch speed grows without bound, and was followed to {way}"


def test_points_are_what_find_finds():
    machine = Hopper("r", "1/(1 + k*z)**2", 0.5, 10.0, parameters={"k": 0.0})
    for point in list(follow(machine, "k", 0.05))[::18]:
        orbit = find(machine.with_values(k=point.value))
        assert point.alpha == pytest.approx(orbit.alpha, rel=1e-12)
        assert point.flight_time == pytest.approx(orbit.flight_time, rel=1e-12)
        assert point.contact_time == pytest.approx(orbit.contact_time, rel=1e-10)
        assert point.certificate.loss_coefficient == pytest.approx(orbit.certificate.loss_coefficient, rel=1e-8)


def test_stiffness_only_changes_the_units():
    """A flight in closed form takes Taylor steps where its parameter varies, and neighbours are solved in one call."""
    machine = Hopper("k*r", parameters={"k": 1.0})
    family = follow(machine, "k", 9.0)
    assert family.column("alpha") * np.sqrt(family.column("k")) == pytest.approx(4.493409457909064, rel=1e-13)


def test_trace_yields_orbits_events_and_the_end():
    items = list(trace(Hopper("cubic"), "beta", 1.0, 0.0, at=[0.5], longest=0.1))
    assert isinstance(items[0], Orbit)
    assert items[0].alpha == pytest.approx(4.493409457909064)
    assert [type(item) for item in items if not isinstance(item, Orbit)] == [Event, End]
    assert items[-2].machine["parameters"]["beta"] == 1.0


@pytest.mark.slow
def test_orbits_with_nodes_are_traced_as_they_are_followed():
    """Up to the last requested value, beyond which small changes grow more and the limit is known."""
    machine, values = Hopper("r + c*r**2", parameters={"c": 0.0}), [-0.022, -0.018]
    family = follow(machine, "c", -1.0, at=values)
    assert (family.end.kind, family[-1].value) == ("escaped", values[-1])
    orbits = [item for item in trace(machine, "c", -1.0, at=values) if isinstance(item, Orbit)]
    assert [orbit.alpha for orbit in orbits] == family.column("alpha").tolist()
    losses = [orbit.certificate.loss_coefficient for orbit in orbits[-9:]]
    assert losses == pytest.approx(family.column("loss_coefficient")[-9:], rel=1e-12)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"along": "gamma"}, "no parameter 'gamma' to follow; it has mass_ratio, beta"),
        ({"stop": 0.3}, "choose another stop"),
        ({"start": 0.0, "stop": 1e-320}, "a length from 1e-150 to 1e\\+150"),
        ({"stop": np.nan}, "not a finite number"),
        ({"longest": 0.0}, "it must be a share"),
        ({"most": 0}, "a number of points"),
        ({"at": ["a"]}, "not a finite number"),
        ({"family": np.nan}, "family"),
        ({"start": [0.3]}, "start = \\[0.3\\] is not a finite number"),
        ({"start": {"alpha": 4.5}}, "start has no 'liftoff'"),
        ({"watch": {"fold": 1}}, "a function of the orbit"),
        ({"watch": {"grazing": lambda orbit: 1.0}}, "with a name that nothing else has"),
        ({"output": "/nowhere/family.jsonl"}, "cannot be written"),
    ],
)
def test_bad_questions_are_refused(options, message):
    question = {"along": "beta", "stop": 1.0, "start": 0.3, **options}
    with pytest.raises(InputError, match=message):
        follow(Hopper("cubic"), question.pop("along"), question.pop("stop"), **question)


class TestBranchPoint:
    """With b = fold + q**2 the families on both sheets cross at q = 0, transversally."""

    MACHINE = Hopper("r + (b + q**2)*r**3", rest_length=30.0, parameters={"b": FOLD, "q": -0.08})

    @pytest.fixture(scope="class")
    @classmethod
    def family(cls):
        return follow(cls.MACHINE, "q", 0.08, at=[-0.05, 0.05])

    def test_it_is_located_and_passed(self, family):
        (point,) = events(family, "branch point")
        assert point.value == pytest.approx(0, abs=1e-8)
        assert point.alpha == pytest.approx(FOLD_ALPHA, abs=1e-7)
        assert family.end.kind == "reached"
        assert family.at(-0.05)[0].alpha < FOLD_ALPHA < family.at(0.05)[0].alpha

    def test_the_other_curve_is_its_mirror_image(self, family):
        (point,) = events(family, "branch point")
        for upper, value in ((True, -0.05), (False, 0.05)):
            other = follow_branch(self.MACHINE, point, "q", 1.6 * value, upper=upper, at=[value])
            assert other.end.kind == "reached"
            assert other.at(value)[0].alpha == pytest.approx(family.at(-value)[0].alpha, rel=1e-12)

    @pytest.mark.slow
    def test_a_branch_that_hangs_goes_on(self, family):
        """On the upper sheet both barriers are nearly reached, and a change grows 1e14-fold."""
        (point,) = events(family, "branch point")
        other = follow_branch(self.MACHINE, point, "q", -0.101, upper=True)
        assert other.end.kind == "reached"
        error = quartic_error(0.0, FOLD + other[-1].value ** 2, other[-1].alpha, 1, within=2e-11)
        assert error <= other[-1].error < 1e-11

    def test_what_cannot_be_meant(self, family):
        (point,) = events(family, "branch point")
        with pytest.raises(InputError, match="away from stop"):
            follow_branch(self.MACHINE, point, "q", 0.08)
        with pytest.raises(NoOrbit, match="no other curve"):
            follow_branch(self.MACHINE, family[3], "q", 0.08)
        with pytest.raises(InputError, match="no parameter 'x'"):
            follow_branch(self.MACHINE, point, "x", 0.08)
        with pytest.raises(InputError, match="the `point` of a family's event"):
            follow_branch(self.MACHINE, 0.0, "q", 0.08)


def test_an_orbit_at_a_point_is_the_one_that_was_followed(softening_family):
    """On the second sheet too, where `find` finds another one."""
    (point,) = [point for point in softening_family.at(-0.005) if point.alpha > FOLD_ALPHA]
    orbit = orbit_at(Hopper("cubic", rest_length=30.0), point, "beta")
    with pytest.raises(InputError, match="along = 'alpha' is not a parameter"):
        orbit_at(Hopper("cubic", rest_length=30.0), point, "alpha")
    assert orbit.alpha == pytest.approx(point.alpha, rel=1e-13)
    assert orbit.machine["parameters"]["beta"] == -0.005
    axes = thumbnails(softening_family.plot(), softening_family, [(point, orbit)])
    (small,) = axes.child_axes
    assert len(small.lines) == 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "along", "stop", "family"),
    [
        # The orbit is found by the search alone.
        (Hopper("r*exp(a*r)", "1/(1+z/R)**2", rest_length=10.0, parameters={"a": 0.3, "R": 20.0}), "R", 20.01, 1),
        # The one to which the guess leads is not the lowest.
        (Hopper("r", "1 + 0.9*sin(z)", rest_length=10.0), "rest_length", 10.01, 2),
    ],
)
def test_a_family_begins_with_what_find_gives(machine, along, stop, family):
    lowest = find(machine, family).alpha
    first = next(trace(machine, along, stop, family=family))
    assert first.alpha == pytest.approx(lowest, rel=1e-12)
