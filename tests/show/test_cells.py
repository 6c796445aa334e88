"""What a cell of a notebook shows: whole tables, drawn pictures, and nothing that breaks."""

import base64
import re
from io import BytesIO

import numpy as np
import pytest
from cells import Cells

from orbits import ReturnMap, existence, find, follow, optimize, pareto, prove, simulate, sweep, uncertainty
from orbits.result import cell
from orbits.returns import bifurcations
from orbits.tables import VIOLATED
from problems import Hopper, hopper_in_si, steering

LARGEST_CELL = 150_000  # bytes
LINEAR_HOP = 4.493409457909064  # of the linear hopper: the first root of tan(alpha) = alpha above 0


def pixels(image: dict) -> np.ndarray:
    """The pixels (height, width, 3) of a picture within a page."""
    from PIL import Image

    kind, data = image["src"].split(",", 1)
    assert kind == "data:image/png;base64"
    return np.asarray(Image.open(BytesIO(base64.b64decode(data))).convert("RGB"))


def test_an_orbits_table_is_its_certificate():
    """Closed form: the linear hopper of equal masses lifts off with tan(alpha) = alpha and flies for 2 alpha."""
    rows = dict(find(Hopper()).rows(12))
    assert rows["alpha"].startswith("4.49340945790906 ")  # all digits that its error leaves
    assert rows["flight time"] == "8.98681891582"
    assert rows["admissible"] == "yes"
    assert VIOLATED not in rows
    short = find(Hopper(rest_length=3.0))
    rows = short.rows()
    assert [text for name, text in rows if name == VIOLATED] == list(short.violations)
    assert dict(rows)["admissible"] == "NO"
    leg = find(hopper_in_si(60.0, 3.0, force="k*r", parameters={"k": 5000.0}, rest_length=0.8))
    rows = dict(leg.rows())
    assert rows["largest contact force"].startswith(f"{leg.certificate.largest_contact_force:.7g} N")
    assert rows["rise of body"].endswith(" m)")
    printed = " ".join(str(leg).split())
    assert all(" ".join(text.split()) in printed for text in dict(leg.rows(15)).values())


def results():
    """A maker of a result of each class that shows itself, by name."""
    cubic = Hopper("r + beta*r**3", parameters={"beta": 0.3}, rest_length=8.0)
    leg = hopper_in_si(60.0, 3.0, force="k*r", parameters={"k": 5000.0}, rest_length=0.8)
    over = {"over": {"k": (3e3, 9e3)}, "subject_to": ["stroke <= 0.25"]}
    objectives = ("-centre_of_mass_rise", "largest_contact_force")
    return {
        "Orbit": lambda: find(cubic),
        "Orbit in SI": lambda: find(leg),
        "Orbit that is no motion": lambda: find(Hopper(rest_length=3.0)),
        "Family": lambda: follow(Hopper("cubic", rest_length=30), "beta", stop=-0.02, start=0.0, most=60),
        "ReturnMap": lambda: ReturnMap(cubic, inject=0.03),
        "ReturnMap in SI": lambda: ReturnMap(leg),
        "ReturnMap of a damped machine": lambda: ReturnMap(Hopper(damping=0.01)),
        "Hops": lambda: ReturnMap(cubic)([2.0, 4.0, 4.5]),
        "Simulation": lambda: simulate(Hopper(restitution=0.3, damping=0.01), 4.6, hops=3),
        "Design": lambda: optimize(leg, minimise="loss_coefficient", **over),
        "Front": lambda: pareto(leg, minimise=objectives, points=3, over=over["over"]),
        "Control": lambda: steering.keep_hopping(Hopper(damping=0.01)),
        "Disturbed": lambda: steering.keep_hopping(Hopper(damping=0.01)).simulate(3, launch_error=1e-4),
        "BifurcationDiagram": lambda: bifurcations(
            Hopper(), "inject", (0.06, 0.065), (4.5, 4.6), samples=50, sections=2, attractor=6
        ),
        "Sweep": lambda: sweep(leg, {"k": [3e3, 5e3], "body_mass": [55.0, 60.0]}, quantities=["stroke"]),
        "Sweep over three": lambda: sweep(cubic, dict.fromkeys(("beta", "mass_ratio", "rest_length"), (0.5, 0.9)), 16),
        "Existence": lambda: existence(cubic, "beta", (-0.02, 0.02), "mass_ratio", [0.5, 0.6], samples=5),
        "Uncertainty": lambda: uncertainty(leg, {"k": (4.9e3, 5.1e3)}, samples=16),
        "Proof": lambda: prove(find(cubic)),
    }


WITHOUT_PICTURE = ("Proof",)


@pytest.mark.parametrize("kind", results())
@pytest.mark.slow
def test_results_show_themselves(kind):
    """A table and a drawn picture, well formed, below 150 kB; and one line of fewer than 200 characters."""
    result = results()[kind]()
    assert "\n" not in repr(result)
    assert len(repr(result)) < 200
    page = result._repr_html_()
    assert len(page) < LARGEST_CELL
    seen = Cells(page)
    assert len(seen.rows) >= 2
    assert "no picture" not in page
    if kind in WITHOUT_PICTURE:
        assert not seen.images
        return
    (image,) = seen.images
    assert image["alt"]
    drawn = pixels(image)
    assert (drawn != 255).any(axis=2).mean() > 0.01
    assert len(np.unique(drawn @ np.array([1 << 16, 1 << 8, 1]))) > 10  # colours


@pytest.mark.slow
def test_a_cell_tells_the_numbers():
    rows = {name: text for name, text, *_ in Cells(find(Hopper())._repr_html_()).rows}
    assert float(rows["alpha"].split()[0]) == pytest.approx(LINEAR_HOP, abs=1e-6)
    family = follow(Hopper("cubic", rest_length=30), "beta", stop=-0.02, start=0.0, most=60)
    rows = {name: text for name, text, *_ in Cells(family._repr_html_()).rows}
    place = float(re.search(r"beta = (\S+),", rows["fold"])[1])
    assert place == pytest.approx(-0.0106952149164040, rel=1e-6)


def test_what_cannot_be_drawn_does_not_break_the_cell(monkeypatch):
    def failing(axes):
        raise RuntimeError("<no> ink")

    seen = Cells(cell("title", [("a", "b")], failing))
    assert seen.rows == [["a", "b"]]
    assert "no picture: <no> ink" in seen.words
    both = sweep(Hopper(), {"mass_ratio": [0.5, 1.0], "rest_length": [20.0, 30.0]}, family=[1, 2])
    assert "a figure over two or more parameters shows one family" in both._repr_html_()
    nothing = sweep(Hopper(spring="0*r"), {"mass_ratio": [0.5, 1.0]})
    assert Cells(nothing._repr_html_()).words
