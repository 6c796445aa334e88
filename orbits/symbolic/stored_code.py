"""Machine code that is stored for the next process, in a folder that belongs to the user alone.

Object files are named by a digest of the text that they are made of, of the versions and of the processor, and begin
with a digest of themselves, so that a file that is cut off is not used. Whoever can write to the folder can run code as
the user: it is used only where it is the user's own, nobody else may write to it, and nobody else may rename a folder
above it. `PERSISTENT_ORBITS_CACHE` names another folder, from the root on; empty or `off`, it lets nothing be stored.
"""

import hashlib
import os
import re
from contextlib import suppress
from functools import cache
from pathlib import Path
from stat import S_ISDIR, S_ISVTX, S_IWGRP, S_IWOTH
from typing import NamedTuple


class StoreOptions(NamedTuple):
    """How much is stored."""

    files: int = 8192  # at most, each of some 15 kB; beyond that the half written first is removed


STORE = StoreOptions()
VARIABLE = "PERSISTENT_ORBITS_CACHE"
OWN_NAME = re.compile("[0-9a-f]{64}")  # of a digest


def folder() -> Path | None:
    """The folder where code is stored, made where it is missing; None where nothing is to be stored."""
    stated = os.environ.get(VARIABLE)
    return None if stated is not None and stated in ("", "off") else _safe_folder(stated or _usual_folder())


def _usual_folder() -> str:
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return os.path.join(base, "persistent-orbits")


@cache
def _safe_folder(name: str) -> Path | None:
    """A folder, where it is the user's own, nobody else may write to it, and others may rename none above it."""
    if not hasattr(os, "getuid") or not os.path.isabs(name):  # no owner is known, or it is another one elsewhere
        return None
    try:
        path = Path(name)
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        found, above = path.lstat(), [each.stat() for each in path.resolve().parents]
    except OSError:
        return None
    own = S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & (S_IWGRP | S_IWOTH)
    open_above = any(each.st_mode & (S_IWGRP | S_IWOTH) and not each.st_mode & S_ISVTX for each in above)
    return path if own and not open_above else None


def load(key: bytes) -> bytes:
    """The code with a key, empty where there is none."""
    if (path := folder()) is None:
        return b""
    try:
        whole = (path / key.hex()).read_bytes()
    except OSError:
        return b""
    size = hashlib.sha256().digest_size
    return whole[size:] if hashlib.sha256(whole[size:]).digest() == whole[:size] else b""


def store(key: bytes, code: bytes) -> None:
    """Store code for the next process, where that is possible."""
    import tempfile

    if (path := folder()) is None:
        return
    with suppress(OSError):
        _make_room(path)
        handle, name = tempfile.mkstemp(dir=path)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(hashlib.sha256(code).digest() + code)
            os.replace(name, path / key.hex())  # at once, so that no other process reads a part
        except BaseException:
            os.unlink(name)
            raise


def _make_room(path: Path) -> None:
    """Remove the half of the stored files that was written first, where there are too many; other files stay."""
    if len(os.listdir(path)) < STORE.files:
        return
    files = [each for each in path.iterdir() if OWN_NAME.fullmatch(each.name)]
    if len(files) >= STORE.files:
        for each in sorted(files, key=lambda file: file.stat().st_mtime)[: len(files) // 2]:
            each.unlink(missing_ok=True)
