"""The command line: what it prints and writes, and that bad input ends in one message and an exit code."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import Result, slow_after

from orbits import Orbit, follow
from orbits.io import to_json
from problems import Hopper
from problems.command.cli import orbits as main_group
from tests.browser import PATIENCE

ALPHA = 4.493409457909064  # tan(alpha) = alpha, eq. (12) of the paper
KEYS = """
alpha flight_time contact_time admissible violations residual error energy_drift clearance smallest_separation
family liftoff_extension state_mid_flight loss_coefficient parameters method skipped seconds
"""
INADMISSIBLE = "find --spring 'r + beta*r**2' --set beta=0.03 --mass-ratio 0.2 --rest-length 60 --family 2"
CUBIC = "find --spring 'r + beta*r**3' --set beta=0.3"


def in_a_process(*arguments) -> Result:
    command = [Path(sys.executable).with_name("orbits"), *arguments]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", timeout=PATIENCE, check=False)
    return Result(done.returncode, done.stdout, done.stderr)


# Whole processes.


@pytest.mark.slow
def test_process_finds_an_orbit():
    done = in_a_process("find", "--json")
    assert (done.code, done.err) == (0, "")
    assert done.document["alpha"] == pytest.approx(ALPHA, rel=1e-15, abs=0)


def test_process_reports_bad_input():
    done = in_a_process("find", "--spring", "r^3")
    assert (done.code, done.out) == (2, "")
    assert done.err.endswith("'^' is not allowed: write a power as\n  **\n    r^3\n     ^\n")


def test_process_survives_an_argument_that_is_no_text():
    done = in_a_process("find", "--json", "--spring", b"r + \xff")
    assert done.code == done.document["exit_code"] == 2
    assert "is not allowed" in done.err
    assert "Traceback" not in done.err


# What is found.


def test_linear_hopper_to_the_last_digit(orbits):
    done = orbits("find --json")
    assert (done.code, done.err) == (0, "")
    assert done.document["alpha"] == pytest.approx(ALPHA, rel=1e-15, abs=0)
    assert done.document["flight_time"] == pytest.approx(2 * ALPHA, rel=1e-15, abs=0)


def test_json_is_one_document_with_every_key(orbits):
    document = orbits("find --json --explain").document
    assert document.keys() >= set(KEYS.split())
    assert document["admissible"] is True
    assert document["violations"] == []
    assert len(document["state_mid_flight"]) == 2
    assert 0 <= document["error"] < 1e-14


@pytest.mark.parametrize("line", ["find", CUBIC, INADMISSIBLE, "find --gravity linear --rest-length 20"])
def test_floats_round_trip(line, orbits):
    """Seventeen digits: reading and writing again gives the same text."""
    done = orbits(line + " --json")
    assert to_json(done.document) + "\n" == done.out


def test_options_reproduce_the_reference_orbits(reference, orbits):
    settings = [word for name, value in reference["parameters"].items() for word in ("--set", f"{name}={value}")]
    done = orbits(
        "find --json",
        *("--spring", reference["spring"], "--gravity", reference["gravity"], "--family", reference["family"]),
        *("--mass-ratio", reference["mass_ratio"], "--rest-length", reference["rest_length"], *settings),
    )
    document = done.document
    assert done.code == (0 if reference["admissible"] else 1)
    assert document["admissible"] is reference["admissible"]
    assert document["parameters"] == reference["parameters"]
    assert document["family"] == reference["family"]
    for name in ("alpha", "flight_time", "liftoff_extension"):
        assert document[name] == pytest.approx(float(reference[name]), rel=1e-12)
    assert document["contact_time"] == (
        reference["contact_time"] and pytest.approx(reference["contact_time"], rel=1e-8)
    )


def test_an_inadmissible_orbit_is_printed_and_fails(orbits):
    done = orbits(INADMISSIBLE + " --json")
    assert done.code == 1
    assert done.document["admissible"] is False
    assert any("never lifts off again" in violation for violation in done.document["violations"])
    allowed = orbits(INADMISSIBLE + " --json --allow-inadmissible")
    assert allowed.code == 0
    assert allowed.answer == done.answer


def test_text_shows_the_digits_and_explains(orbits):
    plain, explained = orbits("find"), orbits("find --explain")
    assert plain.code == explained.code == 0
    assert "4.49340945790906" in plain.out
    assert len(explained.out.splitlines()) > len(plain.out.splitlines())
    for line in orbits("find --json").document["skipped"]:
        assert line in explained.out
        assert line not in plain.out


# Files written.


def test_plot_writes_a_png(orbits, tmp_path):
    path = tmp_path / "hop.png"
    done = orbits("find --plot", path)
    assert (done.code, done.err) == (0, "")
    assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")


def test_animate_writes_a_gif(orbits, tmp_path, monkeypatch):
    monkeypatch.setattr(Orbit.animate, "__defaults__", (4,))  # frames: a hundred more prove nothing
    path = tmp_path / "hop.gif"
    done = orbits("find --json --animate", path)
    assert (done.code, done.err) == (0, "")
    assert done.document["alpha"] == pytest.approx(ALPHA)
    assert path.read_bytes().startswith(b"GIF8")


@pytest.mark.parametrize("line", ["find", CUBIC, INADMISSIBLE])
def test_a_saved_orbit_loads(line, orbits, tmp_path):
    path = tmp_path / "orbit.json"
    document = orbits(line + " --json --save", path).document
    orbit = Orbit.load(path)
    assert orbit.document() == document
    assert orbit(0.0)[0] == pytest.approx(document["liftoff_extension"], rel=1e-14)
    assert orbit(0.0)[1] == pytest.approx(document["alpha"], rel=1e-14)


# What is refused. Each: the command line, the exit code, what the message must contain.

NUMBERS = [
    ("find --mass-ratio nan", 2, "mass_ratio = nan"),
    ("find --mass-ratio inf", 2, "mass_ratio = inf"),
    ("find --mass-ratio 0", 2, "'--mass-ratio': 0.0 is not in the range x>0"),
    ("find --mass-ratio heavy", 2, "--mass-ratio"),
    ("find --mass-ratio", 2, "--mass-ratio"),
    ("find --rest-length nan", 2, "rest_length = nan"),
    ("find --rest-length 0", 2, "x>0"),
    ("find --family 0", 2, "'--family': 0 is not in the range x>=1"),
    ("find --family 100001", 2, "to 10000"),
    ("find --family 1.5", 2, "'1.5'"),
    ("find --family one", 2, "'one'"),
]
FORMULAS = [
    ("find --spring ''", 2, "is missing"),
    ("find --spring r^3", 2, "write a power as **"),
    ("find --spring 'sinn(r)'", 2, "did you mean 'sin'?"),
    ("find --spring sin", 2, "unknown law 'sin'; did you mean 'sinh'"),
    ("""find --spring '__import__("os")'""", 2, "is not allowed"),
    ("find --spring 'r\x1b[31m'", 2, "character 2"),
    ("find --spring potential:", 2, "is missing"),
    ("find --gravity '1 +' --rest-length 20", 2, "is missing"),
    ("find --spring cubik", 2, "cubic"),
    ("find --spring tabel:bench.csv", 2, "tabel"),
    ("find --gravity table:bench.csv --rest-length 20", 2, "table"),
    ("find --gravity inverse_sqare --rest-length 20", 2, "inverse_square"),
]
LAWS = [
    ("find --spring 0", 2, "'0'"),
    ("find --spring 'r - r'", 2, "'r - r'"),
    ("find --spring -r", 2, "-r"),
    ("find --spring 'r - 0.5*r**3'", 1, "never reaches the foot's weight"),
    ("find --spring cubic --set beta=-0.1", 1, "does not come back"),
    ("find --spring tanh --set b=0", 2, "b = 0"),
    ("find --spring linear --set k=-1", 2, "k = -1"),
    ("find --spring end-stops --set gap=0", 2, "gap = 0"),
    ("find --gravity linear", 2, "rest length"),
    ("find --gravity 2", 2, "must be 1 at z = 0"),
    ("find --gravity inverse-square --set R=-1 --rest-length 20", 2, "R = -1"),
]
PARAMETERS = [
    ("find --spring 'r + beta*r**3'", 2, "'beta' without a value"),
    ("find --set beta=0.3", 2, "'beta'"),
    ("find --spring cubic --set betta=0.3", 2, "did you mean 'beta'?"),
    (f"{CUBIC} --set gamma=1", 2, "'gamma'"),
    (f"{CUBIC} --set beta=0.4", 2, "beta"),
    (f"{CUBIC} --set mass_ratio=1", 2, "mass_ratio"),
    (f"{CUBIC} --set rest_length=1", 2, "rest_length"),
    ("find --spring 'r + pi*r**3' --set pi=3", 2, "'pi'"),
    ("find --spring cubic --set beta", 2, "NAME=VALUE"),
    ("find --spring cubic --set beta=", 2, "not a number"),
    ("find --spring cubic --set beta=big", 2, "'big'"),
    ("find --masses 60,3 --stiffness 8000 --rest-length 620mm", 2, "state the number alone, 0.62 for a machine in SI"),
    ("find --masses 60kg,3 --stiffness 8000", 2, "leave the unit 'kg' out and state the number alone, 60"),
    ("find --spring 'k*r' --set k=8N/mm", 2, "'N/mm' out and state the number alone, 8000"),
    ("find --spring cubic --set beta=nan", 2, "beta = nan"),
    ("find --spring cubic --set", 2, "--set"),
]
OPTIONS = [
    ("fnd", 2, "find"),
    ("find --famly 2", 2, "--family"),
    ("find extra", 2, "extra"),
    ("find --method magic", 2, "closed form"),
    ("find --method 'closed form' --spring cubic", 2, "a linear spring"),
    ("find --method relative --gravity linear --rest-length 20", 2, "constant gravity"),
    ("find --machine hoper", 2, "hopper"),
    ("find --machine machine.json", 2, ".toml"),
]
TABLES = {
    "empty.csv": ("", 2, "no rows"),
    "header.csv": ("extension,force\n", 2, "at least 4 rows"),
    "few.csv": ("r,f\n0,0\n1,1\n2,2\n", 2, "at least 4"),
    "words.csv": ("r,f\n0,0\n1,one\n2,2\n3,3\n4,4\n", 2, "row 3"),
    "column.csv": ("r\n0\n1\n2\n3\n4\n", 2, "no column force"),
    "semicolons.csv": ("r;f\n0;0\n1;1\n2;2\n3;3\n", 1, "[0, 3]"),
    "nan.csv": ("r,f\n0,0\n1,nan\n2,2\n3,3\n4,4\n", 2, "finite"),
    "binary.csv": (bytes(range(256)), 2, "cannot be read"),
    "short.csv": ("r,f\n-1,-1\n0,0\n1,1\n2,2\n3,3\n", 1, "[-1, 3]"),
    "loop.csv": ("r,f\n" + "".join(f"{r},{r + 1}\n" for r in range(9)) + "8,7\n6,5\n4,3\n2,1\n0,-1\n", 2, "is a loop"),
    "units.csv": ("r (mm),f\n0,0\n1,1\n2,2\n3,3\n", 2, "hopper_in_si"),
}
SI = "[si]\nbody_mass = 1\nfoot_mass = 1\n"
MACHINES = {
    "syntax.toml": ("machine = \n", 2, "line 1"),
    "twice.toml": ("mass_ratio = 1\nmass_ratio = 2\n", 2, "line 2"),
    "binary.toml": (bytes(range(256)), 2, "cannot be read"),
    "key.toml": ("mass_ration = 1\n", 2, "did you mean 'mass_ratio'?"),
    "family.toml": ("family = 2\n", 2, "unknown key 'family'"),
    "kind.toml": ('machine = "hoper"\n', 2, "did you mean 'hopper'?"),
    "kind_number.toml": ("machine = 3\n", 2, "unknown machine 3"),
    "heavy.toml": ('mass_ratio = "heavy"\n', 2, "'heavy' is not a number"),
    "zero.toml": ("mass_ratio = 0\n", 2, "mass_ratio = 0 is out of bounds"),
    "bouncy.toml": ("restitution = 2\n", 2, "restitution = 2"),
    "spring_number.toml": ("spring = 3\n", 2, "not int"),
    "spring_nul.toml": ('spring = "table:a\\u0000b"\n', 2, "table"),
    "spring_table.toml": ('spring = "table:none.csv"\n', 2, "none.csv"),
    "parameters.toml": ("parameters = 3\n", 2, "[parameters]"),
    "parameter_text.toml": ('spring = "cubic"\n[parameters]\nbeta = "big"\n', 2, "beta = 'big'"),
    "parameter_unknown.toml": ('spring = "cubic"\n[parameters]\nbetta = 1\n', 2, "did you mean 'beta'?"),
    "si_number.toml": ("si = 3\n", 2, "[si]"),
    "si_ratio.toml": ("mass_ratio = 1\n" + SI + "stiffness = 1\n", 2, "'mass_ratio' together with [si]"),
    "si_massless.toml": ("[si]\nbody_mass = 1\nstiffness = 1\n", 2, "needs foot_mass (kg)"),
    "si_juggler.toml": ('machine = "juggler"\n' + SI + "stiffness = 1\n", 2, "body_mass"),
    "si_springless.toml": (SI, 2, "stiffness (N/m)"),
    "si_key.toml": (SI + "stifness = 1\n", 2, "did you mean 'stiffness'?"),
    "si_negative.toml": ("[si]\nbody_mass = -1\nfoot_mass = 1\nstiffness = 1\n", 2, "body_mass = -1"),
    "si_radius.toml": ('gravity = "1"\n' + SI + "stiffness = 1\nbody_radius = 9\n", 2, "body_radius or gravity"),
    "si_unheld.toml": (SI + "stiffness = 1\nbody_radius = 9\n", 2, "rest length"),
    "si_flat.toml": ('spring = "r**3"\n' + SI, 2, "slope 0 at rest"),
    "si_missing.toml": ('spring = "9*r + b*r**3"\n' + SI, 2, "'b' without a value"),
}
FILES = [
    *((f"find --spring table:{name}", code, telling) for name, (_, code, telling) in TABLES.items()),
    *((f"find --machine {name}", code, telling) for name, (_, code, telling) in MACHINES.items()),
    ("find --spring table:none.csv", 2, "none.csv"),
    ("find --spring table:folder.csv", 2, "folder.csv"),
    ("find --spring table:short.csv --set b=1", 2, "'b'"),
    ("find --spring table:short.csv?branch=up", 2, "one of loading, unloading, mean"),
    ("find --spring table:loop.csv", 2, "table:FILE?branch=loading"),
    ("find --spring 'r + c*v' --set c=1", 2, "damping"),
    ("find --machine none.toml", 2, "none.toml"),
    ("find --machine folder.toml", 2, "folder.toml"),
    ("find --machine si_good.toml --mass-ratio 2", 2, "'mass_ratio' together with [si]"),
    ("find --machine si_good.toml --set b=2", 2, "'b'"),
]
OUTPUTS = [
    ("find --plot none/hop.png", 2, "none/hop.png"),
    ("find --plot hop.xyz", 2, "xyz"),
    ("find --animate hop.webm", 2, ".gif"),
    ("find --save none/hop.json", 2, "none/hop.json"),
    ("find --save folder.toml", 2, "folder.toml"),
]
BAD = [*NUMBERS, *FORMULAS, *LAWS, *PARAMETERS, *OPTIONS, *FILES, *OUTPUTS]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """The files that the bad command lines name."""
    folder = tmp_path_factory.mktemp("cli")
    for name, (content, _, _) in (TABLES | MACHINES).items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    (folder / "folder.csv").mkdir()
    (folder / "folder.toml").mkdir()
    (folder / "si_good.toml").write_text(SI + "stiffness = 1\n")
    return folder


@pytest.mark.parametrize(("line", "code", "telling"), BAD, ids=[ascii(line)[1:-1][:60] for line, _, _ in BAD])
def test_bad_input_is_one_message_and_a_code(line, code, telling, orbits, folder, monkeypatch):
    monkeypatch.chdir(folder)
    done = orbits(line)
    assert "Traceback" not in done.err
    assert "internal error" not in done.err
    assert "Warning" not in done.err
    assert done.err.startswith("orbits: ")
    assert telling in done.err
    assert all(c.isprintable() or c == "\n" for c in done.err)
    assert done.code == code


@pytest.mark.parametrize(
    "line",
    [
        "find --mass-ratio 0",
        "find --mass-ratio heavy",
        "find --famly 2",
        "find --spring 'r - r**2'",
        "find --spring cubic --set beta=-0.1",
        "find --machine key.toml",
        "find --plot none/hop.png",
        "find --animate hop.webm",
        "find --save none/hop.json",
    ],
)
def test_an_error_is_one_json_document_too(line, orbits, folder, monkeypatch):
    monkeypatch.chdir(folder)
    done = orbits(line + " --json")
    assert done.document["exit_code"] == done.code in (1, 2)
    assert done.document["error"] in done.err


@pytest.mark.parametrize("option", ["--plot", "--animate", "--save"])
def test_an_empty_file_name_is_refused(option, orbits, tmp_path, monkeypatch):
    """It comes from a shell variable that is not set: to write nothing and report success would lose the result."""
    monkeypatch.chdir(tmp_path)
    assert orbits(f"find {option} ''").code == 2


EXTREME = {
    "huge.csv": "r,f\n-1e300,-1e300\n-1,-1\n0,0\n1,1\n1e300,1e300\n",
    "dense.csv": "r,f\n-20,-20\n0,0\n1e-320,1\n1,1\n20,20\n",
    "quoted.toml": 'spring = "9*r + b*r**3"\n[parameters]\nb = "0.3"\n',
    "si_quoted.toml": 'spring = "9*r + b*r**3"\n' + SI + '[parameters]\nb = "0.3"\n',
}


@pytest.mark.parametrize(
    "line",
    [
        "find --mass-ratio 1e300",
        "find --mass-ratio 1e-300",
        "find --spring 1e300*r",
        "find --spring 'sign(r)'",
        "find --spring r**1000",
        "find --spring bilinear --set ratio=1e300",
        "find --gravity '1 - 1e300*z' --rest-length 20",
        *(f"find --spring table:{name}" for name in EXTREME if name.endswith(".csv")),
        *(f"find --machine {name}" for name in EXTREME if name.endswith(".toml")),
    ],
)
def test_what_is_extreme_ends_in_a_result_or_a_reason(line, orbits, tmp_path, monkeypatch):
    """Numbers that are numbers, but no machine's: one document, no warnings, nothing internal."""
    monkeypatch.chdir(tmp_path)
    for name, content in EXTREME.items():
        (tmp_path / name).write_text(content)
    done = orbits(line + " --json")
    assert "Traceback" not in done.err
    assert "internal error" not in done.err
    assert "Warning" not in done.err
    assert "cannot hold a number" not in done.err
    assert done.code in (0, 1, 2)
    assert ("alpha" in done.document) != ("error" in done.document and "exit_code" in done.document)


