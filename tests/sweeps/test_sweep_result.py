"""The result of a sweep: families, orbits, documents, tables and files."""

import json

import numpy as np
import pytest

from orbits import InputError, sweep
from problems import Hopper
from tests.sweeps.swept import LEG


def test_one_family_of_several():
    machine, over = Hopper("cubic"), {"beta": [0.0, 0.1], "mass_ratio": [0.5, 1.0, 2.0]}
    both, second = (sweep(machine, over, family=family) for family in ([1, 2], 2))
    one = both.of_family(2)
    for name in second.columns:
        assert one[name].tolist() == second[name].tolist()
    assert one.orbit(3).family == 2
    with pytest.raises(InputError, match="shows one family"):
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
