"""The time that a computation may take."""

import time
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest

from orbits import Family, InputError, NoOrbit, existence, find, find_all, follow, sweep, time_limit
from orbits.curves import Run
from orbits.running import check_time
from orbits.sweeps import sparse_grid
from problems import Hopper

MODULE = import_module("orbits.running.time_limit")


class TestTimeLimit:
    """A force that bends where it vanishes is followed step by step, for minutes."""

    SLOW = Hopper("abs(r) + 1e-9*abs(r)**1.5")

    @pytest.mark.parametrize("search", [find, find_all])
    def test_what_takes_longer_is_ended(self, search):
        began = time.process_time()
        with pytest.raises(NoOrbit, match=r"more than 0.5 s: raise the limit \(with time_limit"):
            search(self.SLOW, limit=0.5)
        assert time.process_time() - began < 20

    def test_a_block_limits_all_that_is_computed_in_it(self, monkeypatch):
        """Beyond the 30 s that a search has without one, too; a family is handed back as far as it was followed."""
        with (
            pytest.raises(NoOrbit, match=r"it takes more than 0.3 s.*; none of 2 members was done; nothing is kept"),
            time_limit(0.3),
        ):
            sweep(Hopper("abs(r) + b*r + 1e-9*abs(r)**1.5", parameters={"b": 0.1}), {"b": [0.1, 0.2]}, progress=False)
        late = SimpleNamespace(monotonic=lambda: np.inf)
        with time_limit(60.0):
            family = follow(
                Hopper("cubic", rest_length=9.0), "beta", 0.4,
                progress=lambda share: share > 0.3 and monkeypatch.setattr(MODULE, "time", late),
            )  # fmt: skip
        assert family.end.kind == "interrupted"
        assert "it takes more than 60 s" in family.end.reason
        assert 0.33 < family[-1].value < 0.36
        monkeypatch.undo()
        whole = follow(Hopper("cubic", rest_length=9.0), "beta", 0.4, resume=family)
        assert whole.end.kind == "reached"
        with pytest.raises(InputError, match="limit = -1"), time_limit(-1):
            pass

    with time_limit(10**400):  # longer than any computation takes
        pass

    def test_a_family_has_its_first_orbit_at_least(self, monkeypatch, tmp_path):
        """Where the time is over while the points after it are solved; a run goes on from there."""
        machine, late = Hopper("cubic", rest_length=9.0), SimpleNamespace(monotonic=lambda: np.inf)

        def next_batch(*_):
            monkeypatch.setattr(MODULE, "time", late)
            check_time()

        monkeypatch.setattr(Run, "advance", next_batch)
        with time_limit(60.0):
            family = follow(machine, "beta", 0.4, start=0.3, output=tmp_path / "family.jsonl")
        assert (len(family), family.end.kind) == (1, "interrupted")
        monkeypatch.undo()
        saved = Family.load(tmp_path / "family.jsonl", machine)
        assert saved[0].alpha == family[0].alpha == pytest.approx(find(family.source).alpha, abs=1e-12)
        assert follow(machine, "beta", 0.4, start=0.3, resume=saved).end.kind == "reached"
        with pytest.raises(NoOrbit, match=r"more than 0.1 s.* the first orbit is not found"), time_limit(0.1):
            follow(Hopper("abs(r) + b*r + 1e-9*abs(r)**1.5", parameters={"b": 0.1}), "b", 0.2)

    def test_a_diagram_has_its_grid_at_least(self, monkeypatch):
        """Its boundaries are then midpoints; before the grid is searched there is none."""
        late = SimpleNamespace(monotonic=lambda: np.inf)

        def diagram(samples, over):
            end = lambda state: over(state) and monkeypatch.setattr(MODULE, "time", late)  # noqa: E731
            with time_limit(60.0):
                return existence(
                    Hopper("cubic"), "beta", (-0.03, 0.01), "rest_length", (25, 30), samples=samples, progress=end
                )

        found = diagram((9, 2), lambda state: state.done == state.whole)
        monkeypatch.undo()
        assert not found.boundaries.located.any()
        assert "midpoints between members: it takes more than 60 s" in " ".join(str(found).split())
        assert found.motions(0) == [(-0.0075, 0.01)]
        assert found.unknown(0)
        monkeypatch.setattr(sparse_grid, "CHUNK", 3)
        with pytest.raises(NoOrbit, match=r"more than 60 s.*; 3 of 18 members were done in .*others would take about"):
            diagram((9, 2), lambda state: True)

    def test_the_next_search_has_its_own(self):
        with pytest.raises(NoOrbit, match="it takes more than"):
            find(self.SLOW, limit=0.1)
        assert find(Hopper(), limit=20).admissible

    def test_an_inner_limit_gives_no_time_beyond_the_outer_one(self):
        with pytest.raises(NoOrbit, match=r"more than 0.1 s"), time_limit(0.1):
            find(self.SLOW, limit=100)

    @pytest.mark.parametrize("limit", [0, -1.0, True, "1", float("nan")])
    def test_no_time(self, limit):
        with pytest.raises(InputError, match="it must be a number of seconds above 0"):
            find(self.SLOW, limit=limit)


def test_the_default_limit_counts_the_processor_time_of_its_thread(monkeypatch):
    """What other threads and programs do takes no time from it; a limit that the user states is one of the clock."""
    now = {"monotonic": 0.0, "process_time": 0.0, "thread_time": 0.0}
    clocks = SimpleNamespace(**{name: lambda name=name: now[name] for name in now})
    monkeypatch.setattr(MODULE, "time", clocks)

    def work(limit: float | None, *readings: dict[str, float]):
        with time_limit(limit), time_limit(None):
            for each in readings:
                check_time()
                now.update(each)
            check_time()

    with pytest.raises(NoOrbit, match=r"it takes more than 30 s of processor time"):
        work(
            None,
            *(
                {"monotonic": 1e4, "process_time": 1e3, "thread_time": 29.9},
                {"monotonic": 1e4 + 0.2, "thread_time": 30.1},
            ),
        )
    with pytest.raises(NoOrbit, match=r"it takes more than 60 s:"):
        work(60.0, {"thread_time": 1e6}, {"monotonic": 1e4 + 61.0})
