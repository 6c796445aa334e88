"""Designs: optima against brute force along families and closed forms, exact sensitivities, fronts, named failures."""

import json
import math

import numpy as np
import pytest
from scipy.optimize import brentq

from orbits import InputError, NoOrbit, find, follow, optimize, pareto, quantities, sensitivities
from orbits.design.optimize import starting_points
from orbits.design.problem import DesignProblem
from problems import Chain, Hopper, Juggler, hopper_in_si

CUBIC = Hopper("r + b*r**3", mass_ratio=0.5, rest_length=20.0, parameters={"b": 0.3})
VARYING = Hopper("r + b*r**3", "1/(1 + z/R)**2", 0.5, 20.0, parameters={"b": 0.3, "R": 150.0})
LEG = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 5000.0, "b": 1e5}, rest_length=0.8)
RANGE = (0.02, 3.0)


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


@pytest.mark.parametrize(
    ("verb", "text", "value"),
    [
        ("maximise", "largest_contact_force + 3*alpha", lambda o: o.certificate.largest_contact_force + 3 * o.alpha),
        ("minimise", "loss_coefficient + alpha", lambda o: o.certificate.loss_coefficient + o.alpha),
        ("minimise", "-alpha*landing_jerk", lambda o: -o.alpha * o.certificate.landing_jerk),
    ],
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
    worst = optimize(Hopper(mass_ratio=0.4), maximise="loss_coefficient", over={"mass_ratio": (0.2, 4.0)})
    assert worst.parameters["mass_ratio"] == pytest.approx(1.0, abs=1e-8)
    assert worst.objective == pytest.approx(find(Hopper()).certificate.loss_coefficient, rel=1e-13)
    assert worst.kkt < 1e-12


def test_constraint_that_binds_is_met_exactly():
    best = optimize(CUBIC, minimise="alpha", over={"b": RANGE}, subject_to=["stroke >= 7"])
    assert best.quantities["stroke"] == pytest.approx(7.0, abs=1e-9)
    (active,) = best.active
    slopes = sensitivities(best.source, best.orbit, ["b"], ["alpha", "stroke"])
    assert active.text == "stroke >= 7"
    assert active.multiplier == pytest.approx(slopes["alpha"]["b"] / slopes["stroke"]["b"], rel=1e-9)
    relaxed = optimize(CUBIC, minimise="alpha", over={"b": RANGE}, subject_to=["stroke >= 6.999"])
    assert best.objective - relaxed.objective == pytest.approx(1e-3 * active.multiplier, rel=1e-3)


def test_two_parameters_meet_the_optimality_conditions():
    """The optimality conditions hold with gradients by differences between orbits that are found anew."""
    text = "loss_coefficient + 0.004*largest_contact_force*contact_time"
    bounds = {"b": (0.01, 3.0), "mass_ratio": (0.05, 0.95)}
    best = optimize(CUBIC, minimise=text, over=bounds, subject_to=["stroke <= 8"])
    assert best.kkt < 1e-9
    gradients = []
    for name in bounds:
        h, x, rows = 1e-4 * best.parameters[name], best.parameters[name], []
        for s in (-2, -1, 1, 2):
            machine = best.source.with_values(**{name: x + s * h})
            rows.append(list(quantities(machine, find(machine), [text, "stroke"]).values()))
        rows = np.array(rows)
        gradients.append((rows[0] - 8 * rows[1] + 8 * rows[2] - rows[3]) / (12 * h))
    slope, stroke = np.array(gradients).T
    multipliers = {active.text: active.multiplier for active in best.active}
    left = slope + multipliers.get("stroke <= 8", 0.0) * stroke
    left[1] -= multipliers.get("mass_ratio >= 0.05", 0.0)
    assert np.abs(left).max() < 1e-7 * np.abs(slope).max()
    assert min(multipliers.values(), default=1.0) > 0


@pytest.mark.parametrize(
    ("machine", "family"),
    [(CUBIC, 1), (CUBIC, 2), (VARYING, 1), (Juggler("r + b*r**3", mass_ratio=0.7, parameters={"b": 0.2}), 1)],
)
def test_sensitivities_are_those_of_neighbouring_orbits(machine, family):
    orbit = find(machine, family)
    names = ["b", "mass_ratio"]
    exact = sensitivities(machine, orbit, names)
    for name in names:
        h, rows = 1e-3 * machine.values[name], []
        for s in (-2, -1, 1, 2):
            near = machine.with_values(**{name: machine.values[name] + s * h})
            rows.append(np.array(list(quantities(near, find(near, family)).values())))
        slopes = (rows[0] - 8 * rows[1] + 8 * rows[2] - rows[3]) / (12 * h)
        for quantity, slope in zip(exact, slopes, strict=True):
            assert exact[quantity][name] == pytest.approx(slope, rel=1e-7, abs=1e-8), quantity


def test_quantities_are_those_of_the_document():
    for machine, family in ((CUBIC, 2), (VARYING, 1)):
        orbit = find(machine, family)
        values, document = quantities(machine, orbit), orbit.document()
        assert {
            "stroke",
            "landing_sensitivity",
            "largest_spring_force",
            "period",
        } == values.keys() - document.keys() - {f"{name.replace(' ', '_')}_rise" for name in orbit.rises}
        for name in values.keys() & document.keys():
            # the certificate takes C from the motion before Newton's last step
            share = 1e-8 if name == "loss_coefficient" else 1e-11
            assert values[name] == pytest.approx(document[name], rel=share), name
        for name, rise in orbit.rises.items():
            assert values[f"{name.replace(' ', '_')}_rise"] == pytest.approx(rise, rel=1e-11)
        t = np.linspace(0, orbit.period, 20001)
        extension = orbit(t)[:, 0] - orbit(t)[:, 2]
        assert values["stroke"] == pytest.approx(np.ptp(extension), rel=1e-6)


def test_linear_hopper_has_its_closed_forms():
    """Flight time 2 alpha, rise of the centre of mass alpha^2/2/(1 + M), period and stroke by hand."""
    M, alpha = 0.3, 4.493409457909064
    values = quantities(Hopper(mass_ratio=M), find(Hopper(mass_ratio=M)))
    depth = -1 / M - (1 + M) / M * math.sqrt(1 + M / (1 + M) * alpha**2)
    assert values["centre_of_mass_rise"] == pytest.approx(alpha**2 / 2 / (1 + M), rel=1e-12)
    assert values["stroke"] == pytest.approx(math.sqrt(1 + alpha**2) - depth, rel=1e-12)
    assert values["largest_spring_force"] == pytest.approx(-depth, rel=1e-12)
    assert values["landing_sensitivity"] * (1 + M) == pytest.approx(2 * alpha - math.sin(2 * alpha), rel=1e-12)


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


def test_an_optimum_stays_admissible():
    """With a short leg the higher hop is that at which the masses almost meet."""
    short = Hopper("r + b*r**3", mass_ratio=0.5, rest_length=6.0, parameters={"b": 1.0})
    best = optimize(short, maximise="centre_of_mass_rise", over={"b": (0.01, 3.0)})
    assert 0 < best.orbit.certificate.smallest_separation < 1e-8
    assert best.orbit.admissible
    assert [active.text for active in best.active] == ["smallest_separation > 0"]


def test_an_extreme_at_two_places():
    """Where the peak force in contact has come down to that in flight, it cannot fall further: a corner."""
    spring = Hopper("r + a*r**2 + b*r**3", mass_ratio=5.0, rest_length=60.0, parameters={"a": 0.1, "b": 0.1})
    best = optimize(spring, minimise="largest_spring_force + 0.05*mass_ratio", over={"mass_ratio": (1.0, 100.0)})
    stiff = spring.with_values(mass_ratio=100.0)
    in_flight = quantities(stiff, find(stiff), ["largest_spring_force"])["largest_spring_force"]
    assert best.quantities["largest_spring_force"] == pytest.approx(in_flight, rel=1e-9)
    in_contact = quantities(best.source, best.orbit, ["largest_contact_force - 1"])["largest_contact_force - 1"]
    assert in_contact == pytest.approx(in_flight, rel=1e-9)
    assert best.active[0].text == "an extreme at two places"


def test_varying_gravity_goes_over_into_constant():
    """As the planet grows the design tends to that under constant gravity, found by another statement."""
    texts = {"minimise": "centre_of_mass_rise", "over": {"b": RANGE}, "subject_to": ["stroke >= 6"]}
    flat = optimize(CUBIC, **texts)
    far = [optimize(VARYING.with_values(R=R), **texts).parameters["b"] for R in (1e4, 1e5)]
    assert far[0] - flat.parameters["b"] == pytest.approx(10 * (far[1] - flat.parameters["b"]), rel=1e-2)


@pytest.mark.parametrize("text", ["stroke - 7 >= 0", "0 <= 2*(stroke - 7)", "stroke/7 >= 1"])
def test_a_constraint_means_the_same_however_it_is_written(text):
    """Against b = 0.17580..., the root of stroke = 7 that a bracketing method finds from orbits found anew."""

    def stroke(b):
        machine = CUBIC.with_values(b=b)
        return quantities(machine, find(machine), ["stroke"])["stroke"]

    best = optimize(CUBIC, minimise="alpha", over={"b": RANGE}, subject_to=[text], starts=1)
    assert best.parameters["b"] == pytest.approx(brentq(lambda b: stroke(b) - 7, 0.1, 0.3, xtol=1e-12), rel=1e-9)
    assert best.kkt < 1e-9


def test_an_equation_between_quantities():
    """The equation leaves one parameter; along it C falls with the mass ratio, here scanned, down to its bound."""
    machine = CUBIC.with_values(mass_ratio=0.3)
    over = {"b": RANGE, "mass_ratio": (0.1, 3.0)}
    best = optimize(machine, minimise="loss_coefficient", over=over, subject_to=["stroke == 2.5*alpha"], starts=1)

    def on_the_equation(mass_ratio):
        def value(b, text):
            there = CUBIC.with_values(mass_ratio=mass_ratio, b=b)
            return quantities(there, find(there), [text])[text]

        b = brentq(lambda b: value(b, "stroke - 2.5*alpha"), *RANGE, xtol=1e-10)
        return b, value(b, "loss_coefficient")

    least = on_the_equation(0.1)
    assert (best.parameters["b"], best.objective) == pytest.approx(least, rel=1e-8)
    assert best.parameters["mass_ratio"] == 0.1
    assert min(on_the_equation(mass_ratio)[1] for mass_ratio in (0.11, 0.2, 0.5, 0.8)) > least[1]


@pytest.mark.parametrize(
    ("machine", "verb", "name", "bounds", "at", "value"),
    [
        (CUBIC, "maximise", "alpha", {"b": (0.02, 1e6)}, 0.02, 4.0233),
        (CUBIC, "minimise", "alpha", {"b": (1e-6, 1e6)}, 1e6, 0.2509),
        (Hopper(mass_ratio=0.5), "maximise", "contact_time", {"mass_ratio": (1e-3, 1e3)}, 1e-3, 189.86),
    ],
)
def test_far_away_is_not_without_bound(machine, verb, name, bounds, at, value):
    """A monotone objective is best on a bound, however many decades away."""
    best = optimize(machine, **{verb: name}, over=bounds)
    (parameter,) = bounds
    assert best.parameters[parameter] == at
    assert best.objective == pytest.approx(value, abs=1e-2 if value > 100 else 1e-4)
    there = machine.with_values(**{parameter: at})
    assert best.objective == pytest.approx(find(there).document()[name], rel=1e-10)


@pytest.mark.slow
def test_a_front_is_that_of_all_its_starts():
    """No design on a grid of parameters dominates the front; from the stiff end alone no light foot would be found."""
    over = {"b": RANGE, "mass_ratio": (0.05, 8.0)}
    front = pareto(CUBIC, minimise=("stroke", "loss_coefficient"), over=over, points=3)
    assert not front.refused
    assert len(front.designs) == 3
    for b in RANGE:
        for mass_ratio in (0.05, 0.1, 0.5, 1.0, 8.0):
            there = CUBIC.with_values(b=b, mass_ratio=mass_ratio)
            pair = np.array(list(quantities(there, find(there), front.texts).values()))
            assert not (pair < front.values * (1 - 1e-8)).all(1).any()


def test_a_flat_end_of_a_front_is_best_in_the_other_objective():
    """The launch speed is least, 3.2, all along a curve of two stiffnesses whose ranges differ forty times, and the
    greatest force falls along it to where the higher stiffness is 0."""
    spring = Hopper("r + b*r**3 + d*r**5", parameters={"b": 0.1, "d": 0.001})
    options = {"over": {"b": (0.0, 0.2), "d": (0.0, 0.005)}, "subject_to": ["alpha >= 3.2"], "points": 2}
    end, _ = pareto(spring, minimise=("alpha", "largest_spring_force"), **options).designs
    assert end.parameters["d"] == 0.0
    cubic = [spring.with_values(b=end.parameters["b"] + change, d=0.0) for change in (1e-6, -1e-6)]
    assert find(cubic[0]).alpha < 3.2 < find(cubic[1]).alpha
    along = [spring.with_values(b=0.145848, d=0.002692), spring.with_values(b=0.130706, d=0.005)]
    for machine in along:
        assert find(machine).alpha == pytest.approx(3.2, abs=1e-5)
        assert quantities(machine, find(machine), ["largest_spring_force"])["largest_spring_force"] > 13.0
    assert quantities(cubic[0], find(cubic[0]), ["largest_spring_force"])["largest_spring_force"] < 12.5


def test_a_front_whose_ends_are_the_same_design_has_one():
    (only,) = pareto(CUBIC, minimise=("alpha", "stroke"), over={"b": RANGE}, points=2).designs
    assert only.parameters["b"] == RANGE[1]


def test_parameters_without_effect_are_reported():
    best = optimize(CUBIC, minimise="alpha", over={"b": RANGE, "rest_length": (15.0, 30.0)})
    assert best.idle == ("rest_length",)
    assert best.parameters["b"] == RANGE[1]
    assert "without effect" in str(best)


def test_starts_are_seeded():
    options = {"minimise": "alpha", "over": {"b": RANGE}, "subject_to": ["stroke >= 7"], "starts": 2, "seed": 3}
    one, two = optimize(CUBIC, **options), optimize(CUBIC, **options)
    assert [start.parameters for start in one.starts] == [start.parameters for start in two.starts]
    assert one.objective == two.objective
    assert len({start.parameters["b"] for start in one.starts}) == 2


@pytest.mark.slow
def test_front():
    """Every design is certified; one objective rises as the other falls, and the slope is the multiplier."""
    front = pareto(CUBIC, minimise=("loss_coefficient", "alpha"), over={"b": RANGE}, points=5)
    assert len(front.designs) == 5
    assert all(design.orbit.admissible for design in front.designs)
    first, second = front.values.T
    assert (np.diff(first) > 0).all()
    assert (np.diff(second) < 0).all()
    assert front.column("b")[0] == RANGE[0]
    assert "5 certified designs" in str(front)
    (only,) = pareto(CUBIC, minimise=("loss_coefficient", "-alpha"), over={"b": RANGE}).designs
    assert only.parameters["b"] == RANGE[0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"over": {"b": (1.0, 0.5)}}, "bounds of b are in conflict: its lower bound 1 is not below the upper, 0.5"),
        ({"over": {"mass_ration": (0, 1)}}, "no parameter 'mass_ration' to design; did you mean 'mass_ratio'"),
        ({"over": {}}, "over names the parameters"),
        ({"over": {"b": 3}}, "give its bounds"),
        ({"over": {"mass_ratio": (-1, 1)}}, "mass_ratio = -1 is out of bounds"),
        ({"minimise": "strok"}, "unknown quantity 'strok'; did you mean 'stroke'"),
        ({"minimise": "alpha +"}, "is missing here"),
        ({"minimise": None}, "one of the two"),
        ({"maximise": "alpha"}, "one of the two"),
        ({"subject_to": ["stroke < 3"]}, "not of the form 'stroke <= 0.25'"),
        ({"subject_to": ["stroke <= forse"]}, "unknown quantity 'forse'"),
        ({"subject_to": ["stroke <= 3", "stroke >= 4"]}, "'stroke <= 3' and 'stroke >= 4' are in conflict"),
        ({"subject_to": ["4 <= stroke <= 3"]}, "can never hold"),
        ({"subject_to": ["1 <= 3"]}, "says nothing"),
        ({"subject_to": "stroke <= 3"}, "a list of constraints"),
        ({"starts": 0}, "starts = 0"),
        ({"starts": 2, "seed": -1}, "seed = -1; it is a whole number from 0"),
        ({"starts": 2, "seed": 1.5}, "seed = 1.5"),
        ({"starts": 2, "seed": "a"}, "seed = 'a'"),
        ({"minimise": 3}, "minimise = 3; an objective is a formula"),
        ({"minimise": "3"}, "'3' says nothing of the orbit"),
        ({"minimise": "abs(b - 1)"}, "abs is a law in pieces"),
        ({"subject_to": ["sign(alpha - 1) >= 0"]}, "sign is a law in pieces"),
        ({"subject_to": ["alpha <= 1/0"]}, "'1/0' is not a finite number"),
        ({"subject_to": ["b == 0.5", "2*b == 1"]}, "2 equations for 1 parameters to design"),
        ({"over": {"b": (0.3, 0.3 + 1e-13)}}, "leave no room"),
        ({"over": {"rest_length": (15, 30)}}, "'alpha' and the constraints do not depend on rest_length"),
        ({"family": 0}, "family = 0"),
    ],
)
def test_ill_posed_problems_are_refused(options, words):
    with pytest.raises(InputError) as error:
        optimize(CUBIC, **{"minimise": "alpha", "over": {"b": RANGE}, **options})
    assert words in str(error.value)


