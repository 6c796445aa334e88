"""Families against golden values, known folds and limits, other routes along them, and themselves at half the step."""

import json
import resource
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from conftest import PROVED, middle, slow_after

from orbits import Family, InputError, NoOrbit, Orbit, find, follow, follow_branch, orbit_at, trace
from orbits.continuation.corrector import correct, correct_all, predict_and_correct
from orbits.continuation.curve import Curve, CurvePoint, interpolated
from orbits.continuation.events import watched
from orbits.continuation.point import End, Event
from orbits.continuation.predictor import around
from orbits.flow.vector_field import FlowControl
from orbits.periodic.certificate import certify
from orbits.periodic.find import solve_family
from orbits.shooting.newton_kernel import NewtonKernel
from orbits.shooting.single_shooting import Shooting
from orbits.show.plot import spread, thumbnails
from problems import Hopper, Juggler, hopper_in_si
from problems.laws import springs
from studies.random_families import differences, random_springs, twice

GOLDEN = {float(beta): middle(hop["alpha"]) for beta, hop in PROVED["cubic"].items()}
SINH = Hopper("sinh", "1/(1 + z/R)**2", rest_length=12, parameters={"b": 0.1, "R": 80.0})
FOLD, FOLD_ALPHA = (middle(PROVED["fold"][name]) for name in ("beta", "alpha"))


def events(family: Family, kind: str) -> list:
    return [event.point for event in family.events if event.kind == kind]


@pytest.fixture(scope="module")
def softening() -> Family:
    """The cubic spring from linear to its fold, and back on the second sheet."""
    return follow(Hopper("cubic", rest_length=30.0), "beta", -0.02, 0.0, at=[-0.005])


def test_golden_values_are_hit_exactly():
    family = follow(Hopper("cubic"), "beta", 5.0, 0.0, at=[0.5, 1, 2, 5])
    for value, alpha in GOLDEN.items():
        (point,) = family.at(value)
        assert point.alpha == pytest.approx(alpha, rel=1e-12)
        assert abs(point.alpha - alpha) <= max(point.error, 1e-15)
    assert family.end.kind == "reached"
    assert family[-1].value == 5.0
    assert [event.kind for event in family.events] == ["asked"] * 3


def test_the_fold_of_the_cubic_spring_and_its_second_sheet(softening):
    (fold,) = events(softening, "fold")
    assert fold.value == pytest.approx(FOLD, abs=1e-11)
    assert fold.alpha == pytest.approx(FOLD_ALPHA, abs=1e-8)
    assert [round(point.alpha, 4) for point in softening.at(-0.005)] == [4.7432, 9.924]
    assert softening.end.kind == "escaped"
    assert softening.end.limit == pytest.approx(0, abs=1e-4)
    beta, alpha = softening[-1].value, softening[-1].alpha
    way = f"beta = {beta:.10g}, alpha = {alpha:.10g}"
    assert softening.end.reason == f"the launch speed grows without bound, and was followed to {way}"


def test_the_collapse_in_contact_is_where_the_energy_is_that_of_the_barrier(softening):
    """Just above it the contact takes ever longer, below it there is none: energy equals that of the unstable rest."""
    (point,) = events(softening, "collapse")
    b, rho = point.value, point.liftoff_extension
    total = lambda r: r**2 / 2 + b * r**4 / 4 + r  # noqa: E731 - M = 1: kinetic energy v^2 beside it
    roots = np.roots([b, 0, 1, 1])
    top = min(root.real for root in roots if abs(root.imag) < 1e-12)
    assert point.alpha**2 + total(rho) == pytest.approx(total(top), rel=1e-10)
    before = softening[softening.events[1].after]
    assert before.admissible
    assert not softening[softening.events[1].after + 1].admissible


@pytest.mark.parametrize("family", slow_after(2, [1, 4, 2, 3]))
def test_the_saturating_spring_runs_off_to_its_limit(family):
    curve = follow(Hopper("tanh"), "b", 0.9, 0.05, family)
    assert curve.end.kind == "escaped"
    assert curve.end.limit == pytest.approx(1 / (2 * family + 1), abs=1e-6)
    assert {point.family for point in curve} == {family}


