"""Where figures show themselves: in pyplot where that is loaded, in the cell of a notebook, and else nowhere."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"}


def run(script: str, folder: Path) -> None:
    """Run a script in a process of its own, in which a warning is an error."""
    command = [sys.executable, "-W", "error", "-c", script]
    done = subprocess.run(command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


ALONE = """
import sys
from orbits import find
from problems import Hopper
orbit = find(Hopper())
kept = [orbit.plot() for _ in range(25)]
assert "matplotlib.pyplot" not in sys.modules
from matplotlib import pyplot
assert not pyplot.get_fignums()
"""

WITH_PYPLOT = """
from threading import Thread
from matplotlib import pyplot
from orbits import ReturnMap, find, follow, orbit_at, simulate, sweep
from orbits.show import new_axes, new_row, save_figure, thumbnails
from orbits.show.canvas import off_screen
from problems import Hopper
machine = Hopper("cubic", rest_length=8.0)
orbit = find(machine)
axes = orbit.plot()
assert pyplot.get_fignums() == [1] and pyplot.gcf() is axes.figure and pyplot.gca() is axes
pyplot.title("mine")
assert axes.get_title() == "mine"
pyplot.show()
family, run = follow(machine, "beta", 0.35), simulate(machine, 4.6, hops=1)
drawn = [orbit.plot_phase_portrait(), family.plot("loss_coefficient"), run.plot()]
drawn += [ReturnMap(machine).plot(2.0, 4.0, samples=200), new_row(2)[0]]
assert [one.figure.number for one in drawn] == [2, 3, 4, 5, 6]
_, own = pyplot.subplots()
orbit.plot(own), family.plot(axes=own)
cubes = sweep(machine, dict.fromkeys(("beta", "mass_ratio", "rest_length"), (0.5, 0.9)), 8)
assert pyplot.get_fignums() == [1, 2, 3, 4, 5, 6, 7]
orbit._repr_html_(), family._repr_html_(), cubes._repr_html_()
save_figure(own, "figure.png")
orbit.animate("hop.gif", frames=3), run.animate("run.gif", frames=3)
thumbnails(own, family, [(family[0], orbit_at(machine, family[0], "beta"))])
with off_screen():  # of more open figures pyplot warns
    kept = [new_axes() for _ in range(25)]
thread = Thread(target=orbit.plot)
thread.start(), thread.join()
assert pyplot.get_fignums() == [1, 2, 3, 4, 5, 6, 7]
"""


@pytest.mark.parametrize("script", [ALONE, pytest.param(WITH_PYPLOT, marks=pytest.mark.slow)], ids=["alone", "pyplot"])
@pytest.mark.slow
def test_figures_are_pyplots_where_pyplot_is_loaded(script, tmp_path):
    run(script, tmp_path)


CELLS = {
    "from orbits import find, follow\nfrom problems import Hopper\norbit = find(Hopper())": (0, 0),
    "orbit": (0, 1),
    "orbit.plot();": (1, 0),
    "axes = orbit.plot()\naxes.set_title('mine')\norbit.plot_phase_portrait()": (2, 0),
    "orbit.plot()\norbit": (1, 1),
    "orbit.animate('hop.gif', frames=3)": (0, 0),
    "for _ in range(3):\n    orbit._repr_html_()": (0, 0),
    "import matplotlib.pyplot as plt\nfig, axes = plt.subplots()\norbit.plot(axes)\nplt.show()": (1, 0),
    "for _ in range(3):\n    orbit.plot()\n    plt.show()": (3, 0),
}


@pytest.mark.docs
def test_figures_are_shown_once_in_a_notebook(tmp_path, monkeypatch):
    """Each cell with how many pictures it shows, and how many tables with their pictures."""
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.delenv("MPLBACKEND", raising=False)
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source) for source in CELLS])
    nbclient.NotebookClient(book, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    for cell, (pictures, tables) in zip(book.cells, CELLS.values(), strict=True):
        assert not [output for output in cell.outputs if output.output_type == "stream"]
        shown = [output.data for output in cell.outputs]
        assert sum("image/png" in data for data in shown) == pictures, cell.source
        pages = [data["text/html"] for data in shown if "text/html" in data]
        assert len(pages) == tables, cell.source
        assert all(page.count("<img ") == 1 for page in pages)