def test_machines_that_cannot_be_designed():
    with pytest.raises(InputError, match="'mass_ratio' of a machine in SI follows from its masses"):
        optimize(LEG, minimise="alpha", over={"mass_ratio": (0.1, 0.2)})
    with pytest.raises(InputError, match="no parameter 'unit_stiffness'"):
        optimize(LEG, minimise="alpha", over={"unit_stiffness": (1.0, 2.0)})
    assert quantities(CUBIC, find(CUBIC), []) == {}
    with pytest.raises(InputError, match="a list"):
        quantities(CUBIC, find(CUBIC), "alpha")
    with pytest.raises(InputError, match="a list"):
        sensitivities(CUBIC, quantities="alpha")
    with pytest.raises(InputError, match="a law in pieces cannot be designed"):
        optimize(Hopper("bilinear"), minimise="alpha", over={"mass_ratio": (0.1, 0.2)})
    chain = Chain((1.0, 1.0, 1.0), "r + b*r**3", parameters={"b": 0.1})
    with pytest.raises(InputError, match="a chain of 3 masses cannot be designed"):
        optimize(chain, minimise="alpha", over={"b": (0.1, 0.2)})
    with pytest.raises(InputError, match="a chain of 3 masses cannot be designed"):
        sensitivities(chain)
    with pytest.raises(InputError, match="is no machine"):
        optimize(None, minimise="alpha", over={"mass_ratio": (0.1, 0.2)})
    with pytest.raises(InputError, match="another machine's"):
        sensitivities(CUBIC, find(VARYING))
    with pytest.raises(InputError, match="two objectives"):
        pareto(CUBIC, minimise="alpha", over={"b": RANGE})
    with pytest.raises(InputError, match="two objectives"):
        pareto(CUBIC, minimise=3, over={"b": RANGE})
    with pytest.raises(InputError, match="points = 1; it is a number of designs, from 2"):
        pareto(CUBIC, minimise=("alpha", "stroke"), over={"b": RANGE}, points=1)
    with pytest.raises(NoOrbit, match="damped machine"):
        optimize(Hopper(damping=0.1), minimise="alpha", over={"mass_ratio": (0.1, 0.2)})
    with pytest.raises(NoOrbit, match="no clearance"):
        optimize(CUBIC, maximise="clearance", over={"b": RANGE})


