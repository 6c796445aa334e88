"""Sweeps against `find`, one member after the other, and their answers as tables, statistics and figures."""

import json

import numpy as np
import pytest
from scipy.stats import norm

from orbits import InputError, NoOrbit, find, quantities
from orbits.sweeps.question import CHUNK
from orbits.sweeps.sweep import sweep
from orbits.sweeps.sweep_result import Sweep
from problems import Hopper, Juggler, hopper_in_si

LEG = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8000.0, "b": 2e6}, rest_length=0.8)
GRAVITY = Hopper("cubic", "1/(1 + z/R)**2", rest_length=15.0, parameters={"R": 200.0})
CASES = {
    "cubic": (Hopper("cubic", rest_length=9.0), {"beta": (0.0, 1.0), "mass_ratio": (0.2, 5.0, "log")}, 1),
    "family 3": (Hopper("cubic"), {"beta": (0.0, 0.2)}, 3),
    "softening": (Hopper("cubic", rest_length=20.0), {"beta": (-0.02, 0.01)}, 1),
    "linear": (Hopper(), {"mass_ratio": (0.1, 10.0, "log"), "rest_length": (3.0, 12.0)}, 2),
    "juggler": (Juggler("sinh", parameters={"b": 0.3}), {"b": (0.01, 0.6), "mass_ratio": (0.5, 2.0)}, 1),
    "varying gravity": (GRAVITY, {"R": (60.0, 400.0), "beta": (0.0, 0.5)}, 1),
    "saturating": (
        Hopper("tanh(b*r)/b + c*r", parameters={"b": 0.2, "c": 0.0}),
        {"b": (0.1, 0.8), "c": (0.0, 0.05)},
        1,
    ),
    "SI": (LEG, {"k": (2000.0, 20000.0), "b": (0.0, 4e6), "body_mass": (40.0, 90.0)}, 1),
}


@pytest.mark.parametrize("case", CASES)
def test_every_member_is_what_find_finds(case):
    machine, over, family = CASES[case]
    names = ["loss_coefficient", "smallest_separation", "contact_time/flight_time"]
    asked = names if machine.rest_length else [names[0], names[2]]
    found = sweep(machine, over, 40, sampling="sobol", family=family, quantities=asked)
    assert len(found) == 40
    for i in range(0, 40, 2):
        member = machine.with_values(**{name: float(found[name][i]) for name in over})
        if found["status"][i] == "no orbit":
            with pytest.raises(NoOrbit) as error:
                find(member, family)
            assert found["reason"][i] == str(error.value)
            assert np.isnan(found["alpha"][i])
            continue
        orbit = find(member, family)
        assert abs(found["alpha"][i] - orbit.alpha) <= found["error"][i] + orbit.error
        assert found["flight_time"][i] == pytest.approx(orbit.flight_time, rel=1e-11)
        assert found["status"][i] == ("certified" if orbit.admissible else "inadmissible")
        assert (found["reason"][i] == "") == orbit.admissible
        assert found["family"][i] == family
        assert found["loss_coefficient"][i] == pytest.approx(orbit.certificate.loss_coefficient, rel=1e-8)
        if orbit.contact_time:
            assert found[names[2]][i] == pytest.approx(orbit.contact_time / orbit.flight_time, rel=1e-11)
        if "smallest_separation" in found.columns and orbit.certificate.smallest_separation is not None:
            assert found["smallest_separation"][i] == pytest.approx(orbit.certificate.smallest_separation, rel=1e-10)


@pytest.mark.parametrize("case", ["cubic", "linear", "juggler", "varying gravity", "SI"])
def test_members_are_solved_together(case, monkeypatch):
    """None of these is left to be asked for alone."""
    machine, over, family = CASES[case]
    monkeypatch.setattr("orbits.design.designs_at_once._solve_alone", lambda *arguments: pytest.fail("asked for alone"))
    assert np.isfinite(sweep(machine, over, 40, family=family)["alpha"]).all()


def test_long_flights_are_within_their_errors():
    """A juggler of tanh(b r)/b + c r, whose extension goes to -160 and back: the launch speed, by quadrature of the
    relative motion r'' = -(1 + phi(r)) in 34 digits, was 1.7 and 2.7 times the bound off that defects alone give."""
    b, c = [0.5675387947354466, 0.5969733101781458], [0.011838218448683619, 0.014252853207290167]
    alphas = [27.243381354303207129, 25.659428773751039539]
    found = sweep(Juggler("tanh(b*r)/b + c*r", parameters={"b": 0.5, "c": 0.01}), None, {"b": b, "c": c})
    assert (np.abs(found["alpha"] - alphas) <= found["error"]).all()
    assert (found["error"] < 1e-12).all()


def test_quantities_are_those_of_quantities():
    names = ["stroke", "largest_spring_force", "centre_of_mass_rise", "landing_sensitivity", "period", "beta*stroke**2"]
    found = sweep(CASES["cubic"][0], CASES["cubic"][1], 6, quantities=names)
    for i in range(6):
        machine = CASES["cubic"][0].with_values(**{name: float(found[name][i]) for name in CASES["cubic"][1]})
        expected = quantities(machine, find(machine), names)
        for name in names:
            assert found[name][i] == pytest.approx(expected[name], rel=1e-9), name


