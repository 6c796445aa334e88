"""Files of orbits: read to the last bit, and refused where they are damaged or contradict themselves."""

import json

import pytest
from conftest import REFERENCES, machine_of
from documents import NO_UNITS

from orbits import InputError, Orbit, find, find_all
from orbits.io import write_json
from problems import Hopper, hopper_in_si


@pytest.fixture(scope="module")
def orbit():
    return find(machine_of(REFERENCES[4]))


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"format": "other"}', '{"format": "persistent-orbits orbit 1"}', "\x00"]
)
def test_files_that_are_no_orbit(text, tmp_path):
    path = tmp_path / "hop.json"
    path.write_text(text)
    with pytest.raises(InputError, match="is not a saved orbit"):
        Orbit.load(path)
    with pytest.raises(InputError, match="is not a saved orbit"):
        Orbit.load(tmp_path / "missing.json")


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("admissible", lambda value: False), ("rises", lambda value: {**value, "foot": 9.0}),
        ("state_mid_flight", lambda value: [2 * each for each in value]),
    ],
)  # fmt: skip
def test_a_file_that_tells_a_number_in_two_ways(cubic_hop, tmp_path, name, change):
    """Its digest is that of what it says."""
    document = cubic_hop.saved()
    path = write_json(document | {name: change(document[name])}, tmp_path / "hop.json", "orbit")
    with pytest.raises(InputError, match=f"it states {name}"):
        Orbit.load(path)
    assert find(cubic_hop.source, start=path).alpha == pytest.approx(cubic_hop.alpha, abs=1e-12)


def test_a_file_in_si_tells_each_number_twice(tmp_path):
    document = find(hopper_in_si(3.0, 2.0, stiffness=500.0)).saved()
    path = write_json(document, tmp_path / "hop.json", "orbit")
    assert Orbit.load(path).alpha == document["alpha"]
    with pytest.raises(InputError, match="it states alpha"):
        Orbit.load(write_json(document | {"alpha": 1.01 * document["alpha"]}, path, "orbit"))


@pytest.mark.usefixtures("any_digest")
def test_the_number_known_is_kept(tmp_path):
    orbit = find_all(Hopper("cubic"))[0]
    path = orbit.save(tmp_path / "orbit.json")
    assert Orbit.load(path).known_in_family == 1
    assert "known in its family     1" in str(orbit)
    document = json.loads(path.read_text())
    del document["known_in_family"]  # as in files of versions that did not have it
    path.write_text(json.dumps(document))
    assert Orbit.load(path).known_in_family is None


@pytest.mark.usefixtures("any_digest")
@pytest.mark.parametrize("key", ["violations", "error", "alpha", "skipped", "seconds", "parameters", "motion"])
def test_an_orbit_with_a_wrong_value_is_refused_by_name(key, saved_documents, tmp_path):
    path = tmp_path / "orbit.json"
    path.write_text(json.dumps(json.loads(saved_documents["orbit"]) | {key: "abc"}))
    with pytest.raises(InputError, match=f"is not a saved orbit: .*{key}"):
        Orbit.load(path)


@pytest.mark.usefixtures("any_digest")
@pytest.mark.parametrize("layout", ["today", "0.1.0"])
@pytest.mark.parametrize("value", NO_UNITS)
def test_an_orbit_with_a_unit_that_is_none_is_refused(value, layout, saved_documents, tmp_path):
    """In the layout of today, and in that of version 0.1.0, without units of results."""
    data, path = json.loads(saved_documents["orbit in SI"]), tmp_path / "orbit.json"
    for name in {"today": (), "0.1.0": ("bare", "units")}[layout]:
        del data[name]
    for name in ("length", "time", "force", "energy"):
        units = {**data["motion"]["units"], name: value}
        path.write_text(json.dumps(data | {"motion": data["motion"] | {"units": units}}))
        with pytest.raises(InputError, match=f"is not a saved orbit: its unit of {name} is"):
            Orbit.load(path)


@pytest.mark.usefixtures("any_digest")
def test_an_orbit_in_si_with_a_mass_that_is_no_number_is_refused(saved_documents, tmp_path):
    path = tmp_path / "orbit.json"
    path.write_text(json.dumps(json.loads(saved_documents["orbit in SI"]) | {"foot_mass": [1.0]}))
    with pytest.raises(InputError, match="is not a saved orbit: foot_mass = "):
        Orbit.load(path)
