"""Files: names to write to checked, results as JSON, documents read and checked against their types, and versions; and
the one line that describes a result."""

import errno
import hashlib
import json
import logging
import math
import os
import stat
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, BinaryIO, TypeAlias, TypeVar, get_args, get_origin, get_type_hints, is_typeddict

import numpy as np

from .errors import InputError, cut_in_the_middle

Read = TypeVar("Read")
# A JSON document or a part of one by name: numbers, texts, lists, and such documents.
Document: TypeAlias = dict[str, Any]
MEGABYTE = 1 << 20
LONGEST_ONE_LINE = 195  # characters of the line that describes a result
LONGEST_ENTRY = 100  # characters of a value in that line
FULL = {getattr(errno, name, None) for name in ("ENOSPC", "EDQUOT", "EFBIG")} - {None}  # Windows has no quotas
DIGEST = "digest"  # the key of a document that has its own
# The names, in messages, of the types that an entry of a document has to have.
WORDS = {float: "a finite number", int: "a whole number", str: "a text", bool: "true or false"}


def version(package: str) -> str:
    """The version of a package, "unknown" for sources that are used without being installed."""
    from importlib import metadata  # takes a tenth of the time of all imports

    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"


def extra_package(package: str, what: str, extra: str = "data") -> Any:
    """A package that one of the extras installs; raises `InputError`, stating its purpose, where it is
    missing."""
    try:
        return import_module(package)
    except ImportError:
        raise InputError(f"{what}, {package} is needed: pip install 'persistent-orbits[{extra}]'") from None


def in_words(values: Mapping[str, object]) -> list[str]:
    """The values as name=value, numbers with all their digits."""
    arrays = np.generic | np.ndarray
    plain = {name: value.tolist() if isinstance(value, arrays) else value for name, value in values.items()}
    return [f"{name}={value!r}" for name, value in plain.items()]


def one_line(result: object, values: Mapping[str, object]) -> str:
    """A result in one line of fewer than 200 characters: its type, and some of its values by name, the first ones for
    which there is room, long ones without their middle."""
    texts = [each if len(each) <= LONGEST_ENTRY else cut_in_the_middle(each, 70, 25) for each in in_words(values)]
    name, count = type(result).__name__, len(texts)
    while count > 1 and len(f"{name}({', '.join(texts[:count])}, ...)") > LONGEST_ONE_LINE:
        count -= 1
    return f"{name}({', '.join([*texts[:count], *(['...'] if count < len(texts) else [])])})"


def fields_in_line(result: object, *names: str) -> str:
    """A result in one line: its type, and these attributes."""
    return one_line(result, {name: getattr(result, name) for name in names})


def to_json(value: object) -> str:
    """JSON in one line, each float with all the digits that bring it back to the last bit.

    Mappings, sequences and NumPy arrays are taken; NaN and infinity raise `InputError`, since JSON has no number for
    them.
    """
    try:
        return json.dumps(value, allow_nan=False, ensure_ascii=True, default=_plain)
    except ValueError as error:
        raise InputError(f"a result cannot hold a number that is not finite: {error}") from None


