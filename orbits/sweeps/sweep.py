"""Many orbits of one machine over its parameters: requested once, computed anywhere, stored as they are found."""

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, OrbitsError, one_of, true_or_false
from ..model import Machine, check_machine, free_parameters
from ..periodic import StartLike
from ..running import TimeOver, exclusive, interrupts, running
from .designs import Members, members_of
from .execution import check_executor, chunks_of, solved_chunks
from .progress import SweepProgress, on_screen, pace
from .question import LAUNCH_SPEED, OUTCOMES, Question, Table, empty_table, question_of
from .sweep_result import Sweep, solves_again

if TYPE_CHECKING:
    from .store import Store


# Seconds after which progress within a chunk is reported.
SILENT = 1.0


def sweep(
    machine: Machine,
    over: Mapping[str, object] | Sequence[str] | None = None,
    samples: object = None,
    *,
    sampling: str | None = None,
    seed: int = 0,
    family: int | Sequence[int] = 1,
    quantities: str | Sequence[str] = (),
    outcome: str = "find",
    between: tuple[float, float] | None = None,
    start: StartLike | None = None,
    method: str | None = None,
    tune: str | Iterable[str] | None = None,
    at: Mapping[str, float] | None = None,
    executor: object = None,
    workers: int | None = None,
    client: Any = None,
    store: str | Path | None = None,
    resume: bool = True,
    progress: Callable[[SweepProgress], None] | bool | None = None,
) -> Sweep:
    """The orbits of many machines that differ in some parameters.

    machine : as in `find`, with `with_values`
    over : a mapping from names of parameters to a range (low, high) or (low, high, "log"), a list of values, or a
        frozen distribution of `scipy.stats`; with a table of samples, the names of its columns, None for all
    samples : the number of members, 1000 by default; with "grid", the number of values of each range, 10 by default, or
        a tuple of one number for each parameter; or a table with a column for each parameter: a DataFrame, a mapping of
        arrays or the name of a CSV file
    sampling : "grid", "sobol", "lhs" (Latin hypercube) or "random"; None means a grid for lists and for a tuple of
        samples, else "sobol"
    seed : of the sampling
    family : number of the family, or several numbers; each design then has one member for each of them
    quantities : further columns: a name or a list of names as in `orbits.quantities`, or formulas of them and of the
        parameters
    outcome : "find" for the orbits; "map" for the next launch speeds, with a launch speed "alpha" among the parameters;
        "fixed_points" for the fixed points of the return map `between` two launch speeds
    between : (low, high), launch speeds, for "fixed_points"
    start : as in `find`, for the orbit of the machine itself; the orbits of the members are continued from it, whatever
        their families. Machines whose launch has several unknowns need it
    method : as in `find`, which then finds the members one by one; None for the simplest method, which finds them
        together
    tune, at : as in `find`, for quantities other than extremes of the motion; the orbits of the members are continued
        from that of the machine itself. Additional columns are the tuned values, bounds on their errors such as
        "k_error", "admissible" as 1 or 0, and for runs step, speeds and friction
    executor : None for this process, "processes" for `workers` processes (None: one for each core), or an executor of
        `concurrent.futures`
    client : of a Dask cluster, instead of an executor
    store : an SQLite file to which every chunk of members is written as soon as it is finished; with `resume`, the same
        sweep with this store continues where it ended, without `resume` it is refused
    progress : called with a `SweepProgress` after every chunk, and every second within one; True prints a line, and
        None does so on a terminal

    From a start, the parameters go to those of each member along a straight line, or else one after the other. If that
    fails, the status says how: "ends" if the orbits end at a fold on the way, "not reached" if Newton's method failed
    on the way. Neither means that the member has no orbit.

    To the last bit, the result of a member depends neither on the other members nor on where it is computed. Raises
    `InputError` for an invalid argument, before anything is computed.

    >>> from orbits import sweep
    >>> from problems import Hopper
    >>> hops = sweep(Hopper("cubic", rest_length=9.0), {"beta": [0.1, 0.2, 0.3]})
    >>> hops["alpha"].round(6).tolist(), hops["status"].tolist()
    ([3.412355, 3.111516, 2.936459], ['certified', 'certified', 'certified'])
    """
    question = checked_question(
        machine, over, samples, sampling, seed, family, quantities, outcome, between, start, tune, at, method
    )
    if client is not None:
        if executor is not None or not hasattr(client, "get_executor"):
            raise InputError(f"client = {client!r}; it must be a client of Dask, given instead of an executor")
        executor = client.get_executor()
    check_executor(executor, workers)
    resume = true_or_false("resume", resume)
    show = on_screen(progress)
    opened = None
    if store is not None:
        from .store import Store  # imports the database

        opened = Store(store, question, resume)
    return _computed(question, opened, executor, workers, show)


