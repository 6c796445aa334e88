"""Machine code that is stored for the next process: found again, never cut off, and in no folder of somebody else."""

import os

import numpy as np
import pytest
from kernel_functions import assert_equal, countdown, starts

from orbits.symbolic import Kernel, machine_code, stored_code
from orbits.symbolic.machine_code import MachineCode, coded

pytestmark = pytest.mark.posix
KEY = b"0" * 32


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder for code, which is made when it is first used."""
    path = tmp_path / "own" / "code"
    monkeypatch.setenv("PERSISTENT_ORBITS_CACHE", str(path))
    return path


def test_the_next_process_finds_the_code(folder, monkeypatch):
    """Nothing is compiled again, and the results are equal."""
    first = Kernel(countdown())
    first.compile()
    assert folder.stat().st_mode & 0o777 == 0o700
    monkeypatch.setattr(machine_code, "store", lambda *_: pytest.fail("it is compiled again"))
    second = Kernel(countdown())
    second.compile()
    assert second._code.compiled == first._code.compiled
    arguments = starts(9, 2), np.ones((1, 1))
    assert_equal(first(*arguments), second(*arguments))


def test_what_is_cut_off_is_not_used(folder):
    """Nor what is changed; it is made again."""
    stored_code.store(KEY, b"code" * 100)
    (file,) = folder.iterdir()
    assert stored_code.load(KEY) == b"code" * 100
    for wrong in (file.read_bytes()[:-1], b"", file.read_bytes()[:-1] + b"x"):
        file.write_bytes(wrong)
        assert stored_code.load(KEY) == b""


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o720])
def test_a_folder_that_others_may_write_to_is_not_used(folder, mode):
    folder.mkdir(parents=True)
    folder.chmod(mode)
    stored_code.store(KEY, b"code")
    assert not [*folder.iterdir()]
    (folder / KEY.hex()).write_bytes(b"code")
    assert stored_code.load(KEY) == b""


def test_a_folder_below_one_that_others_may_write_to_is_not_used(folder):
    """They could put another one in its place."""
    folder.mkdir(parents=True)
    folder.parent.chmod(0o777)
    stored_code.store(KEY, b"code")
    assert not [*folder.iterdir()]


@pytest.mark.parametrize("name", ["code", "~/code", "./code"])
def test_a_folder_that_depends_on_the_place_is_not_used(tmp_path, monkeypatch, name):
    """It would be another one, unchecked, after a change of the working folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PERSISTENT_ORBITS_CACHE", name)
    stored_code.store(KEY, b"code")
    assert not [*tmp_path.iterdir()]


def test_a_folder_of_somebody_else_is_not_used(folder, monkeypatch):
    folder.mkdir(parents=True)
    monkeypatch.setattr(os, "getuid", lambda: folder.stat().st_uid + 1)
    stored_code.store(KEY, b"code")
    assert not [*folder.iterdir()]


def test_a_link_to_a_folder_is_not_used(folder, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    folder.parent.mkdir()
    folder.symlink_to(tmp_path / "elsewhere")
    stored_code.store(KEY, b"code")
    assert not [*(tmp_path / "elsewhere").iterdir()]


@pytest.mark.parametrize("off", ["", "off"])
def test_nothing_is_stored_where_that_is_switched_off(monkeypatch, off):
    monkeypatch.setenv("PERSISTENT_ORBITS_CACHE", off)
    assert stored_code.folder() is None
    stored_code.store(KEY, b"code")
    assert stored_code.load(KEY) == b""


def test_a_folder_that_cannot_be_made(tmp_path, monkeypatch):
    """Is as none."""
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("PERSISTENT_ORBITS_CACHE", str(tmp_path / "file" / "code"))
    stored_code.store(KEY, b"code")
    assert stored_code.load(KEY) == b""


def test_only_so_many_files_are_stored(folder, monkeypatch):
    """The files written first are removed; one of name stays."""
    folder.mkdir(parents=True)
    (folder / "letter.txt").write_text("mine")
    monkeypatch.setattr(stored_code, "STORE", stored_code.STORE._replace(files=6))
    for i in range(20):
        stored_code.store(bytes([i]) * 32, b"code")
        os.utime(folder / (bytes([i]) * 32).hex(), (i, i))
    assert len([*folder.iterdir()]) <= 7
    assert (folder / "letter.txt").read_text() == "mine"
    assert stored_code.load(bytes([19]) * 32) == b"code"
    assert stored_code.load(bytes([3]) * 32) == b""


def test_another_processor_has_code_of_its_own(monkeypatch, folder):
    """And so has another version of what makes it."""
    one = MachineCode(coded(countdown())).key
    monkeypatch.setattr(machine_code, "_maker", lambda: "another one")
    assert MachineCode(coded(countdown())).key != one
