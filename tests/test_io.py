"""Files: an old one survives whatever fails, and a changed one is not read as another."""

import json
import os
import random
import sqlite3
import stat
import subprocess
import sys
from contextlib import closing
from io import FileIO

import numpy as np
import pytest
from browser import PATIENCE

from orbits import Family, InputError, Orbit, Sweep, find, follow, prove, simulate, sweep
from orbits.io import digest, sealed, to_json, unsealed, writing
from problems import Hopper


@pytest.fixture(scope="module")
def orbit():
    return find(Hopper("cubic", rest_length=9.0, parameters={"beta": 0.3}))


@pytest.fixture(scope="module")
def family():
    return follow(Hopper("cubic", rest_length=9.0), "beta", stop=0.4, longest=0.2)


@pytest.fixture(scope="module")
def swept():
    return sweep(Hopper("cubic", rest_length=9.0), {"beta": (0.0, 1.0)}, samples=6)


def writers(orbit, family, swept):
    """Everything that is written, by ending."""
    return {
        "orbit.json": orbit.save,
        "family.jsonl": family.save,
        "family.csv": family.save,
        "family.nc": family.save,
        "sweep.json": swept.save,
        "sweep.csv": swept.save,
        "sweep.nc": swept.save,
        "proof.json": lambda path: prove(orbit, motion=False).save(path),
        "figure.png": lambda path: save(orbit, path),
        "figure.pdf": lambda path: save(orbit, path),
    }


def save(orbit, path):
    from matplotlib import pyplot

    from orbits.show import save_figure

    axes = orbit.plot()
    try:
        save_figure(axes, path)
    finally:
        pyplot.close(axes.figure)


KINDS = (
    *("orbit.json", "family.jsonl", "family.csv", "family.nc", "sweep.json", "sweep.csv", "sweep.nc", "proof.json"),
    *("figure.png", "figure.pdf"),
)


class TestWriting:
    @pytest.mark.parametrize(
        "name",
        [pytest.param(name, marks=pytest.mark.extra("xarray") if name.endswith(".nc") else ()) for name in KINDS],
    )
    def test_a_failure_leaves_the_old_file(self, name, tmp_path, monkeypatch, orbit, family, swept):
        """The disk is full as the file is to be made durable."""
        path, write = tmp_path / name, writers(orbit, family, swept)[name]
        path.write_bytes(b"old")

        def full(descriptor):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("os.fsync", full)
        with pytest.raises(InputError, match="No space left"):
            write(path)
        assert path.read_bytes() == b"old"
        assert [each.name for each in tmp_path.iterdir()] == [name]
        monkeypatch.undo()
        write(path)
        assert path.read_bytes() != b"old"
        assert [each.name for each in tmp_path.iterdir()] == [name]

    @pytest.mark.posix
    def test_links_and_modes_stay(self, tmp_path, orbit):
        path, link = tmp_path / "orbit.json", tmp_path / "link.json"
        path.write_bytes(b"old")
        path.chmod(0o640)
        link.symlink_to(path)
        orbit.save(link)
        assert link.is_symlink()
        assert Orbit.load(path).alpha == orbit.alpha
        assert stat.S_IMODE(path.stat().st_mode) == 0o640

    @pytest.mark.posix
    def test_what_is_no_file_is_written_to(self, tmp_path):
        with writing("text", "/dev/null") as target:
            target.write_text("nothing")
        link = tmp_path / "link.json"
        link.symlink_to("/dev/stdout")
        script = (
            "import sys; from orbits import io; print(0, flush=True); io.write_json({'x': 1}, sys.argv[1], 'table')"
        )
        with open(tmp_path / "out.txt", "w", encoding="utf-8") as out:
            subprocess.run([sys.executable, "-c", script, str(link)], stdout=out, check=True, timeout=PATIENCE)
        assert (tmp_path / "out.txt").read_text().startswith('{"x": 1')  # it is opened anew, as a shell's > does
        assert link.is_symlink()

    def test_a_family_that_grows_leaves_the_old_one(self, tmp_path, monkeypatch, family):
        """The disk is full after some points: nothing is lost, neither of the old family nor of what was found."""
        machine, path = Hopper("cubic", rest_length=9.0), tmp_path / "family.jsonl"
        follow(machine, "beta", stop=0.1, longest=0.2, output=path)
        old, write, lines = path.read_bytes(), FileIO.write, []

        class Full(FileIO):
            def write(self, data):
                lines.append(data)
                if len(lines) > 3:
                    raise OSError(28, "No space left on device")
                return write(self, data)

        monkeypatch.setattr("orbits.continuation.checkpoint.FileIO", Full)
        with pytest.raises(InputError, match=r"family.part.jsonl: \[Errno 28\] No space left"):
            follow(machine, "beta", stop=0.4, longest=0.2, output=path)
        assert path.read_bytes() == old
        part = Family.load(tmp_path / "family.part.jsonl")
        assert part.points == family.points[:3]
        monkeypatch.undo()
        whole = follow(machine, "beta", stop=0.4, longest=0.2, resume=part, output=path)
        assert Family.load(path) == whole
        assert whole[-1].alpha == pytest.approx(family[-1].alpha, rel=1e-13)

    @pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is full")
    @pytest.mark.parametrize("asked", ["find", "find --spring none_such --json"])
    def test_a_full_standard_output(self, asked):
        command = [sys.executable, "-m", "orbits", *asked.split()]
        with open("/dev/full", "w", encoding="utf-8") as full:
            done = subprocess.run(
                command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=PATIENCE
            )
        assert done.returncode == 2
        assert done.stderr.startswith("orbits: ")
        assert all(line.startswith("  ") for line in done.stderr.splitlines()[1:])  # one message

    @pytest.mark.posix
    @pytest.mark.parametrize("after", range(4))
    def test_a_kill_leaves_the_old_file_or_the_new_one(self, after, tmp_path):
        path = tmp_path / "table.json"
        path.write_text('{"old": 1}')
        script = (
            "import os, sys\n"
            "from orbits import io\n"
            "names = ['chmod', 'fsync', 'replace']\n"
            f"after = {after}\n"
            "if after < len(names): setattr(os, names[after], lambda *args: os._exit(9))\n"
            "io.write_json({'new': [1.5] * 1000}, sys.argv[1], 'table')\n"
        )
        done = subprocess.run([sys.executable, "-c", script, str(path)], cwd=os.getcwd(), check=False, timeout=PATIENCE)
        content = json.loads(path.read_text())
        assert ("new" in content) == (done.returncode == 0) == (after == 3)


