"""An orbit as a function of the parameters of its machine, with exact derivatives, for graphs of CasADi.

The unknowns u of half an orbit are functions of the parameters theta by its equations F(u, theta) = 0, so that
du/dtheta = -F_u^-1 F_theta. The state x0 at lift-off follows from them, and so does every other: up to mid-flight
that at time t is the flow phi(x0, t), and then its mirror image R phi(x0, T - t), T the flight time; and so in
contact. The states of a machine in SI are multiples of these, whose units depend on the parameters too.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

from ..errors import InputError, NoOrbit, OrbitsError, list_of_names, whole_number
from ..model import Machine, Model, check_parameters, refuse_forward, refuse_hysteresis
from ..numerics import Array
from ..periodic import Orbit, StartLike, find, orbit_of
from ..running import exclusive
from ..shooting import vector
from ..symbolic import cached
from ..units import TIME, Units
from .design_problem import Outputs
from .evaluator import DesignPoints, Evaluator, Varied, VariedOrbit, evaluator, of_varied
from .local_search import attempt
from .optimize import Origin
from .sensitivities import check_varied, known_motion, sensitivities
from .tuned_machine import (
    TunedMachine,
    statement_of_orbits,
    tuned_numbers,
    unknowns_of,
    untuned,
    with_tuning,
)

# A motion of a shorter time, as a share of its phase, is its start.
SHARE_OF_START = 1e-12
# CasADi refers to the Python objects that it calls without owning them: what a graph may call lives on here.
_OF_CASADI: list[ca.Callback] = []
# The numbers of rows and columns of arguments or results, by name.
Sizes: TypeAlias = dict[str, tuple[int, int]]


@exclusive
def orbit_function(
    machine: Machine, over: str | Sequence[str], orbit: Orbit | int = 1, *,
    quantities: str | Sequence[str] = (), times: int = 0, start: StartLike | None = None,
    tune: str | Iterable[str] | None = None, at: Mapping[str, float] | None = None, name: str = "orbit",
) -> ca.Function:  # fmt: skip
    """An orbit of a machine as a `casadi.Function` of some of its parameters, with exact first derivatives.

    machine : as in `find`, with a reversor
    over : names (k,) of the parameters, or one of them
    orbit : an orbit of the machine, or the number of its family. The orbits for other parameters are continued from it:
        in one step if they are near, else along the straight line between them, or one parameter after the other
    quantities : of the orbit, or formulas of them, as in `sensitivities`
    times : number m of times at which states are returned
    start : as in `find`, of the orbit, instead of the number of its family
    tune, at : as in `optimize`: the orbit is tuned for all parameters; `over` may also name prescribed quantities
    name : of the function

    The function takes "parameters" (k,) in the order of `over` and, unless m is 0, "times" (m,) since lift-off, and
    returns

        launch     (j,)    unknowns of the launch, named by `machine.model.launch_unknowns`: "liftoff", "alpha", ...
        durations  (2,)    of flight and contact
        tuned      (t,)    values of the parameters in `tune`, unless there are none
        quantities (q,)    unless there are none
        states     (n, m)  flight states at the times, unless m is 0; for a machine that steps, as in `Orbit`

    in the machine's units. Each call finds and certifies an orbit, which need not be admissible: where it must be,
    bound quantities such as "clearance" and "smallest_contact_force". Where the orbit cannot be followed, the call
    raises `RuntimeError` with the reason; Ipopt then takes a shorter step. Derivatives follow from the implicit
    function theorem. Second derivatives, which Ipopt uses unless "hessian_approximation" is "limited-memory", are
    differences of these. Raises `InputError` for an unknown name, and for a model without a reversor, and `NoOrbit` for
    a spring with hysteresis.

    >>> from orbits import orbit_function
    >>> from problems import Hopper
    >>> launch = orbit_function(Hopper("cubic"), "beta")
    >>> round(float(launch(0.3)[0][1]), 9)
    2.936459188
    """
    names = list_of_names("over", over)
    texts = list_of_names("quantities", quantities)
    check_parameters(machine)
    if not names or len({*names}) < len(names):
        raise InputError(f"over = {over!r}; it must name the parameters of the function, each once")
    refuse_hysteresis(machine.model)
    if machine.model.sticks and (tune is not None or at is not None):
        others = "use optimize, pareto or sensitivities with tune= and at="
        raise InputError(
            f"a {machine.model.name} moves along the ground, which orbit_function cannot differentiate; {others}"
        )
    refuse_forward(machine.model)
    stated = with_tuning(machine, tune, at, ())
    check_varied(stated, names)
    if machine.model.reversor is None:
        halves = "only the first half of an orbit is differentiated, and the second must be its mirror image"
        raise InputError(f"a {machine.model.name} has no reversor: {halves}")
    whole_number("times", times, "times", least=0)
    if not (isinstance(name, str) and ca.Function.check_name(name)):
        raise InputError(
            f"name = {name!r}; it must begin with a letter and have letters, digits and single underscores"
        )
    machine, known = known_motion(stated, orbit, start)
    if known.contact_time is None:
        raise NoOrbit("the orbit has no contact that ends: " + "; ".join(known.violations))
    if texts:
        sensitivities(machine, known, names, texts)  # refuses unknown ones
    branch = _Branch(machine, known, names, texts)
    sizes_in = {"parameters": (len(names), 1), **({"times": (times, 1)} if times else {})}
    sizes_out = {"launch": (len(machine.model.launch_unknowns), 1), "durations": (2, 1)}
    sizes_out |= {"tuned": (len(tuned), 1)} if (tuned := tuned_numbers(machine)) else {}
    sizes_out |= {"quantities": (len(texts), 1)} if texts else {}
    sizes_out |= {"states": (len(machine.model.flight.states), times)} if times else {}
    return _Callback(name, sizes_in, sizes_out, branch.values, branch.slopes)


class _Branch:
    """The orbits of a machine over some parameters, continued from a known one; the latest is stored."""

    def __init__(self, machine: Machine, known: Orbit, names: list[str], texts: list[str]):
        self.machine, self.known, self.names, self.texts = machine, known, names, texts
        self._latest: tuple[bytes, Machine, Orbit] | None = None

    def orbit(self, theta: Array) -> tuple[Machine, Orbit]:
        """The machine and its orbit at parameters (k,); raises `NoOrbit` where the branch cannot be followed there."""
        if self._latest is None or self._latest[0] != theta.tobytes():
            self._latest = theta.tobytes(), *self._continued(theta)
        return self._latest[1:]

    def _continued(self, theta: Array) -> tuple[Machine, Orbit]:
        """From the known orbit, always on the same way, so that the result does not depend on earlier calls."""
        values = dict(zip(self.names, theta.tolist(), strict=True))
        other, found = self.machine.with_values(**values), None
        # Where a launch is a speed, the number of a family distinguishes its orbits, so that the known one leads there.
        if self.machine.model.one_speed and not tuned_numbers(self.machine):
            found = attempt(lambda: (other, find(other, self.known.family, start=self.known)))
        if not isinstance(found, tuple):
            (found,) = Origin(self.known.family, self.machine, self.known.dimensionless()).motions([other])
        if not isinstance(found, OrbitsError):
            machine, orbit = found[0], orbit_of(untuned(found[0]), found[1].dimensionless())
            if orbit.contact_time is not None:
                return machine, orbit
            found = NoOrbit("its contact does not end: " + "; ".join(orbit.violations))
        at = ", ".join(f"{name} = {x:.6g}" for name, x in values.items())
        raise NoOrbit(f"the orbit cannot be followed to {at}: {found}")

    def values(self, theta: Array, t: Array) -> dict[str, Array]:
        """The results of the function."""
        machine, orbit = self.orbit(theta)
        launch, durations = _launch_and_durations(machine, orbit)
        found = {"launch": launch, "durations": durations, "states": orbit(t).T}
        found["tuned"] = np.array([machine.values[name] for name in tuned_numbers(machine)])
        if self.texts:
            point = sensitivities(machine, orbit, self.names, self.texts)
            found["quantities"] = np.array([point.at[text] for text in self.texts])
        return found

    def slopes(self, theta: Array, t: Array) -> dict[str, Array]:
        """Their derivatives by the parameters and times together, a row for each number; the states one after the
        other."""
        machine, orbit = self.orbit(theta)
        found = _derivatives_of_motion(machine, orbit, tuple(self.names), t)
        if self.texts:
            point = sensitivities(machine, orbit, self.names, self.texts)
            rows = np.array([[point[text][name] for name in self.names] for text in self.texts])
            found["quantities"] = np.hstack([rows, np.zeros((len(rows), len(t)))])
        return found


class _Callback(ca.Callback):
    """A function of CasADi in Python, from the parameters and times to results by name.

    sizes_in, sizes_out : the numbers of rows and columns of arguments and results by name
    results : (parameters (k,), times (m,)) -> the results by name
    slopes : (parameters, times) -> their derivatives by the parameters and times together, a row for each number; None
        for those by differences
    """

    def __init__(
        self, name: str, sizes_in: Sizes, sizes_out: Sizes, results: Callable[..., Mapping[str, Array]],
        slopes: Callable[..., Mapping[str, Array]] | None = None,
    ):  # fmt: skip
        ca.Callback.__init__(self)
        self.sizes, self.results, self.slopes = (sizes_in, sizes_out), results, slopes
        self.construct(name, {} if slopes else {"enable_fd": True})
        _OF_CASADI.append(self)

    def get_n_in(self) -> int:
        return len(self.sizes[0])

    def get_n_out(self) -> int:
        return len(self.sizes[1])

    def get_name_in(self, i: int) -> str:
        return [*self.sizes[0]][i]

    def get_name_out(self, i: int) -> str:
        return [*self.sizes[1]][i]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*[*self.sizes[0].values()][i])

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*[*self.sizes[1].values()][i])

    def eval(self, arguments: Sequence[ca.DM]) -> list[ca.DM]:
        """The results, for CasADi."""
        theta, *times = (np.array(each, dtype=float).ravel() for each in arguments)
        found = self.results(theta, times[0] if "times" in self.sizes[0] else np.zeros(0))
        return [ca.DM(found[name]) for name in self.sizes[1]]

    def has_jacobian(self) -> bool:
        return self.slopes is not None

    def get_jacobian(
        self, name: str, names_in: Sequence[str], names_out: Sequence[str], options: Mapping[str, Any]
    ) -> ca.Function:
        """The function of the arguments and results with the blocks of the Jacobian, for CasADi."""
        assert self.slopes is not None
        slopes, (of_in, of_out) = self.slopes, self.sizes
        ends, own = np.cumsum([size for size, _ in of_in.values()])[:-1], [*of_in.values(), *of_out.values()]
        blocks = [(int(np.prod(result)), size) for result in of_out.values() for size, _ in of_in.values()]

        def results(theta: Array, t: Array) -> dict[str, Array]:
            found = slopes(theta, t)
            parts = (block for each in of_out for block in np.split(found[each], ends, axis=1))
            return dict(zip(names_out, parts, strict=True))

        sizes = (
            dict(zip([*of_in, *names_in[len(of_in) :]], own, strict=True)),
            dict(zip(names_out, blocks, strict=True)),
        )
        return _Callback(name, *sizes, results)


def _launch_and_durations(machine: Machine, orbit: Orbit) -> tuple[Array, Array]:
    """The unknowns of the launch, and the durations of flight and contact, in the machine's units."""
    model, units, bare = machine.model, machine.units, orbit.dimensionless()
    own = model.launch_at(bare.flight.coefficients[0, :, 0].tolist()) | {"alpha": bare.alpha}
    sizes = [1.0 if units is None else units.of(name) for name in model.launch_unknowns]
    times = [float(orbit.flight_time), float(orbit.contact_time or np.nan)]
    return np.array([own[name] for name in model.launch_unknowns]) * sizes, np.array(times)


