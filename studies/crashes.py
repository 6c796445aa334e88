"""Does a crash lose anything? A stored sweep is killed at random times, again and again, and its workers are too.

A child process sweeps 16,384 hoppers, tells how many are done after every chunk, and is killed by SIGKILL at a random
time; then another child goes on with the store. The store is read while the child runs and after each kill: members
that were told or read before must still be there, each to the last bit what an unbroken sweep answers. A sweep that
comes to its end begins anew with another store. At last worker processes are killed below a sweep that lives on.
Run: python studies/crashes.py [--kills N] [--workers N] [--seed N]; it needs a system with fork, such as Linux
"""

import argparse
import multiprocessing
import os
import signal
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from threading import Timer

import numpy as np

from orbits import InputError, Sweep, sweep
from problems import Hopper

OVER = {"mass_ratio": (0.1, 10.0, "log"), "rest_length": (4.0, 12.0)}  # the shortest springs collapse
HOPPER, MEMBERS = Hopper(), 16_384


@dataclass
class Count:
    """What a study has met: kills, sweeps that came to their end, members that were known at kills and were lost, and
    members whose answer is not that of the unbroken sweep."""

    kills: int = 0
    ended: int = 0
    known: int = 0
    lost: int = 0
    different: int = 0
    in_store: list[int] = field(default_factory=list)

    def compare(self, found: Sweep, whole: Sweep) -> None:
        """Hold members against those of the unbroken sweep, to the last bit."""
        for name, column in found.columns.items():
            expected = whole.columns[name][found.index]
            same = column == expected if column.dtype == object else column.view(np.int64) == expected.view(np.int64)
            self.different += int((~same).sum())


def child(store: Path) -> tuple[int, int]:
    """A process that sweeps, and the pipe by which it tells how many members are done."""
    reader, writer = os.pipe()
    if pid := os.fork():
        os.close(writer)
        return pid, reader
    sweep(HOPPER, OVER, MEMBERS, store=store, progress=lambda state: os.write(writer, b"%d\n" % state.done) and None)
    os._exit(0)


def members_in(store: Path) -> Sweep | None:
    """The members that a store has; None for one that is not there, or not yet made."""
    try:
        return Sweep.load(store)
    except InputError:
        return None


def kill_sweeps(kills: int, folder: Path, whole: Sweep, pause: float, generator: np.random.Generator) -> Count:
    """Kill stored sweeps so many times, each after a random time of at most two `pause`s."""
    count, known, store = Count(), np.zeros(0, dtype=np.int64), folder / "0.db"
    while count.kills < kills:
        pid, reader = child(store)
        before, after = np.diff([0, *np.sort(generator.uniform(0, 2 * pause, 2))])
        time.sleep(before)
        if (read := members_in(store)) is not None:
            known = np.union1d(known, read.index)
        time.sleep(after)
        os.kill(pid, signal.SIGKILL)
        _, status = os.waitpid(pid, 0)
        with os.fdopen(reader) as pipe:
            told = [int(line) for line in pipe.read().splitlines()]
        found = members_in(store)
        index = np.zeros(0, dtype=np.int64) if found is None else found.index
        missing = len(np.setdiff1d(known, index))
        count.lost += max(missing, max(told, default=0) - len(index))
        count.known += max(len(known), max(told, default=0))
        count.in_store.append(len(index))
        if found is not None:
            count.compare(found, whole)
        known = index
        if os.WIFSIGNALED(status):
            count.kills += 1
        elif status:
            raise RuntimeError(f"a sweep that was to go on with its store ended with the code {status}")
        if len(index) == MEMBERS:
            count.compare(sweep(HOPPER, OVER, MEMBERS, store=store, progress=False), whole)
            count.ended += 1
            known, store = known[:0], folder / f"{count.ended}.db"
    return count


def kill_workers(kills: int, whole: Sweep, pause: float, generator: np.random.Generator) -> Count:
    """Kill so many worker processes of sweeps, each at a random time after a chunk."""
    count = Count()

    def kill() -> None:
        victims = multiprocessing.active_children()
        if victims and count.kills < kills:
            os.kill(int(victims[int(generator.integers(len(victims)))].pid or 0), signal.SIGKILL)
            count.kills += 1

    while count.kills < kills:
        timers = [Timer(0, kill)]

        def again(state, timers=timers) -> None:
            if not timers[-1].is_alive():
                timers.append(Timer(5 * pause + generator.uniform(0, 20 * pause), kill))
                timers[-1].start()

        count.compare(sweep(HOPPER, OVER, MEMBERS, executor="processes", workers=2, progress=again), whole)
        timers[-1].cancel()
        count.ended += 1
    return count


def main(kills: int = 1000, workers: int = 30, seed: int = 0) -> dict[str, Count]:
    generator = np.random.default_rng(seed)
    sweep(HOPPER, OVER, 2, progress=False)  # what is made at first is made before the children
    began = time.perf_counter()
    whole = sweep(HOPPER, OVER, MEMBERS, progress=False)
    pause = (time.perf_counter() - began) / 16
    print(f"  {MEMBERS} members: " + ", ".join(f"{number} {status}" for status, number in whole.statuses().items()))
    with tempfile.TemporaryDirectory() as folder:
        swept = kill_sweeps(kills, Path(folder), whole, pause, generator)
    told = f"{swept.kills} kills, {swept.ended} stores came to their end, {swept.known} members were known at kills"
    print(f"  {told}: {swept.lost} lost, {swept.different} values different; {time.perf_counter() - began:.0f} s")
    worked = kill_workers(workers, whole, pause, generator)
    told = f"{worked.kills} kills of workers in {worked.ended} sweeps"
    print(f"  {told}: {worked.different} values different; {time.perf_counter() - began:.0f} s")
    return {"sweeps": swept, "workers": worked}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--kills", type=int, default=1000, help="of sweeps")
    parser.add_argument("--workers", type=int, default=30, help="kills of worker processes")
    parser.add_argument("--seed", type=int, default=0, help="of the random times")
    arguments = parser.parse_args()
    found = main(arguments.kills, arguments.workers, arguments.seed)
    raise SystemExit(any(count.lost or count.different for count in found.values()))
