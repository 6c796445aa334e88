"""Machine code that is kept is loaded only as this user has written it."""

import os
import stat

import casadi as ca
import pytest

from orbits.symbolic.kernels import compile_function, compiled_before, compiler
from orbits.symbolic.store import KEY, store, stored

CONTENT = bytes(range(256)) * 8


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """The folder of a user who has stored one file there."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    store("code.so", CONTENT)
    return tmp_path / "persistent-orbits"


def test_what_is_stored_is_found_and_private(folder):
    assert stored("code.so") == CONTENT
    assert stored("other.so") is None
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert {file.name: stat.S_IMODE(file.stat().st_mode) for file in folder.iterdir()} == {KEY: 0o600, "code.so": 0o600}


def cut(folder):
    whole = (folder / "code.so").read_bytes()
    (folder / "code.so").write_bytes(whole[:-1])


def foreign(folder):
    (folder / "code.so").write_bytes(CONTENT)


def renamed(folder):
    store("other.so", CONTENT[::-1])
    (folder / "other.so").rename(folder / "code.so")


def emptied(folder):
    (folder / "code.so").write_bytes(b"")


def linked(folder):
    (folder / "code.so").rename(folder.parent / "elsewhere")
    (folder / "code.so").symlink_to(folder.parent / "elsewhere")


def key_of_another(folder):
    (folder / KEY).write_bytes(bytes(32))


def key_cut(folder):
    (folder / KEY).write_bytes(b"")


def key_open(folder):
    (folder / KEY).chmod(0o644)


def file_open(folder):
    (folder / "code.so").chmod(0o666)


def folder_open(folder):
    folder.chmod(0o770)


def folder_linked(folder):
    folder.rename(folder.parent / "elsewhere")
    folder.symlink_to(folder.parent / "elsewhere")


@pytest.mark.parametrize(
    "harm",
    [cut, foreign, renamed, emptied, linked, key_of_another, key_cut, key_open, file_open, folder_open, folder_linked],
)
def test_what_others_may_have_written_is_not_found(folder, harm):
    harm(folder)
    assert stored("code.so") is None


def test_a_folder_of_another_user_is_not_used(folder, monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    assert stored("code.so") is None
    store("new.so", CONTENT)
    assert not (folder / "new.so").exists()


def test_nothing_is_stored_where_it_cannot_be_made_sure_of(folder, monkeypatch):
    folder.chmod(0o777)
    store("new.so", CONTENT)
    assert not (folder / "new.so").exists()
    folder.chmod(0o700)
    monkeypatch.setattr(os, "supports_dir_fd", set())
    assert stored("code.so") is None


@pytest.mark.skipif(compiler() is None, reason="no C compiler on this machine")
def test_a_foreign_library_is_compiled_anew(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    x = ca.SX.sym("x")
    own, foreign = (ca.Function("f", [x], [n * ca.sin(x)]) for n in (2, 3))
    compile_function(own)
    (first,) = (tmp_path / "persistent-orbits").glob("*.so")
    compile_function(foreign)
    (second,) = set((tmp_path / "persistent-orbits").glob("*.so")) - {first}
    first.write_bytes(second.read_bytes())  # a sound library, of another function
    assert compiled_before(own) is None
    assert float(compile_function(own)(0.5)) == float(compiled_before(own)(0.5)) == float(own(0.5))
