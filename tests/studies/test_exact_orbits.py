"""The benchmark set of exact orbits: its files, its reader, and the programs that agree on every number."""

import json
import math
import re
import shutil
import subprocess
import sys
from decimal import Decimal
from pathlib import Path
from types import SimpleNamespace

import pytest
from flint import arb, arb_poly, ctx
from scipy.optimize import brentq

from studies.exact_orbits import build, toolkit
from studies.exact_orbits.build import filled, text_of, with_table
from studies.exact_orbits.check import check
from studies.exact_orbits.doubles import Doubles
from studies.exact_orbits.motion import Problem
from studies.exact_orbits.reader import Case
from studies.exact_orbits.series import CaseError, read
from studies.exact_orbits.toolkit import COMPARED, compared
from studies.exact_orbits.zeros import first_crossing

FOLDER = Path(__file__).parents[2] / "studies" / "exact_orbits"
CASES = sorted((FOLDER / "cases").glob("*.json"))


@pytest.mark.extra("jsonschema")
def test_files_are_of_the_schema_and_have_names_titles_and_tables():
    import jsonschema

    schema = json.loads((FOLDER / "schema.json").read_text())
    validator = jsonschema.Draft202012Validator(schema)
    assert CASES
    for path in CASES:
        case = json.loads(path.read_text())
        assert not [f"{path.name}: {error.message}" for error in validator.iter_errors(case)]
        assert case["name"] == path.stem
        rows = path.with_suffix(".csv").read_text().splitlines()
        assert len(rows) == 2 + len(case["samples"]) + 2 * len(case["events"])
    validator.check_schema(schema)


