"""Springs with hysteresis: what a loop loses, by closed forms and by SciPy's quadrature, and how they are stated."""

import itertools

import numpy as np
import pytest
from scipy.integrate import quad

from orbits import InputError, ReturnMap, find, follow, optimize, quantities, simulate, sweep
from problems import Hopper, hopper_in_si, springs
from problems.machines import files

MEASURED = np.concatenate([np.linspace(-6.0, 6.0, 41), np.linspace(6.0, -6.0, 41)])
WIDTH = 0.003 * (36.0 - MEASURED**2) * np.sign(41 - np.arange(82) - 0.5)


def area(law, low: float, high: float) -> float:
    """The area of a loop, by SciPy."""
    return quad(lambda r: float(law.extending(r) - law.shortening(r)), low, high, points=[0.0], epsabs=1e-12)[0]


@pytest.mark.parametrize("law", ["r + beta*r**3", "tanh(beta*r)/beta"])
def test_a_loss_factor_is_the_loss_over_two_pi_times_the_stored_energy(law):
    spring = springs.lossy(law, loss_factor=0.07, beta=0.3)
    stored = quad(lambda r: float(spring.mean(r)), 0.0, 1.7)[0]
    assert area(spring, -1.7, 1.7) == pytest.approx(2 * np.pi * 0.07 * stored, rel=1e-12)


@pytest.mark.parametrize("mean", [springs.formula("r + 0.1*r**2"), springs.bilinear(), springs.air()])
def test_a_loop_has_the_area_that_is_stated(mean):
    assert area(springs.lossy(mean, loop_area=0.2, between=(-0.5, 2.0)), -0.5, 2.0) == pytest.approx(0.2, rel=1e-9)


@pytest.mark.slow
def test_a_measured_loop_is_its_two_branches():
    force = MEASURED + 0.01 * MEASURED**3 + WIDTH
    law = springs.loop((MEASURED, force), noise=0)
    r = np.linspace(-5.9, 5.9, 30)
    for branch, side in ((law.extending, 1), (law.shortening, -1)):
        exact = r + 0.01 * r**3 + side * 0.003 * (36.0 - r**2)
        assert branch(r) == pytest.approx(exact, abs=1e-10)
    formula = springs.hysteretic("r + 0.01*r**3 + h*(36 - r**2)", "r + 0.01*r**3 - h*(36 - r**2)", h=0.003)
    hops = [simulate(Hopper(spring), 4.0, hops=1) for spring in (law, formula)]
    assert hops[0].status == "done"
    assert hops[0].launches == pytest.approx(hops[1].launches, abs=1e-8)
    # One in compression alone is unloaded while its extension grows.
    pressed = springs.loop((-6.0 - MEASURED[::-1], -6.0 - (MEASURED - WIDTH)[::-1]), noise=0)
    assert float(pressed.extending(-4.0) - pressed.shortening(-4.0)) > 0


