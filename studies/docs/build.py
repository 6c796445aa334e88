"""Build the documentation: python studies/docs/build.py [--output FOLDER]

The pages are static: FOLDER/index.html opens from the disk, without a server and without a network. Figures and parsed
pages are kept in FOLDER/.cache, so that a second build takes only what has changed. Warnings are errors.
"""

import argparse
import sys
from pathlib import Path

from sphinx.cmd.build import main as sphinx_build

HERE = Path(__file__).parent


def build(output: Path) -> int:
    """Build the site into a folder; returns the exit code of Sphinx."""
    kept = output / ".cache"
    options = ["--fail-on-warning", "--keep-going", "--quiet", "-b", "html", "-d", str(kept / "doctrees")]
    return sphinx_build([*options, str(HERE), str(output)])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("site"), help="folder for the pages")
    folder = parser.parse_args().output.resolve()
    code = build(folder)
    print(f"{folder / 'index.html'}" if code == 0 else "the documentation has errors, listed above")
    sys.exit(code)