@pytest.mark.parametrize(
    ("machine", "along", "stop"),
    [
        pytest.param(Hopper("cubic", parameters={"beta": 0.0}), "beta", -0.02, marks=pytest.mark.slow),
        pytest.param(
            Hopper("r + c*r**2 + d*r**3", parameters={"c": 0.0, "d": -0.003}), "c", 0.2, marks=pytest.mark.slow
        ),
        (Hopper("r", "1/(1 + k*z)**2", rest_length=20.0, parameters={"k": 0.0}), "k", 0.05),
        (Juggler("r + 0.1*r**3", "1/(1 + k*z)**2", rest_length=20.0, parameters={"k": 0.0}), "k", 0.05),
        (Hopper("bilinear", parameters={"ratio": 1.0}), "ratio", 5.0),
        (Hopper("toda", parameters={"b": 0.01}), "b", 0.45),
    ],
    ids=["cubic", "quadratic", "hopper in gravity", "juggler in gravity", "bilinear", "toda"],
)
def test_half_the_step_gives_the_same_curve(machine, along, stop):
    """The same events, and the same orbits wherever the parameter has the same value."""
    start = machine.values[along]
    at = np.linspace(start, stop, 7)[1:-1]
    one, two = (follow(machine, along, stop, at=at, longest=step) for step in (0.03, 0.015))
    assert len(two) > 1.2 * len(one)
    assert one.end.kind == two.end.kind
    assert [event.kind for event in one.events] == [event.kind for event in two.events]
    for a, b in zip(one.events, two.events, strict=True):
        assert a.point.value == pytest.approx(b.point.value, rel=1e-10)
        assert a.point.alpha == pytest.approx(b.point.alpha, rel=1e-7 if a.kind == "fold" else 1e-10)


def test_points_are_what_find_finds():
    machine = Hopper("r", "1/(1 + k*z)**2", 0.5, 10.0, parameters={"k": 0.0})
    for point in list(follow(machine, "k", 0.05))[::9]:
        orbit = find(machine.with_values(k=point.value))
        assert point.alpha == pytest.approx(orbit.alpha, rel=1e-12)
        assert point.flight_time == pytest.approx(orbit.flight_time, rel=1e-12)
        assert point.contact_time == pytest.approx(orbit.contact_time, rel=1e-10)
        assert point.certificate.loss_coefficient == pytest.approx(orbit.certificate.loss_coefficient, rel=1e-8)


def test_a_parameter_that_does_not_matter_leaves_alpha_alone():
    family = follow(Hopper("r", mass_ratio=0.5), "mass_ratio", 4.0)
    assert np.ptp(family.column("alpha")) < 1e-14
    closed = [find(Hopper("r", mass_ratio=point.value)).certificate.loss_coefficient for point in family]
    assert family.column("loss_coefficient") == pytest.approx(closed, rel=1e-10)


def test_stiffness_only_changes_the_units():
    """A flight in closed form takes Taylor steps where its parameter varies, and neighbours are solved in one call."""
    machine = Hopper("k*r", parameters={"k": 1.0})
    family = follow(machine, "k", 9.0)
    assert family.column("alpha") * np.sqrt(family.column("k")) == pytest.approx(4.493409457909064, rel=1e-13)


def test_the_last_step_is_of_the_motion_itself():
    """Not of what a Newton step from there makes of it, where it may go back: this air spring got stuck."""
    machine = Hopper("L*(1 - (1 + r/L)**(-1.4))/1.4", parameters={"L": 50.0})
    family = follow(machine, "L", 3.0)
    assert family.end.kind == "reached"
    assert family[-1].alpha == pytest.approx(find(machine.with_values(L=3.0)).alpha, rel=1e-12)


def test_points_between_are_solved_together(monkeypatch):
    """Most points of a family are solved in batches, whatever number of Taylor steps each takes."""
    sizes, call = [], NewtonKernel.__call__
    counted = lambda self, xs, *others: sizes.append(len(xs)) or call(self, xs, *others)  # noqa: E731
    monkeypatch.setattr(NewtonKernel, "__call__", counted)
    family = follow(SINH, "b", 2.0, at=[0.5])
    assert family[-1].value == 2.0
    assert max(sizes) > 20
    assert sum(sizes) < 3 * len(family.points)


def test_motions_of_many_steps_are_followed_one_by_one(monkeypatch):
    values = [0.2, 0.3, 0.4]
    together = follow(SINH, "b", 0.5, at=values)
    monkeypatch.setattr("orbits.flow.flow.Flow.control", FlowControl(max_block=4))
    alone = follow(SINH, "b", 0.5, at=values)
    for value in values:
        ((one,), (other,)) = alone.at(value), together.at(value)
        assert abs(one.alpha - other.alpha) <= one.error + other.error
        assert one.flight_time == pytest.approx(other.flight_time, rel=1e-14)


