"""The orbit as its user holds it: states at any time, tables, plots, units."""

import dataclasses
import json

import numpy as np
import pytest
from conftest import REFERENCES, machine_of
from steps import stepping

from orbits import InputError, Orbit, OrbitsError, find, orbit_at
from orbits.io import to_json
from orbits.show import save_figure
from problems import Hopper, Juggler, hopper_in_si, juggler_in_si


@pytest.fixture(scope="module")
def orbit():
    return find(machine_of(REFERENCES[4]))


def test_states_are_vectorised(orbit):
    t = np.linspace(0, 2 * orbit.period, 24).reshape(2, 3, 4)
    states = orbit(t)
    assert states.shape == (2, 3, 4, 4)
    assert states[1, 2, 3] == pytest.approx(orbit(t[1, 2, 3]), abs=1e-14)
    with pytest.raises(InputError, match="finite"):
        orbit(np.nan)


def test_time_runs_backwards_too(orbit):
    t = np.linspace(0.1, orbit.flight_time - 0.1, 30)
    assert orbit(orbit.flight_time - t) * [1, -1, 1, -1] == pytest.approx(orbit(t), abs=1e-12)
    assert orbit(-0.3) == pytest.approx(orbit(orbit.period - 0.3), abs=1e-12)


@pytest.mark.parametrize("of", ["__call__", "table", "contact_force", "unrolled"])
def test_times_are_finite_numbers(orbit, of):
    for t in ("log(r)", [0.0, np.nan], 10**400):
        with pytest.raises(InputError, match="times must be finite numbers"):
            getattr(orbit, of)(t)


class TestPlots:
    @pytest.mark.parametrize("kind", [Hopper, Juggler])
    def test_figure_3(self, kind, tmp_path):
        orbit = find(kind())
        axes = orbit.plot()
        names = {line.get_label() for line in axes.lines}
        assert names >= ({"body", "foot", "centre of mass"} if kind is Hopper else {"ball", "hand"})
        body = axes.lines[0]
        assert body.get_ydata()[0] == pytest.approx(orbit(0.0)[0])
        assert body.get_xdata()[-1] == pytest.approx(orbit.period)
        assert save_figure(axes, tmp_path / "hop.png").stat().st_size > 10_000

    def test_an_orbit_without_contact_is_drawn_to_its_landing(self):
        collapsing = find(machine_of(next(r for r in REFERENCES if not r["admissible"])), 2)
        assert collapsing.plot().lines[0].get_xdata()[-1] == pytest.approx(collapsing.flight_time)

    @pytest.mark.slow
    def test_animation(self, orbit, tmp_path):
        from PIL import Image

        for index, hop in enumerate((orbit, find(Hopper()), find(Juggler()))):
            with Image.open(hop.animate(tmp_path / f"hop{index}.gif", frames=6)) as image:
                assert image.n_frames == 6
        with pytest.raises(InputError, match=r"must end in \.gif"):
            orbit.animate(tmp_path / "hop.avi")


class TestUnits:
    def test_equation_13(self):
        """Launch speed alpha g sqrt(M (m1 + m2)/k) of the linear hopper."""
        m1, m2, k, g = 2.5, 0.4, 150.0, 9.81
        orbit = find(hopper_in_si(m1, m2, stiffness=k, surface_gravity=g))
        expected = 4.493409457909064 * g * np.sqrt(m2 / m1 * (m1 + m2) / k)
        assert orbit.si()["alpha_m_per_s"] == pytest.approx(expected, rel=1e-14)

    def test_flight_is_ballistic(self):
        """Under constant gravity the centre of mass flies for 2 v/g and rises by v**2/(2 g)."""
        m1, m2, g = 2.5, 0.4, 3.7
        orbit = find(hopper_in_si(m1, m2, force="150*r + 800*r**3", surface_gravity=g, rest_length=0.9))
        si = orbit.si()
        v = m1 * si["alpha_m_per_s"] / (m1 + m2)
        assert si["flight_time_s"] == pytest.approx(2 * v / g, rel=1e-13)
        assert si["centre_of_mass_rise_m"] == pytest.approx(v**2 / (2 * g), rel=1e-12)

    def test_rises_are_to_the_highest_point(self):
        orbit = find(juggler_in_si(0.2, 0.3, stiffness=300.0), 2)
        t = np.linspace(0, orbit.period, 100001)
        for i, name in ((0, "ball"), (2, "hand")):
            path = orbit(t)[:, i]
            assert orbit.si()[f"{name}_rise_m"] == pytest.approx(path.max() - path[0], rel=1e-7)

    def test_juggler(self):
        orbit = find(juggler_in_si(0.2923, 0.2657, stiffness=8.8, surface_gravity=9.81 * np.sin(np.arctan(1.1 / 60))))
        assert orbit.scales.length == pytest.approx(5.431e-3, rel=1e-3)  # as the paper has it

    @pytest.mark.parametrize(
        ("statement", "message"),
        [
            ({}, "needs its stiffness"),
            ({"stiffness": -1.0}, "stiffness = -1"),
            ({"stiffness": 1.0, "body_radius": 1.0, "gravity": "1"}, "not both"),
            ({"stiffness": 1.0, "parameters": {"q": 1.0}}, "has a parameter 'q'"),
            ({"force": "r**3"}, "slope 0 at rest"),
            ({"force": "3*r + r**3", "stiffness": 5.0}, "stiffness 3 N/m at rest, not 5"),
            ({"stiffness": 1.0, "surface_gravity": 0.0}, "surface_gravity = 0"),
            ({"stiffness": 1.0, "rest_length": 0.0}, "rest_length = 0"),
        ],
    )
    def test_refusals(self, statement, message):
        with pytest.raises(InputError, match=message):
            hopper_in_si(1.0, 1.0, **statement)

    def test_dimensionless_machines_have_none(self, orbit):
        with pytest.raises(InputError, match="stated in dimensionless units"):
            orbit.si()