def checked_question(
    machine: Machine, over: Any, samples: Any, sampling: str | None, seed: int, family: Any,
    quantities: str | Sequence[str] = (), outcome: str = "find", between: Any = None, start: Any = None,
    tune: Any = None, at: Any = None, method: str | None = None,
) -> Question:  # fmt: skip
    """The question of a sweep with these arguments; raises `InputError`, which names the invalid one."""
    exclusive(check_machine)(machine, "with_values")
    allowed = [*free_parameters(machine), *getattr(machine, "further_parameters", ())]
    one_of("outcome", outcome, OUTCOMES)
    allowed = list(dict.fromkeys([*allowed, LAUNCH_SPEED] if outcome == "map" else allowed))
    members = members_of(over, samples, sampling, seed, allowed, machine)
    _check_domain(machine, members)
    return question_of(machine, members, family, quantities, outcome, between, start, tune, at, method)


@exclusive
def _check_domain(machine: Machine, members: Members) -> None:
    """Raise `InputError` for a member whose parameters the machine cannot have."""
    names = [name for name in members.names if name != LAUNCH_SPEED]
    values = members.values[:, [members.names.index(name) for name in names]]

    def refusal(row: np.ndarray) -> OrbitsError | None:
        try:
            machine.with_values(**dict(zip(names, row.tolist(), strict=True)))
        except OrbitsError as error:
            return error
        return None

    # Parameters between two sets of values that the machine admits are admissible too.
    if not names or not (refusal(values.min(0)) or refusal(values.max(0))):
        return
    for i, row in enumerate(values):
        interrupts.heed()
        if error := refusal(row):
            raise InputError(f"member {i} of the sweep is impossible: {error}")


def _computed(
    question: Question,
    store: "Store | None",
    executor: object,
    workers: int | None,
    show: Callable[[SweepProgress], None],
) -> Sweep:
    """The result, including the members already in the store."""
    began, count = time.perf_counter(), len(question)
    done = np.zeros(count, dtype=bool) if store is None else store.done()
    table = None if store else empty_table(count, question.columns())
    statuses = Counter(store.statuses() if store else {})
    chunks, before, shown = chunks_of(question, done), int(done.sum()), began

    def show_state(now: int) -> None:
        nonlocal shown
        shown, seconds = time.perf_counter(), time.perf_counter() - began
        left = (count - now) * seconds / max(now - before, 1)
        show(SweepProgress(now, count, dict(statuses), seconds, left, before))

    def within_chunk(more: int) -> None:
        if time.perf_counter() - shown > SILENT:
            show_state(min(int(done.sum()) + more, count - 1))

    try:
        with running("sweep"), interrupts.deferred():
            for part in solved_chunks(question, chunks, executor, workers, within_chunk):
                if store is not None:
                    store.write(part)
                if table is not None:
                    _put(table, part)
                done[part.members] = True
                statuses.update(part.columns["status"])
                show_state(int(done.sum()))
        if table is None:
            assert store is not None
            table = store.read()
        return Sweep.of(question, table)
    except (KeyboardInterrupt, TimeOver) as stop:
        now, seconds = int(done.sum()) - before, time.perf_counter() - began
        cause = f"{stop}; {pace(now, count - before, seconds)}; " if isinstance(stop, TimeOver) else ""
        if store is None:
            raise type(stop)(f"{cause}nothing is kept: name a store to keep finished members") from None
        stored, way = f"{int(done.sum())} of {count} members are in {store.path}", "in the command with --resume"
        raise type(stop)(f"{cause}{stored}: call the same sweep with this store to continue, {way}") from None
    finally:
        if store is not None:
            store.close()


@solves_again
def _further_sweep(
    question: Question, samples: Mapping[str, object], quantities: Sequence[str], **options: Any
) -> Sweep:
    """The sweep of other members of the machine and family of a question."""
    return sweep(
        question.machine,
        None,
        samples,
        family=question.families[0],
        quantities=quantities,
        start=question.start,
        method=question.method,
        tune=question.tuning.names if question.tuning else None,
        at=question.tuning.at if question.tuning else None,
        **options,
    )


def _put(table: Table, part: Table) -> None:
    """Write the results of some members into the table of all."""
    table.members[part.members] = part.members
    for name, column in part.columns.items():
        table.columns[name][part.members] = column
