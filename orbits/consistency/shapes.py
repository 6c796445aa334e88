"""The fields of a hand-written model, called once: whether each is there, is called as `Model` says, and answers with
what it should."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from ..errors import OrbitsError
from ..model.model import Model
from ..model.phase import Affine, Phase
from ..model.relative import Relative
from ..model.state_formula import StateFormula
from ..units import Units

# The quantity that every contact phase watches, and the four reasons that every model has words for.
WATCHED_FORCE, TOLD_REASONS = "contact force", ("gap", "pull", "separation", "end")


def malformed(model: Model, values: Mapping[str, float]) -> dict[str, str]:
    """What is wrong with the form of a model's fields, in words by the field's name."""
    found = {f"{where}.states": text for where in ("flight", "contact") if (text := _no_phase(getattr(model, where)))}
    if found:
        return found
    if text := _no_unknowns(model):
        return {"launch_unknowns": text}
    for name, look in _looks(model, values):
        if name == "springs" and "heights" in found:
            continue
        try:
            text = look()
        except OrbitsError as error:
            # A machine may have no launch, no guess and no closed form, and says so.
            text = "" if name in ("release", "flight.closed_form", "contact.closed_form") else str(error)
        except Exception as error:
            text = f"it cannot be evaluated ({type(error).__name__}: {error})"
        if text:
            found.setdefault(name, text)
    return found


def _no_phase(phase: Any) -> str:
    if not isinstance(phase, Phase):
        return f"it is a {type(phase).__name__}, not a Phase"
    named = isinstance(phase.states, tuple) and phase.states and all(isinstance(name, str) for name in phase.states)
    return "" if named and len({*phase.states}) == len(phase.states) else f"states = {phase.states!r} are no names"


def _looks(model: Model, p: Mapping[str, float]) -> Iterator[tuple[str, Callable[[], str]]]:
    """The name of each field with a function that says what is wrong with its form, "" where nothing is."""
    n, m = len(model.flight.states), len(model.contact.states)
    x, y, u = (
        _symbols_named(model.flight.states),
        _symbols_named(model.contact.states),
        _symbols_named(model.launch_unknowns),
    )
    named, known = dict(zip(model.launch_unknowns, u, strict=True)), dict(zip(p, _symbols_named(p), strict=True))
    q, stood = _symbols_named(range(_data_count(model.flight))), _symbols_named(range(_data_count(model.contact)))
    yield "flight.field", lambda: _not_so_many(model.flight.field(x, known, q), n)
    yield "contact.field", lambda: _not_so_many(model.contact.field(y, known, stood), m)
    for where, phase, arguments in (
        ("flight", model.flight, (x, known, q)),
        ("contact", model.contact, (y, known, stood)),
    ):
        yield f"{where}.watch", partial(_no_watch, phase, arguments)
        yield f"{where}.pieces", partial(_no_pieces, phase, known)
        yield f"{where}.closed_form", partial(_no_closed_form, phase, p)
        yield f"{where}.reaches", partial(_no_reaches, phase)
    yield "contact.watch", lambda: "" if WATCHED_FORCE in model.contact.watch else f"it has no '{WATCHED_FORCE}'"
    yield "flight_gradient", lambda: _not_so_many(model.flight_gradient(x, known, q), n)
    yield "contact_gradient", lambda: _not_so_many(model.contact_gradient(y, known, stood), m)
    yield "launch", lambda: _not_so_many(model.launch(named, known), n)
    yield "liftoff", lambda: _not_so_many([model.liftoff(named, known, q)], 1)
    yield "landing", lambda: _not_so_many(model.landing(named, x, known), 3)
    yield "touchdown", lambda: _not_so_many(model.touchdown(named, known), m)
    yield "tension", lambda: _not_so_many([model.tension(x, known, q)], 1) if model.tension else ""
    yield "reversor", lambda: _no_reversor(model.reversor, n)
    yield "embed", lambda: _no_array(model.embed, (n, m))
    yield "impact", lambda: _not_so_many(model.impact(x, known), n)
    yield "impact_mass", lambda: _not_so_many([model.impact_mass(x, known)], 1)
    yield "extension", lambda: _not_affine(model.extension, n)
    yield "contact_speed", lambda: _not_affine(model.contact_speed, m)
    yield "gap", lambda: _not_affine(model.gap(p), n)
    yield "separation", lambda: "" if (apart := model.separation(p)) is None else _no_height(apart, model.flight)
    yield "heights", lambda: _no_heights(model.heights(p), model.flight)
    yield "springs", lambda: _no_pairs(model, model.springs, p)
    yield "knees", lambda: _no_knees(model, p)
    yield "rest", lambda: "" if model.rest is None else _no_array(model.rest(p), (n,))
    yield "violations", lambda: _not_told(model.violations)
    yield "release", lambda: _no_array(np.nan_to_num(model.release(np.ones(2), p)), (2,)) if model.one_speed else ""
    for name in ("homotopy", "gauge"):
        yield name, partial(_no_parameter, getattr(model, name), p)
    yield "units", lambda: _no_units(model, p)
    for name in ("guess", "search"):
        yield name, partial(_no_function, getattr(model, name) or len)
    yield "relative", lambda: "" if isinstance(model.relative, Relative | None) else "it is no relative motion"


def _data_count(phase: Phase) -> int:
    return phase.pieces.size if phase.pieces else 0


def _symbols_named(names: Any) -> list[ca.SX]:
    return [ca.SX.sym(str(name)) for name in names]


def _not_so_many(values: Any, count: int) -> str:
    """Whether an answer is so many expressions."""
    if not isinstance(values, list | tuple | np.ndarray):
        return f"it gives a {type(values).__name__}, not a list of {count} expressions"
    if len(values) != count:
        return f"it gives {len(values)} expressions, not {count}"
    sizes = [ca.SX(value).numel() for value in values]
    return "" if sizes == [1] * count else "it gives expressions that are no scalars"


def _no_array(value: Any, shape: tuple[int, ...]) -> str:
    array = np.asarray(value, dtype=float)
    if array.shape != shape:
        return f"it has the shape {array.shape}, not {shape}"
    return "" if np.isfinite(array).all() else "it has a number that is not finite"


def _not_affine(value: Any, count: int) -> str:
    if not isinstance(value, Affine):
        return f"it is a {type(value).__name__}, not an Affine"
    if len(value.weights) != count:
        return f"it has {len(value.weights)} weights, not {count}"
    return "" if np.isfinite([*value.weights, value.offset]).all() else "it has a weight that is no finite number"


def _no_unknowns(model: Model) -> str:
    own = ("liftoff", "alpha")
    if missing := [name for name in own if name not in model.launch_unknowns]:
        return f"it has no '{missing[0]}'"
    other = [name for name in model.launch_unknowns if name not in (*own, *model.flight.states)]
    return f"'{other[0]}' is no flight state" if other else ""


def _no_watch(phase: Phase, arguments: tuple) -> str:
    wrong = [text for quantity in phase.watch.values() if (text := _not_so_many([quantity(*arguments)], 1))]
    return wrong[0] if wrong else ""


def _no_pieces(phase: Phase, p: Mapping[str, Any]) -> str:
    if phase.pieces is None:
        return ""
    if len(phase.pieces.coordinate) != len(phase.states):
        return f"its coordinate has {len(phase.pieces.coordinate)} weights, not {len(phase.states)}"
    breaks, rows = phase.pieces.table(p)
    if len(breaks) != len(rows) + 1:
        return f"its table has {len(breaks)} breakpoints for {len(rows)} pieces"
    sizes = {len(row) for row in rows} - {phase.pieces.size}
    return f"its table has {sizes.pop()} data values of a piece, not {phase.pieces.size}" if sizes else ""


def _no_closed_form(phase: Phase, p: Mapping[str, float]) -> str:
    if phase.closed_form is None:
        return ""
    form, n = phase.closed_form(p), len(phase.states)
    return _no_array(form.state(np.zeros(n), 0.1), (n,)) or _no_array(form.transition(0.1), (n, n))


def _no_reaches(phase: Phase) -> str:
    wrong = [far for weights, far in phase.reaches if len(weights) > len(phase.states) or not far > 0]
    return f"{wrong[0]!r} is no distance along a coordinate of the states" if wrong else ""


def _no_reversor(reversor: Any, count: int) -> str:
    if reversor is None:
        return ""
    if len(reversor) != count:
        return f"it has {len(reversor)} signs, not {count}"
    return "" if {*reversor} <= {1, -1} else f"{tuple(reversor)} are not signs 1 and -1"


def _no_height(value: Any, phase: Phase) -> str:
    """Whether something is a function of the states of a phase, `Affine` or a `StateFormula`."""
    if not isinstance(value, StateFormula):
        return _not_affine(value, len(phase.states))
    return "" if value.states == phase.states else f"it is a function of {value.states}, not of the flight states"


def _no_heights(heights: Any, phase: Phase) -> str:
    if not isinstance(heights, Mapping) or not heights:
        return f"it gives a {type(heights).__name__}, not functions by name"
    wrong = [f"'{name}': {text}" for name, height in heights.items() if (text := _no_height(height, phase))]
    return wrong[0] if wrong else ""


def _no_knees(model: Model, p: Mapping[str, float]) -> str:
    if model.knees is None:
        return ""
    known = model.knees(p)
    wrong = [length for *_, length in known if not _positive(length)]
    return _no_pairs(model, [pair for *pair, _ in known], p) or (f"{wrong[0]!r} is no length" if wrong else "")


def _no_pairs(model: Model, pairs: Any, p: Mapping[str, float]) -> str:
    ends = [end for pair in pairs for end in pair if end is not None]
    names = model.heights(p)
    other = [end for end in ends if end not in names]
    if other:
        return f"'{other[0]}' is none of the heights"
    return "" if all(len(pair) == 2 for pair in pairs) else "they are not pairs of heights"


def _not_told(violations: Any) -> str:
    missing = [name for name in TOLD_REASONS if not isinstance(violations.get(name), str)]
    return f"it has no words for '{missing[0]}'" if missing else ""


def _no_parameter(name: Any, p: Mapping[str, float]) -> str:
    return "" if name is None or name in p else f"'{name}' is no parameter"


def _no_function(value: Any) -> str:
    return "" if callable(value) else "it is no function"


def _no_units(model: Model, p: Mapping[str, float]) -> str:
    if model.units is None:
        return ""
    units = model.units(p)
    if not isinstance(units, Units):
        return f"it gives a {type(units).__name__}, not Units"
    sizes = {name: unit for name, unit in vars(units).items() if unit is not None and name != "angles"}
    wrong = [f"{name} is {unit!r}" for name, unit in sizes.items() if not _positive(unit)]
    return f"its unit of {wrong[0]}" if wrong else ""


def _positive(value: Any) -> bool:
    return bool(np.ndim(value) == 0 and 0 < value < np.inf)
