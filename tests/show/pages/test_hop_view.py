"""The figures of a hop on a page, against closed forms and balances, and how they change."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import trapezoid

from orbits import InputError, Orbit, find
from problems import Hopper, Juggler, hopper_in_si, knee_hopper, rimless_wheel, shuttle

pytest.importorskip("bokeh")

from orbits.show import HopFigures, hop_data

pytestmark = pytest.mark.extra("bokeh")

G = 9.80665


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


def test_the_contact_force_is_the_weight_and_the_springs_pressure(cubic_hop):
    data = hop_data(cubic_hop)
    r = data.height[0] - 8 - data.height[1]
    standing = data.time > data.flight_time
    assert data.force[standing] == pytest.approx((1 - (r + 0.3 * r**3))[standing], abs=1e-9)
    assert data.force[[0, -1]] == pytest.approx(0, abs=1e-9)
    words = {"height": "height", "drawn": "height", "speed": "speed", "force": "contact force"}
    assert data.labels == {"time": "time", **words}


@pytest.mark.parametrize(
    ("machine", "weight"),
    [
        (hopper_in_si(70, 5, stiffness=20_000, rest_length=1.0), 75 * G),
        (knee_hopper(body_mass=60.0, foot_mass=3.0, surface_gravity=9.81), 63 * 9.81),
        (Hopper("tanh", mass_ratio=0.5, rest_length=20), 3.0),
    ],
    ids=["SI", "knee", "tanh"],
)
@pytest.mark.slow
def test_over_a_cycle_the_contact_carries_the_weight(machine, weight):
    """The momentum after a cycle is that before, whatever the spring."""
    orbit = find(machine)
    t = np.linspace(orbit.flight_time, orbit.period, 20_001)
    assert trapezoid(orbit.contact_force(t), t) / orbit.period == pytest.approx(weight, rel=1e-6)
    assert hop_data(orbit).force.max() == pytest.approx(orbit.certificate.largest_contact_force, rel=1e-3)
    assert orbit.contact_force(t + 3 * orbit.period) == pytest.approx(orbit.contact_force(t), rel=1e-6, abs=1e-6)


@pytest.mark.slow
def test_a_machine_that_turns_is_shown_by_its_angles():
    orbit = find(rimless_wheel(2.0, 0.4, 8, 0.5, 0.5, 20.0))
    data = hop_data(orbit)
    assert data.names == ("theta", "phi")
    angles = ["time (s)", "angle (rad)", "height (m)", "rate (rad/s)", "contact force (N m)"]
    assert list(data.labels.values()) == angles
    step, first = np.pi / 4, orbit.liftoff_extension
    assert data.height[:, [0, -1]] == pytest.approx(np.array([[0, step], [first, step + first]]), abs=1e-9)
    stands = data.time > orbit.flight_time
    assert data.landed[stands][:-1] == pytest.approx(data.force[stands][-2::-1], abs=1e-9)  # mirrored in time
    assert data.landed.max() == pytest.approx(orbit.certificate.largest_contact_force, rel=1e-9)
    hopping, swinging = hop_data(find(Hopper())), hop_data(find(shuttle()))
    assert hopping.landed is swinging.landed is None
    assert (hopping.turns, swinging.turns, swinging.plane) == (False, True, None)


def test_a_hop_in_si_has_units(leg_hop):
    data = hop_data(leg_hop)
    assert list(data.labels.values()) == ["time (s)", *["height (m)"] * 2, "speed (m/s)", "contact force (N)"]
    assert data.end == pytest.approx(leg_hop.period)
    assert data.height[0, 0] == pytest.approx(1.0 + leg_hop.liftoff_extension)


@pytest.mark.parametrize("name", ["cubic_hop", "leg_hop"], ids=["cubic", "in_si"])
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


@pytest.mark.slow
def test_what_no_rest_length_says_is_no_height(cubic_hop):
    hand = hop_data(find(Juggler()))
    assert hand.floating
    assert hand.labels["height"] == "displacement"
    assert (hand.drawn[0] >= hand.drawn[1] - 1e-9).all()
    assert hand.springs == ((-1, 1),)
    assert not hop_data(cubic_hop).floating
    knee = hop_data(find(knee_hopper(link=0.45)))
    assert knee.knees == ((1, 0, 0.45),)
    assert not knee.floating


def test_a_force_that_is_not_known_is_told_in_words(cubic_hop):
    collapsing = hop_data(find(Hopper("r - 0.008*r**3", rest_length=30)))
    assert (collapsing.force, collapsing.why) == (None, "the contact never ends")
    assert collapsing.end == collapsing.flight_time
    foreign = replace(cubic_hop, contact=replace(cubic_hop.contact, names=("y1", "y1'", "heat")))
    with pytest.raises(InputError, match="has no contact force of this name; it has y1, y1', heat"):
        foreign.contact_force(0.0)
    assert hop_data(foreign).force is None
    figures = HopFigures()
    figures.show(hop_data(foreign))
    assert "has no contact force of this name" in figures.force.title.text


def changes_told(figures, document, data) -> int:
    """How many changes a document tells of when other data are shown."""
    told = []
    document.on_change(told.append)
    figures.show(data)
    document.remove_on_change(told.append)
    return len(told)


def test_another_hop_is_shown_by_few_changes_and_in_the_same_axes(cubic_hop):
    from bokeh.document import Document

    figures, document, first = HopFigures(), Document(), hop_data(cubic_hop)
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


@pytest.mark.slow
def test_figures_take_a_machine_of_other_masses(cubic_hop):
    figures = HopFigures()
    figures.show(hop_data(cubic_hop))
    figures.show(hop_data(find(knee_hopper())))
    assert figures.portrait.renderers[0].data_source.data["name"] == ["body", "foot"]
    assert figures.machine.yaxis[0].axis_label == "height (m)"
    figures.show(hop_data(find(Juggler())))
    assert not figures.machine.yaxis[0].visible