def test_masses_that_touch_are_located_and_the_curve_goes_on():
    machine = Hopper("toda", rest_length=30.0)
    family = follow(machine, "b", -0.6, -0.01)
    (touch,) = events(family, "masses touch")
    assert abs(touch.certificate.smallest_separation) < 1e-12
    assert family[-1].value == -0.6
    assert "masses pass" in family[-1].certificate.violations[0]
    short = follow(machine, "b", -0.6, -0.01, stop_inadmissible=True)
    assert short.end.kind == "stopped"
    assert "masses pass" in short.end.reason
    assert [point.admissible for point in short] == [True] * (len(short) - 1) + [False]


def test_the_users_own_event():
    family = follow(Hopper("cubic"), "beta", 2.0, 0.0, watch={"three": lambda orbit: orbit.alpha - 3.0})
    (point,) = events(family, "three")
    assert point.alpha == pytest.approx(3.0, rel=1e-14)
    assert find(Hopper("cubic", parameters={"beta": point.value})).alpha == pytest.approx(3.0, rel=1e-12)


def test_the_interpolant_has_its_order():
    """Six data of an exponential curve: the error falls with the sixth power."""

    def at(t: float) -> CurvePoint:
        return CurvePoint(np.array([np.exp(t), t]), 0.3 * np.array([np.exp(t), 1.0]), 1.0, None, 0)

    errors = []
    for h in (0.2, 0.1):
        points = interpolated([at(-2 * h), at(-h), at(0.0)], np.array([0.0, 1.0]), np.array([h, -0.5 * h]))
        assert points[:, 1] == pytest.approx([h, -0.5 * h])
        errors.append(np.abs(points[:, 0] - np.exp([h, -0.5 * h])))
    assert 50 < errors[0][0] / errors[1][0] < 100
    assert errors[0][1] < errors[0][0] / 100


def test_trace_yields_orbits_events_and_the_end():
    items = list(trace(Hopper("cubic"), "beta", 1.0, 0.0, at=[0.5], longest=0.1))
    assert isinstance(items[0], Orbit)
    assert items[0].alpha == pytest.approx(4.493409457909064)
    assert [type(item) for item in items if not isinstance(item, Orbit)] == [Event, End]
    assert items[-2].machine["parameters"]["beta"] == 1.0


