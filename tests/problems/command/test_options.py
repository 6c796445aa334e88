"""Options that the commands share: machines in many words, and the display of progress."""

import numpy as np
import pytest

from orbits import InputError, find, optimize
from orbits.mechanics import Ground
from problems import Hopper, hopper_in_si
from problems.command.options import machine_along, machine_of

ALPHA = 4.493409457909064  # tan(alpha) = alpha, eq. (12) of the paper
DUFFING = 2.936459188494196478  # tests/data/orbits.json: r + 0.3 r**3


@pytest.mark.parametrize(
    "line",
    [
        "find --spring cubic --set beta=0.3",
        "find --spring cubic",
        "find --spring 'beta*r**3 + r' --set ' beta = 3e-1 '",
        "find --spring 'potential:r**2/2 + beta*r**4/4' --set beta=0.3",
        "find --spring 'r + 0.3*r**3' --gravity constant --rest-length 50",
        "find --spring quintic --set beta=0.3 --set delta=0",
    ],
)
def test_one_spring_in_many_words(line, orbits):
    done = orbits(line + " --json")
    assert (done.code, done.err) == (0, "")
    assert done.document["alpha"] == pytest.approx(DUFFING, rel=1e-12)


@pytest.mark.parametrize(
    ("line", "parameters"),
    [
        ("--spring tanh --set b=0.3", {"b": 0.3}),
        ("--spring end-stops --set stop=30", {"gap": 3.0, "stop": 30.0}),
        ("--spring toda", {"b": 0.2}),
        ("--gravity inverse-square --set R=150 --rest-length 20", {"R": 150.0}),
        ("--gravity inverse_square --rest-length 20", {"R": 1000.0}),
        (
            "--spring cubic --gravity linear --set kappa=0.002 --set beta=0.1 --rest-length 20",
            {"beta": 0.1, "kappa": 0.002},
        ),
    ],
)
def test_named_laws_keep_their_other_defaults(line, parameters, orbits):
    done = orbits(f"find {line} --json")
    assert done.code == 0
    assert done.document["parameters"] == parameters


def test_a_named_gravity_is_its_formula(orbits):
    named = orbits("find --gravity inverse-square --set R=150 --rest-length 20 --json")
    formula = orbits("find --gravity '1/(1 + z/R)**2' --set R=150 --rest-length 20 --json")
    assert named.answer == formula.answer
    assert named.document["alpha"] == pytest.approx(3.8408905380050934918, rel=1e-12)  # tests/data/orbits.json


def test_a_measured_spring(orbits, tmp_path):
    """A table of a straight line in rows of any order is that line."""
    path = tmp_path / "bench.csv"
    rows = [f"{r},{r}" for r in np.random.default_rng(3).permutation(np.linspace(-15, 15, 31))]
    path.write_text("\n".join(["extension,force", *rows]), encoding="utf-8")
    done = orbits("find --json --spring", f"table:{path}")
    assert done.code == 0
    assert done.document["alpha"] == pytest.approx(ALPHA, rel=1e-12)
    assert done.document["spring"] == "table:bench.csv (extension and force, noise not known, rows smooth to rounding)"


@pytest.mark.parametrize(
    ("options", "changed"),
    [
        ("--set body_mass=70 --set stiffness=9000", {"body_mass": 70.0, "stiffness": 9000.0}),
        ("--rest-length 0.9", {"rest_length": 0.9}),
        ("--rest-length 0.9 --set surface_gravity=3.7", {"rest_length": 0.9, "surface_gravity": 3.7}),
        ("--set body_radius=250", {"body_radius": 250.0}),
    ],
)
def test_numbers_of_a_machine_in_si_are_parameters(options, changed, orbits, tmp_path):
    stated = {"body_mass": 60.0, "foot_mass": 3.0, "stiffness": 8000.0, "rest_length": 0.8}
    path = tmp_path / "leg.toml"
    path.write_text("[si]\n" + "".join(f"{name} = {value}\n" for name, value in stated.items()))
    done = orbits(f"find --json {options} --machine", path)
    assert done.code == 0
    assert done.document["alpha"] == find(hopper_in_si(**stated | changed)).alpha
    refused = orbits("find --mass-ratio 2 --machine", path)
    assert (refused.code, "state lengths and masses in [si]" in refused.err) == (2, True)


