"""Files of machine code that only this user can have written, for later processes.

They lie in a folder that belongs to the user and that nobody else may open. Each begins with its HMAC-SHA256 under a
key that only the user can read, so that a file that was cut short, renamed or put there by others is not taken. Where
that cannot be made sure of, as on systems without POSIX file modes, nothing is stored and nothing found.
"""

import hashlib
import hmac
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

KEY, DIGEST_SIZE = "key", hashlib.sha256().digest_size


def store(name: str, content: bytes) -> None:
    """Keep a file for later processes, if that is safe and there is room."""
    try:
        with _folder() as folder:
            _write(folder, name, _digest(_key(folder), name, content) + content)
    except OSError:
        pass


def stored(name: str) -> bytes | None:
    """The content of a file that this user has stored; None when there is none, and when it is not sound."""
    try:
        with _folder() as folder:
            found = _read(folder, name)
            digest, content = found[:DIGEST_SIZE], found[DIGEST_SIZE:]
            return content if hmac.compare_digest(digest, _digest(_key(folder), name, content)) else None
    except OSError:
        return None


@contextmanager
def _folder() -> Iterator[int]:
    """The folder, made where it is missing, as a descriptor: what happens to its path later does not matter.

    Raises `OSError` where it is not the user's own, or open to others.
    """
    if not hasattr(os, "geteuid") or os.open not in os.supports_dir_fd:
        raise OSError("there are no file modes that could be relied on")
    try:
        root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError as error:
        raise OSError("there is no home directory") from error
    path = root / "persistent-orbits"
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        _check_own(folder, path)
        yield folder
    finally:
        os.close(folder)


def _check_own(file: int, path: Path | str) -> None:
    """Raise `OSError` unless an open file or folder belongs to the user, and nobody else may read or write it."""
    status = os.fstat(file)
    if status.st_uid != os.geteuid() or stat.S_IMODE(status.st_mode) & 0o077:
        raise OSError(f"{path} does not belong to this user alone")


def _key(folder: int) -> bytes:
    """The user's key, made when it is first asked for."""
    try:
        key = _read(folder, KEY)
    except FileNotFoundError:
        _write(folder, KEY, secrets.token_bytes(DIGEST_SIZE), anew=True)
        key = _read(folder, KEY)  # another process may have been faster
    if len(key) != DIGEST_SIZE:
        raise OSError("the key is damaged")
    return key


def _digest(key: bytes, name: str, content: bytes) -> bytes:
    return hmac.digest(key, name.encode() + b"\0" + content, "sha256")


def _read(folder: int, name: str) -> bytes:
    file = os.open(name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK, dir_fd=folder)
    with open(file, "rb") as opened:
        _check_own(file, name)
        return opened.read()


def _write(folder: int, name: str, content: bytes, anew: bool = False) -> None:
    """Write a file in one atomic step, as other processes may read it; one that is there stays if it is to be new."""
    temporary = f"{name}.{secrets.token_hex(8)}"
    file = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600, dir_fd=folder)
    try:
        with open(file, "wb") as opened:
            opened.write(content)
        if anew:
            os.link(temporary, name, src_dir_fd=folder, dst_dir_fd=folder)
        else:
            os.replace(temporary, name, src_dir_fd=folder, dst_dir_fd=folder)
    except FileExistsError:
        pass
    finally:
        with suppress(FileNotFoundError):
            os.unlink(temporary, dir_fd=folder)