def _derivatives_of_motion(machine: Machine, orbit: Orbit, over: tuple[str, ...], t: Array) -> dict[str, Array]:
    """The derivatives of the launch, the durations and the states at times (m,), by the parameters and the times."""
    model, names, bare = machine.model, tuple(machine.values), orbit.dimensionless()
    tuned = [statement_of_orbits(machine)] if isinstance(machine, TunedMachine) else []
    evaluate, n, k = evaluator(model, names, Outputs((), over), (), *tuned), len(model.flight.states), len(over)
    middle = np.array([[(bare.contact_time or np.nan) / 2]])
    found = evaluate.orbit(DesignPoints(vector(machine.values)[None], unknowns_of(machine, bare)[None], middle))
    sizes, j = _sizes_of_motion(model, names)(found.p), len(model.launch_unknowns)
    of_launch, time, of_states = (sizes.only([*range(*ends)]) for ends in ((0, j), (j, j + 1), (j + 1, j + 1 + n)))
    launch = found.begins["flight"].only([int(place) for place in model.launch_at(range(n)).values()])
    durations = Varied(*(2 * np.concatenate(parts, axis=1) for parts in zip(found.half, found.contact, strict=True)))
    at = Varied(t[:, None] / time.values, -t[:, None, None] / time.values[:, None] ** 2 * time.by)
    states, rates = _states_on_cycle(evaluate, found, at)
    by_time = np.zeros((len(t), n, len(t)))
    by_time[range(len(t)), :, range(len(t))] = rates * of_states.values / time.values
    still, moving = [(0, 0), (0, len(t))], states.times(of_states).by
    return {
        "launch": np.pad(launch.times(of_launch).by[0], still),
        "durations": np.pad(durations.times(time).by[0], still),
        "tuned": np.pad(found.p.by[0][[names.index(name) for name in tuned_numbers(machine)]], still),
        "states": np.dstack([moving, by_time]).reshape(len(t) * n, k + len(t)),
    }