def test_they_are_stated_in_text_and_in_files(tmp_path):
    law = springs.as_spring("lossy:r + beta*r**3", {"beta": 0.3, "loss_factor": 0.05})
    assert dict(law.parameters) == {"beta": 0.3, "loss_factor": 0.05}
    assert law.mean.text == "r + beta*r**3"
    both = springs.as_spring("hysteretic:r + h; r - h", {"h": 0.1})
    assert (float(both.extending(1.0)), float(both.shortening(1.0))) == (1.1, 0.9)
    for spring in (law, both):
        machine = Hopper(spring, mass_ratio=0.5)
        assert files.machine_stated(files.statement_for_file(machine)) == machine
    rows = [f"{r:.6g},{force:.9g}" for r, force in zip(MEASURED, MEASURED + WIDTH, strict=True)]
    (tmp_path / "loop.csv").write_text("\n".join(["extension,force", *rows]), encoding="utf-8")
    for text in ("loop:loop.csv?noise=0", "lossy:table:loop.csv?branch=mean&noise=0"):
        statement = f'machine = "hopper"\nspring = "{text}"\nparameters = {{}}\n'
        if text.startswith("lossy"):
            statement = statement.replace("{}", "{ loss_factor = 0.05 }")
        (tmp_path / "hopper.toml").write_text(statement, encoding="utf-8")
        stated = files.build(files.read(tmp_path / "hopper.toml"))
        assert float(stated.spring.mean(1.0)) == pytest.approx(1.0, abs=1e-8)
        with pytest.raises(InputError, match="in another file"):
            files.machine_stated({"machine": "hopper", "spring": text})


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        (lambda: springs.hysteretic("r - 0.1", "r + 0.1"), "smaller while the spring extends: exchange the two"),
        (lambda: springs.hysteretic("r", "r", a=1.0), "has no parameter 'a'"),
        (lambda: springs.lossy("r", loss_factor=0.7), r"loss_factor = 0.7; it must be at least 0 and below 2/pi"),
        (lambda: springs.lossy("r"), "needs a loss_factor, or a loop_area"),
        (lambda: springs.lossy("r", loop_area=0.1), "needs a loss_factor, or a loop_area"),
        (lambda: springs.lossy("r", loop_area=-0.1, between=(0, 1)), "loop_area = -0.1 is below 0"),
        (lambda: springs.lossy("r", loop_area=0.1, between=(1, 1)), r"between = \(1, 1\)"),
        (lambda: springs.lossy("r", loop_area=0.1, between=3), "between = 3; it must be the two extensions"),
        (lambda: springs.lossy("r", loop_area=9.0, between=(0, 1)), "at least 0 and below 2/pi"),
        (lambda: springs.lossy("r + 1", loss_factor=0.1), "is 1 at r = 0: a loss factor needs a spring that is"),
        (lambda: springs.lossy("-r", loss_factor=0.1), "pulls away from rest"),
        (lambda: springs.lossy("loss_factor*r", loss_factor=0.1), "has no parameter|loss_factor"),
        (lambda: springs.as_spring("lossy:r"), "needs a loss factor: set loss_factor=VALUE"),
        (lambda: springs.as_spring("hysteretic:r"), "it must have two branches"),
        (lambda: springs.as_spring("loop:"), "a loop is stated as loop:FILE"),
        (lambda: springs.loop((MEASURED, MEASURED + WIDTH * np.sign(MEASURED)), noise=0), "branches cross, and at r"),
    ],
)
def test_what_is_no_loop_is_refused(stated, message):
    with pytest.raises(InputError, match=message):
        stated()


def test_an_orbit_of_one_branch_states_what_the_loop_loses():
    """The record of a spring with dry friction; its next launch is that of the same loop stated by two formulas."""
    turns = np.concatenate([np.linspace(a, b, 21)[1:] for a, b in itertools.pairwise((0, 0.12, -0.12, 0.12, -0.12))])
    rubbing = 6.0 * np.sign(np.diff(turns, prepend=0.0))
    law = springs.table((turns, 1500.0 * turns + rubbing), in_si=True, branch="mean", cycle="last", noise=0)
    orbit = find(hopper_in_si(3.0, 1.5, force=law, rest_length=0.3))
    spring = springs.hysteretic("k*r + friction", "k*r - friction", k=1500.0, friction=6.0)
    stated = hopper_in_si(3.0, 1.5, force=spring, stiffness=1500.0, rest_length=0.3)
    following = float(ReturnMap(stated)(orbit.alpha).next)
    found = orbit.summary()
    assert found["next launch on the loop"] == pytest.approx(following, rel=1e-6)
    energy = ReturnMap(stated).upkeep(orbit.alpha).energy
    assert [orbit.loop_energy, found["loop_energy"]] == pytest.approx([energy, energy], rel=1e-6)
    assert orbit.document()["si"]["loop_energy_J"] == orbit.loop_energy
    machine = orbit.source
    assert quantities(machine, orbit, ["loop_energy", "stroke"])["loop_energy"] == orbit.loop_energy
    swept = sweep(machine, {"body_mass": [3.0, 3.3]}, quantities=["loop_energy", "loop_energy/stroke"], progress=False)
    heavier = machine.with_values(body_mass=3.3)
    expected = [orbit.loop_energy, find(heavier).loop_energy]
    assert swept["loop_energy"] == pytest.approx(expected, rel=1e-9)
    assert swept["loop_energy/stroke"][0] == pytest.approx(orbit.loop_energy / orbit.stroke, rel=1e-9)
    assert swept.unit_of("loop_energy") == "J"
    family = follow(machine, "body_mass", 3.3, most=3)
    last = find(machine.with_values(body_mass=family[-1].value)).loop_energy
    assert family.column("loop_energy")[[0, -1]] == pytest.approx([orbit.loop_energy, last], rel=1e-9)
    with pytest.raises(InputError, match="sweeps and families have it as a column, designs do not"):
        optimize(machine, minimise="loop_energy", over={"body_mass": (3.0, 4.0)})
    assert "on the measured loop" not in str(find(hopper_in_si(3.0, 1.5, stiffness=1500.0, rest_length=0.3)))
