"""The notebooks: without outputs in the repository, and they run, each with a physical number that it asserts."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
NOTEBOOKS = sorted((ROOT / "studies" / "notebooks").glob("*.ipynb"))


def test_there_are_notebooks():
    assert [path.stem for path in NOTEBOOKS] == [
        *("family_and_its_fold", "first_hop", "leg_designed", "spring_of_your_own")
    ]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_kept_without_outputs(path):
    book = json.loads(path.read_text(encoding="utf-8"))
    code = [cell for cell in book["cells"] if cell["cell_type"] == "code"]
    assert all(not cell["outputs"] and cell["execution_count"] is None for cell in code)
    assert all(not cell["metadata"] for cell in book["cells"])
    assert sum("assert " in "".join(cell["source"]) for cell in code) == 1
    texts = ["".join(cell["source"]) for cell in book["cells"] if cell["cell_type"] == "markdown"]
    assert texts[0].startswith("# ")
    for link in re.findall(r"\]\(([^)]+)\)", "".join(texts)):
        assert (path.parent / link).is_file()


@pytest.mark.docs
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, tmp_path, monkeypatch):
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    monkeypatch.delenv("MPLBACKEND", raising=False)
    book = nbformat.read(path, as_version=4)
    nbformat.validate(book)
    nbclient.NotebookClient(book, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in book.cells if cell.cell_type == "code" for output in cell.outputs]
    written = "".join(output["text"] for output in outputs if output.get("name") == "stderr")
    assert not re.sub(r"^\w+ has been computing for \d+ s$", "", written, flags=re.M).strip()  # on a busy machine
    pages = [output.data["text/html"] for output in outputs if "text/html" in output.get("data", {})]
    assert any("<img " in page for page in pages)
    assert not any("no picture" in page for page in pages)
