"""Designs: optima against brute force along families and on grids, equations between quantities, global searches, and
machines that are refused."""

from functools import cache

import numpy as np
import pytest
from conftest import slow_after
from designs import CUBIC, LEG, RANGE, VARYING
from scipy.optimize import minimize
from steps import closed_form

from orbits import InputError, NoOrbit, find, find_all, follow, optimize, pareto, quantities, sensitivities, sweep
from problems import Chain, Hopper, hopper_in_si, rimless_wheel, rocking_block, springs


def refined(machine, name: str, low: float, high: float, value) -> tuple[float, float]:
    """The minimum of value(point) along a family: a scan, refined by Newton steps with fourth-order differences."""
    family = follow(machine, name, high, start=low)
    values = np.array([value(point) for point in family])
    i = int(np.argmin(values))
    assert 0 < i < len(values) - 1
    x = family[i].value
    for h in (1e-2, 1e-3, 1e-3):
        steps = np.array([-2, -1, 1, 2]) * h * x
        near = [value(find(machine.with_values(**{name: x + s}))) for s in steps]
        slope = (near[0] - 8 * near[1] + 8 * near[2] - near[3]) / (12 * h * x)
        centre = value(find(machine.with_values(**{name: x})))
        bend = (-near[0] + 16 * near[1] - 30 * centre + 16 * near[2] - near[3]) / (12 * (h * x) ** 2)
        x -= slope / bend
    return x, value(find(machine.with_values(**{name: x})))


def test_the_share_of_the_starts_that_have_ended():
    """It rises from 0 to 1, and stays below it while a search goes on."""
    shares: list[float] = []
    optimize(CUBIC, minimise="alpha + loss_coefficient", over={"b": (0.1, 2.0)}, starts=3, progress=shares.append)
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("verb", "text", "value"),
    slow_after(
        1,
        [
            (
                "maximise",
                "largest_contact_force + 3*alpha",
                lambda o: o.certificate.largest_contact_force + 3 * o.alpha,
            ),
            ("minimise", "loss_coefficient + alpha", lambda o: o.certificate.loss_coefficient + o.alpha),
            ("minimise", "-alpha*landing_jerk", lambda o: -o.alpha * o.certificate.landing_jerk),
        ],
    ),
)
def test_one_parameter_against_a_scan_of_the_family(verb, text, value):
    sign = 1 if verb == "minimise" else -1
    place, least = refined(CUBIC, "b", *RANGE, lambda o: sign * value(o))
    best = optimize(CUBIC, **{verb: text}, over={"b": RANGE})
    assert best.parameters["b"] == pytest.approx(place, rel=1e-8)
    assert best.objective == pytest.approx(sign * least, rel=1e-10)
    assert best.kkt < 1e-9
    assert best.orbit.admissible


def test_equal_masses_are_the_least_forgiving():
    """C is the same for M and 1/M, so it is stationary at M = 1, where fact and closed form have 3.61694..."""
    over = {"mass_ratio": (0.2, 4.0)}
    worst = optimize(Hopper(mass_ratio=0.4), maximise="loss_coefficient", over=over)
    narrow = optimize(Hopper(mass_ratio=0.4), minimise="robustness", over=over)
    assert narrow.parameters["mass_ratio"] == pytest.approx(1.0, abs=1e-8)
    assert narrow.objective == pytest.approx(find(Hopper()).certificate.robustness, rel=1e-12)
    assert worst.parameters["mass_ratio"] == pytest.approx(1.0, abs=1e-8)
    assert worst.objective == pytest.approx(find(Hopper()).certificate.loss_coefficient, rel=1e-13)
    assert worst.kkt < 1e-12


def test_leg_in_si():
    """60 kg over 3 kg, at most 0.25 m of stroke, 0.2 m high: the second family can, with an optimum inside."""
    best = optimize(
        LEG,
        minimise="loss_coefficient",
        over={"k": (500.0, 5e4), "b": (0.0, 1e7)},
        subject_to=["stroke <= 0.25", "centre_of_mass_rise == 0.2"],
        family=2,
    )
    assert best.parameters == pytest.approx({"k": 1546.42797844, "b": 847615.587}, rel=1e-6)
    assert best.orbit.si()["centre_of_mass_rise_m"] == pytest.approx(0.2, rel=1e-10)
    assert best.quantities["stroke"] < 0.25
    assert best.kkt < 1e-9
    # the same design stated anew, in units of its own, is the same motion
    again = find(hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters=best.parameters, rest_length=0.8), 2)
    assert again.si()["flight_time_s"] == pytest.approx(best.orbit.si()["flight_time_s"], rel=1e-10)
    assert again.certificate.loss_coefficient == pytest.approx(best.objective, rel=1e-9)