def test_check_prints_a_line_for_each_relation(orbits):
    done = orbits(CUBIC.replace("find", "check"))
    title, heads, *lines = done.out.splitlines()
    assert (done.code, title, done.err) == (0, "hopper: 10 relations hold", "")
    assert heads.split() == ["relation", "deviation", "bound"]
    assert sum(line.endswith(("1e-08", "1e-06")) for line in lines) == 10


def test_help_and_version(orbits):
    for line in ("--help", "-h", "find --help"):
        done = orbits(line)
        assert (done.code, done.err) == (0, "")
        assert "Usage: orbits" in done.out
    assert "version" in orbits("--version").out
    assert "table:FILE" in orbits("find --help").out


LONG = "--set foot_mass=0.1 --set rest_length=3.7 --tune inertia --tune hip_stiffness --at speed=0.4"
PRINTED = [
    "--help",
    *(f"{name} --help" for name in main_group.commands),
    "find --family 3",
    f"find --machine runner {LONG}",
    "find --masses 60,3 --rest-length 0.8 --spring '8000*r + 2e6*r**3' --explain",
    f"find --spring 'r + {' + '.join(f'1e-{n}*r**3' for n in range(10, 40))}' --rest-length 60",
    f"find --spring '{'+'.join(['r'] * 60)}'",
    "find --tune mass_ratio",
    "follow --spring cubic --along beta --from 0 --to -0.02 --rest-length 30",
    "map --masses 60,3 --rest-length 0.8 --spring '8000*r + 2e6*r**3' --alpha 0.8:0.9:3",
    "map --alpha 4.3:5:40 --along inject --from 0 --to 0.15",
    "simulate --alpha 4.6 --hops 2 --restitution 0.3 --masses 60,3 --rest-length 0.8 --spring '8000*r + 2e6*r**3'",
    "sweep --spring cubic --over beta=0:1 --over mass_ratio=0.1:10:log --samples 8",
    "existence --spring cubic --along beta=-0.02:0.1 --across rest_length=6:20 --samples 6",
    "uncertainty --spring cubic --over beta=norm(0.3,0.02) --samples 16 --indices",
    "control recover --short 0.1",
]