class TestMasses:
    """--masses states a machine in SI without a file."""

    def test_they_replace_those_of_a_file(self, orbits, tmp_path):
        path = tmp_path / "leg.toml"
        path.write_text("[si]\nbody_mass = 60\nfoot_mass = 3\nstiffness = 8000\n")
        done = orbits("find --json --masses 70,4 --machine", path)
        assert done.document["alpha"] == find(hopper_in_si(70.0, 4.0, stiffness=8000.0)).alpha
        path.write_text("mass_ratio = 2\n")
        refused = orbits("find --masses 70,4 --machine", path)
        assert (refused.code, "give it a table [si]" in refused.err) == (2, True)

    @pytest.mark.parametrize(
        ("text", "words"),
        [("60", "KG,KG"), ("60,3,1", "KG,KG"), ("heavy,3", "list of numbers"), ("60,-3", "foot_mass = -3"),
         ("nan,3", "body_mass = nan")],
    )  # fmt: skip
    def test_what_is_refused(self, text, words, orbits):
        done = orbits("find --set stiffness=8000 --masses", text)
        assert done.code == 2
        assert words in done.err


def test_the_progress_display_shows_on_a_terminal_and_clears_itself(monkeypatch):
    import io
    import time

    from problems.command.options import progress

    class Terminal(io.StringIO):
        def isatty(self):
            return True

    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    with progress() as report:
        report(0.25)
        time.sleep(1.3)
    shown = terminal.getvalue()
    assert "searching, 1 s, 25%" in shown
    assert shown.endswith("\r" + " " * 40 + "\r")


def test_the_numbers_of_ground_that_yields_are_parameters(tmp_path):
    machine = tmp_path / "soft.toml"
    machine.write_text("[ground]\nmass = 2.0\nstiffness = 5.0\n")
    soft = machine_of(str(machine), ("ground_mass=3.0", "ground_stiffness=7.0"))
    assert (soft.values["ground_mass"], soft.values["ground_stiffness"]) == (3.0, 7.0)
    assert machine_of(str(machine), first=("ground_mass", 4.0)).values["ground_mass"] == 4.0


PLATE = {
    "liftoff": 4.1923, "alpha": -1.5392, "ground": -0.17468, "ground'": 3.796, "duration": 2.25674,
    "contact_duration": 0.48548,
}  # fmt: skip
SOFT = """
rest_length = 10
ground = {mass = 2.0, stiffness = 50.0}
[design]
minimise = "largest_contact_force"
over = {ground_stiffness = [45, 55]}
"""
OF_SEVERAL = {
    "sweep": "--over ground_stiffness=49,51",
    "existence": "--along ground_stiffness=49:51 --across mass_ratio=1,1.1 --samples 2",
    "uncertainty": "--over ground_stiffness=norm(50,0.2) --samples 4",
    "follow": "--along ground_stiffness --to 50.1",
    "map": "",
    "simulate": "--hops 1",
    "control keep-hopping": "--actuator 'y1 - y2' --intervals 6",
    "prove": "",
}


@pytest.fixture(scope="module")
def soft(tmp_path_factory):
    """A hopper on ground that yields, its lossless hop, and the files of both."""
    files = tmp_path_factory.mktemp("soft")
    machine = Hopper(rest_length=10, ground=Ground(2.0, 50.0))
    orbit = find(machine, start=PLATE)
    (files / "soft.toml").write_text(SOFT)
    orbit.save(files / "hop.json")
    return machine, orbit, files / "soft.toml", files / "hop.json"