def test_constraints_that_cannot_be_met():
    """Which, and by how much: at the upper bound the stroke is what the family has there."""
    with pytest.raises(NoOrbit) as error:
        optimize(CUBIC, minimise="alpha", over={"b": (0.1, 1.0)}, subject_to=["stroke <= 2"], starts=1)
    stiff = CUBIC.with_values(b=1.0)
    stroke = quantities(stiff, find(stiff), ["stroke"])["stroke"]
    assert f"'stroke <= 2' is missed by {stroke - 2:.4g}, at {stroke:.6g}, with b = 1" in str(error.value)
    constraints = ["stroke <= 6", "centre_of_mass_rise >= 4"]
    with pytest.raises(NoOrbit, match="'centre_of_mass_rise >= 4' is missed by"):
        optimize(CUBIC, minimise="alpha", over={"b": (0.1, 1.0)}, subject_to=constraints, starts=1)


def test_objective_without_bound():
    """The saturating spring's first family runs off as b -> 1/3; with a bound on it there is an optimum."""
    spring = Hopper("tanh", parameters={"b": 0.2})
    with pytest.raises(NoOrbit, match=r"no largest value: 'alpha' gets better as the orbit escapes, .* at b = 0\.33"):
        optimize(spring, maximise="alpha", over={"b": (0.05, 0.5)})
    best = optimize(spring, maximise="alpha", over={"b": (0.05, 0.5)}, subject_to=["alpha <= 8"])
    assert best.objective == pytest.approx(8.0, abs=1e-9)


