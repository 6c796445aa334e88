"""`orbits explore` as a process of its own, for tests."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

ROOT = Path(__file__).parents[3]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "error"}
# Bokeh heeds these for pages of other kinds.
ENVIRONMENT |= {"BOKEH_RESOURCES": "cdn", "BOKEH_ALLOW_WS_ORIGIN": "*"}


def command(*options: str, before: str = "") -> list[str]:
    """The command that serves the page with these options; its process begins with the code `before`."""
    main = f"{before}from problems.command.cli import main; main()"
    return [sys.executable, "-c", main, "explore", "--no-browser", *options]


@contextmanager
def served(*options: str, before: str = "") -> Iterator[tuple[str, subprocess.Popen]]:
    """The address of the page that the command serves with these options, and its process."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command("--port", "0", *options, before=before), **pipes, env=ENVIRONMENT) as process:
        try:
            yield process.stdout.readline().split(" ")[0], process
        finally:
            process.kill()


def descendants(pid: int) -> list[int]:
    """The processes that a process has started, and those that these have."""
    parents = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # of a process that has just ended
            state, parent = path.read_text().rpartition(")")[2].split()[:2]
            if state != "Z":
                parents[int(path.parent.name)] = int(parent)
    found = [pid]
    for one in found:
        found += [child for child, parent in parents.items() if parent == one]
    return found[1:]
