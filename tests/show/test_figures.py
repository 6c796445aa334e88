"""What the figures of hops, families, laws and sweeps show, against closed forms and balances, and how they change."""

import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import trapezoid

from orbits import InputError, Orbit, find, follow, sweep
from problems import Hopper, Juggler, hopper_in_si, knee_hopper

pytest.importorskip("bokeh")

from orbits.show.pages.family_view import FamilyFigure, family_data
from orbits.show.pages.hop_view import HopFigures, hop_data
from orbits.show.pages.law_view import LawFigure, law_data
from orbits.show.pages.sweep_view import MOST_SHOWN, sweep_figures

pytestmark = pytest.mark.extra("bokeh")

G = 9.80665


@pytest.fixture(scope="module")
def cubic() -> Orbit:
    return find(Hopper("r + beta*r**3", rest_length=8, parameters={"beta": 0.3}))


@pytest.fixture(scope="module")
def in_si() -> Orbit:
    return find(hopper_in_si(70, 5, stiffness=20_000, rest_length=1.0))


@pytest.fixture(scope="module")
def folded():
    return follow(Hopper("cubic", rest_length=30), "beta", stop=-0.02, start=0.0)


@pytest.mark.parametrize("ratio", [0.4, 1.0])
def test_a_linear_hop_is_that_of_the_closed_form(ratio):
    """Centre of mass on a parabola, extension cos t + alpha sin t; in contact M y'' (1 + M) = -M (M y + 1)."""
    orbit = find(Hopper("r", mass_ratio=ratio))
    data, alpha = hop_data(orbit), orbit.alpha
    assert data.names == ("body", "foot")
    flying = data.time <= data.flight_time
    t = data.time[flying]
    r, rate = np.cos(t) + alpha * np.sin(t), alpha * np.cos(t) - np.sin(t)
    centre, speed = (1 + alpha * t - t**2 / 2) / (1 + ratio), (alpha - t) / (1 + ratio)
    body, foot = centre + ratio / (1 + ratio) * r, centre - r / (1 + ratio)
    assert data.height[:, flying] == pytest.approx(np.array([body, foot]), abs=1e-9)
    speeds = np.array([speed + ratio / (1 + ratio) * rate, speed - rate / (1 + ratio)])
    assert data.speed[:, flying] == pytest.approx(speeds, abs=1e-6)
    assert data.centre[flying] == pytest.approx(centre, abs=1e-9)
    since, omega = data.time[~flying] - data.flight_time, np.sqrt(ratio / (1 + ratio))
    standing = -1 / ratio + (1 + 1 / ratio) * np.cos(omega * since) - alpha / omega * np.sin(omega * since)
    assert data.height[0, ~flying] == pytest.approx(standing, abs=1e-8)
    assert data.height[1, ~flying] == pytest.approx(0, abs=1e-12)
    assert data.force[~flying] == pytest.approx(1 - standing, abs=1e-8)
    assert data.force[flying].tolist() == [0.0] * flying.sum()


def test_the_contact_force_is_the_weight_and_the_springs_pressure(cubic):
    data = hop_data(cubic)
    r = data.height[0] - 8 - data.height[1]
    standing = data.time > data.flight_time
    assert data.force[standing] == pytest.approx((1 - (r + 0.3 * r**3))[standing], abs=1e-9)
    assert data.force[[0, -1]] == pytest.approx(0, abs=1e-9)
    assert data.labels == {"time": "time", "height": "height", "speed": "speed", "force": "contact force"}


@pytest.mark.parametrize(
    ("machine", "weight"),
    [
        (hopper_in_si(70, 5, stiffness=20_000, rest_length=1.0), 75 * G),
        (knee_hopper(body_mass=60.0, foot_mass=3.0, surface_gravity=9.81), 63 * 9.81),
        (Hopper("tanh", mass_ratio=0.5, rest_length=20), 3.0),
    ],
    ids=["SI", "knee", "tanh"],
)
def test_over_a_cycle_the_contact_carries_the_weight(machine, weight):
    """The momentum after a cycle is that before, whatever the spring."""
    orbit = find(machine)
    t = np.linspace(orbit.flight_time, orbit.period, 20_001)
    assert trapezoid(orbit.contact_force(t), t) / orbit.period == pytest.approx(weight, rel=1e-6)
    assert hop_data(orbit).force.max() == pytest.approx(orbit.certificate.largest_contact_force, rel=1e-3)
    assert orbit.contact_force(t + 3 * orbit.period) == pytest.approx(orbit.contact_force(t), rel=1e-6, abs=1e-6)


