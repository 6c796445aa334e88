"""The store: what is acknowledged stays, whatever happens; what is not a store of this question is refused "
"untouched."""

import os
import signal
import sqlite3
import subprocess
import sys
import textwrap
from contextlib import closing

import numpy as np
import pytest

from orbits import InputError, Sweep, sweep
from orbits.sweeps.designs import members_of
from orbits.sweeps.members import failed_table
from orbits.sweeps.question import Question, question_of
from orbits.sweeps.store import DIGEST_OF_ROW, STORE_FORMAT, Store, question_in, read_store
from problems import Hopper

MACHINE = Hopper("cubic")


def asked(count: int = 600, **options) -> Question:
    members = members_of({"beta": (0.0, 1.0)}, count, "sobol", 0, ["beta"])
    return question_of(MACHINE, members, options.get("family", 1), options.get("quantities", ()), "find", None)


def table_of(question: Question, members) -> object:
    """Some members as failed ones, with numbers to recognise."""
    table = failed_table(question, np.asarray(members), "a reason with 'quotes' and \u03b1")
    table.columns["alpha"][:] = np.asarray(members) / 3
    return table


def test_what_is_written_is_read_to_the_last_bit(tmp_path):
    question, path = asked(quantities=("period", "alpha/2")), tmp_path / "study.db"
    store = Store(path, question)
    store.write(table_of(question, [5, 7]))
    store.write(table_of(question, range(100, 600)))
    store.close()
    again = Store(path, question)
    assert np.flatnonzero(again.done()).tolist() == [5, 7, *range(100, 600)]
    found, expected = again.read(), table_of(question, [5, 7, *range(100, 600)])
    again.close()
    assert found.members.tolist() == expected.members.tolist()
    for name, column in expected.columns.items():
        np.testing.assert_array_equal(found.columns[name], column, err_msg=name)


def test_it_is_read_while_it_is_written(tmp_path):
    question, path = asked(), tmp_path / "study.db"
    store = Store(path, question)
    store.write(table_of(question, [1]))
    assert read_store(path, question.columns()).members.tolist() == [1]
    store.write(table_of(question, [2]))
    assert read_store(path, question.columns()).members.tolist() == [1, 2]
    store.close()


def test_another_question_is_refused_and_both_are_named(tmp_path):
    path = tmp_path / "study.db"
    Store(path, asked()).close()
    before = path.read_bytes()
    for other, said in (
        (asked(601), "members is 600 there, but 601"),
        (asked(family=2), r"families is \[1\] there, but \[2\] here"),
        (asked(quantities=("stroke",)), r"quantities is \[\] there, but"),
    ):
        with pytest.raises(InputError, match=said):
            Store(path, other)
    with pytest.raises(InputError, match="exists"):
        Store(path, asked(), resume=False)
    assert path.read_bytes() == before


def test_another_version_is_refused(tmp_path):
    path = tmp_path / "study.db"
    Store(path, asked()).close()
    connection = sqlite3.connect(path)
    with connection:
        connection.execute("UPDATE question SET format = 'persistent-orbits sweep 9'")
    connection.close()
    with pytest.raises(InputError, match=rf"sweep 9.*{STORE_FORMAT}"):
        Store(path, asked())


@pytest.mark.parametrize("content", [b"no database at all, but some text", b"SQLite format 3\x00" + bytes(4000)])
def test_a_file_that_is_no_store_is_refused_untouched(tmp_path, content):
    path = tmp_path / "study.db"
    path.write_bytes(content)
    with pytest.raises(InputError, match="is not a store"):
        Store(path, asked())
    assert path.read_bytes() == content


def test_a_database_of_something_else_is_refused(tmp_path):
    path = tmp_path / "other.db"
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE songs (name TEXT)")
    connection.commit()
    connection.close()
    with pytest.raises(InputError, match="is not a store"):
        Store(path, asked())


ENDLESS = "SELECT 1 FROM (WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i FROM n)"


@pytest.mark.parametrize(
    "statement",
    [
        f"CREATE VIEW members AS WITH RECURSIVE n(member) AS (SELECT 1 UNION ALL SELECT member + 1 FROM n) "
        f"SELECT member, 1 AS {DIGEST_OF_ROW} FROM n",
        f"CREATE TRIGGER endless AFTER INSERT ON members BEGIN {ENDLESS}; END",
    ],
    ids=["view", "trigger"],
)
def test_a_store_with_statements_of_its_own_is_refused(tmp_path, statement):
    """Neither a view nor a trigger need end when the store is read or written."""
    path = tmp_path / "study.db"
    Store(path, asked()).close()
    with closing(sqlite3.connect(path)) as connection, connection:
        if "VIEW" in statement:
            connection.execute("DROP TABLE members")
        connection.execute(statement)
    with pytest.raises(InputError, match="a store must have only the tables members and question"):
        Store(path, asked())


def test_a_spoilt_store_is_refused_untouched(tmp_path):
    question, path = asked(), tmp_path / "study.db"
    store = Store(path, question)
    store.write(table_of(question, range(600)))
    store.close()
    content = bytearray(path.read_bytes())
    content[8192:16384] = os.urandom(8192)
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"is damaged|is not a store"):
        Store(path, question)
    assert path.read_bytes() == content