def test_machines_that_cannot_be_designed():
    with pytest.raises(InputError, match="'mass_ratio' to design: in SI it follows from the masses"):
        optimize(LEG, minimise="alpha", over={"mass_ratio": (0.1, 0.2)})
    with pytest.raises(InputError, match="no parameter 'unit_stiffness'"):
        optimize(LEG, minimise="alpha", over={"unit_stiffness": (1.0, 2.0)})
    assert quantities(CUBIC, find(CUBIC), []) == {}
    chain = Chain((1.0, 1.0, 1.0), "r + b*r**3", parameters={"b": 0.1})
    with pytest.raises(InputError, match="families of a chain of 3 masses is known: give an orbit of it"):
        optimize(chain, minimise="alpha", over={"b": (0.1, 0.2)})
    with pytest.raises(InputError, match="is known: give"):
        sensitivities(chain)
    with pytest.raises(InputError, match="derivative by the launch speed"):
        optimize(chain, minimise="loss_coefficient", over={"b": (0.1, 0.2)})
    with pytest.raises(InputError, match="is not a machine"):
        optimize(None, minimise="alpha", over={"mass_ratio": (0.1, 0.2)})
    with pytest.raises(InputError, match="belongs to another machine"):
        sensitivities(CUBIC, find(VARYING))
    with pytest.raises(InputError, match="two different objectives"):
        pareto(CUBIC, minimise="alpha", over={"b": RANGE})
    with pytest.raises(InputError, match="two different objectives"):
        pareto(CUBIC, minimise=3, over={"b": RANGE})
    with pytest.raises(InputError, match="points = 1; it must be a number of designs, at least 2"):
        pareto(CUBIC, minimise=("alpha", "stroke"), over={"b": RANGE}, points=1)
    with pytest.raises(NoOrbit, match="damped machine"):
        optimize(Hopper(damping=0.1), minimise="alpha", over={"mass_ratio": (0.1, 0.2)})
    with pytest.raises(NoOrbit, match="no clearance"):
        optimize(CUBIC, maximise="clearance", over={"b": RANGE})


