"""Public names: imported when they are first used, and not hidden by modules of the same name."""

import importlib
import subprocess
import sys

import pytest

FILES = {
    "room/__init__.py": '''"""A room."""

from typing import TYPE_CHECKING

from orbits.public_names import public_names

if TYPE_CHECKING:
    from . import words
    from .find import find, other as other
    from .inner.deep import DEEP

__all__ = [*public_names(__name__)]
''',
    "room/find.py": "from .words import TEXT\n\n\ndef find():\n    return TEXT\n\n\nother = 3\n",
    "room/words.py": "TEXT = 'found'\n",
    "room/inner/__init__.py": "",
    "room/inner/deep.py": "DEEP = 4\n",
}


@pytest.fixture
def room(tmp_path, monkeypatch):
    """A package with a public function that has the name of its module, a public module, and a name from farther in."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    yield importlib.import_module("room")
    for name in [name for name in sys.modules if name.partition(".")[0] == "room"]:
        del sys.modules[name]


def test_names_are_imported_when_they_are_used(room):
    assert [name for name in sys.modules if name.startswith("room.")] == []
    assert room.DEEP == 4
    assert sorted(name for name in sys.modules if name.startswith("room.")) == ["room.inner", "room.inner.deep"]
    assert room.words.TEXT == "found"
    assert room.other == 3


@pytest.mark.parametrize("before", [(), ("room.find",), ("room.words", "room.find")])
def test_a_function_hides_the_module_of_its_name(room, before):
    """Whatever was imported before it, as by `from room import find` after an import of the module."""
    for name in before:
        importlib.import_module(name)
    assert room.find() == "found"
    assert importlib.import_module("room.find").find is room.find


def test_what_is_there(room):
    assert room.__all__ == ["words", "find", "other", "DEEP"]
    assert {"find", "words", "other", "DEEP", "__doc__"} <= {*dir(room)}
    assert not hasattr(room, "deep")
    with pytest.raises(AttributeError, match="module 'room' has no attribute 'missing'"):
        room.missing  # noqa: B018


def test_all_names_are_there():
    """The names of every package of the toolkit, in a fresh interpreter."""
    code = (
        "import importlib, pkgutil, orbits, problems\n"
        "for top in (orbits, problems):\n"
        "    names = [m.name for m in pkgutil.iter_modules(top.__path__, top.__name__ + '.') if m.ispkg]\n"
        "    for package in map(importlib.import_module, [*names, top.__name__]):\n"
        "        for name in getattr(package, '__all__', ()):\n"
        "            getattr(package, name)\n"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)
