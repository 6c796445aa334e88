"""The table of rooms in where.md: the page states their order, and their docstrings what they contain.

python studies/docs/rooms.py writes the contents into the page.
"""

import ast
import re
from pathlib import Path

PAGE = Path(__file__).with_name("where.md")
ENGINE = Path(__file__).parents[2] / "orbits"
ROW = re.compile(r"^\| `(\w+)/?` \|.*\|\n", flags=re.MULTILINE)


def rooms() -> tuple[str, ...]:
    """The rooms of the engine from the ground up, as the page lists them."""
    return tuple(ROW.findall(PAGE.read_text(encoding="utf-8")))


def row(room: str) -> str:
    """The row of a room, a package or a module, with the first paragraph of its docstring."""
    package = ENGINE / room / "__init__.py"
    path = package if package.exists() else ENGINE / f"{room}.py"
    words = str(ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))).split("\n\n")[0]
    return f"| `{room}{'/' if path == package else ''}` | {' '.join(words.split())} |\n"


def page() -> str:
    """The page with the contents of all rooms."""
    return ROW.sub(lambda each: row(each[1]), PAGE.read_text(encoding="utf-8"))


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