def test_a_formula_without_a_value_on_the_equation(capfd):
    with pytest.raises(NoOrbit, match=r"'sqrt\(1-b\)' has no finite value or slope on the way: keep the parameters"):
        optimize(CUBIC, minimise="sqrt(1-b)", over={"b": RANGE}, starts=1)
    assert not capfd.readouterr().err


def test_phase_that_collapses():
    """The contact of a softening spring lasts ever longer, and at beta = -0.0067221 for ever."""
    soft = Hopper("cubic", rest_length=30.0, parameters={"beta": -0.005})
    family = follow(soft, "beta", -0.0072, start=-0.006)
    (collapse,) = [event.point.value for event in family.events if event.kind == "collapse"]
    with pytest.raises(NoOrbit, match="runs into a collapse just beyond beta = ") as error:
        optimize(soft, maximise="contact_time", over={"beta": (-0.02, 0.1)})
    assert float(str(error.value).split("beta = ")[1].split(":")[0]) == pytest.approx(collapse, rel=1e-5)
    with pytest.raises(NoOrbit, match="the spring collapses"):
        optimize(soft, minimise="stroke", over={"beta": (-0.0099, -0.0095)})
    endless = soft.with_values(beta=-0.0072)
    with pytest.raises(NoOrbit, match="the spring collapses"):
        quantities(endless, find(endless))
    with pytest.raises(NoOrbit, match="the spring collapses"):
        sensitivities(Hopper("tanh(b*r)/b", mass_ratio=0.05, parameters={"b": 0.1}), 2)


