"""Machine files: they state what options state, also in SI, and tables lie beside them."""

import math

import pytest

ALPHA = 4.493409457909064  # tan(alpha) = alpha, eq. (12) of the paper
CUBIC = "find --spring 'r + beta*r**3' --set beta=0.3"


def test_a_machine_file_says_what_options_say(orbits, tmp_path):
    path = tmp_path / "hopper.toml"
    path.write_text(
        'machine = "hopper"\nmass_ratio = 0.5\nrest_length = 10\nspring = "r + beta*r**3"\n'
        'gravity = "1/(1 + z/R)**2"\n[parameters]\nbeta = 0.3\nR = 50.0\n'
    )
    options = "--mass-ratio 0.5 --rest-length 10 --gravity '1/(1 + z/R)**2' --set R=50"
    done = orbits("find --json --machine", path)
    assert done.code == 0
    assert done.answer == orbits(f"{CUBIC} {options} --json").answer
    assert done.document["alpha"] == pytest.approx(2.3379634746120540168, rel=1e-12)  # tests/data/orbits.json


def test_a_table_lies_beside_the_machine_file(orbits, tmp_path):
    folder = tmp_path / "rig"
    folder.mkdir()
    (folder / "bench.csv").write_text("r,f\n" + "\n".join(f"{r},{r}" for r in range(-12, 13)))
    (folder / "rig.toml").write_text('spring = "table:bench.csv"\n')
    assert orbits("find --json --machine", folder / "rig.toml").document["alpha"] == pytest.approx(ALPHA, rel=1e-12)


def test_a_machine_in_si(orbits, tmp_path):
    """Of a linear spring with k = 8000 N/m the units follow by hand (eq. 2)."""
    path = tmp_path / "rover.toml"
    path.write_text(
        "[si]\nbody_mass = 60.0\nfoot_mass = 3.0\nstiffness = 8000.0\nrest_length = 0.8\nsurface_gravity = 9.81\n"
    )
    done = orbits("find --json --machine", path)
    length, time = 3 * 9.81 / 8000, math.sqrt(3 / 8000 / (1 + 3 / 60))
    assert done.code == 0
    assert done.document["alpha"] == pytest.approx(ALPHA * length / time, rel=1e-15, abs=0)
    assert done.document["mass_ratio"] == pytest.approx(0.05, rel=1e-15)
    assert done.document["rest_length"] == 0.8
    assert done.document["units"]["alpha"] == "m/s"
    si = done.document["si"]
    assert si["alpha_m_per_s"] == pytest.approx(ALPHA * length / time, rel=1e-14)
    assert si["flight_time_s"] == pytest.approx(2 * ALPHA * time, rel=1e-14)
    assert si["contact_time_s"] == done.document["contact_time"]
    assert si["liftoff_extension_m"] == pytest.approx(length, rel=1e-14)
    assert "m/s" in orbits("find --machine", path).out
    done = orbits("follow --json --along body_mass --from 60 --to 50 --machine", path).document
    assert done["points"][-1]["body_mass"] == 50
    longer = math.sqrt(3 / 8000 / (1 + 3 / 50))
    assert done["points"][-1]["alpha"] == pytest.approx(ALPHA * length / longer, rel=1e-14)
    assert done["units"]["body_mass"] == "kg"
    hop = orbits("map --json --alpha 0.9 --machine", path).document
    assert hop["units"]["next"] == "m/s"
    assert hop["next"][0] ** 2 == pytest.approx(0.81 - hop["loss"][0], rel=1e-14)
    assert "launch speed (m/s)" in orbits("map --alpha 0.9 --machine", path).out
    run = orbits("simulate --json --alpha 0.9 --hops 1 --machine", path).document
    assert run["launches"] == pytest.approx([0.9, hop["next"][0]], rel=1e-13)


def test_a_spring_in_si_is_its_dimensionless_self(orbits, tmp_path):
    """8000 r + 2e6 r**3 N for a foot of 3 kg: beta = 2e6 length**3/weight."""
    path = tmp_path / "rover.toml"
    path.write_text(
        'spring = "k*r + 2e6*r**3"\n[si]\nbody_mass = 60\nfoot_mass = 3\nrest_length = 0.8\nsurface_gravity = 9.81\n'
        "[parameters]\nk = 8000\n"
    )
    weight = 3 * 9.81
    beta = 2e6 * (weight / 8000) ** 3 / weight
    si = orbits("find --json --machine", path)
    dimensionless = orbits(f"find --json --spring cubic --set beta={beta!r} --mass-ratio 0.05")
    assert si.code == dimensionless.code == 0
    speed = weight / 8000 / math.sqrt(3 / 8000 / 1.05)
    assert si.document["alpha"] == pytest.approx(dimensionless.document["alpha"] * speed, rel=1e-12)