class TestStartOfSeveralNumbers:
    """What the commands compute from `--start` is what the functions do, and without it they name it."""

    def test_designs(self, soft, orbits):
        machine, orbit, file, hop = soft
        done = orbits(f"optimize {file} --start {hop} --json")
        best = optimize(machine, minimise="largest_contact_force", over={"ground_stiffness": (45, 55)}, start=orbit)
        assert done.document["objective"]["value"] == pytest.approx(best.objective, rel=1e-9)

    def test_launches_differ_in_speed(self, soft, orbits):
        _, orbit, file, hop = soft
        done = orbits(f"map --machine {file} --start {hop} --alpha=-1.6:-1.5:2 --json")
        assert done.document["alpha"] == [-1.6, -1.5]
        assert done.document["ground"] == pytest.approx([orbit(0.0)[4]] * 2, rel=1e-12)
        assert "cobweb" in orbits(f"map --machine {file} --start {hop} --cobweb 4").err

    @pytest.mark.parametrize("name", [*OF_SEVERAL, "find", "optimize"])
    def test_without_it(self, name, soft, orbits):
        file = soft[2] if name == "optimize" else f"--machine {soft[2]}"
        done = orbits(f"{name} {file} {OF_SEVERAL.get(name, '')}")
        assert done.code == 2
        assert "several numbers, liftoff, alpha, ground, ground': give a saved orbit, --start FILE" in done.err

    def test_the_file_of_another_machine(self, soft, orbits):
        done = orbits(f"simulate --start {soft[3]} --hops 1")
        assert (done.code, "of another machine, with the states" in done.err) == (2, True)


def test_one_number_starts_from_a_file_too(tmp_path, orbits):
    orbit = find(Hopper())
    orbit.save(tmp_path / "hop.json")
    for line in ("map", "simulate --hops 1"):
        done = orbits(f"{line} --start {tmp_path / 'hop.json'} --json")
        assert done.code == 0
    assert done.document["launches"] == pytest.approx([orbit.alpha] * 2, rel=1e-12)
    assert "--alpha A, or --start FILE" in orbits("map").err


class TestSteps:
    """Machines that step, by their ratios."""

    @pytest.mark.parametrize(
        ("options", "telling"),
        [
            ("--machine wheel --set inertia_ratio=0", "inertia_ratio = 0; it must lie above 0"),
            ("--machine wheel --set angle=2", "angle = 2; it must lie above 0 and below 1.5708"),
            ("--machine rocker --set gravity_ratio=0", "gravity_ratio = 0; it must lie above 0"),
            ("--machine wheel --mass-ratio 2", "'mass_ratio' belongs to machines that hop: a wheel has inertia_ratio"),
            ("--machine wheel --masses 1,2", "only hopping machines have them; a wheel needs a table [si]"),
            ("--machine shuttle --spring 'r + r**2'", "an odd law, such as"),
            (
                "--machine wagon",
                "must be a .toml file, or one of hopper, juggler, wheel, rocker, shuttle, runner",
            ),
        ],
    )
    def test_what_is_no_such_machine(self, orbits, options, telling):
        done = orbits(f"find {options}")
        assert done.code == 2
        assert telling in done.err

    def test_other_commands_take_them(self, orbits):
        ratio = "--set gravity_ratio=0.5"
        done = orbits(f"follow --machine wheel --along inertia_ratio --from 1 --to 1.1 {ratio} --json")
        assert done.code == 0
        done = orbits(f"sweep --machine rocker --over inertia_ratio=0.5:2 {ratio} --samples 4 --json")
        assert done.code == 0
        done = orbits(f"map --machine wheel --set angle=0.3 {ratio} --alpha 0.349144090286584708 --json")
        assert done.code == 0
        assert "lifts_off" in done.out


def test_a_family_begins_at_a_value_of_a_parameter_or_of_a_quantity():
    walker = {"machine": "walker"}
    assert machine_along("angle", 0.3, True, walker).values == machine_of(**walker).values
    assert machine_along("leg_mass", 0.2, True, walker).values["leg_mass"] == 0.2
    with pytest.raises(InputError, match="'angle' is a coordinate"):
        machine_along("angle", 0.3, False, walker)