class TestOnDisk:
    def test_a_family_saves_and_loads_to_the_last_bit(self, softening, tmp_path):
        again = Family.load(softening.save(tmp_path / "family.jsonl"))
        assert again == softening
        assert str(again) == str(softening)

    def test_csv_has_full_precision(self, softening, tmp_path):
        lines = softening.save(tmp_path / "family.csv").read_text().splitlines()
        assert lines[0].startswith("beta,alpha,liftoff_extension,flight_time,contact_time,admissible,error")
        assert float(lines[3].split(",")[1]) == softening[2].alpha
        assert len(lines) == len(softening) + 1

    def test_netcdf_needs_an_extra(self, softening, tmp_path, monkeypatch):
        monkeypatch.setitem(sys.modules, "xarray", None)
        with pytest.raises(InputError, match=r"persistent-orbits\[data\]"):
            softening.save(tmp_path / "family.nc")

    @pytest.mark.extra("xarray")
    def test_netcdf(self, softening, tmp_path):
        import xarray

        with xarray.open_dataset(softening.save(tmp_path / "family.nc")) as data:
            assert (data["alpha"].values == softening.column("alpha")).all()

    def test_a_killed_run_is_resumed(self, tmp_path):
        """Every finished point is on disk; resumed, the curve is that of an uninterrupted run."""
        path = tmp_path / "family.jsonl"
        code = (
            "from orbits import follow; from problems import Hopper\n"
            f"follow(Hopper('cubic'), 'beta', 5.0, 0.0, longest=0.002, output={str(path)!r})"
        )
        process = subprocess.Popen([sys.executable, "-c", code])
        until = time.monotonic() + 30
        while time.monotonic() < until and not (path.exists() and path.read_text().count("\n") > 20):
            time.sleep(0.02)
        process.kill()
        process.wait()
        broken = Family.load(path)
        assert 15 < len(broken) < 500
        assert broken.end.kind == "interrupted"
        rest = follow(Hopper("cubic"), "beta", 5.0, 0.0, at=[2.0], resume=broken, output=path)
        assert rest.points[: len(broken) - 1] == broken.points[:-1]
        assert rest.at(2.0)[0].alpha == pytest.approx(GOLDEN[2.0], rel=1e-12)
        assert rest.end.kind == "reached"
        assert Family.load(path) == rest

    def test_a_table_that_ends_is_no_collapse(self):
        """In contact the hop of a light foot leaves the table."""
        rows = np.linspace(-6.0, 5.0, 12)
        table = Hopper(springs.table((rows, rows), noise=0), mass_ratio=1.0, rest_length=9.0)
        (event,) = follow(table, "mass_ratio", 4.0).events
        assert event.kind == "law ends"
        assert "leaves the law's range, [-6, 5]" in event.point.violations[0]

    def test_another_machine_cannot_resume(self, softening):
        with pytest.raises(InputError, match="another machine"):
            follow(Hopper("cubic", rest_length=31.0), "beta", -0.02, 0.0, resume=softening)

    def test_what_is_no_family_is_refused(self, tmp_path):
        path = tmp_path / "family.jsonl"
        for text in ("", "{}", '{"format": "other"}', "not json"):
            path.write_text(text)
            with pytest.raises(InputError, match="is not a saved family"):
                Family.load(path)

    def test_a_document_is_json(self, softening):
        document = json.loads(json.dumps(softening.document()))
        assert document["points"][0]["beta"] == 0.0
        assert document["settings"]["stop"] == -0.02
        assert set(document["versions"]) == {"persistent-orbits", "casadi", "numpy", "python"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"along": "gamma"}, "no parameter 'gamma' to follow; it has mass_ratio, beta"),
        ({"stop": 0.3}, "there is no way between"),
        ({"stop": np.nan}, "not a finite number"),
        ({"longest": 0.0}, "a step is a share"),
        ({"most": 0}, "a number of points"),
        ({"at": ["a"]}, "not a finite number"),
        ({"start": find(Hopper("cubic"))}, "give an orbit to begin with as orbit="),
        ({"watch": {"fold": 1}}, "a function of the orbit"),
        ({"watch": {"grazing": lambda orbit: 1.0}}, "a name of its own"),
        ({"output": "/nowhere/family.jsonl"}, "cannot be written"),
    ],
)
def test_bad_questions_are_refused(options, message):
    question = {"along": "beta", "stop": 1.0, "start": 0.3, **options}
    with pytest.raises(InputError, match=message):
        follow(Hopper("cubic"), question.pop("along"), question.pop("stop"), **question)


def test_no_first_orbit_is_said_and_a_lost_curve_keeps_what_it_has():
    with pytest.raises(NoOrbit, match="does not come back"):
        follow(Hopper("cubic"), "beta", 0.0, -0.1)
    family = follow(Hopper("r"), "mass_ratio", -1.0)
    assert family.end.kind == "degenerate"
    assert family.end.reason.startswith("there is no such machine any more at mass_ratio = ")
    assert len(family.end.reason) <= 300
    assert len(family) > 10


def test_a_machine_in_si_is_followed_in_its_own_units():
    machine = hopper_in_si(60, 3, force="k*r + c*r**3", rest_length=0.8, parameters={"k": 8e3, "c": 0.0})
    family = follow(machine, "c", 2e6)
    assert family[-1].alpha == pytest.approx(find(machine.with_values(c=2e6)).alpha, rel=1e-12)


def test_plots(softening):
    axes = softening.plot(label="first")
    follow(Hopper("cubic"), "beta", -0.003, 0.0, 2).plot(axes=axes, label="second")
    solid, dashed, *_ = axes.lines
    assert np.nanmin(solid.get_xdata()[~np.isnan(solid.get_ydata())]) == events(softening, "collapse")[0].value
    assert np.nanmax(dashed.get_ydata()) == softening[-1].alpha
    assert {text.get_text() for text in axes.get_legend().get_texts()} == {
        "first",
        "second",
        "collapse",
        "fold",
        "no motions",
    }


