"""A family as a data frame: every quantity, of the points and the events, against the orbits themselves."""

import sys

import numpy as np
import pytest

from orbits import Family, InputError, follow, orbit_at, quantities
from problems import Hopper, hopper_in_si

pytest.importorskip("pandas")

pytestmark = pytest.mark.extra("pandas")

GRAVITY = 9.80665


@pytest.fixture(scope="module")
def leg():
    return hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8000.0, "b": 2e6}, rest_length=0.8)


@pytest.fixture(scope="module")
def stiffening(leg):
    return follow(leg, "b", 4e6, at=[3e6])


@pytest.fixture(scope="module")
def softening():
    return follow(Hopper("cubic", rest_length=30), "beta", stop=-0.02, start=0.0, at=[-0.005], most=120)


def test_it_has_the_quantities_of_the_orbits(leg, stiffening):
    """The others by `orbits.quantities`, which solves for the extremes of each orbit; the rise of the centre of mass
    also by its closed form, that of a throw."""
    frame = stiffening.dataframe()
    assert len(frame) == len(stiffening)
    for i in (0, len(frame) // 2, len(frame) - 1):
        row, machine = frame.iloc[i], leg.with_values(b=frame["b"][i])
        orbit = orbit_at(leg, stiffening[i], "b")
        for name, value in quantities(machine, orbit).items():
            if name not in ("largest_spring_force", "landing_sensitivity"):
                assert row[name] == pytest.approx(value, rel=1e-11), name
        assert row["admissible"]
        assert row["error"] == stiffening[i].error
    thrown = (60.0 * frame["alpha"] / 63.0) ** 2 / (2 * GRAVITY)
    assert frame["centre_of_mass_rise"].to_numpy() == pytest.approx(thrown.to_numpy(), rel=1e-12)
    assert frame["stroke"].to_numpy() == pytest.approx(stiffening.column("stroke"), rel=1e-14)


def test_events_stand_in_order_along_the_curve(softening):
    frame = softening.dataframe()
    asked = [event for event in softening.events if event.kind == "value"]
    assert len(frame) == len(softening) + len(softening.events) - len(asked)
    (fold,) = np.flatnonzero(frame["event"] == "fold")
    assert frame["beta"][fold] == pytest.approx(-0.0106952149164040, rel=1e-12)
    assert frame["beta"].idxmin() == fold
    assert frame["beta"][frame["event"] == "value"].tolist() == [event.point.value for event in asked]
    assert (np.diff(frame["alpha"]) > 0).all()
    collapsed = ~frame["admissible"]
    (collapse,) = np.flatnonzero(frame["event"] == "collapse")
    assert collapsed.idxmax() in (collapse, collapse + 1)
    assert frame["violations"][collapsed].str.contains("collapses").all()
    assert frame["stroke"][collapsed].iloc[1:].isna().all()
    assert frame["foot_rise"].notna().all()


def test_a_family_from_a_file_needs_its_machine(softening, tmp_path):
    again = Family.load(softening.save(tmp_path / "family.jsonl"))
    bare, whole = again.dataframe(), softening.dataframe()
    heights = [f"{name}_{end}" for end in ("rise", "apex") for name in ("body", "foot", "centre_of_mass")]
    further = ["duty_factor", "stroke", "peak_force_in_weights", *heights]
    assert [name for name in whole if name not in bare] == further
    assert again.dataframe(Hopper("cubic", rest_length=30)).equals(whole)
    with pytest.raises(InputError, match=r"no quantity 'stroke': they have beta, alpha, .*Family\.load"):
        again.plot("stroke")
    with pytest.raises(InputError, match="beta"):
        again.dataframe(Hopper())


def test_any_quantity_is_plotted(stiffening, softening):
    axes = softening.plot("loss_coefficient")
    assert axes.get_ylabel() == "loss coefficient"
    axes = stiffening.plot("stroke")
    assert (axes.get_xlabel()[:4], axes.get_ylabel()) == ("b (N", "stroke (m)")
    assert sorted({*axes.lines[0].get_ydata()}) == pytest.approx(sorted({*stiffening.dataframe()["stroke"]}))
    axes = softening.plot("foot_rise")
    marks = {line.get_label(): line.get_ydata() for line in axes.lines}
    rows = softening.dataframe().set_index("event")
    assert marks["fold"] == pytest.approx(rows["foot_rise"]["fold"])


def test_without_pandas(softening, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match=r"pandas.*persistent-orbits\[data\]"):
        softening.dataframe()
