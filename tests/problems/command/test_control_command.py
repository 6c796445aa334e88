"""`orbits control`: what it prints and writes, and what it refuses."""

import csv

import pytest

from problems import Actuator, Hopper, steering


def test_keep_hopping_costs_what_the_function_says(orbits):
    done = orbits("control keep-hopping --damping 0.01 --intervals 20 --json")
    assert (done.code, done.err) == (0, "")
    expected = steering.keep_hopping(Hopper(damping=0.01), intervals=20)
    assert done.document["cost"] == pytest.approx(expected.cost, rel=1e-9)
    assert done.document["status"] == "optimal"
    earlier = orbits("control hold --damping 0.01 --intervals 20 --json")
    assert (earlier.document["cost"], earlier.err) == (done.document["cost"], "'hold' is now called 'keep-hopping'\n")


def test_keep_hopping_at_a_speed(orbits):
    done = orbits("control keep-hopping --speed 4.6 --intervals 16 --follow speed:4.7 --json")
    assert (done.code, done.err) == (0, "")
    expected = steering.keep_hopping(Hopper(), speed=4.7, intervals=16).cost
    assert done.document["costs"][-1] == pytest.approx(expected, rel=1e-8)


@pytest.mark.slow
def test_an_actuator_is_named(orbits):
    """A force between the masses, as in Python; the default is the end of the only spring, as there."""
    line = "control keep-hopping --damping 0.01 --intervals 16 --json"
    done = orbits(f"{line} --actuator 'force:y1 - y2' --force 0.5")
    pushed = steering.keep_hopping(Hopper(damping=0.01), actuator=Actuator("y1 - y2", "force"), intervals=16, force=0.5)
    assert done.document["cost"] == pytest.approx(pushed.cost, rel=1e-9)
    assert orbits(f"{line} --actuator 'y1 - y2'").document["cost"] == orbits(line).document["cost"]


def test_a_family_from_the_lossless_hop(orbits, tmp_path):
    table = tmp_path / "family.csv"
    done = orbits(f"control keep-hopping --intervals 16 --follow damping:0.05 --json --save {table}")
    assert (done.code, done.err) == (0, "")
    assert done.document["end"]["kind"] == "reached"
    expected = steering.keep_hopping(Hopper(damping=0.05), intervals=16).cost
    assert done.document["costs"][-1] == pytest.approx(expected, rel=1e-9)
    with open(table, newline="") as file:
        head, *rows = csv.reader(file)
    assert head == ["damping", "cost", "slope", "active"]
    assert float(rows[-1][0]) == 0.05


@pytest.mark.slow
def test_start_up(orbits):
    done = orbits("control start-up --pumps 2 --stroke 2 --intervals 8 --json")
    assert (done.code, done.err) == (0, "")
    assert [leg["phase"] for leg in done.document["legs"]] == ["contact"] * 4


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        ("", 2, "Missing argument"),
        ("fly", 2, "'fly'"),
        ("recover", 2, "recover needs --short"),
        ("start-up", 2, "start-up needs --pumps"),
        ("keep-hopping --short 0.1", 2, "--short belongs to recover, not to keep-hopping"),
        ("recover --short 0.1 --speed 4.6", 2, "--speed belongs to keep-hopping, not to recover"),
        ("keep-hopping --cost joy", 2, "it must be 'effort', 'work' or 'peak'"),
        ("keep-hopping --actuator 'force:y1 - y3'", 2, "there is no coordinate 'y3'"),
        ("keep-hopping --actuator 'torque:y1 - y2'", 2, "'displacement' or 'force'"),
        ("keep-hopping --save hold.txt", 2, "must end in"),
        ("keep-hopping --follow damping", 2, "as damping:0.2"),
        ("keep-hopping --follow damping:much", 2, "--follow 'much' is not a number"),
        (
            "keep-hopping --follow zeta:1",
            2,
            "'zeta' is not a number of this motion; it has mass_ratio, damping, drag",
        ),
        ("keep-hopping --follow damping:0.1 --animate hop.gif", 2, "draws one motion"),
        ("recover --short 0.1 --follow damping:0.1", 2, "--follow belongs to keep-hopping"),
        ("keep-hopping --damping 0.01 --rate 1e-6", 1, ""),
    ],
)
def test_refusals(options, code, words, orbits):
    done = orbits(f"control {options}")
    assert (done.code, done.out) == (code, "")
    assert words in done.err