def _plain(value: object) -> object:
    """A value that `json` cannot write, as one that it can."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{value!r} cannot be written as JSON")


def write_json(document: Mapping, path: str | Path, what: str) -> Path:
    """Write a document to a JSON file and return its path; `what` it is goes into the `InputError` when that fails."""
    path, text = check_ending(path, (".json",)), to_json(sealed(document)) + "\n"
    with writing(what, path) as target:
        target.write_text(text, encoding="utf-8")
    return path


def parse_json(text: str | bytes) -> Any:
    """The value of a JSON text; raises `ValueError` where an object has a name twice, since readers differ in which of
    the two they take."""

    def entries(pairs: list[tuple[str, Any]]) -> Document:
        found = dict(pairs)
        if len(found) < len(pairs):
            twice = Counter(name for name, _ in pairs).most_common(1)[0][0]
            raise ValueError(f"it has '{twice}' twice in one object: keep one of the two")
        return found

    return json.loads(text, object_pairs_hook=entries)


def canonical(value: Any) -> str:
    """The content of a JSON document, however it is laid out: keys in order, all numbers as floats."""
    if isinstance(value, Mapping):
        pairs = (f"{json.dumps(key)}:{canonical(value[key])}" for key in sorted(value))
        return f"{{{','.join(pairs)}}}"
    if isinstance(value, list | tuple):
        return f"[{','.join(map(canonical, value))}]"
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return repr(float(value)) if is_number and abs(value) < 2**1000 else json.dumps(value)


def digest(content: object, before: str = "") -> str:
    """The digest of a content; of one that follows another, also of the digest `before` it."""
    return hashlib.sha256((before + canonical(content)).encode()).hexdigest()


def sealed(document: Mapping, before: str = "") -> Document:
    """A document with its digest, as it is read again from a file."""
    content = json.loads(to_json(document))
    return {**content, DIGEST: digest(content, before)}


class Changed(ValueError):
    """The content of a file is not the one that was written."""


def unsealed(document: Any, before: str = "") -> Any:
    """A document without its digest; raises `Changed` where its content is not the one that was written."""
    parts = document.items() if isinstance(document, Mapping) else ()
    content = {name: value for name, value in parts if name != DIGEST}
    if len(content) == len(parts) or document[DIGEST] != digest(content, before):
        raise Changed("it was changed or cut after it was written: restore an earlier copy, or compute it again")
    return content


def read_sealed(file: BinaryIO) -> Any:
    """The JSON document of a file, checked against its digest."""
    return unsealed(parse_json(file.read()))


def has_digest(document: object, path: str | Path) -> bool:
    """Whether an orbit or the first line of a family has a digest. Those of version 0.1.0 have none, and the logger
    "orbits" says that they are not checked."""
    if found := isinstance(document, Mapping) and DIGEST in document:
        return found
    logging.getLogger("orbits").warning(
        "%s has no digest, like all files of version 0.1.0: its content is not checked", path
    )
    return False


def write_table(names: Sequence[str], rows: Iterable[Sequence], path: str | Path, what: str) -> Path:
    """Write a CSV file of named columns, floats with all their digits; the others as in `write_json`."""
    import csv  # as below, what few runs need

    path = Path(path)
    with writing(what, path) as target, open(target, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows([f"{each:.17g}" if isinstance(each, float) else each for each in row] for row in rows)
    return path


@contextmanager
def refusing(what: str, path: str | Path) -> Iterator[None]:
    """Where a file is written: a failure, or a name that no file can have, is an `InputError` about `what` it is."""
    from subprocess import CalledProcessError

    try:
        yield
    except InputError:
        raise
    except (OSError, ValueError, RuntimeError, CalledProcessError) as error:  # NetCDF's errors are RuntimeErrors
        full = _is_full(Path(path))
        missing = "No space left on device: " if full and "No space" not in str(error) else ""
        way = remedy("name another file", error, full)
        raise InputError(f"the {what} cannot be written to {path}: {missing}{error}; {way}") from None


def remedy(other: str, error: Exception, full: bool = False) -> str:
    """What a user can do about an error of writing: the other way, and make room where the disk or a share is full."""
    return f"make room, or {other}" if full or getattr(error, "errno", None) in FULL else other


def _is_full(path: Path) -> bool:
    """Whether a file's disk is as good as full, which the writers of NetCDF report as another error."""
    import shutil

    with suppress(OSError):
        disk = shutil.disk_usage(path.parent)  # a place without a disk, such as /proc, has a total of 0
        return disk.total > 0 and disk.free < 64 * 1024
    return False


@contextmanager
def writing(what: str, path: str | Path) -> Iterator[Path]:
    """The path to write a file to: next to the file that it then replaces in one step with its mode, so that whatever
    fails, the old file stays as it was. A link stays one, and a path that is not a file, such as a pipe, or is open
    already, as /dev/stdout, is written to directly. Failures are as with `refusing`.
    """
    with refusing(what, path):
        if (Path(path).exists() and not Path(path).is_file()) or _is_open_already(Path(path)):
            yield Path(path)
            return
        whole = Path(os.path.realpath(path))
        # A name has at most 255 bytes, and a character up to 4.
        beside = whole.with_name(f".{whole.stem[:40]}.{os.getpid()}-{threading.get_ident()}{whole.suffix}")
        try:
            yield beside
            if whole.exists():
                os.chmod(beside, stat.S_IMODE(whole.stat().st_mode))
            with open(beside, "rb+") as file:
                os.fsync(file.fileno())
            os.replace(beside, whole)
        finally:
            with suppress(OSError):
                beside.unlink()


def _is_open_already(path: Path) -> bool:
    """Whether a name leads to a descriptor of a process, as /dev/stdout does: its file has no other name for it."""
    for _ in range(40):  # as many links as a system follows
        if os.path.realpath(path.parent).startswith("/proc/"):
            return True
        if not path.is_symlink():
            return False
        path = path.parent / os.readlink(path)
    return False


def named_file(path: str | Path) -> Path:
    """The path of a file; raises `InputError` for anything that is not a name."""
    try:
        return Path(path)
    except TypeError:
        raise InputError(f"{path!r} is not a file name") from None


def check_ending(path: str | Path, endings: tuple[str, ...]) -> Path:
    """The path of a file to write; raises `InputError` when it is not a path, or has another ending than these."""
    path = named_file(path)
    if endings and path.suffix.lower() not in endings:
        raise InputError(f"'{path}' cannot be written: its name must end in {' or '.join(endings)}")
    return path


def check_path(path: str | Path, endings: tuple[str, ...]) -> Path:
    """The path of a file to write, with one of the endings if there are any; raises `InputError` where its ending, its
    folder, its permissions or a name that no file can have rule that out."""
    path = check_ending(path, endings)
    try:
        os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error  # without the name
        raise InputError(f"'{path}' cannot be written: {reason}") from None
    if not path.parent.is_dir():
        raise InputError(f"'{path}' cannot be written: there is no folder '{path.parent}'")
    if path.is_dir():
        raise InputError(f"'{path}' cannot be written: it is a folder")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise InputError(f"'{path}' cannot be written: permission denied")
    return path


