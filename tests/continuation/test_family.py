"""A family as its user holds it: saved, loaded, and asked for quantities."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from documents import NO_UNITS

from orbits import Family, InputError, find, follow
from problems import Hopper, rimless_wheel


class TestOnDisk:
    def test_a_family_saves_and_loads_to_the_last_bit(self, softening_family, tmp_path):
        again = Family.load(softening_family.save(tmp_path / "family.jsonl"))
        assert again == softening_family
        assert str(again) == str(softening_family)

    def test_csv_has_full_precision(self, softening_family, tmp_path):
        lines = softening_family.save(tmp_path / "family.csv").read_text().splitlines()
        assert lines[0].startswith("beta,alpha,liftoff_extension,flight_time,contact_time,admissible,error")
        assert float(lines[3].split(",")[1]) == softening_family[2].alpha
        assert len(lines) == len(softening_family) + 1

    def test_netcdf_needs_an_extra(self, softening_family, tmp_path, monkeypatch):
        monkeypatch.setitem(sys.modules, "xarray", None)
        with pytest.raises(InputError, match=r"persistent-orbits\[data\]"):
            softening_family.save(tmp_path / "family.nc")

    @pytest.mark.slow
    @pytest.mark.extra("xarray")
    def test_netcdf(self, softening_family, tmp_path):
        import xarray

        with xarray.open_dataset(softening_family.save(tmp_path / "family.nc")) as data:
            assert (data["alpha"].values == softening_family.column("alpha")).all()

    def test_what_is_no_family_is_refused(self, tmp_path):
        path = tmp_path / "family.jsonl"
        for text in ("", "{}", '{"format": "other"}', "not json"):
            path.write_text(text)
            with pytest.raises(InputError, match="is not a saved family"):
                Family.load(path)


def test_questions_about_quantities_and_values_that_are_not_there(softening_family, tmp_path):
    with pytest.raises(InputError, match="unknown quantity 'height'; known: alpha, "):
        softening_family.plot("height")
    with pytest.raises(InputError, match=r"at = 0\.1 is not reached: beta goes from 0 to -0\.02"):
        follow(Hopper("cubic"), "beta", -0.02, 0.0, at=[0.1])
    with pytest.raises(InputError, match=r"must end in \.jsonl or \.json or \.csv or \.nc"):
        softening_family.save(tmp_path / "family.txt")
    with pytest.raises(InputError, match="watch 'x' returns nan"):
        follow(Hopper("cubic"), "beta", 1.0, 0.0, watch={"x": lambda orbit: np.nan})
    empty = replace(softening_family, points=(), events=())
    assert "without orbits" in str(empty)
    assert Family.load(empty.save(tmp_path / "empty.jsonl")) == empty
    assert empty.save(tmp_path / "empty.csv").read_text().startswith("beta,alpha")


@pytest.mark.usefixtures("any_digest")
@pytest.mark.parametrize("value", NO_UNITS)
def test_an_old_family_with_a_unit_that_is_none_is_refused(value, saved_documents, tmp_path):
    head, *rest = saved_documents["family"].splitlines()
    record, path = json.loads(head), tmp_path / "family.jsonl"
    record["machine"] |= {"laws_in": "SI", "unit_length": value, "unit_time": 1.0, "unit_force": 1.0}
    path.write_text("\n".join([json.dumps(record), *rest]))
    with pytest.raises(InputError, match="is not a saved family: its unit of length is"):
        Family.load(path)


def test_a_family_of_machines_that_stand_has_the_friction_that_they_need():
    """In columns, tables and documents, as the certificates of single orbits have it; a hopper has none."""
    wheel = rimless_wheel(inertia_ratio=1.0, gravity_ratio=0.5)
    family = follow(wheel, "inertia_ratio", 1.3)
    needed, last = family.column("friction_needed"), find(wheel.with_values(inertia_ratio=1.3)).certificate
    assert (len(needed), needed[-1]) == (len(family), pytest.approx(last.friction_needed, rel=1e-12))
    assert family.table()["smallest_stance_force"][-1] == pytest.approx(last.smallest_stance_force, rel=1e-12)
    assert family.document()["points"][-1]["friction_needed"] == needed[-1]
    hops = follow(Hopper("cubic"), "beta", 0.12, 0.1)
    assert not {"friction_needed", "smallest_stance_force"} & {*hops.table(), *hops.document()["points"][0]}
    with pytest.raises(InputError, match="no quantity 'friction_needed'"):
        hops.column("friction_needed")


def test_values_are_those_of_points():
    family = follow(Hopper("cubic", rest_length=20), "beta", 0.1, start=0.0)
    with pytest.raises(InputError, match="points: 'l' is not a point of a family"):
        family.values_at("log(r)", "alpha")