@pytest.mark.parametrize("line", slow_after(20, PRINTED))
def test_printed_lines_fit_into_a_terminal(line, orbits, monkeypatch):
    """A terminal of 80 columns."""
    monkeypatch.setenv("COLUMNS", "80")
    done = orbits(line)  # which refuses longer lines
    assert done.code in (0, 2)
    assert done.out or done.err


@pytest.mark.parametrize(
    "option", ["--plot nowhere/hop.png", "--animate hop.webm", "--save nowhere/hop.json", "--plot hop"]
)
def test_a_file_that_cannot_be_written_is_refused_before_the_search(orbits, option):
    result = orbits(f"find --family 400 --spring cubic --json {option}")
    assert result.code == 2
    assert "cannot be written" in result.err


class TestFollow:
    def test_the_json_document(self, orbits):
        result = orbits("follow --spring cubic --along beta --from 0 --to 2 --at 0.5,1 --json")
        assert result.code == 0
        document = result.document
        assert set(document) >= {"points", "events", "end", "along", "machine", "settings"}
        by_value = {point["beta"]: point for point in document["points"]}
        assert by_value[0.5]["alpha"] == pytest.approx(2.7218099551244222, rel=1e-12)
        assert by_value[1.0]["alpha"] == pytest.approx(2.4464033594052791, rel=1e-12)
        assert {"flight_time", "admissible", "error", "stable_side"} <= set(by_value[2.0])
        assert [event["kind"] for event in document["events"]] == ["value", "value"]
        assert document["end"]["kind"] == "reached"

    @pytest.mark.slow
    def test_the_table_the_figure_and_the_files(self, orbits, tmp_path):
        figure, points, table = tmp_path / "fold.png", tmp_path / "fold.jsonl", tmp_path / "fold.csv"
        line = "follow --spring cubic --along beta --from 0 --to -0.02"
        result = orbits(line, "--plot", figure, "--output", points, "--save", table)
        assert result.code == 0
        assert f"{'fold':<24}beta = -0.01069521491640" in result.out
        assert figure.stat().st_size > 10_000
        assert table.read_text().count("\n") == points.read_text().count('{"point"') + 1
        again = orbits(line, "--resume", points)
        assert again.code == 0
        assert "escaped" in again.out

    def test_where_there_is_no_machine_any_more_the_family_ends(self, orbits):
        done = orbits("follow --along mass_ratio --from 1 --to -1 --json")
        assert done.code == 0
        assert done.document["end"]["kind"] == "degenerate"
        assert "the machine ceases to exist" in done.document["end"]["reason"]

    @pytest.mark.parametrize(
        ("line", "code", "message"),
        [
            ("--spring cubic --along gamma --to 1", 2, "no parameter 'gamma'"),
            ("--spring cubic --along beta --from 1 --to 1", 2, "choose another stop"),
            ("--spring cubic --along beta --from 0 --to 1 --at a,b", 2, "not a list of numbers"),
            ("--spring cubic --along beta --from 0 --to nan", 2, "not a finite number"),
            ("--spring cubic --along beta --to 1 --longest 2", 2, "it must be a share"),
            ("--spring cubic --along beta --to 1 --resume missing.jsonl", 2, "is not a saved family"),
            ("--spring cubic --along beta --to 1 --plot no/fold.png", 2, "cannot be written"),
            ("--spring cubic --along beta --from -1 --to 1", 1, "never reaches"),
            ("--spring cubic", 2, "--along"),
        ],
    )
    def test_bad_input_is_one_message_and_a_code(self, orbits, line, code, message):
        result = orbits("follow " + line)
        assert result.code == code
        assert message in result.err
        assert "Traceback" not in result.err