ROWS = np.linspace(-14, 14, 97)
MEASURED = Hopper(
    springs.table((ROWS, ROWS + 0.02 * ROWS**3), noise=0, scale="b"), rest_length=12, parameters={"b": 1.2}
)
CHAIN = Chain(springs="r + b*r**3", parameters={"b": 0.02})
ON_GRID = {
    "measured": (MEASURED, {"b": (0.6, 2.0), "mass_ratio": (0.3, 2.0)}, "stroke + 1.5*largest_contact_force/alpha**2"),
    "chain": (
        CHAIN,
        {"m1": (0.95, 1.3), "b": (0.01, 0.05)},
        "largest_contact_force/centre_of_mass_rise + 30*(m1 - 1.1)**2 + 4000*(b - 0.03)**2",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", slow_after(1, ON_GRID))
def test_the_optimum_is_the_least_of_a_dense_grid(case):
    """Nor does a stencil about the optimum have less; from a family and from a start."""
    machine, over, text = ON_GRID[case]
    start = find(machine, start=find_all(Chain(), Chain().starts(4, 5))[0]) if case == "chain" else None
    best = optimize(machine, minimise=text, over=over, start=start)
    whole = {name: np.linspace(*bounds, 7) for name, bounds in over.items()}
    steps = {name: best.parameters[name] + 5e-3 * np.ptp(bounds) * np.arange(-1, 2) for name, bounds in over.items()}
    near = {name: np.unique(np.clip(steps[name], *bounds)) for name, bounds in over.items()}
    for axes, most in ((whole, 1.5), (near, 0.0)):
        grid = sweep(machine, {name: axis.tolist() for name, axis in axes.items()}, start=start, quantities=text,
                     progress=False)  # fmt: skip
        assert np.nanmin(grid[text]) >= best.objective * (1 - 1e-12)
        for name, axis in axes.items():
            assert abs(best.parameters[name] - grid[name][np.nanargmin(grid[text])]) <= most * (axis[1] - axis[0])
    assert np.nanmin(grid[text]) == pytest.approx(best.objective, rel=1e-12)
    assert best.kkt < 1e-6


# Body and foot may be exchanged in the loss coefficient, which so has edges at both ends of the mass ratio, and the
# machine's own lies on the side of the worse one.
BETWEEN_EDGES = Hopper("r + beta*r**3", mass_ratio=1.5, rest_length=10.0, parameters={"beta": 0.3})
BOTH = {"mass_ratio": (0.3, 2.0), "beta": (0.1, 1.0)}
ON_A_GRID = {"sampling": "grid", "progress": False}
LEAST_LOSS = {"minimise": "loss_coefficient", "over": BOTH}


@cache
def found_everywhere():
    return optimize(BETWEEN_EDGES, **LEAST_LOSS, starts="global")


@pytest.mark.slow
def test_a_global_search_finds_the_better_of_two_edges():
    alone, everywhere = optimize(BETWEEN_EDGES, **LEAST_LOSS, starts=1), found_everywhere()
    grid = sweep(BETWEEN_EDGES, BOTH, (18, 10), quantities=["loss_coefficient"], **ON_A_GRID)
    best = int(np.nanargmin(grid["loss_coefficient"]))
    assert alone.parameters["mass_ratio"] == pytest.approx(2.0)
    assert everywhere.objective < 0.9 * alone.objective
    assert everywhere.objective == pytest.approx(grid["loss_coefficient"][best], rel=1e-9)
    assert everywhere.parameters == pytest.approx({name: grid[name][best] for name in BOTH})
    assert alone.share is None
    assert "lead here" in str(everywhere)


def test_the_share_is_that_of_the_sample_on_this_side():
    """The coefficient falls away from the mass ratio 1 to either side, so that the designs below 1 lead to the lower
    edge: 0.7 of 1.7, up to what a sample of 256 and its neighbours blur."""
    assert found_everywhere().share == pytest.approx(0.7 / 1.7, abs=0.1)


def test_a_constraint_is_met_that_only_one_corner_meets():
    found = optimize(BETWEEN_EDGES, **LEAST_LOSS, subject_to=["stroke <= 5"], starts="global")
    grid = sweep(
        BETWEEN_EDGES, BOTH, (18, 19), sampling="grid", quantities=["loss_coefficient", "stroke"], progress=False
    )
    allowed = grid["stroke"] <= 5 + 1e-9
    assert found.quantities["stroke"] <= 5 + 1e-6
    assert found.objective <= np.min(grid["loss_coefficient"][allowed])


def test_what_cannot_be_meant():
    with pytest.raises(InputError, match="starts = 'everywhere'; it must be a number, or 'global'"):
        optimize(BETWEEN_EDGES, **LEAST_LOSS, starts="everywhere")
    short = Hopper("r + beta*r**3", rest_length=1.0, parameters={"beta": 0.3})
    with pytest.raises(NoOrbit, match="none of 256 designs within the bounds has an orbit that is a motion"):
        optimize(short, minimise="alpha", over={"beta": (0.1, 0.2)}, starts="global")


class TestSteps:
    """Machines whose points of contact take turns."""

    @pytest.mark.parametrize("kind", slow_after(1, ["wheel", "rocker"]))
    def test_optima_of_closed_forms(self, kind):
        """The slowest launch of short steps, and the fastest of short flights, by SciPy on the closed forms."""
        machine, sign = (rimless_wheel(), 1) if kind == "wheel" else (rocking_block(), -1)
        over, (name, most) = {"inertia_ratio": (0.5, 5.0), "gravity_ratio": (0.1, 3.0)}, ("period", 4.0)
        if kind == "rocker":
            name, most = "flight_time", 6.0
        verb = {"minimise" if sign > 0 else "maximise": "alpha"}
        best = optimize(machine, **verb, over=over, subject_to=[f"{name} <= {most}"])

        def time_left(z) -> float:
            half, _, contact = closed_form(kind, *z, 1)
            return most - 2 * half - (contact if kind == "wheel" else 0.0)

        other = minimize(
            lambda z: sign * closed_form(kind, *z, 1)[1], [1.0, 0.5], bounds=[*over.values()], method="SLSQP",
            constraints={"type": "ineq", "fun": time_left}, options={"ftol": 1e-13},
        )  # fmt: skip
        assert best.objective == pytest.approx(sign * other.fun, rel=1e-8)
        assert [*best.parameters.values()] == pytest.approx(other.x, rel=1e-5)
        assert best.kkt < 1e-9