def _states_on_cycle(evaluate: Evaluator, orbit: VariedOrbit, at: Varied) -> tuple[Varied, Array]:
    """The flight states (m, n) at any times (m, 1) since a lift-off, and their rates of change (m, n)."""
    embed, (count, _, k) = np.array(evaluate.model.embed), at.by.shape
    flight, whole = (Varied(*(2 * each for each in half)) for half in (orbit.half, orbit.half.plus(orbit.contact)))
    since = at.plus(whole, -np.floor(at.values / whole.values))
    flying = (since.values <= flight.values)[:, 0]
    values, rates, by = *np.empty((2, count, len(embed))), np.empty((count, len(embed), k))
    for phase, rows, half in (("flight", flying, orbit.half), ("contact", ~flying, orbit.contact)):
        if rows.any():
            inside = since if phase == "flight" else since.plus(flight, -1.0)
            own = Varied(inside.values[rows], inside.by[rows])
            x, p = _in_phase(evaluate, phase, orbit, half, own)
            turned = embed if phase == "contact" else np.eye(len(embed))
            values[rows], by[rows] = x.values @ turned.T, turned @ x.by
            rates[rows] = evaluate.rates(phase, x.values, p) @ turned.T
    return Varied(values, by), rates


def _in_phase(
    evaluate: Evaluator, phase: str, orbit: VariedOrbit, half: Varied, since: Varied
) -> tuple[Varied, Varied]:
    """The states at times (m, 1) since the beginning of a phase, in its second half the images of those in the first;
    and the parameters (m, np)."""
    late = since.values > half.values
    back = since.plus(half, -2.0)
    since = Varied(np.where(late, -back.values, since.values), np.where(late[:, None], -back.by, since.by))
    begin, p = (Varied(*(np.repeat(part, len(late), 0) for part in each)) for each in (orbit.begins[phase], orbit.p))
    moved = (since.values > SHARE_OF_START * half.values)[:, 0]
    x = Varied(begin.values, begin.by + evaluate.rates(phase, begin.values, p)[:, :, None] * since.by)
    if moved.any():
        own = (Varied(each.values[moved], each.by[moved]) for each in (begin, since, p))
        x.values[moved], x.by[moved] = evaluate.after(phase, *own)
    image = _turned_back(evaluate.model, evaluate.names, phase)(x, p)
    return Varied(np.where(late, image.values, x.values), np.where(late[:, None], image.by, x.by)), p


@cached
def _turned_back(model: Model, names: tuple[str, ...], phase: str) -> Callable[..., Varied]:
    """(states, parameters) -> the images of states of flight or contact under time reversal."""
    reversal = model.reversal if phase == "flight" else model.contact_reversal
    x, p = ca.SX.sym("x", len(reversal.signs)), ca.SX.sym("p", len(names))
    values = dict(zip(names, ca.vertsplit(p), strict=True))
    return of_varied([x, p], reversal.image(ca.vertsplit(x), values))


@cached
def _sizes_of_motion(model: Model, names: tuple[str, ...]) -> Callable[..., Varied]:
    """Parameters -> the units of the unknowns of a launch, of time and of the flight states."""
    p = ca.SX.sym("p", len(names))
    units = model.units(dict(zip(names, ca.vertsplit(p), strict=True))) if model.units else Units(1.0, 1.0, 1.0)
    own: list[Any] = [*model.launch_unknowns, TIME, *model.flight.states]
    return of_varied([p], [units.of(each) for each in own])
