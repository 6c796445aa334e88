"""The README's Python runs as it stands, and what it says of the answers is so."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from problems import springs

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
BLOCKS, FILES = (
    re.findall(rf"^```{kind}\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL) for kind in ("python", "toml")
)


def executed(block: str) -> dict:
    names: dict = {}
    exec(compile(block, "README.md", "exec"), names)
    return names


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.split("\n")[0][-40:])
def test_block_runs(block, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = executed(block)
    if "Mechanism" in names:
        linear = names["leg"].with_values(c=0.0)
        m1, m2, k, _, b = (linear.values[name] for name in ("m1", "m2", "k", "c", "b"))
        x = names["find"](linear).flight_time / 2 * np.sqrt(k / (m1 * m2 / (m1 + m2) + b))
        assert x == pytest.approx(np.tan(x), rel=1e-12)


@pytest.mark.parametrize("what", ["springs.formula", "gravity.function", "leg = Mechanism"])
def test_extensions_are_short(what):
    (block,) = (block for block in BLOCKS if what in block)
    frame = ("from ", "import ", "print(")
    assert len([line for line in block.splitlines() if line.strip() and not line.startswith(frame)]) < 15


@pytest.mark.parametrize("text", FILES, ids=lambda text: text.split("\n")[0][:40])
def test_machine_file_hops(text, orbits, tmp_path):
    """With the shipped sample beside it, as the command that is shown takes it."""
    shutil.copy(springs.SAMPLE, tmp_path)
    (tmp_path / "measured.toml").write_text(text, encoding="utf-8")
    assert "orbits find --machine measured.toml --json" in README
    done = orbits("find --json --machine", tmp_path / "measured.toml")
    assert (done.code, done.document["admissible"]) == (0, True)
