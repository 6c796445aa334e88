"""`orbits prove`: the theorem in words and as JSON, exact decimals, exit codes."""

import json

import pytest

CUBIC = "prove --spring cubic --set beta=0.3 --rest-length 8"


def test_words(orbits):
    done = orbits(CUBIC)
    assert done.code == 0
    assert done.out.startswith("proved")
    assert "beta = 0.3" in done.out
    assert "It is a motion: it is of family 1" in " ".join(done.out.split())


def test_json(orbits, tmp_path):
    path = tmp_path / "proof.json"
    done = orbits(f"{CUBIC} --json --loss --digits 25 --save {path}")
    document = done.document
    assert done.code == 0
    assert document["proved"] is True
    assert set(document["conditions"]) == {"clearance", "separation", "contact_force", "contact_end"}
    assert set(document["conditions"].values()) == {"proved"}
    for name in ("alpha", "flight_time", "contact_time", "loss_coefficient"):
        assert isinstance(document[name]["low"], str)
    assert float(document["uniqueness_radius"]) > float(document["radius"]) > 0
    assert document["digits"] == 25
    assert json.loads(path.read_text())["alpha"] == document["alpha"]


@pytest.mark.slow
def test_numbers_are_exact_decimals(orbits):
    """Beyond what floats tell: alpha changes by about -0.45 times what is added to beta."""
    exact = orbits(CUBIC + " --digits 30 --json")
    moved = orbits(CUBIC.replace("0.3", "0.3000000000000000000001") + " --digits 30 --json")
    low, high = (done.document["alpha"]["low"] for done in (moved, exact))
    assert low[:21] == high[:21]
    assert low != high


@pytest.mark.slow
def test_attraction(orbits):
    document = orbits("prove --rest-length 20 --attraction --json").document
    assert document["proved"] is True
    assert document["attraction_radius"] == "0.01"
    assert float(document["attraction_loss"]["low"]) < 3.61695 < float(document["attraction_loss"]["high"])


@pytest.mark.slow
def test_an_interval(orbits):
    done = orbits("prove --spring cubic --between beta=0.2999:0.3001 --between mass_ratio=0.999:1.001 --json")
    assert done.code == 0
    assert "beta in [0.2999, 0.3001]" in done.document["statement"]


def test_a_fixed_point_of_the_return_map(orbits):
    done = orbits("prove --inject 0.03 --near 4.52 --json")
    assert done.code == 0
    document = done.document
    assert document["kind"] == "fixed point"
    assert document["alpha"]["low"].startswith("4.5188288594780977968")
    assert document["multiplier"]["high"].startswith("-0.5976197355332")


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ("--inject 0.03 --near 4.52 --rest-length 4", 1),  # the masses pass through each other
        ("--inject 0.03 --near 2", 1),  # it comes to rest
        ("--inject 0.03", 2),
        ("--inject 0.03 --near 4.52 --loss", 2),
        ("--spring cubic --set beta=0.3 --family 2 --rest-length 3", 1),  # the masses pass through each other
        ("--spring 'r - 0.5*r**3'", 1),
        ("--between beta", 2),
        ("--between beta=x:2", 2),
        ("--spring cubic --between beta=0.3:0.2", 2),
        ("--digits 0", 2),
    ],
)
def test_exit_codes(orbits, options, code):
    done = orbits(f"prove {options}")
    assert done.code == code
    assert done.out or done.err