class TestMap:
    def test_the_json_document(self, orbits):
        document = orbits("map --alpha 2:4.5:6 --json").document
        assert set(document) == {"alpha", "next", "loss", "impacts", "status"}
        assert document["alpha"] == pytest.approx([2.0, 2.5, 3.0, 3.5, 4.0, 4.5])
        assert document["status"][0] == "rests"
        assert document["next"][0] is None
        assert document["next"][4] == pytest.approx(2.07360256000564579, rel=1e-14)
        assert document["impacts"][4] == 2
        assert document["loss"][5] == pytest.approx(0.043397976103492665, rel=1e-12)

    def test_losses_and_injection(self, orbits):
        plain, lifted = (orbits(f"map --alpha 4.6 --json {more}").document["next"][0] for more in ("", "--inject 0.05"))
        assert lifted - plain == pytest.approx(0.05, rel=1e-12)
        for more in ("--restitution 0.3", "--damping 0.02", "--drag 0.02"):
            assert orbits(f"map --alpha 4.6 --json {more}").document["next"][0] != pytest.approx(plain, rel=1e-5)

    def test_the_table_and_the_figure(self, orbits, tmp_path):
        figure = tmp_path / "map.png"
        result = orbits("map --alpha 4:5:3 --cobweb 4.6", "--plot", figure)
        assert result.code == 0
        assert result.out.splitlines()[1].split()[-1] == "lifts_off"
        assert figure.stat().st_size > 10_000

    @pytest.mark.parametrize(
        ("line", "words"),
        [
            ("--alpha x", "neither a number nor a range"),
            ("--alpha 1:2", "neither a number nor a range"),
            ("--alpha 1:2:1", "neither a number nor a range"),
            ("--alpha -1", "launch speeds must be above 0"),
            ("--alpha 1 --restitution 2", "restitution"),
            ("--alpha 1 --damping -1", "damping"),
            ("--alpha 1 --plot x.png", "needs a range"),
            ("--alpha 5:1:4", "A must be below B"),
            ("--alpha 3:3:4", "A must be below B"),
            ("--alpha 3 --inject nan", "inject = nan is not a finite number"),
            ("--alpha 3:4:9 --cobweb 3.5", "give --plot FILE too"),
            ("--alpha 3:4:9 --plot x.png --cobweb -1", "a launch speed must be above 0"),
        ],
    )
    def test_bad_input(self, orbits, line, words):
        result = orbits("map " + line)
        assert result.code == 2
        assert words in result.err