@pytest.mark.parametrize(
    ("text", "parameters", "family"),
    slow_after(2, random_springs(12, seed=7)),
)
def test_random_families_keep_to_their_curve(text, parameters, family):
    curves = twice(text, parameters, family)
    assert curves is None or not differences(*curves, family)


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


def test_an_isola_closes():
    """With b = fold + d - q**2 the two sheets are joined at both ends of q**2 = d: fold, fold, and the start again."""
    machine = Hopper("r + (b - q**2)*r**3", rest_length=30.0, parameters={"b": FOLD + 4e-4, "q": 0.0})
    family = follow(machine, "q", (-0.1, 0.1))
    assert family.end.kind == "closed"
    assert [fold.value for fold in events(family, "fold")] == pytest.approx([0.02, -0.02], abs=1e-9)
    assert [fold.alpha for fold in events(family, "fold")] == pytest.approx([FOLD_ALPHA] * 2, abs=1e-6)
    assert family[-1].u == pytest.approx(family[0].u, rel=1e-9)
    assert follow(machine, "q", 0.1).end.reason == "q = 0 again, on another sheet"
    for start, bounds in ((0.0, (0.05, 0.1)), (0.5, (-1.0, -0.2)), (0.5, (-0.2, -1.0)), (-0.5, (0.2, 1.0))):
        with pytest.raises(InputError, match="does not lie between"):
            follow(machine, "q", bounds, start=start)


def test_questions_about_quantities_and_values_that_are_not_there(softening, tmp_path):
    with pytest.raises(InputError, match="no quantity 'height'; they have beta, alpha"):
        softening.plot("height")
    with pytest.raises(InputError, match=r"at = 0\.1 is not reached: beta lies between 0 and -0.02"):
        follow(Hopper("cubic"), "beta", -0.02, 0.0, at=[0.1])
    with pytest.raises(InputError, match=r"ending, \.jsonl or \.json or \.csv or \.nc"):
        softening.save(tmp_path / "family.txt")
    with pytest.raises(InputError, match="watch 'x' gives nan"):
        follow(Hopper("cubic"), "beta", 1.0, 0.0, watch={"x": lambda orbit: np.nan})
    empty = replace(softening, points=(), events=())
    assert "without orbits" in str(empty)
    assert Family.load(empty.save(tmp_path / "empty.jsonl")) == empty
    assert empty.save(tmp_path / "empty.csv").read_text().startswith("beta,alpha")


def test_an_orbit_at_a_point_is_the_one_that_was_followed(softening):
    """On the second sheet too, where `find` finds another one."""
    (point,) = [point for point in softening.at(-0.005) if point.alpha > FOLD_ALPHA]
    orbit = orbit_at(Hopper("cubic", rest_length=30.0), point, "beta")
    assert orbit.alpha == pytest.approx(point.alpha, rel=1e-13)
    assert orbit.machine["parameters"]["beta"] == -0.005
    axes = thumbnails(softening.plot(), softening, [(point, orbit)])
    (small,) = axes.child_axes
    assert len(small.lines) == 2


def test_thumbnails_are_spread_along_the_curve_and_leave_room_for_the_labels(softening):
    points = spread(softening, 6)
    assert (points[0], points[-1], len(points)) == (softening[0], softening[-1], 6)
    machine = Hopper("cubic", rest_length=30.0)
    axes = thumbnails(softening.plot(), softening, [(point, orbit_at(machine, point, "beta")) for point in points])
    axes.figure.draw_without_rendering()
    frame = axes.figure.bbox
    for text in (axes.yaxis.label, axes.xaxis.label, axes.title):
        box = text.get_window_extent()
        assert min(box.x0, box.y0, frame.x1 - box.x1, frame.y1 - box.y1) >= 0


@pytest.mark.slow
def test_memory_stays_flat_over_many_orbits():
    def grown() -> float:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for _ in range(4):
            assert len(follow(Hopper("cubic"), "beta", 5.0, 0.0, longest=0.004)) > 300
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before

    grown(), grown()  # with what is compiled on the way
    assert grown() < 2000  # kilobytes; the most that a process has had never falls


