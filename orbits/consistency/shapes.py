"""The fields of a hand-written model, called once: whether each is there, is called as `Model` says, and returns as it
should."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import casadi as ca
import numpy as np

from ..errors import OrbitsError
from ..laws.law import Parameters, Scalars
from ..model.model import CONTACT_FORCE, LANDED_FORCE, Model
from ..model.phase import Affine, Phase
from ..model.relative import Relative
from ..model.state_formula import StateFormula
from ..model.symmetry import SignedShift

# The four reasons that every model has words for, and those of models with such a field or such a force.
REASONS_IN_WORDS = ("gap", "pull", "separation", "end")
OF_LANDING_GAP, OF_LANDED_FORCE = "landing gap", "landed pull"


def malformed(model: Model, values: Mapping[str, float]) -> dict[str, str]:
    """The faults in the form of a model's fields, in words by the field's name."""
    phases = {"flight.states": model.flight, "contact.states": model.contact}
    if found := {name: text for name, phase in phases.items() if (text := _phase(phase))}:
        return found
    if text := _unknowns(model):
        return {"launch_unknowns": text}
    for name, check in _form_checks(model, values):
        if name in ("springs", "knees") and "heights" in found:
            continue
        try:
            text = check()
        except OrbitsError as error:
            text = "" if name == "release" else str(error)  # a machine may have no launch at a speed, and says so
        except Exception as error:
            text = f"it cannot be evaluated ({type(error).__name__}: {error})"
        if text:
            found.setdefault(name, text)
    return found


def _form_checks(model: Model, p: Mapping[str, float]) -> Iterator[tuple[str, Callable[[], str]]]:
    """The name of each field with a function that states the fault in its form, "" where there is none."""
    n, m = len(model.flight.states), len(model.contact.states)
    known = dict(zip(p, _scalar_symbols(len(p)), strict=True))
    flown, stood = _arguments(model.flight, known), _arguments(model.contact, known)
    yield from _form_checks_of_phase("flight", model.flight, flown, p)
    yield from _form_checks_of_phase("contact", model.contact, stood, p)
    yield "contact.watch", lambda: "" if CONTACT_FORCE in model.contact.watch else f"it has no '{CONTACT_FORCE}'"
    yield "flight_gradient", lambda: _scalars(model.flight_gradient(*flown), n)
    yield "tension", lambda: _scalars([model.tension(*flown)], 1) if model.tension else ""
    yield "impact", lambda: _scalars(model.impact(*flown[:2]), n)
    yield "impact_mass", lambda: _scalars([model.impact_mass(*flown[:2])], 1)
    yield from _form_checks_of_maps(model, p)
    yield "embed", lambda: _array_of(model.embed, (n, m))
    yield "extension", lambda: _affine(model.extension, n)
    if model.extension_offset is not None:
        yield "extension_offset", lambda: _affine(model.extension_of(p), n)
    yield "gap", lambda: _affine(model.gap(p), n)
    yield "separation", lambda: "" if (apart := model.separation(p)) is None else _height_function(apart, model.flight)
    yield "heights", lambda: _heights(model.heights(p), model.flight)
    yield "springs", lambda: _pairs(model.springs, model.heights(p))
    yield "knees", lambda: _knees(model.knees(p), model.heights(p)) if model.knees else ""
    yield "rest", lambda: _array_of(model.rest(p), (n,)) if model.rest else ""
    yield "violations", lambda: "".join(f"it has no words for '{name}'" for name in _conditions_in_words(model)
                                        if not isinstance(model.violations.get(name), str))  # fmt: skip
    yield "release", lambda: _array_of(np.nan_to_num(model.release(np.ones(2), p)), (2,)) if model.one_speed else ""
    for name, stated in (("homotopy", model.homotopy), ("gauge", model.gauge)):
        yield name, partial(str, "" if stated is None or stated in p else f"'{stated}' is no parameter")
    for name, function in (("guess", model.guess), ("search", model.search)):
        fine = callable(function) or isinstance(function, Relative | None)
        yield name, partial(str, "" if fine else "it is no function")


def _form_checks_of_phase(
    where: str, phase: Phase, arguments: tuple, p: Mapping[str, float]
) -> Iterator[tuple[str, Callable[[], str]]]:
    """The form checks of a phase; `arguments` are those of its field."""
    yield f"{where}.field", lambda: _scalars(phase.field(*arguments), len(phase.states))
    yield f"{where}.watch", lambda: _scalars(values := [each(*arguments) for each in phase.watch.values()], len(values))
    yield f"{where}.pieces", lambda: _pieces(phase, arguments[1])


def _form_checks_of_maps(model: Model, p: Mapping[str, float]) -> Iterator[tuple[str, Callable[[], str]]]:
    """The form checks of time reversal, of the relabelling after a landing, and of what follows from both."""
    n, maps = len(model.flight.states), {"reversor": model.reversor, "symmetry": model.symmetry}
    faults = {name: _signs(signs, n) for name, signs in maps.items()}
    yield from ((name, partial(str, text)) for name, text in faults.items())
    for name, shift in (("reversor", model.reversor_shift), ("symmetry", model.symmetry_shift)):
        yield f"{name}_shift", partial(_shift, name, maps[name], shift, model.flight, p)
    if model.reversor and (model.reversor_shift or model.symmetry_shift) and not any(faults.values()):
        yield "reversor_shift", lambda: _undone("it", model.reversal, model.flight, p)
        whole = "the symmetry after the reversor"
        yield "symmetry_shift", lambda: _undone(whole, model.contact_reversal, model.contact, p)
    yield "landing_gap", lambda: _affine(model.landing_gap(p), n) if model.landing_gap else ""
    yield "feet", lambda: "" if len(model.feet) <= 2 else f"it has {len(model.feet)} names, not one or two"


def _conditions_in_words(model: Model) -> list[str]:
    """The names of the conditions of a motion that a model has."""
    landing = [OF_LANDING_GAP] if model.landing_gap else []
    return [*REASONS_IN_WORDS, *landing, *([OF_LANDED_FORCE] if LANDED_FORCE in model.contact.watch else [])]


def _scalar_symbols(count: int) -> list[ca.SX]:
    return [ca.SX.sym("x") for _ in range(count)]


def _arguments(phase: Phase, known: Parameters) -> tuple[Scalars, Parameters, Scalars]:
    """The arguments of the field of a phase."""
    return _scalar_symbols(len(phase.states)), known, _scalar_symbols(phase.pieces.size if phase.pieces else 0)


def _phase(phase: object) -> str:
    if not isinstance(phase, Phase):
        return f"it is a {type(phase).__name__}, not a Phase"
    named = isinstance(phase.states, tuple) and phase.states and all(isinstance(name, str) for name in phase.states)
    return "" if named and len({*phase.states}) == len(phase.states) else f"states = {phase.states!r} are no names"


def _unknowns(model: Model) -> str:
    first, others, states = model.launch_unknowns[:2], model.launch_unknowns[2:], model.contact.states
    if first != ("liftoff", "alpha"):
        return f"it begins with {first}, not with 'liftoff' and 'alpha'"
    if other := [name for name in others if name not in states]:
        return f"'{other[0]}' is no contact state"
    launched = [name for name in states if f"{name}'" in states and name not in others]
    return "" if len(launched) == 1 else f"it leaves {len(launched)} coordinates of the contact to be launched, not 1"


def _scalars(values: object, count: int) -> str:
    if not isinstance(values, list | tuple | np.ndarray):
        return f"it gives a {type(values).__name__}, not a list of {count} expressions"
    if len(values) != count:
        return f"it gives {len(values)} expressions, not {count}"
    return "" if all(ca.SX(value).numel() == 1 for value in values) else "it gives expressions that are no scalars"


def _array_of(value: object, shape: tuple[int, ...]) -> str:
    array = np.asarray(value, dtype=float)
    if array.shape != shape:
        return f"it has the shape {array.shape}, not {shape}"
    return "" if np.isfinite(array).all() else "it has a number that is not finite"


def _affine(value: object, count: int) -> str:
    if not isinstance(value, Affine):
        return f"it is a {type(value).__name__}, not an Affine"
    if len(value.weights) != count:
        return f"it has {len(value.weights)} weights, not {count}"
    return "" if np.isfinite([*value.weights, value.offset]).all() else "it has a weight that is no finite number"


def _pieces(phase: Phase, p: Parameters) -> str:
    if phase.pieces is None:
        return ""
    if len(phase.pieces.coordinate) != len(phase.states):
        return f"its coordinate has {len(phase.pieces.coordinate)} weights, not {len(phase.states)}"
    breaks, rows = phase.pieces.table(p)
    return "" if len(breaks) == len(rows) + 1 else f"its table has {len(breaks)} breakpoints for {len(rows)} pieces"


def _signs(reversor: Sequence[int] | None, count: int) -> str:
    if reversor is None:
        return ""
    if len(reversor) != count:
        return f"it has {len(reversor)} signs, not {count}"
    return "" if {*reversor} <= {1, -1} else f"{tuple(reversor)} are not signs 1 and -1"


def _shift(of: str, signs: object, shift: Callable | None, phase: Phase, p: Mapping[str, float]) -> str:
    """The fault of what a map with these signs adds to the states."""
    if shift is None:
        return ""
    if signs is None:
        return f"there is no {of} whose images it moves: state its signs, 1 where it leaves a state as it is"
    values = np.asarray(shift(p), dtype=float)
    moved = [name for name, by in zip(phase.states, values.flat, strict=False) if name.endswith("'") and by != 0]
    return _array_of(values, (len(phase.states),)) or (f"it adds to the speed {moved[0]}" if moved else "")


def _undone(what: str, turn: SignedShift, phase: Phase, p: Mapping[str, float]) -> str:
    """The fault of a map that should be its own inverse."""
    each = zip(phase.states, turn.signs, turn.shifts(p), strict=True)
    moved = [f"{name} to {name} + {shift:g}" for name, sign, shift in each if sign > 0 and shift != 0]
    return f"{what} takes {moved[0]}, and is not its own inverse" if moved else ""


def _height_function(value: object, phase: Phase) -> str:
    if not isinstance(value, StateFormula):
        return _affine(value, len(phase.states))
    return "" if value.states == phase.states else f"it is a function of {value.states}, not of the flight states"


def _heights(heights: object, phase: Phase) -> str:
    if not isinstance(heights, Mapping) or not heights:
        return f"it gives a {type(heights).__name__}, not functions by name"
    return next((f"'{name}': {text}" for name, each in heights.items() if (text := _height_function(each, phase))), "")


def _pairs(pairs: Sequence[Sequence[str | None]], heights: Mapping[str, Affine | StateFormula]) -> str:
    other = [end for pair in pairs for end in pair if end is not None and end not in heights]
    return f"'{other[0]}' is none of the heights" if other else ""


def _knees(knees: Sequence[tuple], heights: Mapping[str, Affine | StateFormula]) -> str:
    wrong = [length for *_, length in knees if not 0 < length < np.inf]
    return _pairs([pair for *pair, _ in knees], heights) or (f"{wrong[0]!r} is no length" if wrong else "")