def test_members_without_an_orbit_say_why():
    found = sweep(Hopper("cubic", rest_length=30.0), {"beta": [0.0, -0.01, -0.05]})
    assert found["status"].tolist() == ["certified", "inadmissible", "no orbit"]
    assert found["reason"][1].startswith("contact: the spring collapses")
    assert "no lossless orbit" in found["reason"][2]
    assert np.isnan(found["alpha"][2])
    assert {type(reason) for reason in found["reason"]} == {str}  # files take nothing else


def test_several_families_are_members_of_their_own():
    found = sweep(Hopper("cubic"), {"beta": [0.0, 0.1]}, family=[1, 2])
    assert found["family"].tolist() == [1, 2, 1, 2]
    assert found["beta"].tolist() == [0, 0, 0.1, 0.1]
    assert found.count == 4
    assert found.orbit(3).family == 2


def test_the_return_map_is_swept():
    from orbits import ReturnMap

    found = sweep(Hopper(), {"alpha": (4.0, 6.0)}, 50, outcome="map")
    hops = ReturnMap(Hopper())(found["alpha"])
    np.testing.assert_array_equal(found["next"], hops.next)
    assert found["status"].tolist() == hops.status.tolist()


def test_fixed_points_are_swept():
    found = sweep(Hopper(), {"mass_ratio": [0.5, 1.0]}, outcome="fixed_points", between=(4.0, 5.0))
    assert found["count"].tolist() == [1, 1]
    assert found["alpha"][1] == pytest.approx(4.493409457909064, rel=1e-12)


def test_damping_leaves_no_orbit():
    """Without damping a member is the machine's own orbit; with it the member says why there is none."""
    found = sweep(Hopper("cubic", rest_length=9.0), {"damping": [0.0, 0.1], "drag": [0.0, 0.01]})
    assert found["status"].tolist() == ["certified", *["no orbit"] * 3]
    assert found["alpha"][0] == pytest.approx(find(Hopper("cubic", rest_length=9.0)).alpha, abs=1e-14)
    assert all("damped machine loses energy" in reason for reason in found["reason"][1:])


def test_a_law_that_is_none_somewhere_fails_there():
    """Beyond c = 1 the stiffness of this spring is no number, which is no answer to whether it hops."""
    machine = Hopper("sqrt(a - c + 1)*r", parameters={"a": 0.0, "c": 0.0})
    found = sweep(machine, {"c": [0.0, 0.5, 2.0]})
    assert found["status"].tolist() == ["certified", "certified", "failed"]
    assert "stiffness" in found["reason"][2]
    assert np.isnan(found["alpha"][2])


def test_one_family_of_several():
    machine, over = Hopper("cubic"), {"beta": [0.0, 0.1], "mass_ratio": [0.5, 1.0, 2.0]}
    both, second = (sweep(machine, over, family=family) for family in ([1, 2], 2))
    one = both.of_family(2)
    for name in second.columns:
        assert one[name].tolist() == second[name].tolist()
    assert one.orbit(3).family == 2
    with pytest.raises(InputError, match="of one family"):
        both.plot("alpha")
    with pytest.raises(InputError, match="no family 3"):
        both.of_family(3)


def test_an_orbit_comes_back():
    found = sweep(LEG, {"k": [8000.0, 9000.0]})
    orbit = found.orbit(1)
    assert orbit.alpha == pytest.approx(found["alpha"][1], rel=1e-13)
    assert orbit.scales is not None
    with pytest.raises(InputError, match="no member 2"):
        found.orbit(2)


def test_a_store_is_gone_on_with_and_read(tmp_path):
    path, over = tmp_path / "study.db", {"beta": (0.0, 0.5)}
    machine, states = Hopper("cubic"), []

    def stop(state):
        states.append(state)
        if len(states) == 2:
            raise KeyboardInterrupt

    count = 2 * CHUNK + 100
    with pytest.raises(KeyboardInterrupt, match=rf"{2 * CHUNK} of {count} members are in .*study\.db"):
        sweep(machine, over, count, store=path, progress=stop)
    assert len(Sweep.load(path)) == 2 * CHUNK
    later = []
    found = sweep(machine, over, count, store=path, progress=later.append)
    assert [state.done for state in later] == [count]
    expected = sweep(machine, over, count)
    for name, column in expected.columns.items():
        np.testing.assert_array_equal(found.columns[name], column, err_msg=name)
    loaded = Sweep.load(path, machine)
    assert loaded.orbit(3).alpha == pytest.approx(found["alpha"][3], rel=1e-13)
    with pytest.raises(InputError, match="machine="):
        Sweep.load(path).orbit(3)
    with pytest.raises(InputError, match="another machine"):
        Sweep.load(path, Juggler())