FILE = """machine = "hopper"
spring = "k*r + b*r**3"
[parameters]
k = 5000.0
b = 1e5
[si]
body_mass = 60.0
foot_mass = 3.0
rest_length = 0.8
[design]
minimise = "largest_contact_force"
subject_to = ["stroke <= 0.25", "centre_of_mass_rise == 0.2"]
family = 2
starts = 1
[design.over]
k = [500, 5e4]
b = [0, 1e7]
"""


def test_command_line(orbits, tmp_path):
    path = tmp_path / "leg.toml"
    path.write_text(FILE)
    run = orbits(f"optimize '{path}' --json --plot '{tmp_path / 'best.png'}' --save '{tmp_path / 'best.json'}'")
    assert run.code == 0
    assert run.document["quantities"]["centre_of_mass_rise"] == pytest.approx(0.2, rel=1e-9)
    assert run.document["orbit"]["admissible"]
    assert (tmp_path / "best.png").stat().st_size > 10_000
    saved = json.loads((tmp_path / "best.json").read_text())["orbit"]
    assert saved == saved | run.document["orbit"]  # the file has the whole motion besides
    assert "minimise largest_contact_force" in orbits("optimize", path).out
    assert orbits("find --family 2 --machine", path).code == 0


@pytest.mark.slow
def test_command_line_of_a_global_search(orbits, tmp_path):
    path = tmp_path / "leg.toml"
    path.write_text(FILE.replace("starts = 1", 'starts = "global"'))
    run = orbits(f"optimize '{path}' --json")
    assert run.code == 0
    assert run.document["quantities"]["centre_of_mass_rise"] == pytest.approx(0.2, rel=1e-9)


