"""Fronts: the designs of which none is better than another in both of two objectives."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import InputError, OrbitsError
from ..io import write_json
from ..periodic.find import find
from ..symbolic import interrupts
from .optimize import Design, best_from, quantities, searched, sensitivities, starts_of
from .problem import Constraint, DesignProblem, design_problem, formula_of, words_of

# Objectives that differ by a smaller share are the same; one that can gain so much while the other stays, does.
SAME_OBJECTIVE, WORTH = 1e-9, 1e-4
# How far an end of a front is probed for that, as a share of the parameters' range.
PROBE = 1e-3
# An objective with a slope changes by PROBE, one that is only curved by PROBE**2 over that way; a flat one by less than
# this share of the latter.
FLAT_CHANGE = 0.1


@dataclass(frozen=True, eq=False)
class Front:
    """Designs of which none is better than another in both objectives, the best in the first one first.

    texts : the two objectives, both minimised
    designs : each certified
    refused : (level of the second objective, reason) where there is none
    """

    texts: tuple[str, str]
    designs: tuple[Design, ...]
    refused: tuple[tuple[float, str], ...]
    seconds: float

    @property
    def values(self) -> np.ndarray:
        """The objectives (m, 2) of the designs."""
        return np.array([design.pair for design in self.designs])

    def column(self, name: str) -> np.ndarray:
        """A parameter of every design."""
        return np.array([design.parameters[name] for design in self.designs])

    def document(self) -> dict:
        """The front as the JSON document of the command line."""
        return {
            "objectives": list(self.texts),
            "points": [{"values": list(design.pair), **design.document()} for design in self.designs],
            "refused": [{"level": level, "reason": reason} for level, reason in self.refused],
            "seconds": self.seconds,
        }

    def save(self, path) -> Path:
        """Write the document to a JSON file; returns the path."""
        return write_json(self.document(), path, "front")

    def __str__(self) -> str:
        names = list(self.designs[0].parameters)
        lines = ["".join(f"{name:>24}" for name in (*self.texts, *names))]
        for design in self.designs:
            lines.append("".join(f"{value:24.12g}" for value in (*design.pair, *design.parameters.values())))
        lines += [f"{self.texts[1]} <= {level:.6g}: {reason}" for level, reason in self.refused]
        return "\n".join([*lines, f"{len(self.designs)} certified designs, {self.seconds:.2f} s"])


def pareto(
    machine,
    *,
    minimise: tuple[str, str],
    over: Mapping[str, tuple[float, float]],
    subject_to: Sequence[str] = (),
    points: int = 9,
    family: int = 1,
    starts: int | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Front:
    """The front of two objectives: the designs of which none is better in both than another.

    Both ends first; then the first objective is minimised with the second bounded at levels spread evenly between them,
    each from the design before, from both ends, and from as many `starts` as are asked for; of what is found, what
    another design beats is left out. The arguments are those of `optimize`; an objective to be large is "-alpha".
    Raises as `optimize` does where an end has no optimum.
    """
    if isinstance(minimise, str) or not isinstance(minimise, Sequence) or len(minimise) != 2:
        raise InputError(f"minimise = {minimise!r}; a front has two objectives")
    if isinstance(points, bool) or not isinstance(points, int | np.integer) or points < 2:
        raise InputError(f"points = {points!r}; a front has a whole number of them, from 2")
    with interrupts.deferred():
        began = time.perf_counter()
        first, second = (design_problem(machine, text, None, over, subject_to) for text in minimise)
        tell = progress or (lambda share: None)
        ends = []
        for i, brief in enumerate((first, second)):
            best = _with_both_objectives(searched(machine, brief, family, starts, seed), minimise)
            ends.append(_cornered(best, (second, first)[i], i, machine, family, minimise))
            tell((i + 1) / points)
        low, high = ends[1].pair[1], ends[0].pair[1]
        found, refused, here = [ends[0]], [], ends[0]
        # Where one design is best in both, there is nothing between.
        levels = np.linspace(high, low, points)[1:-1] if _beats(ends[1].pair[1:], ends[0].pair[1:]) else np.zeros(0)
        for i, level in enumerate(levels.tolist()):
            bounded = replace(first, constraints=(*first.constraints, _bounded(minimise[1], level, machine)))
            near = [{**d.parameters, "orbit": d.orbit} for d in dict.fromkeys((here, *ends))]
            near += starts_of(machine, first, starts, seed) if starts else []
            try:
                here = _with_both_objectives(best_from(machine, bounded, family, near), minimise)
                found.append(here)
            except OrbitsError as error:
                refused.append((level, f"none found from {len(near)} starts: {error}"))
            tell((i + 3) / points)
        found += ends[1:] if len(levels) or points == 2 else []
        best = [d for d in found if not any(_beats(other.pair, d.pair) for other in found)]
        best.sort(key=lambda design: design.pair)
        return Front(tuple(minimise), tuple(best), tuple(refused), time.perf_counter() - began)


def _cornered(end: Design, other: DesignProblem, best: int, machine, family: int, texts) -> Design:
    """An end of a front, or where the other objective has fallen while that of index `best` stays as it is: an end need
    not be a single design."""
    if not _flat(end, other, best, texts):
        return end
    held = _bounded(texts[best], end.pair[best] + SAME_OBJECTIVE * abs(end.pair[best]), machine)
    start = {**end.parameters, "orbit": end.orbit}
    try:
        further = _with_both_objectives(
            best_from(end.machine, replace(other, constraints=(*other.constraints, held)), family, [start]), texts
        )
    except OrbitsError:
        return end
    gain = end.pair[1 - best] - further.pair[1 - best]
    return further if gain > WORTH * abs(end.pair[1 - best]) else end


def _flat(end: Design, brief: DesignProblem, best: int, texts) -> bool:
    """Whether the objective of index `best` stays as it is a small way along where the other one falls fastest, with
    what is active at an end kept active."""
    span = np.subtract(brief.high, brief.low)
    known_active = {active.text for active in end.active}
    held = [c.formula.text for c in brief.constraints if c.text in known_active]
    slopes = sensitivities(end.machine, end.orbit, brief.names, [texts[1 - best], *held])
    rows = np.array([[slope[name] for name in brief.names] for slope in slopes.values()]) * span
    at = np.array([end.parameters[name] for name in brief.names])
    bounded = np.eye(len(span))[(at == brief.low) | (at == brief.high)]
    fixed = np.vstack([rows[1:], bounded])
    way = -rows[0] + (fixed.T @ np.linalg.lstsq(fixed.T, rows[0], rcond=None)[0] if len(fixed) else 0.0)
    if np.linalg.norm(way) <= 1e-6 * np.linalg.norm(rows[0]):
        return False
    there = np.clip(at + PROBE * span * way / np.linalg.norm(way), brief.low, brief.high)
    machine = end.machine.with_values(**dict(zip(brief.names, there.tolist(), strict=True)))
    try:
        orbit = find(machine, end.orbit.family)
        value = quantities(machine, orbit, [texts[best]])[texts[best]]
    except OrbitsError:
        return False
    return abs(value - end.pair[best]) <= FLAT_CHANGE * PROBE**2 * abs(end.pair[best])


def _bounded(text: str, level: float, machine) -> Constraint:
    """The constraint that an objective is no more than a level."""
    return Constraint(f"{text} <= {level:.9g}", formula_of(text, words_of(machine), "the objective"), -np.inf, level)


def _beats(one, other) -> bool:
    """Whether a pair is better in one objective and not worse in the other, by more than rounding."""
    slack = [2 * SAME_OBJECTIVE * abs(value) for value in other]
    pairs = list(zip(one, other, slack, strict=True))
    return all(a <= b + s for a, b, s in pairs) and any(a < b - s for a, b, s in pairs)


def _with_both_objectives(design: Design, texts) -> Design:
    """A design that knows both objectives."""
    values = quantities(design.machine, design.orbit, texts)
    return replace(design, pair=tuple(values[text] for text in texts))