def test_a_hop_in_si_has_units(in_si):
    data = hop_data(in_si)
    assert list(data.labels.values()) == ["time (s)", "height (m)", "speed (m/s)", "contact force (N)"]
    assert data.end == pytest.approx(in_si.period)
    assert data.height[0, 0] == pytest.approx(1.0 + in_si.liftoff_extension)


@pytest.mark.parametrize("name", ["cubic", "in_si"])
def test_an_orbit_from_a_file_or_another_process_shows_the_same(name, request, tmp_path):
    orbit = request.getfixturevalue(name)
    whole = hop_data(orbit)
    for other in (Orbit.load(orbit.save(tmp_path / "hop.json")), pickle.loads(pickle.dumps(orbit))):
        found = pickle.loads(pickle.dumps(hop_data(other)))
        for key, value in vars(whole).items():
            if isinstance(value, np.ndarray):
                assert getattr(found, key).tolist() == value.tolist(), key
            else:
                assert getattr(found, key) == value, key


def test_what_no_rest_length_says_is_no_height(cubic):
    hand = hop_data(find(Juggler()))
    assert hand.floating
    assert hand.labels["height"] == "displacement"
    assert (hand.drawn[0] >= hand.drawn[1] - 1e-9).all()
    assert hand.springs == ((-1, 1),)
    assert not hop_data(cubic).floating
    knee = hop_data(find(knee_hopper(link=0.45)))
    assert knee.knees == ((1, 0, 0.45),)
    assert not knee.floating


def test_a_force_that_is_not_known_is_told_in_words(cubic):
    collapsing = hop_data(find(Hopper("r - 0.008*r**3", rest_length=30)))
    assert (collapsing.force, collapsing.why) == (None, "the contact never ends")
    assert collapsing.end == collapsing.flight_time
    foreign = replace(cubic, contact=replace(cubic.contact, names=("y1", "y1'", "heat")))
    with pytest.raises(InputError, match="does not tell its contact force, but y1, y1', heat"):
        foreign.contact_force(0.0)
    assert hop_data(foreign).force is None
    figures = HopFigures()
    figures.show(hop_data(foreign))
    assert "does not tell" in figures.force.title.text


def changes_told(figures, document, data) -> int:
    """How many changes a document tells of when other data are shown."""
    told = []
    document.on_change(told.append)
    figures.show(data)
    document.remove_on_change(told.append)
    return len(told)


def test_another_hop_is_shown_by_few_changes_and_in_the_same_axes(cubic):
    from bokeh.document import Document

    figures, document, first = HopFigures(), Document(), hop_data(cubic)
    figures.show(first)
    for root in (figures.player, figures.machine, figures.heights, figures.portrait, figures.force):
        document.add_root(root)
    near = hop_data(find(Hopper("r + 0.297*r**3", rest_length=8)))
    bounds = figures.heights.y_range.start, figures.heights.y_range.end
    assert changes_told(figures, document, near) <= 8
    assert (figures.heights.y_range.start, figures.heights.y_range.end) == bounds
    assert changes_told(figures, document, near) == 0
    other = hop_data(find(Hopper("r", rest_length=80)))
    figures.show(other)
    assert figures.heights.y_range.end > 80 > bounds[1]
    assert figures.machine.y_range.reset_end == figures.machine.y_range.end > 80
    assert document.callbacks.hold_value is None


def test_figures_take_a_machine_of_other_masses(cubic):
    figures = HopFigures()
    figures.show(hop_data(cubic))
    figures.show(hop_data(find(knee_hopper())))
    assert figures.portrait.renderers[0].data_source.data["name"] == ["body", "foot"]
    assert figures.machine.yaxis[0].axis_label == "height (m)"
    figures.show(hop_data(find(Juggler())))
    assert not figures.machine.yaxis[0].visible


def test_a_family_has_its_motions_events_and_end(folded):
    data = family_data(folded)
    known = dict(zip(data.events["kind"], data.events["value"].tolist(), strict=True))
    assert known["fold"] == pytest.approx(-0.0106952149164040, rel=1e-9)  # the reference value
    assert [kind for kind in known if kind.startswith("end")] == ["end: escaped"]
    assert "end: escaped" in data.points["told"][-1]
    assert "tends to" in data.points["told"][-1]
    # Motions end where the contact collapses; there both lines meet.
    collapse = data.value.tolist().index(known["collapse"])
    assert np.isfinite(data.motions[: collapse + 1]).all()
    assert np.isnan(data.motions[collapse + 1 :]).all()
    assert np.isfinite(data.others[collapse:]).all()
    assert data.points["quantity"].tolist() == [point.alpha for point, _ in folded.in_order()]
    assert family_data(folded, "flight_time").labels == ("beta", "flight time")
    with pytest.raises(InputError, match="no quantity 'weight'"):
        family_data(folded, "weight")
    assert pickle.loads(pickle.dumps(data)).labels == data.labels


