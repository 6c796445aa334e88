"""The README's Python runs as it stands, and what it says of the answers is so."""

import re
import shutil
from pathlib import Path

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


@pytest.mark.parametrize("text", FILES, ids=lambda text: text.split("\n")[0][:40])
def test_machine_file_hops(text, orbits, tmp_path):
    """With the shipped sample beside it, as the command that is shown takes it."""
    shutil.copy(springs.SAMPLE, tmp_path)
    (tmp_path / "measured.toml").write_text(text, encoding="utf-8")
    assert "orbits find --machine measured.toml --json" in README
    done = orbits("find --json --machine", tmp_path / "measured.toml")
    assert (done.code, done.document["admissible"]) == (0, True)
