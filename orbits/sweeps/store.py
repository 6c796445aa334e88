"""The store of a sweep: one SQLite file that no crash can spoil.

The file has the question, and a row for each member that is done. The members of a chunk are written in one
transaction: a killed process loses the chunks that it was working on and no other. The file may be read meanwhile.
"""

import json
import os
import sqlite3
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..io import check_path, conform, digest, named_file, nested, parse_json, sealed, to_json, unsealed
from .question import Question, SavedQuestion, Table, empty_table
from .same_equations import EQUATIONS

STORE_FORMAT = "persistent-orbits sweep 1"
DIGEST_OF_ROW = "digest_of_row"
# Seconds to wait while another process writes.
PATIENCE = 60.0
# Rows that are read at a time.
READ_AT_ONCE = 10_000


class Store:
    """The store of a question's results in a file, which is created if it does not exist."""

    def __init__(self, path: str | Path, question: Question, resume: bool = True):
        """Open the store of a question; without `resume` an existing file is refused. Raises `InputError` for a file
        that is not a store, that is damaged, or that holds the results of another question."""
        self.path, self.question = named_file(path), question
        known = os.path.exists(path) and not _has_no_table(self.path)
        if known and not resume:
            raise InputError(f"the store {path} exists: resume it, or name another file")
        if known:
            self._check_question()
        check_path(path, ())
        with self._using("written"):
            self.connection = sqlite3.connect(self.path, timeout=PATIENCE, isolation_level=None)
            self._keep_journal()
            self.connection.execute("PRAGMA synchronous=FULL")
            if not known:
                self._make()

    def done(self) -> np.ndarray:
        """Whether each member is done (m,)."""
        done = np.zeros(len(self.question), dtype=bool)
        with self._using("read"):
            columns = self.question.columns()
            selected = ", ".join(["member", *_names_in_file(columns), DIGEST_OF_ROW])
            for row in self.connection.execute(f"SELECT {selected} FROM members"):
                if _is_unspoilt(row) and row[0] < len(done):
                    done[row[0]] = True  # a spoilt member is computed again
        return done

    def statuses(self) -> dict[str, int]:
        """The number of finished members of each status."""
        with self._using("read"):
            return dict(self.connection.execute("SELECT status, COUNT(*) FROM members GROUP BY status"))

    def write(self, table: Table) -> None:
        """Write the members of a table; once this returns, they are in the file for good."""
        columns = (column.tolist() for column in table.columns.values())  # SQLite stores NaN as NULL
        rows = ((*row, _digest_of_row(row)) for row in zip(table.members.tolist(), *columns, strict=True))
        marks = ", ".join("?" * (2 + len(table.columns)))
        with self._using("written"):
            self.connection.execute("BEGIN IMMEDIATE")
            try:
                self.connection.executemany(f"INSERT OR REPLACE INTO members VALUES ({marks})", rows)
                self.connection.execute("COMMIT")
            except BaseException:
                if self.connection.in_transaction:
                    self.connection.execute("ROLLBACK")
                raise

    def read(self) -> Table:
        """All members that are done, in order."""
        with self._using("read"):
            return _read(self.connection, self.question.columns())

    def close(self) -> None:
        """Close the file."""
        self.connection.close()

    def _keep_journal(self) -> None:
        """Journal writes ahead. While another process does the same, SQLite refuses immediately, without a timeout."""
        until = time.monotonic() + PATIENCE
        while True:
            try:
                self.connection.execute("PRAGMA journal_mode=WAL")
                return
            except sqlite3.OperationalError as error:
                if "locked" not in str(error) or time.monotonic() > until:
                    raise
            time.sleep(0.01)

    def _make(self) -> None:
        requested = self.question.columns()
        kinds = ({str: "TEXT", int: "INTEGER"}.get(kind, "REAL") for kind in requested.values())
        columns = ", ".join(map(" ".join, zip(_names_in_file(requested), kinds, strict=True)))
        self.connection.execute("BEGIN IMMEDIATE")
        if _tables_of(self.connection):  # another process has begun the same store meanwhile
            self.connection.execute("ROLLBACK")
            self._check_question()
            return
        self.connection.execute("CREATE TABLE question (format TEXT, document TEXT)")
        document = to_json(sealed(self.question.document()))
        self.connection.execute("INSERT INTO question VALUES (?, ?)", (STORE_FORMAT, document))
        self.connection.execute(f"CREATE TABLE members (member INTEGER PRIMARY KEY, {columns}, {DIGEST_OF_ROW} TEXT)")
        self.connection.execute("COMMIT")

    def _check_question(self) -> None:
        """Raise `InputError` where the store holds the results of another question."""
        document = question_in(self.path)
        if document != json.loads(to_json(self.question.document())):
            other = _other_question(document, self.question)
            raise InputError(f"the store {self.path} belongs to another sweep: {other}")

    @contextmanager
    def _using(self, what: str) -> Iterator[None]:
        """Read or write the file in this context: an error of SQLite becomes an `InputError` that names the file and
        the data that are safe."""
        try:
            yield
        except sqlite3.Error as error:
            safe = "it keeps all its members; resume it once this is mended"
            raise InputError(f"the store {self.path} cannot be {what}: {error}; {safe}") from None


def _has_no_table(path: Path) -> bool:
    """Whether a file is empty, or a database without a table, as left by a process killed while it made a store."""
    if not path.is_file() or path.stat().st_size == 0:
        return path.is_file()
    try:
        with _database_at(path) as connection:
            return not _tables_of(connection)
    except sqlite3.Error:
        return False


