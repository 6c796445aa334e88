"""The question of a sweep, and the table of the results of its members."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypedDict

import numpy as np

from ..continuation import versions
from ..design import columns_of_tuned, formula_names, known_formula, names_together, tuning_of_designs
from ..errors import InputError, list_of_names, range_of
from ..io import Document
from ..model import Machine, machine_in_words
from ..periodic import Orbit, Tuning, beyond_model, family_number, find, start_in_file, start_or_own, unknowns_of_start
from ..running import exclusive
from ..shooting import method_of
from .designs import Axis, Members
from .same_equations import EQUATIONS, digest_of_equations

OUTCOMES = ("find", "map", "fixed_points")
# Number of members of a chunk, solved and stored together: enough that calls of machine code are full, few enough that
# a crash costs seconds. It is part of the question, since the last digit of a result might depend on it.
CHUNK = 1024
LAUNCH_SPEED = "alpha"  # the name of a launch speed in a sweep of the return map
# Columns of every result, by outcome, with their types; a missing integer is NaN.
COLUMNS_OF: dict[str, dict[str, type]] = {
    "find": {"alpha": float, "flight_time": float, "error": float, "family": int},
    "map": {"next": float, "loss": float, "impacts": int},
    "fixed_points": {"count": int, "alpha": float, "multiplier": float},
}


class Table(NamedTuple):
    """Results of some members: their indices (k,) among all, and columns (k,) by name, numbers or texts."""

    members: np.ndarray
    columns: dict[str, np.ndarray]


def empty_table(count: int, columns: Mapping[str, type]) -> Table:
    """A table of `count` members whose numbers are NaN and whose texts are empty."""
    filled = {
        name: np.full(count, "", dtype=object) if kind is str else np.full(count, np.nan)
        for name, kind in columns.items()
    }
    return Table(np.zeros(count, dtype=np.int64), filled)


@dataclass(frozen=True, eq=False)
class Question:
    """The results requested of every member.

    machine : the machine, whose parameters the members replace
    members : the values of the parameters
    families : the requested families; every design has a member for each
    quantities : further columns, names of quantities or formulas of them
    outcome : one of `OUTCOMES`
    between : launch speeds between which fixed points are searched
    start : the unknowns, in the machine's units, of the machine's own orbit from which those of the members are
        continued; None where they are found by their family
    tuning : the tuned parameters and prescribed quantities; None without any
    method : of `find`, for each member alone; None where the members are solved together
    """

    machine: Machine
    members: Members
    families: tuple[int, ...] = (1,)
    quantities: tuple[str, ...] = ()
    outcome: str = "find"
    between: tuple[float, float] | None = None
    start: Mapping[str, float] | None = None
    tuning: Tuning | None = None
    method: str | None = None

    def __len__(self) -> int:
        return len(self.members) * len(self.families)

    def values_of(self, members: np.ndarray) -> np.ndarray:
        """The parameters (k, n) of some members (k,)."""
        return self.members.values[members // len(self.families)]

    def columns(self) -> dict[str, type]:
        """The columns of the result, with their types."""
        parameters = dict.fromkeys(self.members.names, float)
        own = {**COLUMNS_OF[self.outcome], **dict.fromkeys((*self.tuned_columns, *self.quantities), float)}
        return {**parameters, **own, "status": str, "reason": str}

    @property
    def tuned_columns(self) -> tuple[str, ...]:
        """The columns that tuned orbits have besides those of others."""
        return columns_of_tuned(self.machine.model, self.tuning.names) if self.tuning else ()

    def document(self) -> Document:
        """The question as JSON-ready data, with digests of the machine's equations and of the values of its members."""
        return {
            "machine": machine_in_words(self.machine),
            "parameters": list(self.members.names),
            "members": len(self.members),
            "over": {name: axis.stated for name, axis in zip(self.members.names, self.members.axes, strict=False)},
            "axes": [axis.kind for axis in self.members.axes],
            "drawn": self.members.drawn,
            "values": hashlib.sha256(np.ascontiguousarray(self.members.values).tobytes()).hexdigest(),
            "logarithmic": self.members.logarithmic,
            "shape": None if self.members.shape is None else list(self.members.shape),
            "families": list(self.families),
            "quantities": list(self.quantities),
            "outcome": self.outcome,
            "between": self.between and list(self.between),
            **({} if self.start is None else {"start": dict(self.start)}),
            **({} if self.tuning is None else self._tuned()),
            **({} if self.method is None else {"method": self.method}),
            "chunk": CHUNK,
            "versions": {name: versions()[name] for name in ("persistent-orbits", "casadi", "numpy")},
            EQUATIONS: digest_of_equations(self.machine),  # which differs with the version of CasADi too
        }

    def _tuned(self) -> Document:
        assert self.tuning is not None
        return {"tune": list(self.tuning.names), "at": self.tuning.at, "tuned_columns": list(self.tuned_columns)}


class SavedQuestion(TypedDict):
    """The fields that are read from a question's document in a store."""

    machine: Mapping[str, Any]
    parameters: tuple[str, ...]
    members: int
    shape: tuple[int, ...] | None
    families: tuple[int, ...]
    quantities: tuple[str, ...]
    outcome: str