def test_ipopt_goes_on_where_newton_fails(monkeypatch):
    """A corrector that fails in a window but for a given value of the parameter."""

    def failing(curve, ends, length, value=None):
        if 0.2 < ends[-1].value < 0.6 and value is None and len(solved) < 1:
            raise NoOrbit("the corrector does not converge")
        return predict_and_correct(curve, ends, length, value)

    solved = []
    solve = Shooting.multiple_shooting
    monkeypatch.setattr("orbits.continuation.step_control.predict_and_correct", failing)
    monkeypatch.setattr(Shooting, "multiple_shooting", lambda *a: solved.append(a) or solve(*a))
    family = follow(Hopper("cubic"), "beta", 1.0, 0.0)
    assert len(solved) == 1
    assert family.end.kind == "reached"
    assert family[-1].alpha == pytest.approx(GOLDEN[1.0], rel=1e-13)


def test_named_springs_can_be_followed():
    assert follow(Hopper(springs.sinh()), "b", 1.0).end.kind == "reached"


@pytest.mark.parametrize(
    ("before", "longest"),
    slow_after(3, [(1e-3, 0.02), (1e-9, 0.02), (1e-7, 0.011), (1e-3, 0.011), (1e-7, 0.02), (1e-9, 0.011)]),
)
def test_a_stop_beside_a_fold_is_not_passed_over(before, longest):
    stop = FOLD + before * abs(FOLD)
    family = follow(Hopper("cubic"), "beta", stop, 0.0, longest=longest)
    assert family.end.kind == "reached"
    assert family[-1].value == stop
    assert family[-1].alpha < FOLD_ALPHA
    assert not events(family, "fold")


@pytest.mark.parametrize("before", [1e-6, 1e-9, 1e-12])
def test_values_beside_a_fold_are_hit_twice(before):
    value = FOLD + before
    family = follow(Hopper("cubic"), "beta", -0.02, 0.0, at=[value], most=60)
    first, second = family.at(value)
    assert first.alpha < FOLD_ALPHA < second.alpha
    assert family.end.kind == "stopped"
    assert len(family) <= 60


@pytest.mark.slow
def test_a_family_does_not_depend_on_the_unit_of_its_parameter():
    plain, scaled = (
        follow(Hopper(f"r + {factor}*b*r**3", rest_length=30.0, parameters={"b": 0.0}), "b", -0.02 / factor)
        for factor in (1.0, 1e6)
    )
    assert plain.end.kind == scaled.end.kind
    assert [event.kind for event in plain.events] == [event.kind for event in scaled.events]
    for a, b in zip(plain.events, scaled.events, strict=True):
        assert 1e6 * b.point.value == pytest.approx(a.point.value, rel=1e-9)


@pytest.mark.parametrize(
    ("machine", "along", "stop", "limit"),
    [  # the tide's frequencies as 3 to 1; the barrier of r + c r^2 at -1/c; the softening cubic's family ends at 0
        (Hopper("r", "1 + a*z", rest_length=2.0, parameters={"a": 0.0}), "a", 3.0, 0.25),
        (Hopper("r + c*r**2", parameters={"c": 0.0}), "c", 1.0, 0.0),
        (Hopper("cubic", rest_length=30.0, parameters={"beta": 0.0}), "beta", -0.02, 0.0),
        (Hopper("toda", parameters={"b": 0.01}), "b", 0.9, 0.5),
    ],
)
def test_a_limit_is_as_good_as_it_says(machine, along, stop, limit):
    family = follow(machine, along, stop)
    end = family.end
    assert end.kind == "escaped"
    assert abs(end.limit - limit) <= 2 * end.limit_error
    assert end.limit_error < 2e-3
    # Rounding moves mid-flight, and no stationary point of the extension appears beside it.
    assert "family" not in [event.kind for event in family.events]


def test_what_only_scales_the_orbit_is_followed_to_the_end():
    family = follow(Hopper("k*r", parameters={"k": 1.0}), "k", 1e-3)
    assert family.end.kind == "reached"
    assert family[-1].alpha == pytest.approx(4.493409457909064 / np.sqrt(1e-3), rel=1e-12)


@pytest.mark.parametrize("beside", [1e-4, 1e-6, 1e-8, 1e-9])
def test_a_start_beside_a_fold_comes_back_on_the_other_sheet(beside):
    family = follow(Hopper("cubic", rest_length=30.0), "beta", -0.02, FOLD + beside)
    assert family[0].alpha < FOLD_ALPHA < family[-1].alpha
    assert family[-1].value == FOLD + beside
    assert [event.kind for event in family.events] == ["fold"]
    assert family.end.reason.endswith("on another sheet")