class TestSimulate:
    def test_the_json_document(self, orbits):
        document = orbits("simulate --alpha 4.6 --hops 2 --json").document
        assert document["status"] == "done"
        assert document["launches"][1] == pytest.approx(4.3923267672622012726, rel=1e-14)
        assert [event["kind"] for event in document["events"]] == [
            "landing",
            "lift-off",
            "impact",
            "landing",
            "lift-off",
        ]
        assert document["events"][0]["loss"] == pytest.approx(1.8674655695919803751, rel=1e-12)

    def test_the_table_and_the_figure(self, orbits, tmp_path):
        figure = tmp_path / "run.png"
        result = orbits("simulate --alpha 2 --time 30 --machine juggler", "--plot", figure)
        assert result.code == 0
        assert "done at time 30" in result.out
        assert figure.stat().st_size > 10_000

    def test_bad_input(self, orbits):
        for line, words in (("--alpha 4", "needs hops or a time"), ("--alpha 0 --hops 1", "above 0")):
            result = orbits("simulate " + line)
            assert result.code == 2
            assert words in result.err


@pytest.mark.parametrize("kind", ["hopper", "juggler"])
def test_a_linear_spring_in_si_is_stated_by_its_stiffness(orbits, kind):
    """The launch speed is tan(alpha) = alpha in its units, here by hand: length m2 g/k over a time of the flight."""
    done = orbits(f"find --machine {kind} --masses 60,3 --stiffness 8000 --rest-length 0.8 --json")
    length, stiffness_over_mass = 3 * 9.80665 / 8000, 8000 / 3 * (1.05 if kind == "hopper" else 1.0)
    speed = length * stiffness_over_mass**0.5
    launch = done.document["alpha"]
    if kind == "hopper":
        assert launch == pytest.approx(ALPHA * speed, rel=1e-13)
    assert done.document["parameters"] == {"stiffness": 8000.0}
    as_set = orbits(f"find --machine {kind} --masses 60,3 --spring 8000*r --rest-length 0.8 --json").document
    assert launch == pytest.approx(as_set["alpha"], rel=1e-14)