class TestDigests:
    def test_a_file_that_was_laid_out_anew_holds(self, tmp_path, orbit):
        path = orbit.save(tmp_path / "orbit.json")
        document = json.loads(path.read_text())
        path.write_text(json.dumps(dict(reversed(document.items())), indent=3))
        assert Orbit.load(path).alpha == orbit.alpha

    @pytest.mark.parametrize("path", [0, np.zeros(0), None])
    def test_what_is_no_path_is_refused(self, path):
        with pytest.raises(InputError, match="is not a saved orbit"):
            Orbit.load(path)

    @pytest.mark.parametrize("name", ["alpha", "flight_time", "mass_ratio", "family"])
    def test_a_changed_number_is_refused(self, tmp_path, orbit, name):
        path = orbit.save(tmp_path / "orbit.json")
        document = json.loads(path.read_text())
        path.write_text(json.dumps(document | {name: 2 * document[name]}))
        with pytest.raises(InputError, match="changed or cut after it was written"):
            Orbit.load(path)

    def test_a_changed_orbit_is_measured_anew_where_that_is_asked_for(self, tmp_path, orbit, orbits):
        path = orbit.save(tmp_path / "orbit.json")
        document = json.loads(path.read_text())
        path.write_text(json.dumps(document | {"alpha": 1.01 * document["alpha"], "family": 7, "error": 0.0}))
        with pytest.raises(InputError, match=r"find\(machine, start=FILE\)"):
            Orbit.load(path)
        again = find(orbit.source, start=path)
        assert again.alpha == pytest.approx(orbit.alpha, abs=1e-14)
        assert (again.family, again.error > 0) == (1, True)
        asked = f"find --spring cubic --set beta=0.3 --rest-length 8 --json --start '{path}'"
        assert orbits(asked).document["alpha"] == pytest.approx(orbit.alpha, abs=1e-14)
        assert orbits(asked, "--family", "2").code == 1

    def test_changed_digits_are_refused(self, tmp_path, orbit):
        """Any digit of the file, or another sign in its place; what holds is the same to the last bit."""
        path, rng = orbit.save(tmp_path / "orbit.json"), random.Random(5)
        text = path.read_text()
        same = to_json(Orbit.of_saved(unsealed(json.loads(text))).saved())
        places = [i for i, character in enumerate(text) if character.isdigit()]
        for place in rng.sample(places, 50):
            path.write_text(text[:place] + rng.choice("0123456789") + text[place + 1 :])
            try:
                assert to_json(Orbit.load(path).saved()) == same
            except InputError:
                continue

    def test_a_name_twice_in_a_file_is_refused(self, tmp_path, orbit, family):
        """JSON's readers differ in which of two values they take, and the digest is of the last."""
        path, lines = orbit.save(tmp_path / "orbit.json"), family.save(tmp_path / "family.jsonl")
        path.write_text('{"alpha": 9.5, ' + path.read_text()[1:])
        lines.write_text('{"along": "mass_ratio", ' + lines.read_text()[1:])
        for load, name in ((lambda: Orbit.load(path), "alpha"), (lambda: Family.load(lines), "along")):
            with pytest.raises(InputError, match=f"it has '{name}' twice"):
                load()

    def test_a_family_without_one_of_its_lines_is_refused(self, tmp_path, family):
        path = family.save(tmp_path / "family.jsonl")
        lines = path.read_text().splitlines(keepends=True)
        path.write_text("".join(lines[:2] + lines[3:]))
        with pytest.raises(InputError, match="line 3"):
            Family.load(path)
        path.write_text("".join(lines[:-1]) + lines[-1][:20])
        assert "its file is incomplete" in Family.load(path).end.reason

    def test_files_of_the_first_version_are_read(self, tmp_path, orbit, family, caplog):
        path = orbit.save(tmp_path / "orbit.json")
        path.write_text(json.dumps(unsealed(json.loads(path.read_text()))))
        assert Orbit.load(path).alpha == orbit.alpha
        assert "orbit.json has no digest" in caplog.text
        path.write_text("\n".join(family.records()))
        assert Family.load(path).points == family.points
        assert caplog.text.count("has no digest") == 2

    def test_other_files_without_a_digest_are_refused(self, tmp_path, family):
        for result in (family, simulate(Hopper(), 4.6, hops=1)):
            path = result.save(tmp_path / "result.json")
            path.write_text(json.dumps(unsealed(json.loads(path.read_text()))))
            with pytest.raises(InputError, match="was changed or cut after it was written"):
                type(result).load(path)

    def test_a_spoilt_member_of_a_store_is_refused_and_computed_again(self, tmp_path):
        machine, store = Hopper("cubic", rest_length=9.0), tmp_path / "store.db"
        first = sweep(machine, {"beta": (0.0, 1.0)}, samples=6, store=store)
        with closing(sqlite3.connect(store)) as connection:
            connection.execute("UPDATE members SET alpha = 2 * alpha WHERE member = 3")
            connection.commit()
        with pytest.raises(InputError, match="member 3 was changed"):
            Sweep.load(store)
        again = sweep(machine, {"beta": (0.0, 1.0)}, samples=6, store=store, resume=True)
        assert again.columns["alpha"].tolist() == first.columns["alpha"].tolist()

    @pytest.mark.slow
    def test_two_processes_that_begin_a_store_at_once(self, tmp_path):
        script = (
            "import sys\n"
            "from orbits import sweep\n"
            "from problems import Hopper\n"
            "over = {'mass_ratio': [0.5, 1.0]}\n"
            "sweep(Hopper('r', rest_length=9.0), over, store=sys.argv[1], resume=True)\n"
        )
        started = [
            subprocess.Popen([sys.executable, "-c", script, str(tmp_path / "store.db")], stderr=subprocess.PIPE)
            for _ in range(2)
        ]
        for process in started:
            _, said = process.communicate(timeout=PATIENCE)
            assert process.returncode == 0, said.decode()

    def test_digests_tell_contents_apart_and_layouts_not(self):
        assert digest({"a": 1, "b": [2.0, None]}) == digest({"b": (2, None), "a": 1.0})
        assert digest({"a": 1}) != digest({"a": 1.0000000000000002})
        assert digest({"a": 1}) != digest({"a": 1}, "after another one")
        assert unsealed(sealed({"x": 0.1})) == {"x": 0.1}