def test_what_an_orbit_holds_cannot_be_overwritten(orbit):
    with pytest.raises(ValueError, match="read-only"):
        orbit.flight.coefficients[:] = 0
    with pytest.raises(InputError, match="finite numbers"):
        orbit("a")


def test_orbits_are_equal_where_all_that_they_say_is(orbit, tmp_path):
    same, other = find(orbit.source), find(orbit.source, 2)
    assert same == orbit == Orbit.load(orbit.save(tmp_path / "orbit.json"))
    assert hash(same) == hash(orbit)
    assert orbit not in (other, dataclasses.replace(orbit, alpha=np.nextafter(orbit.alpha, 9)), "orbit")
    leg = hopper_in_si(60.0, 3.0, stiffness=8000.0)
    assert find(leg) == find(leg) != find(leg.with_values(body_mass=61.0))


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Hopper("-r"),
        lambda: Hopper("-tanh(r) - 0.1*r**3"),
        lambda: hopper_in_si(60.0, 3.0, force="-8000*r - 2e6*r**3", rest_length=0.8),
    ],
)
def test_a_force_with_the_sign_of_pressure(wrong):
    with pytest.raises(OrbitsError, match="is tension positive"):
        find(wrong())


@pytest.mark.parametrize(
    ("machine", "spring"),
    [
        (Hopper(), lambda r: r),
        (Hopper("r + 0.3*r**3", mass_ratio=0.5, rest_length=8.0), lambda r: r + 0.3 * r**3),
        (Hopper("bilinear"), lambda r: np.where(r < 0.5, r, 3 * r - 1)),
    ],
)
def test_the_contact_force_is_what_the_spring_and_the_foot_leave(machine, spring):
    """The foot's weight less the spring's pull in contact, 0 in flight; over several cycles, forward and backward."""
    orbit = find(machine)
    t = np.concatenate([np.linspace(-2.3, 3.1, 203) * orbit.period, orbit.flight_time + np.array([1e-9, -1e-9])])
    force, extension = orbit.contact_force(t), orbit(t)[:, 0] - orbit(t)[:, 2]
    standing = np.mod(t, orbit.period) > orbit.flight_time
    assert 50 < standing.sum() < 153
    assert force == pytest.approx(np.where(standing, 1 - spring(extension), 0.0), abs=1e-9)
    assert force.max() <= orbit.certificate.largest_contact_force * (1 + 1e-9)
    assert orbit.contact_force(orbit.flight_time + 0.5 * orbit.contact_time) == pytest.approx(
        orbit.certificate.largest_contact_force, rel=1e-9
    )
    table = orbit.table()
    assert (table["time"][0], table["time"][-1]) == (0.0, orbit.period)
    assert (table["phase"][0], table["phase"][-2]) == ("flight", "contact")
    assert ((table["phase"] == "contact") == (np.mod(table["time"], orbit.period) > orbit.flight_time)).all()
    assert table["contact force"] == pytest.approx(orbit.contact_force(table["time"]))
    assert table["y1"] == pytest.approx(orbit(table["time"])[:, 0])
    own = orbit.table([0.5, 1.5 * orbit.period])
    assert own["time"].tolist() == [0.5, 1.5 * orbit.period]


