"""Sweeps by workers: the same answer to the last bit, whoever computes it and whatever dies on the way."""

import multiprocessing
import os
import signal
import struct
import subprocess
import sys
import textwrap
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Self

import numpy as np
import pytest
from browser import PATIENCE, wait_for

from orbits.errors import InputError
from orbits.sweeps import sweep
from orbits.sweeps.execution import _Processes
from orbits.sweeps.question import CHUNK
from problems import Hopper

OVER = {"beta": (0.0, 0.5), "mass_ratio": (0.5, 2.0)}
DEADLY = 0.125


@dataclass(frozen=True, repr=False)
class DeadlyHopper(Hopper):
    """A hopper that kills its process, if that is a worker, where beta has a certain value."""

    def with_values(self, **values: float) -> Self:
        if values.get("beta") == DEADLY and multiprocessing.parent_process() is not None:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().with_values(**values)


def assert_same(one, other):
    assert one.index.tolist() == other.index.tolist()
    for name, column in one.columns.items():
        np.testing.assert_array_equal(column, other.columns[name], err_msg=name)


@pytest.mark.slow
def test_workers_give_the_same_bits():
    alone = sweep(Hopper("cubic"), OVER, 2 * CHUNK + 50)
    for options in ({"executor": "processes", "workers": 2}, {"executor": ThreadPoolExecutor(2)}):
        assert_same(alone, sweep(Hopper("cubic"), OVER, 2 * CHUNK + 50, **options))
    assert alone.statuses() == {"certified": 2 * CHUNK + 50}


@pytest.mark.slow
def test_a_member_that_kills_its_workers_has_failed_and_no_other(monkeypatch):
    monkeypatch.setattr("orbits.sweeps.execution.CHECK_INTERVAL", 0.01)  # the crash comes after many checks
    table = {"beta": [*np.linspace(0.01, 0.1, 5), DEADLY, *np.linspace(0.15, 0.3, 4)]}
    found = sweep(
        DeadlyHopper("cubic"), None, table, quantities=["largest_spring_force"], executor="processes", workers=2
    )
    assert found.statuses() == {"certified": 9, "failed": 1}
    assert found["status"][5] == "failed"
    assert found["reason"][5] == "it crashed its worker 3 times"
    assert found["beta"][5] == DEADLY
    assert np.isnan(found["alpha"][5])
    table["beta"].remove(DEADLY)
    expected = sweep(Hopper("cubic"), None, table, quantities=["largest_spring_force"])
    np.testing.assert_array_equal(np.delete(found["largest_spring_force"], 5), expected["largest_spring_force"])


SWEEPER = """
    import multiprocessing, sys
    from orbits import sweep
    from problems import Hopper

    def tell(state):
        print(*(worker.pid for worker in multiprocessing.active_children()), flush=True)

    if __name__ == "__main__":
        over = {"beta": (0.0, 0.5)}
        sweep(Hopper("cubic"), over, 200_000, executor="processes", workers=2, store=sys.argv[1], progress=tell)
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM", "SIGINT"])
def test_no_worker_outlives_its_sweep(tmp_path, name):
    script = tmp_path / "sweeper.py"
    script.write_text(textwrap.dedent(SWEEPER), encoding="utf-8")
    command = [sys.executable, str(script), str(tmp_path / "study.db")]
    where = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "start_new_session": True}
    with subprocess.Popen(command, env=where, **options) as process:
        workers = next(pids for line in process.stdout if len(pids := list(map(int, line.split()))) == 2)
        os.killpg(process.pid, signal.SIGINT) if name == "SIGINT" else process.send_signal(getattr(signal, name))
        process.wait(PATIENCE)
        wait_for(lambda: not any(map(is_alive, workers)), "the workers have ended")
        _, said = process.communicate()
    if name == "SIGINT":
        assert said.splitlines()[-1].startswith("KeyboardInterrupt: ")
        assert said.count("Traceback") == 1  # that of the sweep, none of a worker


def is_alive(pid: int) -> bool:
    """Whether a process is there, and not only waits to be looked after."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def die_as_it_answers() -> None:
    """Let this worker send the first bytes of its answer and no more."""

    def send(connection, content) -> None:
        os.write(connection.fileno(), struct.pack("!i", len(content)) + bytes(content[:5]))
        os.kill(os.getpid(), signal.SIGKILL)

    Connection._send_bytes = send


def test_a_worker_that_dies_as_it_sends_its_answer_is_noticed():
    with _Processes(2) as pool:
        future = pool.submit(die_as_it_answers)
        wait_for(lambda: pool.end_if_stuck() or future.done(), "the answer is given up")
        assert isinstance(future.exception(0), BrokenExecutor)
        pool.renew()
        assert pool.submit(abs, -3).result(PATIENCE) == 3


def test_what_cannot_be_sent_is_refused():
    @dataclass(frozen=True, repr=False)
    class Local(Hopper):
        pass

    with pytest.raises(InputError, match=r"cannot be sent to other processes.*cloudpickle"):
        sweep(Local("cubic"), OVER, 10, executor="processes")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"executor": "threads"}, "executor = 'threads'"),
        ({"workers": 2}, "executor='processes'"),
        ({"executor": "processes", "workers": 0}, "workers = 0"),
    ],
)
def test_executors_that_are_none(options, said):
    with pytest.raises(InputError, match=said):
        sweep(Hopper("cubic"), OVER, 10, **options)