def test_a_stiffness_needs_a_machine_in_si(orbits):
    for kind in ("hopper", "wheel"):
        done = orbits(f"find --machine {kind} --stiffness 3")
        assert (done.code, "N/m: a machine without units has" in " ".join(done.err.split())) == (2, True)
    runner = "find --machine runner --set foot_mass=0.1 --set rest_length=3.7 --tune inertia --tune hip_stiffness"
    given = orbits(f"{runner} --at speed=0.4 --stiffness 1.02 --json").document
    assert given == {
        **orbits(f"{runner} --at speed=0.4 --set stiffness=1.02 --json").document,
        "seconds": given["seconds"],
    }


def test_the_stiffness_is_varied_from_that_of_the_option(orbits):
    linear = "--masses 60,3 --stiffness 8000 --rest-length 0.8"
    family = orbits(f"follow {linear} --along stiffness --to 9000 --json").document
    ends = family["points"][0], family["points"][-1]
    assert [end["stiffness"] for end in ends] == [8000.0, 9000.0]
    assert ends[1]["alpha"] / ends[0]["alpha"] == pytest.approx((8000 / 9000) ** 0.5, rel=1e-12)
    swept = orbits(f"sweep {linear} --over stiffness=8000,9000 --json").document["members"]
    assert [member["alpha"] for member in swept] == pytest.approx([end["alpha"] for end in ends], rel=1e-12)