def test_a_stop_at_the_edge_of_a_law_is_reached():
    family = follow(Hopper("r + c**1.5*r**3", parameters={"c": 1.0}), "c", 0.0)
    assert family.end.kind == "reached"
    assert family[-1].alpha == pytest.approx(4.493409457909064, rel=1e-13)


@pytest.mark.slow
def test_watched_truths_poles_and_orbits_without_what_is_asked(softening):
    watch = {
        "fast": lambda orbit: orbit.alpha > 3.0,
        "pole": lambda orbit: 1.0 / (orbit.alpha - 3.5),
        "period": lambda orbit: orbit.period - 1000.0,  # none beyond the collapse
    }
    family = follow(Hopper("cubic"), "beta", 2.0, 0.0, watch=watch)
    assert [event.kind for event in family.events] == ["fast"]
    assert family.events[0].point.alpha == pytest.approx(3.0, rel=1e-11)
    beyond = follow(Hopper("cubic", rest_length=30.0), "beta", -0.02, 0.0, watch={"period": watch["period"]})
    assert [event.kind for event in beyond.events if event.kind != "period"] == ["collapse", "fold"]


def test_where_the_contact_does_not_end_its_force_says_nothing():
    """A spring that collapses at the very start: of the two that change there, contact and force, one is an event."""
    machine = Hopper("r + 0.039*r**2 + s*(0.0041*r**5 - 0.035*r**3)", parameters={"s": 0.0})
    family = follow(machine, "s", 0.1, 0.0, family=3, longest=0.05)
    assert [event.kind for event in family.events] == ["collapse", "contact pulls"]
    assert family.events[0].point.value == pytest.approx(0.0, abs=1e-15)
    assert abs(family.events[1].point.smallest_contact_force) < 1e-11


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
    assert follow(machine, along, stop, family=family)[0].alpha == pytest.approx(lowest, rel=1e-12)
    first = next(trace(machine, along, stop, family=family))
    assert first.alpha == pytest.approx(lowest, rel=1e-12)


def test_a_watched_function_may_divide_by_zero():
    orbit = find(Hopper("cubic"))
    assert watched("pole", lambda orbit: 1.0 / (orbit.alpha - orbit.alpha), orbit) is None


def test_a_first_orbit_of_another_family_is_refused(monkeypatch):
    found = solve_family(Hopper("cubic", parameters={"beta": 0.0}), 2, None)
    monkeypatch.setattr("orbits.continuation.follow.solve_family", lambda machine, family, method: found)
    with pytest.raises(NoOrbit, match="family 1 ended on an orbit of family 2"):
        follow(Hopper("cubic"), "beta", 1.0, 0.0)


def test_what_rests_on_a_chain_of_points():
    """Points on either side are used while the chain keeps its direction: a cubic through two, a line through one."""
    t = np.array([0.0, 0.1, 0.3, 0.35, 0.2])
    xs, tangents = np.stack([t**3, t], axis=1), np.stack([3 * t**2, np.ones(5)], axis=1)
    tangents[4] *= -1  # turned round
    rows, levels = np.array([[0.0, 1.0]] * 4), np.array([0.2, 0.2, 0.2, 0.1])
    points, counts = around(xs, tangents, np.array([1, 2, 4, 5]), 3, 2, rows, levels)
    assert counts.tolist() == [3, 4, 4, 1]
    assert points[:3] == pytest.approx(np.array([[0.008, 0.2]] * 3), abs=1e-15)
    assert points[3] == pytest.approx(np.array([0.008 - 0.1 * 0.12, 0.1]), abs=1e-15)


def test_points_are_certified_up_to_the_first_that_cannot_be(monkeypatch):
    """Along the curve, although those that were solved together are checked together."""
    curve, row = Curve(Hopper("cubic"), "beta", "relative", 1.0), np.array([0.0, 0.0, 1.0])
    betas = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    guesses = np.array([[1.0, find(Hopper("cubic", parameters={"beta": beta})).alpha, beta] for beta in betas])
    single = {i: correct(curve, guesses[i], row, betas[i], row) for i in (1, 3)}
    others = [0, 2, 4, 5]
    rows = np.tile(row, (4, 1))
    together = correct_all(curve, guesses[others], rows, guesses[others, 2], rows)
    points = [single[i] if i in single else together[others.index(i)] for i in range(6)]
    certified, error = curve.certify_all(points)
    assert error is None
    assert [at.point.value for at in certified] == pytest.approx(betas)
    assert [at.point.alpha for at in certified] == pytest.approx(guesses[:, 1], rel=1e-13)
    assert not any(at.certified for at in points)

    def refusing(model, cases):
        certificates, refused = certify(model, cases)
        wrong = np.flatnonzero(cases.p["beta"] > 0.35)
        return certificates, refused | {i: NoOrbit(f"not {cases.p['beta'][i]:.1f}") for i in wrong.tolist()}

    monkeypatch.setattr("orbits.periodic.certified.certify", refusing)
    certified, error = curve.certify_all(points)
    assert [at.x is point.x for at, point in zip(certified, points, strict=False)] == [True] * 3
    assert str(error) == "not 0.4"


