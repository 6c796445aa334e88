"""The README's Python runs as it stands, and what it says of the answers is so."""

import re
from pathlib import Path

import numpy as np
import pytest

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)


def executed(block: str) -> dict:
    names: dict = {}
    exec(compile(block, "README.md", "exec"), names)
    return names


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.split("\n")[0][-40:])
def test_block_runs(block, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    r = np.linspace(-8, 4, 13)
    np.savetxt("bench.csv", np.column_stack([r, r + 0.1 * r**3]), delimiter=",", header="extension,force", comments="")
    names = executed(block)
    if "Buoyed" in names:
        hop, plain = names["find"](names["Buoyed"]()), names["find"](names["Hopper"]())
        # the centre of mass falls at nine tenths of gravity, and so does the scale of the hop
        assert hop.alpha == pytest.approx(0.9 * plain.alpha, rel=1e-13)
        assert hop.admissible


@pytest.mark.parametrize("what", ["springs.formula", "gravity.function", "class Buoyed"])
def test_extensions_are_short(what):
    (block,) = (block for block in BLOCKS if what in block)
    frame = ("from ", "import ", "print(")
    assert len([line for line in block.splitlines() if line.strip() and not line.startswith(frame)]) < 15
