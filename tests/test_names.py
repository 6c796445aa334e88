"""Names by verbs: each quantity and each parameter goes everywhere by its one name, or is refused with the reason."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from conftest import slow_after

from orbits import (
    InputError,
    NoOrbit,
    existence,
    find,
    find_all,
    follow,
    follow_event,
    optimize,
    pareto,
    quantities,
    sensitivities,
    starts,
    sweep,
    uncertainty,
)
from orbits.model import free_parameters
from orbits.periodic import OF_RUNS, QUANTITIES, absent_quantities, quantity_names
from orbits.show.canvas import off_screen
from problems import Chain, Hopper, Juggler, hopper_in_si, rimless_wheel, runner
from problems.explorer import beginning
from problems.explorer.dials import dials_of

RUN = {"tune": ("inertia", "hip_stiffness"), "at": {"speed": 0.4}}
# Machines, each with the parameter that is varied and tuned, a second one, and the values that find its run.
MACHINES: dict[str, tuple[Any, str, str, dict[str, Any]]] = {
    "hopper": (Hopper("cubic", rest_length=9.0, mass_ratio=0.5, parameters={"beta": 0.3}), "beta", "mass_ratio", {}),
    "leg in SI": (
        hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8e3, "b": 2e6}, rest_length=0.8),
        *("k", "foot_mass", {}),
    ),
    "linear leg": (hopper_in_si(60.0, 3.0, stiffness=8e3, rest_length=0.8), "stiffness", "foot_mass", {}),
    "juggler": (Juggler("cubic", rest_length=9.0, mass_ratio=0.5, parameters={"beta": 0.3}), "beta", "mass_ratio", {}),
    "chain": (Chain((1.0, 1.0, 1.0), ["r + b*r**3", "r"], parameters={"b": 0.02}), "b", "m2", {}),
    "wheel": (
        rimless_wheel(angle=0.3, spring="r + b*r**3", parameters={"b": 1.0}, friction=0.6, share=0.5),
        *("b", "inertia_ratio", {}),
    ),
    "runner": (
        runner(foot_mass=0.1, rest_length=3.7, inertia=5.654048422247934, hip_stiffness=5.367600480798711),
        *("foot_mass", "body_mass", RUN),
    ),
}
# Reasons for which a name makes no sense for a verb, or an orbit has no such number, besides those of
# `absent_quantities`.
REASONS = (
    "depends on the whole motion",  # no equation of half an orbit
    "it can be prescribed only in designs",
    "cannot be computed for many",
    "is not available here",
    "it follows from the geometry",
    "it is a parameter of the machine",
    "name in tune= the parameter that changes",
    "does not depend on",  # the number that is tuned
    "do not depend on",
    "does not determine",
    "has no such place",  # orbits without an extreme
    "has no lowest point",
    "has no lowest value",
    "has no value at any orbit",
    "has no loss_coefficient",
    "fewer than two members are motions",
    "has the same value along the whole family",
    "passes 1 along the family 0 times",
    "can be followed only for smooth laws",
    "a quantity of orbits; find",  # parameters
    "it follows from",
    "lossless orbits do not depend on it",
    "is tuned and follows from the others",
    "is followed, so it cannot be tuned",
    "must be followed along another parameter",
    "follow it along another parameter",
    "is varied, so it cannot be tuned",
)


@dataclass(frozen=True, eq=False)
class Case:
    """A machine with an orbit of it, and what the verbs take of it."""

    name: str

    @property
    def stated(self) -> tuple[Any, str, str, dict[str, Any]]:
        return MACHINES[self.name]

    @property
    def machine(self) -> Any:
        return self.stated[0]

    @property
    def runs(self) -> bool:
        return bool(self.stated[3])

    @property
    def start(self) -> dict[str, Any]:
        """Of a machine whose launch has several numbers."""
        return {} if self.machine.model.one_speed or self.runs else {"start": orbit_of(self.name)}

    @property
    def tuned(self) -> dict[str, Any]:
        return self.stated[3]

    def range(self, name: str, share: float = 0.01) -> tuple[float, float]:
        value = self.machine.values.get(name) or 1.0
        return (1 - share) * value, (1 + share) * value

    def value(self, quantity: str) -> float:
        """The value of a quantity of the orbit, from the orbit itself; NaN where it has none."""
        orbit, heights = orbit_of(self.name), {of.replace(" ", "_"): x for of, x in orbit_of(self.name).rises.items()}
        known = {"frequency": 1 / orbit.period, "period": orbit.period}
        known |= {f"{of}_rise": x for of, x in heights.items()}
        places = (getattr(place, quantity, None) for place in (orbit, orbit.certificate))
        value = known.get(quantity, next((each for each in places if each is not None), None))
        if value is None and quantity in quantity_names(self.machine.model, self.machine.values) and not self.runs:
            value, _ = cell(lambda: quantities(self.machine, orbit, quantity)[quantity])
        return float("nan") if value is None else float(value)


@cache
def orbit_of(name: str) -> Any:
    """An orbit of a machine: of a chain the slowest motion that is no short bounce."""
    machine, _, _, tuned = MACHINES[name]
    if machine.model.one_speed or tuned:
        return find(machine, **tuned)
    hops = find_all(machine, starts(machine, 4.0, 4.0))
    return min((hop for hop in hops if hop.admissible and hop.alpha > 1), key=lambda hop: hop.alpha)


@cache
def family_of(name: str) -> Any:
    """A family of a machine, which begins at the orbit."""
    case = Case(name)
    if case.runs:
        return follow(case.machine, "speed", 0.42, start=orbit_of(name), tune=case.tuned["tune"], longest=0.5)
    return follow(case.machine, case.stated[1], case.range(case.stated[1])[1], **case.start, longest=0.5)


@cache
def existence_of(name: str, asked: str) -> Any:
    """A diagram of a machine over its two parameters with a quantity."""
    case = Case(name)
    _, first, second, _ = case.stated
    return existence(
        case.machine,
        first,
        case.range(first, 1e-7),
        second,
        case.range(second, 1e-7),
        samples=2,
        quantities=[asked],
        **case.start,
    )


def _prescribed(case: Case, name: str) -> float:
    tune, value = case.tuned.get("tune", case.stated[1]), case.value(name)
    if np.isnan(value) and name in quantity_names(case.machine.model, case.machine.values):
        return value  # the orbit has none: no search for one that has it
    if case.runs and name.endswith(("_rise", "_apex")):
        return value  # found as the stroke is, by many runs
    found = find(orbit_of(case.name).source, **case.start, tune=tune, at={name: 1.0 if np.isnan(value) else value})
    return Case.value(case, name) if found.alpha == pytest.approx(orbit_of(case.name).alpha, rel=1e-6) else np.nan


def _along(case: Case, name: str) -> float:
    tune, value = case.tuned.get("tune", case.stated[1]), case.value(name)
    last = 1.0 if np.isnan(value) else 1.0001 * value or 0.01
    start = {"start": orbit_of(case.name)} if case.runs or case.start else {}
    return float(follow(case.machine, name, last, **start, tune=tune, most=2).column(name)[0])


def _event(case: Case, name: str) -> float:
    values = family_of(case.name).column(name)
    level = float(values.mean()) if np.isfinite(values).all() and np.ptp(values) > 1e-9 else 1.0
    curve = follow_event(family_of(case.name), {name: level}, case.stated[2], case.range(case.stated[2])[1], most=2)
    assert curve.column(name)[0] == pytest.approx(level, rel=1e-7)
    return float(values[0])


def _best(case: Case, name: str, **more: Any) -> Any:
    over = {case.stated[1]: case.range(case.stated[1])}
    return optimize(case.machine, **more, over=over, **case.start, **case.tuned)


def _objective(case: Case, name: str) -> float:
    own = case.value(name)
    best = _best(case, name, minimise=name)
    assert np.isnan(own) or best.objective <= own + 1e-9 * abs(own)
    return own


def _constrained(case: Case, name: str) -> float:
    best = _best(case, name, minimise="alpha", subject_to=[f"{name} >= -1e9"])
    assert name in best.quantities or name == "alpha"
    return case.value(name)


def _front(case: Case, name: str) -> float:
    over = {case.stated[1]: case.range(case.stated[1])}
    other = "alpha" if name == "flight_time" else "flight_time"
    pareto(case.machine, minimise=(f"-({name})", other), over=over, points=2, **case.start, **case.tuned)
    return case.value(name)


def _swept(case: Case, name: str) -> float:
    own = case.machine.values[case.stated[1]]
    return float(sweep(case.machine, {case.stated[1]: [own]}, quantities=[name], **case.start, **case.tuned)[name][0])


def _spread(case: Case, name: str) -> float:
    found = uncertainty(
        case.machine, {case.stated[1]: case.range(case.stated[1], 1e-6)}, [name], samples=2, **case.start
    )
    assert np.isfinite(found.linear[name])
    return float(found.mean[name])


def _drawn(case: Case, name: str) -> float:
    with off_screen():  # pyplot, where another test has loaded it, would keep all figures
        axes = family_of(case.name).plot(name)
    value = float(family_of(case.name).column(name)[0])
    drawn = [line.get_ydata()[0] for line in axes.lines if len(line.get_xdata()) > 1]
    assert np.isnan(value) or value in drawn
    return value


# What each verb says of a quantity of the orbit.
OF_QUANTITIES: dict[str, Callable[[Case, str], float]] = {
    "find(at=)": _prescribed,
    "follow(along)": _along,
    "family.column": lambda case, name: float(family_of(case.name).column(name)[0]),
    "family.plot": _drawn,
    "follow_event": _event,
    "quantities": lambda case, name: quantities(case.machine, orbit_of(case.name), name)[name],
    "sensitivities": lambda case, name: sensitivities(
        case.machine, orbit_of(case.name), case.stated[1], name, **case.tuned
    ).at[name],
    "optimize(minimise)": _objective,
    "optimize(subject_to)": _constrained,
    "pareto": _front,
    "sweep": _swept,
    "existence": lambda case, name: float(np.median(existence_of(case.name, name).grid[name])),
    "uncertainty": _spread,
}
# Verbs that take the parameters of machines whose numbers are tuned in other ways.
ONLY_HOPS = ("quantities", "existence", "uncertainty")


def names_of(case: Case) -> list[str]:
    """All names of quantities."""
    heights = [of.replace(" ", "_") for of in orbit_of(case.name).rises]
    own = [f"{of}_{kind}" for of in heights for kind in ("rise", "apex")]
    return [*(name for name in QUANTITIES if name not in ("rises", "apexes")), *OF_RUNS, *own]


def cell(verb: Callable[[], Any]) -> tuple[Any, str]:
    """What a verb returns, or the reason why it refuses."""
    try:
        return verb(), ""
    except (InputError, NoOrbit) as error:
        return None, str(error)


# What is drawn and bounded is resolved where columns and objectives are, so that some machines stand for all.
SAME = {"family.plot": "family.column", "pareto": "optimize(minimise)", "optimize(subject_to)": "optimize(minimise)"}
SOME = ("hopper", "chain", "wheel")
CELLS = [(name, verb) for verb in OF_QUANTITIES for name in (SOME if verb in SAME else MACHINES)]
FAST = {("hopper", "family.column"), ("leg in SI", "quantities"), ("wheel", "sensitivities")}
SLOW = [pytest.param(*each, marks=[] if each in FAST else pytest.mark.slow) for each in CELLS]


@pytest.mark.parametrize(("machine", "verb"), SLOW)
def test_a_quantity_has_one_name(machine, verb):
    """Each name works, and then means the same number as on the orbit, or is refused for a reason."""
    case, wrong = Case(machine), list[str]()
    absent = absent_quantities(case.machine.model, case.machine.values)
    if case.runs and verb in ONLY_HOPS:
        return
    for name in names_of(case):
        found, refused = cell(lambda name=name: OF_QUANTITIES[verb](case, name))
        expected = case.value(name)
        if refused:
            own = absent.get(name, "")[:60]  # of the reason, whose end may be cut off
            if not any(reason in refused for reason in (REASONS if name not in absent else [own])):
                wrong.append(f"{name}: {refused}")
        elif not np.isnan(expected) and found != pytest.approx(expected, rel=1e-5):
            wrong.append(f"{name}: {found}, not {expected}")
        elif name in absent and not (verb.startswith("family") or name in ("error", "family", "admissible")):
            wrong.append(f"{name} is taken")
    assert not wrong, "\n".join(wrong)


def _other(case: Case, name: str) -> tuple[str, tuple[float, float]]:
    """Another parameter with its range."""
    other = next(each for each in case.stated[1:3] if each != name)
    return other, case.range(other)


def _followed(case: Case, name: str) -> Any:
    level = {"alpha": float(family_of(case.name).column("alpha").mean())}
    return follow_event(family_of(case.name), level, name, case.range(name)[1], most=2)


# What each verb does with a parameter.
OF_PARAMETERS: dict[str, Callable[[Case, str], Any]] = {
    "find(tune)": lambda case, name: find(
        case.machine, **case.start, tune=name, at={"alpha": 1.0001 * orbit_of(case.name).alpha}
    ),
    "follow": lambda case, name: follow(case.machine, name, case.range(name)[1], **case.start, most=2),
    "sensitivities": lambda case, name: sensitivities(case.machine, orbit_of(case.name), name, "alpha"),
    "optimize(over)": lambda case, name: optimize(
        case.machine, minimise=f"alpha + {name}", over={name: case.range(name)}, **case.start
    ),
    "formula": lambda case, name: sensitivities(case.machine, orbit_of(case.name), case.stated[1], f"alpha*{name}"),
    "sweep": lambda case, name: sweep(case.machine, {name: case.range(name)}, 2, **case.start),
    "existence": lambda case, name: existence(
        case.machine, name, case.range(name), *_other(case, name), samples=2, **case.start
    ),
    "uncertainty": lambda case, name: uncertainty(case.machine, {name: case.range(name)}, samples=2, **case.start),
    "follow_event": _followed,
}
REFUSED = ("no parameter", "unknown quantity", "no quantity", "no family goes along")
OTHERS = ("restitution", "damping", "drag", "mass_ratio", "stiffness", "period", "alpha", "step", "no_name")


@pytest.mark.parametrize(
    ("machine", "verb"),
    slow_after(3, [(name, verb) for verb in OF_PARAMETERS for name in MACHINES if name != "runner"]),
)
def test_a_parameter_has_one_name(machine, verb):
    """Each parameter of a machine is taken, and what is none is refused for a reason."""
    case, wrong = Case(machine), list[str]()
    free = free_parameters(case.machine)
    for name in (*free, *(each for each in OTHERS if each not in free)):
        _, refused = cell(lambda name=name: OF_PARAMETERS[verb](case, name))
        known = any(reason in refused for reason in REASONS)
        if name in free and refused and not known:
            wrong.append(f"{name}: {refused}")
        elif name not in free and not refused and not (verb in ("sweep", "existence") or verb == "formula"):
            wrong.append(f"{name} is taken")
        elif refused and not known and not any(words in refused for words in REFUSED):
            wrong.append(f"{name}: {refused}")
    assert not wrong, "\n".join(wrong)


def test_names_of_tables_and_documents_are_those_of_formulas():
    """The summary of an orbit, its main results in SI, and the columns of families and sweeps."""
    leg = MACHINES["leg in SI"][0]
    orbit, known = orbit_of("leg in SI"), {*quantity_names(leg.model, leg.values), *leg.values}
    words = {"error", "residual", "energy_drift", "method", "seconds", "admissible", "launch_range"}
    assert {*orbit.summary()} - known <= words
    units = ("_m_per_s", "_1_per_s", "_m", "_s", "_N", "_J", "")
    for key, value in orbit.si().items():
        name = next(key.removesuffix(unit) for unit in units if key.endswith(unit))
        assert name in known | {"loop_energy", "step", "speed", "unit_length", "unit_time", "unit_force"}, key
        if name in ("alpha", "flight_time", "stroke", "body_rise"):
            assert value == pytest.approx(quantities(leg, orbit, name)[name], rel=1e-10)
    frame = family_of("leg in SI").table(leg)
    assert known - {*frame} - {*leg.values} == {
        "largest_spring_force",
        "landing_sensitivity",
    }  # which column() computes


LINES = (
    "find --spring cubic --tune beta=0.3 --at {name}={value}",
    "follow --spring cubic --tune beta=0.3 --along {name} --to {value}",
    "sweep --spring cubic --over beta=0.1,0.2 --quantities {name}",
    "existence --spring cubic --along beta=0.1:0.2 --across rest_length=6:7 --samples 2 --colour {name} --plot f.png",
    "uncertainty --spring cubic --over beta=norm(0.3,0.01) --samples 4 --quantity {name} --plot f.png",
)


@pytest.mark.parametrize("line", LINES)
def test_the_command_line_takes_the_same_names(line, orbits, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert orbits(line.format(name="frequency", value=0.1) + " --json").code == 0
    done = orbits(line.format(name="step", value=1.0))
    assert (done.code, "does not move on along the ground" in " ".join(done.err.split())) == (2, True)


def test_a_machine_file_takes_the_same_names(orbits, tmp_path):
    file = tmp_path / "leg.toml"
    problem = 'spring = "cubic"\nrest_length = 9.0\nparameters = {beta = 0.3}\n[design]\nminimise = "%s"\n'
    problem += "over = {beta = [0.2, 0.4]}\n"
    file.write_text(problem % "frequency")
    best = orbits("optimize", file, "--json").document
    assert best["parameters"]["beta"] == pytest.approx(0.2)  # softer springs hop more slowly
    file.write_text(problem % "step")
    done = orbits("optimize", file)
    assert (done.code, "does not move on along the ground" in " ".join(done.err.split())) == (2, True)


@pytest.mark.parametrize("kind", ["hopper", "juggler", "wheel", "rocker", "runner"])
def test_the_live_page_takes_the_same_names(kind):
    """The sliders of a machine have the names of its parameters, and of what maps and tuned runs have besides."""
    scene = beginning(kind)
    machine = scene.build()
    names = {dial.name for dial in dials_of(machine, scene)}
    assert names
    assert names <= {*free_parameters(machine), *scene.prescribed, "restitution", "damping", "drag"}