@contextmanager
def nested() -> Iterator[None]:
    """Where a document is parsed or checked: one that is nested too deeply is a `ValueError`."""
    try:
        yield
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def read_file(path: str | Path, complaint: str, parse: Callable[[BinaryIO], Read], most: int = 32 * MEGABYTE) -> Read:
    """The result of `parse` for a file; whatever is wrong with it is an `InputError` that begins with the `complaint`.

    most : bytes; a larger file is refused, since a parsed file takes some twenty times its file's memory
    """
    try:
        path = Path(path)
        if path.exists() and not path.is_file():
            raise ValueError("it is a folder or a device, not a file")
        with open(path, "rb") as file, nested():
            if (size := os.fstat(file.fileno()).st_size) > most:
                raise ValueError(f"it has {size} bytes, and at most {most} are read")
            return parse(file)
    except KeyError as error:
        reason: object = f"it has no {error}"
    except (OSError, ValueError, TypeError, AttributeError, IndexError, ArithmeticError) as error:
        reason = error
    raise InputError(f"{complaint}: {reason}") from None


def conform(value: Any, kind: Any, name: str = "it") -> Any:
    """A value of a JSON or TOML document as an object of a type, with everything in it; `name` is where it stands.

    kind : float, int, str, bool, None, a union, tuple, list or mapping of such types, `numpy.ndarray`, a class with an
        `of_saved`, a dataclass, whose fields are the keys of a mapping, or a TypedDict, which may have further keys

    Raises `InputError` that names the first value that is of another type, or missing, or not finite.
    """
    origin, inner = get_origin(kind), get_args(kind)
    if kind is Any:
        return value
    if hasattr(kind, "of_saved"):
        return value if isinstance(value, kind) else kind.of_saved(value)
    if origin is UnionType:
        kinds = [each for each in inner if each is not NoneType]
        if value is None and len(kinds) < len(inner):
            return None
        of_list = [each for each in kinds if (get_origin(each) in (list, tuple)) == isinstance(value, list | tuple)]
        return conform(value, next((each for each in kinds if type(value) is each), (of_list or kinds)[0]), name)
    if is_dataclass(kind) or is_typeddict(kind):
        return _record(_mapping(value, name), kind, name)
    if origin in (tuple, list):
        return origin(_items(value, inner, name))
    if origin is not None:
        return {key: conform(each, inner[1], f"{name}.{key}") for key, each in _mapping(value, name).items()}
    if kind is np.ndarray:
        return _array(value, name)
    if kind is float and type(value) is int:
        value = float(value) if abs(value) < 2**1000 else np.inf
    if type(value) is not kind or (kind is float and not math.isfinite(value)):
        raise InputError(f"{name} = {value!r}; it must be {WORDS[kind]}")
    return value


def _mapping(value: object, name: str) -> Mapping[str, object]:
    if not isinstance(value, Mapping):
        raise InputError(f"{name} = {value!r}; it must be a table of names and values")
    return value


def _items(value: object, inner: tuple, name: str) -> list:
    """The items of a list, all of the first of the `inner` types, or each of its own."""
    if not isinstance(value, list | tuple):
        raise InputError(f"{name} = {value!r}; it must be a list")
    same = len(inner) == 1 or inner[1] is Ellipsis
    if not same and len(value) != len(inner):
        raise InputError(f"{name} = {value!r}; it must be a list of {len(inner)}")
    kinds = [inner[0]] * len(value) if same else inner
    return [conform(each, kind, f"{name}[{i}]") for i, (each, kind) in enumerate(zip(value, kinds, strict=True))]


def _array(value: object, name: str) -> np.ndarray:
    """An array of numbers, where None is NaN, or of texts, or of true and false."""
    try:
        array = np.array(value)
        array = np.array(value, dtype=float) if array.dtype.kind == "O" else array
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} is not an array") from None
    if array.dtype.kind == "f" and np.isinf(array).any():
        raise InputError(f"{name} has a number that is not finite")
    return array


@cache
def _hints(kind: Any) -> dict[str, tuple[object, bool]]:
    """The types of a record's entries by name, and whether each must be there."""
    kinds = get_type_hints(kind)
    if is_typeddict(kind):
        return {name: (each, name in kind.__required_keys__) for name, each in kinds.items()}
    return {f.name: (kinds[f.name], f.default is MISSING and f.default_factory is MISSING) for f in fields(kind)}


def _record(data: Mapping[str, object], kind: Any, name: str) -> Any:
    hints, inside = _hints(kind), "" if name == "it" else f"{name}."
    if missing := [key for key, (_, needed) in hints.items() if needed and key not in data]:
        raise InputError(f"{inside}{missing[0]} is missing")
    known = {key: conform(data[key], each, inside + key) for key, (each, _) in hints.items() if key in data}
    if is_typeddict(kind):
        return {**data, **known}
    if unknown := [key for key in data if key not in hints]:
        raise InputError(f"{inside}{unknown[0]} is unknown")
    return kind(**known)