def test_the_reader_is_short_and_needs_no_package(tmp_path):
    """By a step of Runge-Kutta's method, in a bare interpreter."""
    reader = tmp_path / "reader.py"
    reader.write_text((FOLDER / "reader.py").read_text())
    assert len(reader.read_text().splitlines()) <= 40
    code = f"""
from reader import Case
case = Case({str(FOLDER / "cases" / "linear_hop.json")!r})
x, t, mode = case.at(case["start"]["state"]), 0.0, case["start"]["mode"]
slopes = case["modes"][mode]["derivatives"]
def field(t, x): return case.at(slopes, t, x)
def moved(x, v, h): return {{name: x[name] + h * v[name] for name in x}}
h = case["samples"][0]["time"] / 1000
for k in range(1000):
    a = field(t, x)
    b = field(t + h/2, moved(x, a, h/2))
    c = field(t + h/2, moved(x, b, h/2))
    d = field(t + h, moved(x, c, h))
    x, t = {{n: x[n] + h * (a[n] + 2*b[n] + 2*c[n] + d[n]) / 6 for n in x}}, t + h
print(max(abs(x[n] - value) for n, value in case["samples"][0]["state"].items()))
landing, = case["modes"][mode]["events"]
print(case.at(landing["guard"], t, x) > 0, case.at(landing["reset"], t, x), case.at(case["end"]))
"""
    run = subprocess.run(
        [sys.executable, "-I", "-S", "-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r}){code}"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    error, rest = run.stdout.split("\n", 1)
    assert float(error) < 1e-12
    assert rest == "True {'y2': 0, 'v2': 0} 25\n"


def test_the_page_lists_all_cases_and_its_code_runs_by_itself(tmp_path):
    """`build.py` writes the table."""
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert with_table(page) == page
    figures = (FOLDER.parent / "docs" / "exact_orbits.md").read_text(encoding="utf-8")
    assert {*re.findall(r'draw\("(.*?)"\)', figures)} == {json.loads(path.read_text())["subject"] for path in CASES}
    code, printed = re.search(r"```python\n(.*?)```\n\n```output\n(.*?)```", page, re.DOTALL).groups()
    shutil.copytree(FOLDER / "cases", tmp_path / "cases")
    shutil.copy(FOLDER / "reader.py", tmp_path)
    command = [sys.executable, "-S", "-c", code]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert run.stdout == printed


def disagreements(paths):
    """What DOP853 in doubles, and the toolkit, do not agree on, of the files of some cases."""
    return [f"{path.stem}: {each}" for path in paths for both in check(path) for each in both if not each.agrees]


def test_programs_agree_on_a_lossless_hop_and_on_a_bouncing_ball():
    assert not disagreements([FOLDER / "cases" / f"{name}.json" for name in ("linear_hop", "bouncing_ball")])
    ball = json.loads((FOLDER / "cases" / "bouncing_ball.json").read_text())
    first = math.sqrt(2.0)
    for n, each in enumerate(ball["events"]):
        assert each["time"] == pytest.approx(first * (1 + 2 * sum(0.8**k for k in range(1, n + 1))), rel=4e-16)
        assert each["after"]["v"] == pytest.approx(first * 0.8 ** (n + 1), rel=4e-16)


@pytest.mark.parametrize("name", ["wheel", "housner", "impact_graze", "spinning_bounces", "dragged_ball"])
def test_machines_and_closed_forms_move_as_cases_say(name):
    """Without DOP853: machines from masses, springs and gaps, against equations by hand."""
    assert {path.stem for path in CASES} == COMPARED.keys()
    assert not [each for each in compared(FOLDER / "cases" / f"{name}.json") if not each.agrees]


def test_a_machine_with_another_number_is_found_out(tmp_path):
    text = (FOLDER / "cases" / "table_period_one.json").read_text()
    (path := tmp_path / "table_period_one.json").write_text(text.replace('"b": 0.7', '"b": 0.7000001'))
    assert sum(not each.agrees for each in compared(path)) > 15


@pytest.mark.slow
def test_programs_agree_on_every_case():
    assert not disagreements(CASES)


def test_a_wrong_digit_is_found(tmp_path):
    """In the 13th digit of a time, an unknown, a state or a number; and in the motion."""
    text, path = (FOLDER / "cases" / "linear_hop.json").read_text(), tmp_path / "linear_hop.json"
    for right, wrong, what in (
        ("14.292133819968978472", "14.292133819988978472", "before event 2"),
        ('"alpha": {"value": 4.493409457909', '"alpha": {"value": 4.493409457929', "condition v1 - v2 of leg 1"),
        ('"y1": 5.2075053244021', '"y1": 5.2075053244221', "at 1.25"),
        ('"value": 5.3053149041508501215', '"value": 5.3053149041708501215', "contact_time"),
        ('"time": 10, "mode": "contact"', '"time": 10, "mode": "flight"', "mode at 10"),
        ('"guard": "ground_force"', '"guard": "ground_force + 1e-10"', "guard of event 2"),
    ):
        assert text.count(right) == 1
        path.write_text(text.replace(right, wrong))
        assert any(f"what='{what}'" in each for each in disagreements([path])), what
    path.write_text(text.replace('"M": 1}', '"M": 1.001}'))
    assert len(disagreements([path])) > 20


def test_doubles_stop_at_kinks_and_go_backward():
    """A force that jumps from -1 to 1 at a kink: the motion consists of parabolas."""
    mode = {"states": ["x", "v"], "derivatives": {"x": "v", "v": "pull"}, "kinks": ["x"], "events": []}
    (case := Case(CASES[0])).update(modes={"free": mode}, formulas={"pull": "-x/max(abs(x), 1e-300)"}, parameters={})
    *_, (_, there) = Doubles(case).flow("free", 0.0, {"x": 0.5, "v": 0.0}, 8.3)
    assert there == pytest.approx({"x": 0.5 - 0.3**2 / 2, "v": -0.3}, abs=1e-12)
    *_, (_, back) = Doubles(case).flow("free", 8.3, there, 0.0)
    assert back == pytest.approx({"x": 0.5, "v": 0.0}, abs=1e-11)


def test_building_a_case_again_changes_no_digit():
    for name in ("linear_hop", "dragged_ball"):
        document = read(FOLDER / "cases" / f"{name}.json")
        assert text_of(filled(document)) == text_of(document)


def test_a_proof_that_is_lost_is_an_error(monkeypatch, tmp_path):
    shutil.copy(FOLDER / "cases" / "linear_hop.json", tmp_path)
    monkeypatch.setattr(build, "CASES", tmp_path)
    lost = SimpleNamespace(proved=False, reasons=("no theorem here",))
    monkeypatch.setitem(toolkit.PROOFS, "linear_hop", lambda: lost)
    with pytest.raises(ArithmeticError, match=r"linear_hop: .*\(no theorem here\)"):
        build.main(["linear_hop"], prove=True)
    assert (tmp_path / "linear_hop.json").read_text() == (FOLDER / "cases" / "linear_hop.json").read_text()


def test_formulas_are_not_programs():
    document = read(FOLDER / "cases" / "linear_hop.json")
    for text, words in (("open(1)", "'open.1.' in"), ("v1.real", "in 'v1.real'"), ("beta*y1", "'beta'")):
        problem = Problem(document | {"end": text})
        with pytest.raises(CaseError, match=words):
            problem.motion()
        with pytest.raises(AttributeError if "." in text else KeyError):
            Case(FOLDER / "cases" / "linear_hop.json").at(text, 0.0, {"y1": 1.0, "v1": 0.0})


def test_a_ball_with_drag_bounces_as_its_closed_form_says():
    case = json.loads((FOLDER / "cases" / "dragged_ball.json").read_text())
    g, c = case["parameters"]["g"], case["parameters"]["c"]
    time, speed, height = 0.0, 0.0, 1.0
    for each in case["events"]:

        def fallen(t, speed=speed, height=height):
            return height + (speed + g / c) * (1 - math.exp(-c * t)) / c - g * t / c

        duration = brentq(fallen, 1e-3 * (each["time"] - time), 2 * (each["time"] - time), xtol=1e-15)
        time, height = time + duration, 0.0
        speed = -case["parameters"]["e"] * ((speed + g / c) * math.exp(-c * duration) - g / c)
        assert (time, speed) == pytest.approx((each["time"], each["after"]["v"]), rel=1e-11)


def test_a_hop_with_one_landing_is_that_of_the_inverse_mass_ratio():
    two, half = (read(FOLDER / "cases" / f"mass_ratio_{name}.json")["numbers"]["next"] for name in ("two", "half"))
    assert two["value"] == half["value"]


def test_the_loss_beside_a_graze_goes_with_the_power_four_thirds():
    """Ten times as much on the side with a bounce; what is left goes with the power 1/3 of the distance."""
    for name, distance in (
        ("above_2", 1e-2),
        ("above_4", 1e-4),
        ("above_6", 1e-6),
        ("above_8", 1e-8),
        ("below_4", 1e-4),
    ):
        numbers = json.loads((FOLDER / "cases" / f"graze_{name}.json").read_text())["numbers"]
        assert numbers["coefficient"]["value"] == pytest.approx(3.6169497946021460, rel=1e-15)
        assert abs(numbers["ratio"]["value"] - 1) < 3 * distance ** (1 / 3)


def test_what_is_proved_is_about_the_numbers_of_the_case():
    """An enclosure of alpha that a theorem states has the root of the case inside."""
    proved = 0
    for path in CASES:
        case = read(path)
        for each in case["proved"]:
            found = re.search(r"; alpha in \[([-\d.]+), ([-\d.]+)\]", each["statement"])
            if found and "alpha" in case["unknowns"] and path.stem != "table_hop":  # of rounded coefficients
                low, high = map(Decimal, found.groups())
                assert low <= Decimal(case["unknowns"]["alpha"]["value"]) <= high, path.stem
                proved += 1
    assert proved > 15


def test_a_motion_that_cannot_be_followed_is_refused():
    ball = read(FOLDER / "cases" / "dragged_ball.json")
    with pytest.raises(CaseError, match="events accumulate at 6"):
        Problem(ball | {"end": "7"}).motion()
    flight = ball["modes"]["flight"]
    for text in ("log(y - 2)", "v/(y - 1)"):
        rates = flight["derivatives"] | {"v": text}
        with pytest.raises(CaseError, match="derivatives of the mode 'flight' have no value at the time 0"):
            Problem(ball | {"modes": {"flight": flight | {"derivatives": rates}}}).motion()


def polynomial(*zeros):
    """The polynomial with these zeros and the first coefficient 1, in sixty digits."""
    product = arb_poly([1])
    for zero in zeros:
        product *= arb_poly([-zero, 1])
    return product


def test_crossings_are_found_where_they_are_multiple_or_close():
    ctx.dps, cluster = 60, 1e-15
    third, close = arb(1) / 3, arb("0.5000000001")
    for direction in (-1, 0):
        place = first_crossing(polynomial(third, third, third, arb("0.9")), arb(1), direction, cluster)
        assert abs(float(place - third)) < 1e-55
    assert first_crossing(polynomial(third, third), arb(1), 0, cluster) is None
    near = polynomial(arb("0.5"), close, arb("0.7"))
    assert abs(float(first_crossing(near, arb(2), -1, cluster) - close)) < 1e-50
    assert first_crossing(near, arb("0.4"), 0, cluster) is None


def test_a_mode_is_followed_backward_in_time():
    """Half a contact before a lift-off the body is at rest."""
    document = read(FOLDER / "cases" / "linear_hop.json")
    problem, half = Problem(document), document["numbers"]["contact_time"]["value"]
    rest = problem.in_one_mode("contact", -arb(str(half)) / 2)
    assert abs(float(rest.state["v1"])) < 1e-18
    assert float(rest.state["y1"]) == pytest.approx(-1 - math.sqrt(4 + 2 * 4.493409457909064**2), rel=1e-15)