def test_the_stiffness_for_a_launch_speed_is_found(orbits):
    done = orbits("find --spring k*r --tune k=1 --at alpha=5 --json")
    assert done.document["parameters"]["k"] == pytest.approx((ALPHA / 5) ** 2, rel=1e-13)
    assert done.document["tuned"] == {"k": done.document["parameters"]["k"]}
    assert done.document["tuned_errors"]["k"] < 1e-13


def test_a_family_goes_both_ways_from_the_value_of_the_machine(orbits):
    points = orbits("follow --spring cubic --set beta=0.3 --along beta --to 0.1:0.5 --json").document["points"]
    assert [points[0]["beta"], points[-1]["beta"]] == [0.1, 0.5]
    points = orbits("follow --spring cubic --along beta --from 0.2 --to 0.1:0.5 --json").document["points"]
    assert 0.2 in [point["beta"] for point in points]
    for wrong, words in (("0.1:0.2:0.3", "neither a number nor a range A:B"), ("0.4:0.5", "is not between them")):
        done = orbits(f"follow --spring cubic --set beta=0.3 --along beta --to {wrong}")
        assert (done.code, words in " ".join(done.err.split())) == (2, True)


def test_several_families_are_followed_together(orbits, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    line = "follow --spring cubic --set beta=0.1 --along beta --to 0:0.2 --longest 0.3 --families 1,3"
    done = orbits(f"{line} --plot families.png --save families.csv")
    assert (done.code, done.out.splitlines()[0]) == (0, "families 1, 3 of hopper, spring r + beta*r**3, along beta")
    assert (tmp_path / "families.png").stat().st_size > 10_000
    document = orbits(f"{line} --json").document
    assert document["numbers"] == [1, 3]
    assert document["families"][1]["points"][0]["alpha"] == pytest.approx(10.904121659428899, rel=1e-13)
    for other in ("--family 2", "--output x.jsonl", "--save x.jsonl", "--event fold --second rest_length=8"):
        assert "are for one family" in " ".join(orbits(f"{line} {other}").err.split())


def test_a_way_back_that_is_lost_and_a_family_that_is_missing_end_in_code_1(orbits, tmp_path):
    family = follow(Hopper("cubic", parameters={"beta": 0.2}), "beta", (0.1, 0.3), longest=0.5)
    for kind, code in (("reached", 0), ("stuck", 1)):
        lost = replace(family, settings=family.settings | {"beginning": {"kind": kind, "reason": "beta = 0.1"}})
        path = lost.save(tmp_path / f"{kind}.jsonl")
        assert orbits(f"follow --spring cubic --along beta --to 0.1:0.3 --longest 0.5 --resume {path}").code == code
    line = "follow --spring tanh --rest-length 20 --set b=0.18 --along b --to 0.19 --longest 0.5 --families"
    assert orbits(f"{line} 1,2").code == 0
    done = orbits(f"{line} 2,3")  # family n ends at b = 1/(2 n + 1)
    assert (done.code, "no lossless orbit of family 3" in " ".join(done.out.split())) == (1, True)


def test_a_family_goes_along_a_quantity(orbits):
    done = orbits("follow --spring cubic --tune beta=0.3 --along alpha --from 2.9 --to 3 --json")
    assert done.document["points"][-1]["alpha"] == pytest.approx(3.0, rel=1e-13)
    assert done.document["points"][0]["beta"] > done.document["points"][-1]["beta"]


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("find --spring k*r --tune k=1=2 --at alpha=5", "--tune 'k=1=2'"),
        ("find --spring k*r --tune k=1 --at alpha", "--at 'alpha' is not of the form NAME=VALUE"),
        ("find --spring k*r --tune k=1", "one for each quantity of at = []"),
        ("follow --spring k*r --tune k=1 --along clearance --to 5", "depends on the whole motion"),
    ],
)
def test_bad_tuning_is_refused(orbits, line, text):
    done = orbits(line)
    assert done.code == 2
    assert text in done.err


