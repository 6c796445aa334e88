"""Files of test machines: what they write, what cannot be meant, and the sample."""

import os
import time

import numpy as np
import pytest

from orbits import InputError, find
from problems import Hopper, hopper_in_si
from problems.laws import springs

R = np.linspace(-5, 5, 11)
# Files of the line 8 N/mm, from -5 to 5 mm, as test machines write them.
LINES = {
    "a header's units, a decimal comma and semicolons": (
        "Weg [mm];Kraft (N)\n" + "".join(f"{r:.1f};{8 * r:.2f}\n" for r in R).replace(".", ",")
    ),
    "a preamble, units below the header, another column": (
        "Protocol, force against travel;;\nCustomer;M\u00fcller;\n\nTime;Standardkraft;Federweg\ns;kN;mm\n"
        + "".join(f"{i},5;{0.008 * r:.4f};{r:.1f}\n" for i, r in enumerate(R)).replace(".", ",")
    ),
    "tabs and comments": "# bench 3\r\nextension_mm\tforce_kN\r\n" + "".join(f"{r}\t{0.008 * r}\r\n" for r in R),
    "a byte order mark": "\ufeffdeflection (um),load (N)\n" + "".join(f"{1000 * r},{8 * r}\n" for r in R),
    "quoted decimal commas": (
        '"Extension (cm)","Load (N)"\n'
        + "".join(f'"{r / 10}"|"{8 * r}"\n' for r in R).replace(".", ",").replace("|", ",")
    ),
    "blanks": "; Instron\n% 2020\ntravel [mm]   force [N]\n" + "".join(f"{r}  {8 * r}\n" for r in R),
    "a commented header": "# x[m] f[N]\n" + "".join(f"{r / 1000:g} {8 * r:g}\n" for r in R),
    "a setpoint, and times named after the columns": (
        "Travel time [s];Load time [s];Travel [mm];Force setpoint [N];Force [N]\n"
        + "".join(f"{i};{i};{r};0;{8 * r}\n" for i, r in enumerate(R))
    ),
    "indented comments": "r [mm],f [N]\n  # bench 3\n" + "".join(f"{r},{8 * r}\n  # weaker\n" for r in R),
    "three decimals": "r;f\nmm;N\n" + "".join(f"{r:.3f};{8 * r:.3f}\n" for r in R).replace(".", ","),
    "compressive force": "travel (mm),Compressive load (N)\n" + "".join(f"{r},{8 * r}\n" for r in R),
    "compression": "compression/mm,force/N\n" + "".join(f"{r},{8 * r}\n" for r in R),
}


@pytest.mark.parametrize("name", LINES)
@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "utf-16"])
def test_files_of_test_machines(name, encoding, tmp_path):
    text = LINES[name]
    if encoding == "cp1252":
        text = text.removeprefix("\ufeff")
    (tmp_path / "bench.csv").write_bytes(text.encode(encoding))
    law = springs.table(tmp_path / "bench.csv", in_si=True)
    assert law.range() == pytest.approx((-0.005, 0.005))
    assert law(R / 1000) == pytest.approx(8 * R, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("r [mm],f [N]\n0,5,1,5\n1,5,2,5\n", "4 cells, the header 2: separate the columns by ; or tab"),
        ("r;f\nmm;N\n0;1.000,5\n1;2.0,5\n", "row 4: '1;2.0,5' mixes decimal commas with points"),
        ("load [N] cell displacement [mm]\n1 2\n2 3\n", "2 cells, the header 3"),
        ("r [furlong],f [N]\n0,1\n1,2\n", "unknown unit 'furlong'"),
        ("r;f\nmm;tons\n0;1\n", "unknown unit 'tons'"),
        ("r;f\nmm;N\n-1;-1,234\n0;0\n1;1,234\n2;2,468\n", "decimals or thousands"),
        ("r;f\nmm;N\n-1;-1,234\n0;0.5\n", "row 4: '0;0.5' mixes decimal commas with points"),
        ("r;f\nmm;N\n0;0\n1;nan\n", "row 4: '1;nan' does not hold two finite numbers"),
        ("Extension;Compressive force\nmm;N\n0;0\n", "'Extension' and 'Compressive force' have opposite signs"),
    ],
)
def test_files_that_cannot_be_meant(text, message, tmp_path):
    (tmp_path / "bench.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        springs.table(tmp_path / "bench.csv", in_si=True)


@pytest.mark.parametrize("header", ["r [mm],f", "r,force_kN", "r,f\nmm,N", "r (furlong),f"])
def test_a_unit_without_si_is_an_error_with_the_remedy(header, tmp_path):
    (tmp_path / "bench.csv").write_text(header + "\n" + "".join(f"{r},{r}\n" for r in R))
    with pytest.raises(InputError, match="hopper_in_si"):
        Hopper(f"table:{tmp_path / 'bench.csv'}")


def test_capital_letters_tell_mega_from_milli(tmp_path):
    for unit, newtons in (("MN", 1e6), ("mN", 1e-3)):
        (tmp_path / "bench.csv").write_text(f"r [m],f [{unit}]\n" + "".join(f"{r},{r}\n" for r in R))
        assert springs.table(tmp_path / "bench.csv", in_si=True)(2.0) == pytest.approx(2 * newtons)


@pytest.mark.posix
def test_only_regular_files_of_bounded_size_are_read(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    for path in ("/dev/zero", tmp_path / "pipe.csv"):
        with pytest.raises(InputError, match="not a regular file"):
            springs.table(path)
    with open(tmp_path / "sparse.csv", "wb") as file:
        file.truncate(10**12)
    with pytest.raises(InputError, match="larger than 32 MB"):
        springs.table(tmp_path / "sparse.csv")
    (tmp_path / "long.csv").write_text("r,f\n" + "1,1\n" * 1_000_000)
    with pytest.raises(InputError, match="more than 1000000 lines"):
        springs.table(tmp_path / "long.csv")


@pytest.mark.parametrize("content", ["r,f\n0,0\n" + "9" * 9999 + "x,1\n", "s" * 9999 + ",f\n0,0\n1,1\n"])
def test_messages_do_not_repeat_the_file(content, tmp_path):
    (tmp_path / ("b" * 200 + ".csv")).write_text(content)
    with pytest.raises(InputError) as caught:
        springs.table(tmp_path / ("b" * 200 + ".csv"))
    assert len(str(caught.value)) <= 300


def test_many_rows_are_thinned_and_say_so():
    """300,000 rows become 500 pieces, beside which the table of an exact law is off by rounding."""
    began, r = time.process_time(), np.linspace(-6, 3, 300_000)
    law = springs.table((r, r + 0.3 * r**3))
    assert time.process_time() - began < 10
    assert law.text == "table:table (500 of 300000 rows, noise not known, rows smooth to rounding)"
    assert law(R / 2) == pytest.approx(R / 2 + 0.3 * (R / 2) ** 3, abs=1e-9)


def test_the_sample_hops_as_the_spring_that_it_was_made_from():
    orbit = find(hopper_in_si(3.0, 1.5, force=f"table:{springs.SAMPLE}", rest_length=0.3))
    exact = find(hopper_in_si(3.0, 1.5, force="8000*r + 2e6*r**3", rest_length=0.3))
    assert orbit.admissible
    assert abs(orbit.alpha - exact.alpha) < 3 * orbit.certificate.alpha_noise < 0.02
