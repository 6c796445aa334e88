"""Still pages: one file that loads nothing, says what it shows, and says why where it cannot be written."""

import re
import subprocess
import sys
from dataclasses import replace

import pytest

from orbits import InputError, find, follow, simulate, sweep
from problems import Hopper, hopper_in_si

pytest.importorskip("bokeh")

pytestmark = pytest.mark.extra("bokeh")

LARGEST = 5_000_000  # bytes
# What makes a browser load something from elsewhere.
LOADS = re.compile(r"""(?:src|href)\s*=\s*["']?\s*(?:https?:)?//|@import|url\(\s*["']?(?:https?:)?//""")


def checked(path) -> str:
    """The text of a page, after what all pages have in common."""
    text = path.read_text(encoding="utf-8")
    assert len(text.encode()) < LARGEST
    # In scripts such text may stand within strings, as in Bokeh's own; elements and styles are what loads.
    bare = re.sub(r"<script[^>]*>.*?</script>", "", text, flags=re.S)
    assert not LOADS.findall(bare)
    assert not re.findall(r"<script[^>]*src", text)
    assert text.startswith("<!doctype html>\n<html lang='en'>")
    assert "<meta name='viewport' content='width=device-width, initial-scale=1'>" in text
    return text


@pytest.mark.slow
def test_the_page_of_an_orbit(tmp_path):
    orbit = find(hopper_in_si(70, 5, stiffness=20_000, rest_length=1.0))
    path = orbit.page(tmp_path / "hop.html")
    assert path == tmp_path / "hop.html"
    text = checked(path)
    assert "<title>hopper in SI, family 1" in text or "<title>hopper, family 1" in text
    assert f"{orbit.alpha:.15g} m/s" in text
    assert "admissible" in text
    assert "contact force (N)" in text


@pytest.mark.slow
def test_what_a_page_says_of_an_orbit_is_escaped(tmp_path):
    orbit = find(Hopper())
    bad = "</script><script>alert(1)</script><img src=x onerror=alert(1)>"
    words = replace(orbit, machine={**orbit.machine, "spring": bad})
    text = checked(words.page(tmp_path / "hop.html"))
    assert "<script>alert" not in text
    assert "<img" not in re.sub(r"<script[^>]*>.*?</script>", "", text, flags=re.S)


@pytest.mark.slow
def test_the_page_of_a_family_has_hops(softening_family, tmp_path):
    shares = []
    text = checked(softening_family.page(tmp_path / "family.html", progress=shares.append))
    assert shares == [(i + 1) / len(shares) for i in range(len(shares))]
    assert "End: escaped" in text
    assert "Hop of the family" in text
    assert f"{softening_family[0].alpha:.7g}" in text
    assert f"{softening_family[-1].alpha:.7g}" in text
    other = checked(softening_family.page(tmp_path / "family.html", "flight_time", machine=softening_family.source))
    assert "flight time" in other


def test_the_hops_of_a_page_are_those_of_the_points():
    family = follow(hopper_in_si(70, 5, stiffness=20_000, rest_length=1.0), "foot_mass", 8)
    for point in (family[0], family[len(family) // 2], family[-1]):
        orbit = family._orbit(family.source, point)
        assert orbit.alpha == pytest.approx(point.alpha, rel=1e-12)
        assert orbit.flight_time == pytest.approx(point.flight_time, rel=1e-12)
        assert orbit.error == pytest.approx(point.error, rel=1e-9)
        assert orbit.machine["foot_mass"] == point.value


def test_the_page_of_a_sweep(tmp_path):
    swept = sweep(Hopper("cubic", rest_length=30), {"beta": [0.0, 0.1]})
    text = checked(swept.page(tmp_path / "sweep.html", "flight_time"))
    assert "2 of 2 members have flight time." in text
    assert "<title>2 of 2 members of hopper" in text
    nothing = sweep(Hopper("cubic", rest_length=30), {"beta": [-0.5]}).page(tmp_path / "nothing.html")
    assert "0 of 1 members have alpha." in checked(nothing)


@pytest.mark.parametrize(("name", "said"), [("hop.pdf", "must end in .html"), ("none/hop.html", "there is no folder")])
def test_bad_paths_are_refused(name, said, tmp_path, softening_family):
    swept = sweep(Hopper("cubic", rest_length=30), {"beta": [0.0]})
    for result in (find(Hopper()), softening_family, swept):
        with pytest.raises(InputError, match=said):
            result.page(tmp_path / name)


def test_without_bokeh_the_remedy_is_told(monkeypatch, tmp_path):
    for name in ["bokeh", *(name for name in sys.modules if name.startswith("bokeh."))]:
        monkeypatch.setitem(sys.modules, name, None)
    for result in (find(Hopper()), simulate(Hopper(restitution=0.5), 4.7, hops=1)):
        with pytest.raises(InputError, match=r"install persistent-orbits\[explore\]"):
            result.page(tmp_path / "result.html")
    assert not (tmp_path / "result.html").exists()


def test_a_page_without_a_figure_says_why(tmp_path, monkeypatch):
    run = simulate(Hopper(restitution=0.5), 4.7, hops=1)

    def refuse(*_: object, **__: object) -> None:
        raise InputError("nothing <moves>")

    monkeypatch.setattr(type(run), "plot", refuse)
    text = checked(run.page(tmp_path / "run.html"))
    assert "No figure: nothing &lt;moves&gt;" in text
    assert "<table" in text


def test_the_engine_starts_without_bokeh():
    modules = "sys, orbits, problems, orbits.show.pages.hop_view, orbits.show.pages.saved_page"
    code = f"import {modules}; print('bokeh' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"