def question_again(machine: Machine, document: Mapping[str, Any], values: np.ndarray) -> Question:
    """The question rebuilt from its document, with its machine and the values (m, n) of its members."""
    names = tuple(document["parameters"])
    stated = zip(document["axes"], names, strict=False)  # a table of samples has no axes
    axes = [Axis.of_stated(kind, document["over"][name]) for kind, name in stated]
    shape = document["shape"]
    members = Members(names, values, shape and tuple(shape), tuple(axes), document["drawn"])
    return Question(
        machine, members, tuple(document["families"]), tuple(document["quantities"]), document["outcome"],
        document["between"] and tuple(document["between"]), document.get("start"),
        Tuning(tuple(document["tune"]), document["at"], {}) if "tune" in document else None, document.get("method"),
    )  # fmt: skip


@exclusive
def question_of(
    machine: Machine,
    members: Members,
    family: Any,
    quantities: str | Sequence[str],
    outcome: str,
    between: Any,
    start: Any = None,
    tune: Any = None,
    at: Any = None,
    method: str | None = None,
) -> Question:
    """The question of `sweep`; raises `InputError` that names the invalid argument."""
    families = tuple(family) if isinstance(family, list | tuple | range) else (family,)
    if not families or len({*map(str, families)}) < len(families):
        raise InputError(f"family = {family!r}; it must be a number, or a list of different numbers")
    families = tuple(map(family_number, families))
    quantities = list_of_names("quantities", quantities)
    if start is not None and (outcome != "find" or families != (1,)):
        raise InputError("start already determines the family and outcome: leave these out")
    tuning = _tuning(machine, members, outcome, tune, at)
    if method is not None:
        method_of(machine.model, method)
        if outcome != "find" or start is not None or tuning:
            raise InputError(f"method = '{method}' finds orbits by their family: leave out start, tune and at")
    if outcome == "find" and not machine.model.sticks:  # runs are guessed near vertical hops
        start = start_or_own(machine, start, *families)
    if outcome != "find" and (quantities or families != (1,)):
        raise InputError(f"outcome = {outcome!r} has no families and no quantities: leave them out")
    if outcome != "find" and not machine.model.one_speed:
        remedy = "sweep its orbits from start=, or call ReturnMap(machine) with launches"
        raise InputError(f"outcome = {outcome!r}: a launch of a {machine.model.name} has several numbers; {remedy}")
    if (outcome == "map") != (LAUNCH_SPEED in members.names):
        raise InputError(f"'{LAUNCH_SPEED}' is a launch speed: sweep over it with outcome = 'map', and only then")
    if (outcome == "fixed_points") != (between is not None):
        raise InputError("outcome = 'fixed_points', and no other, needs between = (low, high), two launch speeds")
    further = columns_of_tuned(machine.model, tuning.names) if tuning else ()
    numbers = (*COLUMNS_OF[outcome], *further)
    quantities = [each for each in quantities if each not in (*members.names, *numbers)]  # those are columns anyway
    _check_quantities(machine, quantities, tuning)
    names, own = (*members.names, *quantities), (*numbers, "status", "reason", "index", "member")
    for i, name in enumerate(names):
        if name in own:
            raise InputError(f"every result has a column '{name}': leave it out of the quantities and parameters")
        if name in names[:i]:
            raise InputError(f"'{name}' appears twice in quantities: leave one out")
    speeds = None if between is None else range_of("between", between)
    unknowns = None
    if start is not None and tuning:
        start = start if isinstance(start, Orbit | Mapping) else start_in_file(start)
        find(machine, start=start, tune=tuning.names, at=tuning.at)  # raises where it leads to no orbit
        unknowns = unknowns_of_start(machine, start) if isinstance(start, Orbit) else dict(start)
    elif start is not None:
        unknowns = unknowns_of_start(machine, find(machine, start=start))
    return Question(machine, members, families, tuple(quantities), outcome, speeds, unknowns, tuning, method)


def _tuning(machine: Machine, members: Members, outcome: str, tune: Any, at: Any) -> Tuning | None:
    """The tuned parameters of a sweep and its prescribed quantities, None without any; raises `InputError` where they
    cannot be those of a sweep."""
    if tune is None and at is None and not (machine.model.sticks and outcome == "find"):
        return None
    if outcome != "find":
        raise InputError(f"tune and at apply to orbits: leave them out for outcome = {outcome!r}")
    return tuning_of_designs(machine, tune, at, members.names)


def names_of_quantities(machine: Machine, tuning: Tuning | None) -> list[str]:
    """The names that formulas of quantities may use: of machines that go forward, what is computed for many orbits."""
    known = sorted(names_together(machine)) if tuning and machine.model.sticks else formula_names(machine)
    return [*known, *beyond_model(machine)]


def _check_quantities(machine: Machine, quantities: Sequence[str], tuning: Tuning | None) -> None:
    """Raise `InputError`, in one line, for an unknown quantity."""
    known = names_of_quantities(machine, tuning) if quantities else ()
    for text in quantities:
        try:
            known_formula(text, known, "the quantity", machine)
        except InputError as error:
            what, *shown = str(error).split("\n")
            raise InputError(f"the quantity '{text}': {what}" if shown else what) from None