@pytest.mark.slow
def test_command_line_of_a_front(orbits, tmp_path):
    path = tmp_path / "leg.toml"
    objectives = '["alpha", "loss_coefficient"]\npoints = 3'
    text = FILE.replace('"largest_contact_force"', objectives).replace(', "centre_of_mass_rise == 0.2"', "")
    path.write_text(text.replace("k = [500, 5e4]\n", "").replace("k = 5000.0", "k = 2e4"))
    run = orbits(f"optimize '{path}' --json --plot '{tmp_path / 'front.png'}' --save '{tmp_path / 'front.json'}'")
    assert run.code == 0
    assert len(run.document["points"]) == 3
    saved = json.loads((tmp_path / "front.json").read_text())
    assert saved["refused"] == run.document["refused"]
    for point, told in zip(saved["points"], run.document["points"], strict=True):
        assert point == point | told | {"orbit": point["orbit"] | told["orbit"]}
    assert (tmp_path / "front.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("old", "new", "code", "words"),
    [
        ("0.25", "0.01", 1, "'stroke <= 0.01' is missed by"),
        ("k = [500, 5e4]", "k = [5e4, 500]", 2, "bounds of k are in conflict"),
        ('"largest_contact_force"', '"largest_contact_forse"', 2, "did you mean 'largest_contact_force'"),
        ("family = 2", "famly = 2", 2, "unknown key 'famly'; did you mean 'family'"),
        ("starts = 1", "starts = 'locals'", 2, "it is a number, or 'global'"),
        ("family = 2", "points = 2", 2, "points belong to a front"),
        ("[design.over]\nk = [500, 5e4]\nb = [0, 1e7]\n", "", 2, "[design.over] names the parameters"),
        (FILE[FILE.index("[design]") :], "", 2, "has no [design]"),
    ],
)
def test_command_line_failures(orbits, tmp_path, old, new, code, words):
    path = tmp_path / "leg.toml"
    path.write_text(FILE.replace(old, new))
    run = orbits("optimize", path)
    assert run.code == code
    assert words in run.err


def test_starts_within_bounds_over_decades_are_spread_by_their_logarithm():
    machine = Hopper("r + b*r**3", parameters={"b": 0.3})
    problem = DesignProblem("alpha", None, 1, ("b", "mass_ratio"), (1e-4, 0.5), (1e4, 2.0), ())
    first, *others = starting_points(machine, problem, 65, 1)
    assert first == {"b": 0.3, "mass_ratio": 1.0}
    decades = np.floor(np.log10([point["b"] for point in others])).astype(int)
    assert (np.bincount(decades + 4, minlength=8) == 8).all()
    quarters = np.floor((np.array([point["mass_ratio"] for point in others]) - 0.5) / 0.375).astype(int)
    assert (np.bincount(quarters, minlength=4) == 16).all()
