"""Headers of records: names in five languages, units, ties, and stated columns."""

import numpy as np
import pytest

from orbits import InputError
from problems.laws import as_spring
from problems.machines import files
from problems.recordings import read_record

R = np.linspace(-5.0, 5.0, 11)  # mm, of a spring of 8 N/mm
DEGREES = np.linspace(-50.0, 50.0, 11)  # of a spring of 0.3 N m for each degree
WORDS = {
    "Position (mm);Load (N)": (1, 1),
    "Crosshead [mm];Fz [N]": (1, 1),
    "Extension (inch);Force (lbf)": (1 / 25.4, 1 / 4.4482216152605),
    "length [in];load [lbs]": (1 / 25.4, 1 / 4.4482216152605),
    "stroke [mm];weight load [kg]": (1, 1 / 9.80665),
    "Verl\u00e4ngerung [mm];Pr\u00fcfkraft [N]": (1, 1),
    "D\u00e9placement (mm);Effort (daN)": (1, 0.1),
    "Desplazamiento (mm);Fuerza (N)": (1, 1),
    "Yer De\u011fi\u015ftirme (mm);KUVVET (N)": (1, 1),
    "Uzama (cm);Y\u00fck (kgf)": (0.1, 1 / 9.80665),
    "Time [s];Travel rate [mm/s];Travel [mm];Force setpoint [N];Force [N]": (1, 1),
    "Load cell displacement [mm];Load cell [N]": (1, 1),
}


def written(tmp_path, header: str, r=R, force=8 * R, number=str):
    """A file with these rows in the columns that the header names last, and counts in the others."""
    others = header.count(";") - 1
    own = header.split(";")
    place = [i for i, name in enumerate(own) if name.startswith("Travel [")] or [others]
    rows = []
    for i, (a, b) in enumerate(zip(r, force, strict=True)):
        cells = [str(i)] * len(own)
        cells[place[0]], cells[-1] = number(a), number(b)
        rows.append(";".join(cells))
    path = tmp_path / "bench.csv"
    path.write_text("\n".join([header, *rows]), encoding="utf-8")
    return path


@pytest.mark.parametrize("header", WORDS)
def test_words_and_units(header, tmp_path):
    scales = WORDS[header]
    record = read_record(written(tmp_path, header, scales[0] * R, scales[1] * 8 * R), True)
    assert record.extensions == pytest.approx(R / 1000)
    assert record.forces == pytest.approx(8 * R)
    assert record.units == ("m", "N")


def test_a_spring_that_is_twisted(tmp_path):
    record = read_record(written(tmp_path, "Drehwinkel [deg];Drehmoment [N mm]", DEGREES, 300 * DEGREES), True)
    assert record.extensions == pytest.approx(np.radians(DEGREES))
    assert record.forces == pytest.approx(0.3 * DEGREES)
    assert (record.units, record.columns) == (("rad", "N m"), "Drehwinkel in deg and Drehmoment in N mm")
    with pytest.raises(InputError, match="deg and N belong to two kinds of springs"):
        read_record(written(tmp_path, "angle [deg];force [N]"), True)


@pytest.mark.parametrize("mark", ["1.234,5", "1,234.5"])
def test_marks_of_thousands(mark, tmp_path):
    """Numbers such as 1.234,5 in German and 1,234.5 in English."""

    def number(value: float) -> str:
        text = f"{value:,.1f}"
        return text if mark == "1,234.5" else text.translate(str.maketrans(",.", ".,"))

    record = read_record(written(tmp_path, "Weg [um];Kraft [mN]", 1000 * R, 8000 * R, number), True)
    assert (record.extensions, record.forces) == (pytest.approx(R / 1000), pytest.approx(8 * R))


@pytest.mark.parametrize(
    ("header", "names"),
    [
        ("Servo Displacement;Spring Displacement;Force", "'Servo Displacement' and 'Spring Displacement'"),
        ("Displacement;Force Setpoint;Force Actual", "'Force Setpoint' and 'Force Actual'"),
        ("Displacement;Load A;Load B", "'Load A' and 'Load B'"),
        ("Displacement;Spring Displacement;Force", "'Displacement' and 'Spring Displacement'"),
        ("Crosshead [mm];Extension [mm];Force [N]", r"'Crosshead \[mm\]' and 'Extension \[mm\]'"),
    ],
)
def test_ties_are_refused_with_both_names(header, names, tmp_path):
    path = written(tmp_path, header)
    with pytest.raises(InputError, match=f"each of {names} may be the .*: state both columns"):
        read_record(path, "[" in header)


@pytest.mark.parametrize("columns", [("Spring Displacement", "Force"), ("spring displacement", "FORCE [N]"), (1, 2)])
def test_stated_columns(columns, tmp_path):
    path = written(tmp_path, "Servo Displacement [mm];Spring Displacement [mm];Force [N]")
    record = read_record(path, True, columns=columns)
    assert record.forces == pytest.approx(8000 * record.extensions)
    assert record.columns == "Spring Displacement in mm and Force in N"
    law = as_spring(f"table:{path}?columns=Spring Displacement,Force", in_si=True)
    assert float(law(0.002)) == pytest.approx(16.0)
    assert "Spring Displacement in mm and Force in N" in law.text


def test_stated_columns_in_a_machine_file(tmp_path):
    written(tmp_path, "Servo Displacement;Spring Displacement;Force")
    text = "table:bench.csv?columns=Spring Displacement,Force&units=mm,N"
    masses = "[si]\nbody_mass = 0.6\nfoot_mass = 0.3\n"
    (tmp_path / "leg.toml").write_text(f'spring = "{text}"\n{masses}', encoding="utf-8")
    machine = files.build(files.read(tmp_path / "leg.toml"))
    assert float(machine.spring(0.002)) == pytest.approx(16.0)
    assert "Spring Displacement in mm and Force in N" in machine.spring.text


@pytest.mark.parametrize("head", ["", "# bench 3\n", "a;b;c\n", "a;b;c\nmm;s;N\n"])
def test_columns_by_place_need_no_header(head, tmp_path):
    (tmp_path / "bench.csv").write_text(head + "".join(f"{r};0;{8 * r}\n" for r in R), encoding="utf-8")
    record = read_record(tmp_path / "bench.csv", True, columns=(0, 2), units=("mm", "N"))
    assert (record.extensions, record.forces) == (pytest.approx(R / 1000), pytest.approx(8 * R))
    assert record.columns == ("a in mm and c in N" if "a" in head[:1] else "column 0 in mm and column 2 in N")


@pytest.mark.parametrize(
    ("header", "options", "message"),
    [
        ("Displacement;Force", {}, r"gives no unit of .Displacement., but this machine is in SI: state .*units=mm,N"),
        ("Displacement [mm];Force", {}, "gives no unit of 'Force'"),
        ("Displacement [mm];Force [N]", {"columns": ("Weg", "Force")}, "has no columns 'Weg' and 'Force'"),
        ("Displacement [mm];Force [N]", {"columns": (0, 5)}, "no row with numbers in columns 0 and 5"),
        ("Displacement [mm];Force [N]", {"columns": (1, 1)}, "'Force' cannot be both columns"),
        ("Displacement [mm];Force [N]", {"units": ("mm", "stone")}, "unknown unit 'stone'"),
    ],
)
def test_what_is_missing_is_named(header, options, message, tmp_path):
    with pytest.raises(InputError, match=message):
        read_record(written(tmp_path, header), True, **options)