def test_a_familys_figure_marks_the_hop_that_is_shown(folded):
    figure = FamilyFigure()
    figure.show(family_data(folded))
    figure.mark(0.0, folded[0].alpha)
    ring = figure.figure.renderers[-1].data_source
    assert ring.data == {"value": [0.0], "quantity": [folded[0].alpha]}
    figure.show(family_data(folded, "flight_time"))
    assert ring.data == {"value": [], "quantity": []}
    assert figure.figure.yaxis[0].axis_label == "flight time"


def test_a_law_is_shown_where_the_hop_uses_it(cubic, in_si):
    data = law_data(cubic.source, cubic)
    assert data.force == pytest.approx(data.extension + 0.3 * data.extension**3)
    assert data.liftoff == pytest.approx((cubic.liftoff_extension, 1.0))
    heights = hop_data(cubic).height
    used = heights[0] - 8 - heights[1]
    assert data.used == pytest.approx((used.min(), used.max()), rel=1e-3)
    stiff = law_data(in_si.source, in_si)
    assert stiff.force == pytest.approx(20_000 * stiff.extension, abs=1e-9)
    assert stiff.liftoff[1] == pytest.approx(5 * G)
    assert stiff.labels == ("extension (m)", "force (N)")
    LawFigure().show(stiff)


def test_a_law_in_pieces_ends_where_it_is_stated(tmp_path):
    points = np.linspace(-9, 9, 61)
    table = "\n".join(["r,force", *(f"{r},{np.sinh(r / 3) * 3}" for r in points)])
    (tmp_path / "spring.csv").write_text(table)
    orbit = find(Hopper(f"table:{tmp_path / 'spring.csv'}", rest_length=30))
    data = law_data(orbit.source, orbit)
    low, high = data.used
    assert low - 0.35 * (high - low) < -9 <= data.extension[0] == pytest.approx(-9, rel=0.02)
    assert data.force == pytest.approx(3 * np.sinh(data.extension / 3), rel=1e-3, abs=1e-3)


def test_a_knees_spring_has_a_torque():
    orbit = find(knee_hopper(stiffness=600.0, rest_angle=2.6))
    data = law_data(orbit.source, orbit)
    assert data.labels == ("extension (rad)", "torque (N m)")
    assert data.force == pytest.approx(600 * (data.extension - 2.6), abs=1e-6)


def test_members_of_a_sweep_are_shown():
    swept = sweep(Hopper("cubic", rest_length=30), {"beta": [-0.05, -0.008, 0.0, 0.1]}, family=[1, 2])
    (figure,), told = sweep_figures(swept)
    (marks,) = figure.renderers
    data = marks.data_source.data
    known = np.isfinite(swept["alpha"])
    assert np.asarray(data["quantity"]).tolist() == swept["alpha"][known].tolist()
    assert np.asarray(data["p0"]).tolist() == swept["beta"][known].tolist()
    assert set(data["family"]) == {"family 1", "family 2"}
    assert told == f"{known.sum()} of 8 members have alpha."
    with pytest.raises(InputError, match="'status' is no answer in numbers"):
        sweep_figures(swept, "status")
    plane = sweep(Hopper("cubic"), {"beta": [-0.05, 0.1], "mass_ratio": [0.5, 1.0]}, quantities=["stroke"])
    ((figure,), _) = sweep_figures(plane, "stroke")
    crosses, marks = figure.renderers
    assert len(crosses.data_source.data["p0"]) == 2
    assert len(marks.data_source.data["p0"]) == 2
    assert sweep_figures(sweep(Hopper("cubic", rest_length=30), {"beta": [-0.5]})) == ([], "0 of 1 members have alpha.")
    both = sweep(Hopper("cubic"), {"beta": [0.0, 0.1], "mass_ratio": [0.5, 1.0]}, family=[1, 2])
    with pytest.raises(InputError, match="of one family"):
        sweep_figures(both)
    assert len(sweep_figures(both.of_family(2))[0]) == 1


def test_of_a_large_sweep_some_members_are_shown():
    swept = sweep(Hopper("cubic", rest_length=30), {"beta": [0.0, 0.1]})
    count = 2 * MOST_SHOWN + 2
    columns = {name: np.resize(column, count) for name, column in swept.columns.items()}
    (figure,), told = sweep_figures(replace(swept, index=np.arange(count), columns=columns))
    assert told.startswith("One of 3 members is shown: ")
    assert len(figure.renderers[0].data_source.data["p0"]) <= MOST_SHOWN


def test_the_engine_starts_without_bokeh():
    modules = "sys, orbits, problems, orbits.show.pages.hop_view, orbits.show.pages.still"
    code = f"import {modules}; print('bokeh' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"