def question_in(path: str | Path) -> dict[str, Any]:
    """The question's document in a store; raises `InputError` for a file that is not a store, or is damaged."""
    complaint = f"{path} is not a store of a sweep"
    if not os.path.isfile(path):
        raise InputError(f"{complaint}: " + ("it is a folder" if os.path.isdir(path) else "there is no such file"))
    try:
        with _database_at(path) as connection, nested():
            _check_tables(connection)
            (check,) = connection.execute("PRAGMA quick_check(1)").fetchone()
            if check == "ok":
                kind, text = connection.execute("SELECT format, document FROM question").fetchone()
                document = unsealed(parse_json(text))
                if DIGEST_OF_ROW not in [row[1] for row in connection.execute("PRAGMA table_info(members)")]:
                    raise ValueError("it was changed after it was written: restore an earlier copy")
    except (sqlite3.Error, TypeError, ValueError) as error:
        raise InputError(f"{complaint}: {error}") from None
    if check != "ok":
        found = check.splitlines()[-1]
        raise InputError(f"the store {path} is damaged ({found}): restore an earlier copy, or begin another one")
    if kind != STORE_FORMAT:
        raise InputError(f"the store {path} has the format {kind!r}; this version reads {STORE_FORMAT!r}")
    conform(document, SavedQuestion, f"{complaint}: its question")
    return document


def read_store(path: str | Path, columns: Mapping[str, type]) -> Table:
    """The members that are done in a store, with the named columns."""
    try:
        with _database_at(path) as connection:
            return _read(connection, columns)
    except sqlite3.Error as error:
        raise InputError(f"the store {path} cannot be read: {error}") from None


@contextmanager
def _database_at(path: str | Path) -> Iterator[sqlite3.Connection]:
    """An existing database, for reading only. It is not opened in SQLite's read-only mode, which would neither roll
    back the unfinished transaction of a killed process nor remove the auxiliary files of the database."""
    connection = sqlite3.connect(f"{Path(path).absolute().as_uri()}?mode=rw", timeout=PATIENCE, uri=True)
    try:
        connection.execute("PRAGMA query_only=ON")
        yield connection
    finally:
        connection.close()


def _read(connection: sqlite3.Connection, columns: Mapping[str, type]) -> Table:
    (count,) = connection.execute("SELECT COUNT(*) FROM members").fetchone()
    table = empty_table(count, columns)
    selected = ", ".join(["member", *_names_in_file(columns), DIGEST_OF_ROW])
    rows, first = connection.execute(f"SELECT {selected} FROM members ORDER BY member LIMIT {count}"), 0
    while part := rows.fetchmany(READ_AT_ONCE):
        if spoilt := [row[0] for row in part if not _is_unspoilt(row)]:
            remedy = "resume the sweep with this store, which computes damaged members again"
            raise InputError(f"the store's member {spoilt[0]} was changed after it was written: {remedy}")
        members, *values = zip(*part, strict=True)
        last = first + len(part)
        table.members[first:last] = members
        for (name, column), entries in zip(table.columns.items(), values, strict=False):  # the digests come last
            if columns[name] is str:
                shared = {text: text for text in entries}  # a million members have few different texts
                column[first:last] = [shared[text] for text in entries]
            else:
                column[first:last] = np.array(entries, dtype=float)  # None is NaN
        first = last
    if first < count:
        raise InputError(f"the store has {count} members, but only {first} can be read: restore an earlier copy")
    return table


def _tables_of(connection: sqlite3.Connection) -> int:
    """The number of tables of a database."""
    return connection.execute("SELECT COUNT(*) FROM sqlite_master").fetchone()[0]


def _check_tables(connection: sqlite3.Connection) -> None:
    """Raise `ValueError` for a database with more than the two tables of a store: to read a view, or to write where
    there is a trigger, runs statements of its author, which need not end."""
    found = connection.execute("SELECT name, sql FROM sqlite_master").fetchall()
    plain = {name for name, statement in found if str(statement).startswith(f"CREATE TABLE {name} (")}
    if plain != {"question", "members"} or len(found) > len(plain):
        names = ", ".join(sorted(str(name) for name, _ in found))
        raise ValueError(f"a store must have only the tables members and question, but this one has {names}")


def _digest_of_row(row: Sequence[object]) -> str:
    """The digest of the values of a member."""
    plain = [None if isinstance(value, float) and value != value else value for value in row]
    return digest(plain)[:16]


def _is_unspoilt(row: Sequence[object]) -> bool:
    """Whether a member agrees with its digest."""
    try:
        return row[-1] == _digest_of_row(row[:-1])
    except TypeError:  # bytes where a text or a number was
        return False


def _names_in_file(columns: Iterable[str]) -> list[str]:
    """The names of columns in a file, in which SQLite does not distinguish upper and lower case."""
    names, taken = list[str](), {"member"}
    for i, name in enumerate(columns):
        names.append(f'"{name} ({i})"' if name.lower() in taken else f'"{name}"')
        taken.add(name.lower())
    return names


def _other_question(document: Mapping[str, object], question: Question) -> str:
    """The difference between the question in a store and another question, in words."""
    had: object = document
    wanted, place = json.loads(to_json(question.document())), "its"
    while isinstance(had, Mapping) and isinstance(wanted, Mapping):
        name = next((name for name in {**wanted, **had} if had.get(name) != wanted.get(name)), None)
        if name is None:
            return "it has further parts"
        if name == EQUATIONS:
            return "its machine has other equations, for example from another table or function of the same name"
        had, wanted, place = had.get(name), wanted.get(name), f"{place} {name}"
    return f"{place} is {_short(had)} there, but {_short(wanted)} here"


def _short(value: object) -> str:
    text = to_json(value)
    return text if len(text) <= 100 else f"{text[:60]} ... {text[-30:]}"