def test_a_folder_that_is_not_there_and_a_file_that_cannot_be_written(tmp_path):
    with pytest.raises(InputError, match="no folder"):
        Store(tmp_path / "nowhere" / "study.db", asked())
    question, path = asked(), tmp_path / "study.db"
    store = Store(path, question)
    store.write(table_of(question, [3]))
    store.connection.execute("PRAGMA query_only=ON")
    with pytest.raises(InputError, match=r"study\.db cannot be written: .*readonly"):
        store.write(table_of(question, [4]))
    store.close()
    assert read_store(path, question.columns()).members.tolist() == [3]


def test_a_full_disk_is_said_and_loses_nothing(tmp_path):
    question, path = asked(), tmp_path / "study.db"
    store = Store(path, question)
    store.write(table_of(question, range(100)))
    (pages,) = store.connection.execute("PRAGMA page_count").fetchone()
    store.connection.execute(f"PRAGMA max_page_count={pages}")
    with pytest.raises(InputError, match=r"study\.db cannot be written: .*full"):
        store.write(table_of(question, range(100, 600)))
    store.close()
    assert read_store(path, question.columns()).members.tolist() == list(range(100))


@pytest.mark.parametrize("mode", ["delete", "wal"])
def test_a_store_whose_making_was_broken_off_is_made(tmp_path, mode):
    path = tmp_path / "study.db"
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute(f"PRAGMA journal_mode={mode}")
    connection.execute("CREATE TABLE question (format TEXT)")
    connection.execute("DROP TABLE question")
    connection.close()
    assert path.stat().st_size > 0
    Store(path, asked(), resume=False).close()
    assert question_in(path)["members"] == 600


@pytest.mark.slow
def test_a_kill_at_any_moment_of_its_making_leaves_a_store_that_can_be_made(tmp_path):
    """A child process is forked by one that has a single thread, and killed while it makes its store."""
    command = [sys.executable, "-c", textwrap.dedent(MAKER), str(tmp_path)]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "150 made\n"


MAKER = """
    import os, signal, sys, time
    from pathlib import Path
    import numpy as np
    from tests.sweeps.test_store import asked
    from orbits.sweeps.store import Store
    question, generator, folder = asked(), np.random.default_rng(0), Path(sys.argv[1])
    for number in range(150):
        path = folder / f"{number}.db"
        reader, writer = os.pipe()
        child = os.fork()
        if not child:
            os.write(writer, b"x")
            Store(path, question)
            signal.pause()
        os.read(reader, 1)
        time.sleep(generator.uniform(0, 0.006))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        os.close(reader), os.close(writer)
        Store(path, question).close()
    print(number + 1, "made")
"""

WRITER = """
    import sys
    from tests.sweeps.test_store import asked, table_of
    from orbits.sweeps.store import Store
    question = asked()
    store = Store(sys.argv[1], question)
    for member in range(int(store.done().sum()), 600):
        store.write(table_of(question, [member]))
        print(member, flush=True)
"""


@pytest.mark.posix
@pytest.mark.parametrize("kills", [2])
def test_nothing_that_was_acknowledged_is_lost_in_a_kill(tmp_path, kills):
    path, generator = tmp_path / "study.db", np.random.default_rng(0)
    for _ in range(kills):
        writer = subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(WRITER), str(path)], stdout=subprocess.PIPE, text=True
        )
        assert writer.stdout is not None
        acknowledged = [int(writer.stdout.readline()) for _ in range(int(generator.integers(2, 60)))]
        writer.send_signal(signal.SIGKILL)
        rest, _ = writer.communicate()
        acknowledged += [int(line) for line in rest.split("\n")[:-1]]
        found = read_store(path, asked().columns())
        assert set(range(max(acknowledged) + 1)) <= set(found.members.tolist())
    assert question_in(path)["members"] == 600


def test_small_and_large_letters_are_different_columns(tmp_path):
    machine = Hopper("b*r**3 + B*r", parameters={"b": 0.1, "B": 1.0})
    over = {"b": (0.1, 0.2), "B": (0.9, 1.1)}
    swept = sweep(machine, over, 8, store=tmp_path / "a.db")
    loaded = Sweep.load(tmp_path / "a.db")
    for name in ("b", "B", "alpha"):
        assert loaded[name].tolist() == swept[name].tolist()


def test_another_seed_or_range_is_named(tmp_path):
    machine, store = Hopper("cubic"), tmp_path / "a.db"
    sweep(machine, {"beta": (0.1, 0.2)}, 8, store=store)
    with pytest.raises(InputError, match='its drawn is "sobol, seed 0" there, but "sobol, seed 1"'):
        sweep(machine, {"beta": (0.1, 0.2)}, 8, seed=1, store=store)
    with pytest.raises(InputError, match=r"its over beta is \[0.1, 0.2\] there, but \[0.1, 0.3\] here"):
        sweep(machine, {"beta": (0.1, 0.3)}, 8, store=store)


def test_names_and_questions_that_cannot_be_read_are_refused(tmp_path):
    for name in ("x" * 300, "a\0", "a\ud800"):
        with pytest.raises(InputError, match="cannot be written"):
            Store(tmp_path / name, asked())
    path = tmp_path / "deep.db"
    with closing(sqlite3.connect(path)) as store:
        store.execute("CREATE TABLE question (format TEXT, document TEXT)")
        store.execute("CREATE TABLE members (member INTEGER PRIMARY KEY)")
        store.execute("INSERT INTO question VALUES (?, ?)", (STORE_FORMAT, "[" * 60_000))
        store.commit()
    for read in (Sweep.load, lambda path: Store(path, asked())):
        with pytest.raises(InputError, match="nested too deeply"):
            read(path)