def test_the_document_tells_everything_and_no_time():
    found = sweep(Hopper("cubic", rest_length=30.0), {"beta": [0.0, -0.05]}, quantities=["period"])
    document = json.loads(json.dumps(found.document()))
    assert document["parameters"] == ["beta"]
    assert document["count"] == 2
    assert document["status"] == {"certified": 1, "inadmissible": 0, "no orbit": 1, "failed": 0}
    first, second = document["members"]
    assert list(first) == ["index", "beta", "alpha", "flight_time", "error", "family", "period", "status", "reason"]
    assert first["family"] == 1
    assert second["alpha"] is None
    assert second["status"] == "no orbit"


@pytest.mark.extra("xarray", "pandas")
def test_datasets_frames_and_files(tmp_path):
    import pandas
    import xarray

    found = sweep(LEG, {"k": (5000.0, 9000.0), "body_mass": [50.0, 60.0, 70.0]}, (4, 3), sampling="grid")
    data = found.dataset
    assert data["alpha"].dims == ("k", "body_mass")
    assert data["alpha"].shape == (4, 3)
    assert data["alpha"].attrs["units"] == "m/s"
    assert data["k"].attrs["units"] == "N/m"
    assert float(data["alpha"].sel(k=9000.0, body_mass=60.0)) == found["alpha"][found.index[-2]]
    frame = found.dataframe()
    assert list(frame.columns) == list(found.columns)
    assert isinstance(frame, pandas.DataFrame)
    shares = sweep(Hopper("cubic"), {"beta": [0.1, 0.2]}, quantities=["contact_time/flight_time"])
    with xarray.open_dataset(shares.save(tmp_path / "shares.nc")) as again:
        saved = again["contact_time over flight_time"]
        np.testing.assert_array_equal(saved, shares["contact_time/flight_time"])
        assert saved.attrs["long_name"] == "contact time/flight time"
    found.save(tmp_path / "leg.nc")
    with xarray.open_dataset(tmp_path / "leg.nc") as again:
        np.testing.assert_array_equal(again["alpha"], data["alpha"])
    found.save(tmp_path / "leg.csv")
    table = pandas.read_csv(tmp_path / "leg.csv")
    np.testing.assert_allclose(table["alpha (m/s)"], found["alpha"], rtol=1e-15)
    cloud = sweep(Hopper("cubic"), {"beta": (0.0, 1.0)}, 8).dataset
    assert cloud["alpha"].dims == ("member",)
    both = sweep(Hopper("cubic"), {"beta": [0.0, 0.1], "mass_ratio": [0.5, 1.0, 2.0]}, family=[1, 2])
    assert both.dataset["alpha"].shape == (2, 3, 2)
    np.testing.assert_array_equal(both.of_family(2).dataset["alpha"], both.dataset["alpha"][:, :, 1])


def test_a_summary_and_a_table_in_words():
    found = sweep(Hopper("cubic", rest_length=30.0), {"beta": (-0.02, 0.02)}, 64)
    summary = found.summary()
    assert sum(summary[name] for name in found.statuses()) == summary["count"] == 64
    assert summary["alpha 50%"] == found.quantiles()["alpha"]["50%"] == pytest.approx(np.nanmedian(found["alpha"]))
    assert "certified" in str(found)
    assert "alpha" in str(found)


@pytest.mark.parametrize(
    "over",
    [
        {"beta": (-0.02, 0.1)},
        {"beta": (-0.02, 0.1), "mass_ratio": (0.5, 2.0)},
        {"beta": (0.0, 0.1), "mass_ratio": (0.5, 2.0), "rest_length": (6.0, 9.0)},
    ],
)
@pytest.mark.parametrize("sampling", ["grid", "sobol"])
def test_figures(over, sampling, tmp_path):
    from orbits.show.plot import save_figure

    found = sweep(Hopper("cubic", rest_length=8.0), over, 5 if sampling == "grid" else 30, sampling=sampling)
    axes = found.plot("flight_time")
    save_figure(np.ravel(axes)[0], tmp_path / "sweep.png")
    assert (tmp_path / "sweep.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("arguments", "options", "said"),
    [
        (({"beta": (0, 1)}, 5), {"family": 0}, "family = 0"),
        (({"beta": (0, 1)}, 5), {"family": [1, 1]}, "different"),
        (({"beta": (0, 1)}, 5), {"quantities": "period"}, "are a list"),
        (({"beta": (0, 1)}, 5), {"quantities": ["perod"]}, "unknown quantity 'perod'"),
        (({"beta": (0, 1)}, 5), {"quantities": ["alpha"]}, "column of every answer"),
        (({"beta": (0, 1)}, 5), {"outcome": "hop"}, "outcome = 'hop'"),
        (({"beta": (0, 1)}, 5), {"outcome": "map"}, "a launch speed"),
        (({"beta": (0, 1)}, 5), {"outcome": "fixed_points"}, "between"),
        (({"beta": (0, 1)}, 5), {"between": (4, 5)}, "between"),
        (({"mass_ratio": (-1.0, 1.0)}, 5), {}, "mass_ratio"),
        (({"mass_ratio": norm(1.0, 1.0)}, 50), {}, "member .* mass_ratio"),
    ],
)
def test_what_cannot_be_asked_is_refused_at_once(arguments, options, said):
    with pytest.raises(InputError, match=said):
        sweep(Hopper("cubic"), *arguments, **options)