def test_an_event_is_followed_in_a_second_parameter(orbits):
    family = "follow --spring cubic --rest-length 9 --along beta --from 0.2 --to 0.1 --longest 0.5"
    document = orbits(f"{family} --event alpha=3.2 --second mass_ratio=2 --json").document
    assert (document["along"], document["settings"]["event"]) == ("mass_ratio", "alpha = 3.2")
    assert document["points"][-1]["alpha"] == pytest.approx(3.2, abs=1e-12)
    assert "and --second NAME=STOP" in orbits(f"{family} --event fold").err


class TestEnergy:
    """Oscillations on the standing foot."""

    def test_a_family_and_its_figure(self, orbits, tmp_path):
        figure = tmp_path / "standing.png"
        found = orbits(f"follow --along energy --from 0.1 --to 2.5 --longest 0.5 --plot {figure}")
        assert (found.code, found.err) == (0, "")
        assert "contact pulls       2  8.88576587632" in found.out
        assert figure.read_bytes().startswith(b"\x89PNG")

    def test_one_oscillation(self, orbits):
        found = orbits("find --at energy=1 --json").document
        assert abs(found["period"] - 8.885765876316732) < 1e-13
        refused = orbits("find --at energy=1 --animate hop.gif")
        assert refused.code == 2
        assert "--animate, --export and --explain are for hops, not for oscillations" in refused.err