def test_an_orbit_whose_contact_does_not_end_has_no_force(softening_family):
    """Beyond the collapse of the family its table ends with the landing."""
    orbit = orbit_at(Hopper("cubic", rest_length=30.0), softening_family[-1], "beta")
    assert orbit.contact_time is None
    times = [0.0, 0.5 * orbit.flight_time, orbit.flight_time]
    assert orbit.contact_force(times).tolist() == [0.0] * 3
    table = orbit.table()
    assert table["time"][-1] == orbit.flight_time
    assert set(table["phase"]) == {"flight"}
    with pytest.raises(InputError, match="the contact never ends: times lie between 0 and"):
        orbit.contact_force(1.1 * orbit.flight_time)


class TestSteps:
    """Machines that step, against motions integrated by DOP853."""

    @staticmethod
    def integrated(phase, start, time, p):
        from scipy.integrate import solve_ivp

        rates = lambda t, x: [float(each) for each in phase.field(list(x), p, [])]  # noqa: E731
        return solve_ivp(rates, (0.0, time), start, "DOP853", rtol=1e-13, atol=1e-14, dense_output=True).sol

    @pytest.mark.slow
    @pytest.mark.parametrize("kind", ["wheel", "rocker", "shuttle"])
    def test_a_whole_step_is_the_motion_and_its_relabelled_image(self, kind, tmp_path):
        machine = stepping(kind, 1.0, 0.5, 0.3, "r + r**3")
        orbit, p, model = find(machine), machine.values, machine.model
        flown, t = self.integrated(model.flight, orbit(0.0), orbit.flight_time, p), np.linspace(0, 1, 41)
        assert orbit(t * orbit.flight_time) == pytest.approx(flown(t * orbit.flight_time).T, abs=1e-11)
        landed = model.relabelling(flown(orbit.flight_time), p)
        stood = self.integrated(model.contact, landed[:2], orbit.contact_time, p)
        assert landed[2:] == pytest.approx([0.0, 0.0], abs=1e-11)
        s = np.linspace(1e-9, 1 - 1e-9, 41) * orbit.contact_time
        assert orbit(orbit.flight_time + s) == pytest.approx(stood(s).T @ model.embed.T, abs=1e-11)
        assert stood(orbit.contact_time) == pytest.approx(orbit(0.0)[:2], abs=1e-11)
        for name, landing in (("contact force", False), ("contact force of the landed point", True)):
            if name in model.contact.watch:
                force = [float(model.contact.watch[name](list(x), p, [])) for x in stood(s).T]
                assert orbit.contact_force(orbit.flight_time + s, landed=landing) == pytest.approx(force, abs=1e-11)
        path = orbit.save(tmp_path / "step.json")
        again = Orbit.load(path)
        assert again == orbit
        times = np.linspace(0.0, 3.3 * orbit.period, 300)
        assert (again.unrolled(times) == orbit.unrolled(times)).all()
        assert json.loads(path.read_text())["friction_needed"] is None

    @pytest.mark.parametrize("kind", ["wheel", "rocker", "shuttle"])
    def test_unrolled_states_go_on_from_step_to_step(self, kind):
        orbit = find(stepping(kind, 1.0, 0.5, 0.3))
        landings = (np.arange(4)[:, None] * orbit.period + [orbit.flight_time, orbit.period]).ravel()
        before, after = orbit.unrolled(landings - 1e-9), orbit.unrolled(landings + 1e-9)
        assert after == pytest.approx(before, abs=1e-8)
        theta = orbit.unrolled(np.arange(1, 5) * orbit.period)[:, 2]
        assert theta == pytest.approx(
            {"wheel": [0.6, 1.2, 1.8, 2.4], "rocker": [0.0] * 4, "shuttle": [0.6, 0.0] * 2}[kind]
        )
        assert orbit.rises["theta"] >= 0.3
        plain = find(Hopper())
        assert (plain.unrolled([0.3, 20.0]) == plain([0.3, 20.0])).all()

    def test_a_file_with_another_number_of_shifts_is_refused(self, tmp_path):
        document = find(stepping("rocker", 1.0, 0.5)).saved()
        document["motion"]["shape"]["steps"] = ((1.0, 1.0), (0.0, 0.0))
        with pytest.raises(ValueError, match="its shape does not fit its motion"):
            Orbit.of_saved(json.loads(to_json(document)))