def test_a_resumed_family_has_each_event_once(softening, tmp_path):
    """Wherever the file was cut."""
    lines = softening.save(tmp_path / "whole.jsonl").read_text().splitlines(keepends=True)
    fold = next(i for i, line in enumerate(lines) if '"fold"' in line)
    for count in (fold, fold + 1, fold + 2):
        path = tmp_path / "cut.jsonl"
        path.write_text("".join(lines[:count]))
        resumed = follow(
            Hopper("cubic", rest_length=30.0), "beta", -0.02, 0.0, resume=Family.load(path), output=path, most=12
        )
        assert [event.kind for event in resumed.events].count("fold") == 1
        assert Family.load(path) == resumed


def test_what_cannot_be_resumed_or_watched_is_said(softening):
    half = follow(Hopper("cubic"), "beta", 1.0, 0.0, most=5)
    with pytest.raises(InputError, match="number 1, by the method 'relative'"):
        follow(Hopper("cubic"), "beta", 1.0, 0.0, family=2, resume=half)
    assert follow(Hopper("cubic"), "beta", 1.0, resume=half)[-1].value == 1.0  # from where it began
    done = follow(Hopper("cubic"), "beta", 1.0, 0.0, longest=0.2)
    for question, message in (
        ({"stop": 1.0, "resume": done}, "has reached beta = 1 already"),
        ({"stop": 0.5, "resume": done}, "not between 0 and 0.5"),
        ({"stop": 1.0, "resume": "x"}, "a family of `follow`"),
        ({"stop": 1.0, "watch": {"fold": lambda orbit: 1.0}}, "a name of its own"),
        ({"stop": 1.0, "watch": [abs]}, "a mapping of names"),
        ({"stop": 1.0, "at": 0.5}, "a list of values"),
    ):
        with pytest.raises(InputError, match=message):
            follow(Hopper("cubic"), "beta", start=0.0, **question)
    with pytest.raises(InputError, match="give it another name"):
        follow(Hopper("r + alpha*r**3", parameters={"alpha": 0.1}), "alpha", 1.0)
    with pytest.raises(InputError, match="no parameter"):
        follow(Hopper("cubic"), ["beta"], 1.0)


def test_asked_values_on_a_closed_curve():
    """The start among them, which is none to come to; the others on both sheets."""
    isola = Hopper("r + (b - q**2)*r**3", rest_length=30.0, parameters={"b": FOLD + 4e-4, "q": 0.0})
    family = follow(isola, "q", (-0.1, 0.1), at=[0.0, 0.01, -0.01], most=600)
    assert family.end.kind == "closed"
    assert sorted(point.value for point in events(family, "asked")) == [-0.01, -0.01, 0.0, 0.01, 0.01]


def test_every_asked_value_is_an_event_once():
    """Those too that a step happens to end on."""
    asked = 1 + np.arange(1, 101) / 100  # the last is where the curve ends
    family = follow(Hopper("r"), "mass_ratio", 2.0, at=asked)
    assert [point.value for point in events(family, "asked")] == asked[:-1].tolist()
    assert all(family[event.after].value == event.point.value for event in family.events)


def test_a_family_resumed_at_an_asked_value():
    """Wherever it stopped: each value once, as an event and as a point."""
    asked = tuple(np.linspace(0.1, 0.9, 9))
    for most in range(2, 16):
        first = follow(Hopper("cubic"), "beta", 1.0, 0.0, at=asked, most=most)
        whole = follow(Hopper("cubic"), "beta", 1.0, 0.0, at=asked, resume=first)
        assert [point.value for point in events(whole, "asked")] == list(asked)
        assert (np.diff(whole.column("beta")) > 1e-9).all()
