"""Machines are held against their statements: those of the library hold, and every wrong equation is found."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from checked_machines import MACHINES
from conftest import slow_after

from orbits import InputError, Mechanism, check, find, starts
from orbits.checks import checked as checked_module
from orbits.checks.relation import OPTIONS
from orbits.errors import InconsistentModel
from orbits.mechanics import Force, Mass, Spring
from orbits.model import TANGENTIAL_FORCE
from problems import Chain, HeavyHand, Hopper, chain_hand, plate_hopper, runner
from problems.laws import springs

SLOW = pytest.mark.slow
# Each has what others have too: it is another kind of machine, or its laws and units are of another kind.
OTHERS = (
    *("varying", "in pieces", "varying juggler", "damped juggler", "actuated juggler", "juggler in SI", "shuttle"),
    *("bent inerter", "inerter in SI", "soil in SI", "actuated in SI", "wheel in SI", "rocking block", "chain of 2"),
)
IN_FLIGHT, IN_CONTACT, IMPACTS = "in flight the", "in contact the", "impacts change"
LANDS, ENERGY, LENGTHS, HOPS = "it lands", "the energy", "gaps, distances", "hops agree"
REDUCED = "the reduced motion"


@pytest.mark.parametrize("name", [pytest.param(name, marks=SLOW if name in OTHERS else ()) for name in MACHINES])
def test_machines_hold(name):
    checked = check(MACHINES[name])
    assert checked.largest < 1e-2
    assert len(checked.relations) + len(checked.left_out) >= 7
    printed = " ".join(str(checked).split())
    assert len(checked.relations) + len(checked.left_out) <= 10
    assert all(
        text in printed for text in (*(each.words.split(",")[0] for each in checked.relations), *checked.left_out)
    )
    assert checked.title().endswith(f": {len(checked.relations)} relations hold")


@pytest.mark.parametrize("machine", slow_after(1, [plate_hopper(), chain_hand()]), ids=lambda machine: machine.name)
def test_machines_of_three_masses_hold_along_their_own_hops(machine):
    checked = check(machine, start=starts(machine, 4.0, 4.0)[0])
    assert any(each.words.startswith(LANDS) for each in checked.relations)
    assert checked.largest < 1e-2


@SLOW
def test_a_table_of_measurements_holds():
    x = np.linspace(-5, 5, 41)
    assert check(Hopper(springs.table((x, x + 0.05 * x**3)), rest_length=20.0)).largest < 0.1


def test_a_chain_holds_along_its_own_hop():
    """It is `starts(chain, 4.0, 4.0)[0]`."""
    start = {"liftoff": 0.66993275, "alpha": 3.967468, "y1": 2.5671563, "y1'": 1.5957524}
    start |= {"duration": 2.5758617, "contact_duration": 3.168004}
    checked = check(Chain([1.0, 2.0, 0.7], ["r", "r + 0.1*r**3"]), start=start)
    assert any(each.words.startswith(LANDS) for each in checked.relations)
    assert checked.largest < 1e-2


@SLOW
def test_a_runner_holds_along_its_own_orbit(tmp_path):
    """Its orbit takes it on by a step, which is a number of the orbit; a file of another orbit is only a guess."""
    orbit = find(runner(), tune=("inertia", "hip_stiffness"), at={"speed": 0.4})
    checked = check(orbit.source, start=orbit)
    assert any(each.words.startswith(LANDS) for each in checked.relations)
    assert checked.largest < 1e-2
    model = orbit.source.model
    shifted = replace(model, symmetry_shift=changed(model.symmetry_shift))
    with pytest.raises(InconsistentModel, match=LENGTHS):
        check(posing(orbit.source, shifted), start=orbit)
    chain = MACHINES["chain of 3"]
    found = find(chain, start=starts(chain, 4.0, 4.0)[0])
    found.save(tmp_path / "chain.json")
    assert any(each.words.startswith(LANDS) for each in check(chain, start=tmp_path / "chain.json").relations)


def posing(machine, model=None, stated=None, **numbers) -> SimpleNamespace:
    """A machine of the same numbers, but for `numbers`, with another model, or with another statement."""
    names = ("values", "units", "describe", "with_values", "restitution", "rest_length", "scheduled", "dimensionless")
    own = {name: getattr(machine, name) for name in names if hasattr(machine, name)}
    statement = machine.stated() if stated is None else stated
    return SimpleNamespace(**own | numbers, model=model or machine.model, stated=lambda: statement)


def broken(machine) -> list[str]:
    """The relations that do not hold for a machine, with few impacts: what is wrong at states needs no long hops."""
    wrong = pytest.raises(InconsistentModel, match=r"does not move as its statement says: .*: off by")
    with pytest.MonkeyPatch.context() as patch, wrong as error:
        patch.setattr(checked_module, "OPTIONS", replace(OPTIONS, impacts=3))
        check(machine)
    assert all(each.words in str(error.value) for each in error.value.relations)
    return [each.words for each in error.value.relations]


def changed(function, factor=1.01, entries=slice(None)):
    """A function whose results are multiplied, or some entries of them."""

    def other(*arguments):
        values = function(*arguments)
        if not isinstance(values, list | tuple):
            return factor * values
        chosen = range(len(values))[entries]
        return [factor * value if i in chosen else value for i, value in enumerate(values)]

    return other


def of_other_sign(field):
    """A field whose forces that are quadratic in the speeds have the other sign."""

    def other(x, p, q):
        at_rest = field([0 * each if i % 2 else each for i, each in enumerate(x)], p, q)
        return [2 * s - f if i % 2 else f for i, (f, s) in enumerate(zip(field(x, p, q), at_rest, strict=True))]

    return other


def wrong_models(model, turns):
    """Wrong equations of a model, each with the relation that finds it; `turns`: whether forces depend on speeds."""
    bare = replace(model, reduction=None)
    phases = {where: replace(getattr(model, where), closed_form=None) for where in ("flight", "contact")}
    for where, relation in (("flight", IN_FLIGHT), ("contact", IN_CONTACT)):
        phase = phases[where]
        yield relation, replace(bare, **{where: replace(phase, field=changed(phase.field, entries=slice(1, None, 2)))})
    if turns:
        yield IN_FLIGHT, replace(bare, flight=replace(phases["flight"], field=of_other_sign(phases["flight"].field)))
    for name, force in model.contact.watch.items():
        if name == TANGENTIAL_FORCE and not turns:
            continue  # it vanishes where a wheel stands on two feet
        watch = {**model.contact.watch, name: changed(force)}
        yield IN_CONTACT, replace(model, contact=replace(phases["contact"], watch=watch))
    yield ENERGY, replace(model, flight_gradient=changed(model.flight_gradient))
    yield (
        LENGTHS,
        replace(
            model,
            heights=lambda p: dict.fromkeys(model.heights(p), model.gap(p)),
            separation=lambda p: model.separation(p) and model.gap(p),
        ),
    )
    yield IMPACTS, replace(model, impact_mass=changed(model.impact_mass))
    yield IMPACTS, replace(model, impact=changed(model.impact))


@pytest.mark.parametrize(
    "name", slow_after(1, ("knee", "hopper", "juggler", "chain of 3", "wheel", "plate", "runner", "actuated", "in SI"))
)
def test_wrong_equations_are_found(name):
    """Each is off by 1 %, or in the sign of the forces that are quadratic in the speeds."""
    machine = MACHINES[name]
    for relation, model in wrong_models(machine.model, name in ("knee", "runner")):
        assert any(words.startswith(relation) for words in broken(posing(machine, model)))


def test_wrong_forces_heights_and_places_are_found():
    """Each is used beside the motion: for quantities of an orbit, figures, and the count of families."""
    machine = MACHINES["damped"]
    model, heights = machine.model, machine.model.heights
    longer = replace(model.extension, weights=tuple(1.01 * each for each in model.extension.weights))
    for relation, changes in (
        (IN_FLIGHT, {"tension": changed(model.tension)}),
        (IN_FLIGHT, {"spring_forces": {name: changed(force) for name, force in model.spring_forces.items()}}),
        (LENGTHS, {"extension": longer}),
        (LENGTHS, {"extension_offset": lambda p: 1e-3}),
        (LENGTHS, {"heights": lambda p: {**heights(p), "centre of mass": model.gap(p)}}),
        (LENGTHS, {"rest": lambda p: np.array([1e-3, 0.0, 0.0, 0.0])}),
        (ENERGY, {"flight_gradient": changed(model.flight_gradient, 1 + 5e-7)}),
        (IN_CONTACT, {"release": lambda alpha, p: (1 + 1e-6) * np.asarray(model.release(alpha, p))}),
    ):
        assert any(words.startswith(relation) for words in broken(posing(machine, replace(model, **changes)))), changes


@pytest.mark.parametrize("name", ["in SI", "juggler"])
def test_wrong_forces_in_closed_form_are_found(name):
    machine = MACHINES[name]
    form = machine.model.contact.closed_form

    def pressed(p):
        ((named, (weights, force)),) = form(p).watch.items()
        return replace(form(p), watch={named: (1.001 * np.array(weights), 1.001 * force)})

    contact = replace(machine.model.contact, closed_form=pressed)
    assert any(
        words.startswith(IN_CONTACT) for words in broken(posing(machine, replace(machine.model, contact=contact)))
    )


def wrong_maps(model):
    """A model with other maps of the motion turned back, of the next step, and of hand-overs."""
    for name in ("reversor", "symmetry"):
        if signs := getattr(model, name):
            yield LENGTHS, replace(model, **{name: tuple(-sign for sign in signs)})
        if shift := getattr(model, f"{name}_shift"):
            yield LENGTHS, replace(model, **{f"{name}_shift": changed(shift)})
    for name in ("across", "travel", "weight"):
        if model.planar and (function := getattr(model.planar, name)):
            yield LENGTHS, replace(model, planar=replace(model.planar, **{name: changed(function)}))
    if model.planar and model.planar.handed_over:
        for name in ("handed_over", "handed_back"):
            faster = changed(getattr(model.planar, name), 1.05, slice(1, None, 2))
            yield IMPACTS, replace(model, planar=replace(model.planar, **{name: faster}))


@pytest.mark.parametrize("name", slow_after(2, ("wheel on a slope", "runner", "wheel", "rocking block")))
def test_wrong_maps_are_found(name):
    machine = MACHINES[name]
    for relation, model in wrong_maps(machine.model):
        if name == "runner" and model.symmetry_shift is not machine.model.symmetry_shift:
            continue  # without an orbit its step is 0
        if name == "runner" and model.reversor_shift is not machine.model.reversor_shift:
            continue
        assert any(words.startswith(relation) for words in broken(posing(machine, model)))


def test_a_model_that_claims_to_lose_energy_is_found():
    machine = MACHINES["in SI"]
    assert broken(posing(machine, replace(machine.model, conservative=False)))[0].startswith("energy is conserved")


def test_a_return_map_without_numbers_is_found(monkeypatch):
    monkeypatch.setattr(
        checked_module, "ReturnMap", lambda machine: lambda speeds: SimpleNamespace(next=np.full(len(speeds), np.nan))
    )
    assert [words.startswith(HOPS) for words in broken(MACHINES["in SI"])] == [True]


def test_what_is_not_compared_is_said():
    elements = [Mass("a", 1.3), Mass("b", 0.7), Mass("b + 2*cos(t)", 1.3), Spring("a - b", "r"), Spring("t", "r")]
    left_out = check(Mechanism(("a", "b", "t"), elements, gap="b", angles=("t",), gravity=1.0)).left_out
    assert any("no hop: the inertia is singular at rest" in reason for reason in left_out)
    for name, why in (("damped", "and start= is not used"), ("runner", "it is not an orbit of this machine")):
        left_out = check(MACHINES[name], start={"alpha": 3.0}).left_out
        assert [why in reason for reason in left_out] == [True, False]
        assert "no lift-off" in left_out[1]
        assert "the hop ends after 1 event with the status" in left_out[1]


def test_numbers_out_of_bounds_are_refused():
    machine = MACHINES["cubic"]
    for numbers, message in (
        ({"restitution": 2.0}, "restitution = 2 is out of bounds; it must lie between 0 and 1"),
        ({"restitution": np.nan}, "restitution = nan is not a finite number"),
        ({"rest_length": np.nan}, "rest_length = nan is not a finite number"),
        ({"values": machine.values | {"mass_ratio": np.inf}}, "mass_ratio = inf is not a finite number"),
    ):
        with pytest.raises(InputError, match=message):
            check(posing(machine, **numbers))


def test_wrong_statements_are_found():
    """A mass that is 1 % larger, gravity, a spring or a force of the other sign, and a spring of another law."""
    machine = MACHINES["inerter"]
    stated, spring = machine.stated(), springs.formula("-(r + 0.1*r**3)")
    masses = [each for each in stated.elements if isinstance(each, Mass)]
    heavier = [replace(each, mass=f"1.01*({each.mass})") if each is masses[0] else each for each in stated.elements]
    for other in (
        replace(stated, elements=heavier),
        stated.with_values(surface_gravity=1.01),
        stated.with_springs([spring.key]),
        stated.with_springs(["r + 0.101*r**3"]),
        replace(stated, elements=[*stated.elements, Force(masses[0].height, lambda y, v, p: 0.01)]),
    ):
        assert {IN_FLIGHT, IN_CONTACT} <= {
            " ".join(words.split()[:3]) for words in broken(posing(machine, None, other))
        }


def test_a_wrong_reversor_is_found():
    wheel = MACHINES["wheel"]
    stated = wheel.stated()
    other = SimpleNamespace(**{name: getattr(stated, name) for name in (*vars(stated), "values")})
    other.reversor = {**stated.reversor, "phi": "1.99*angle - phi"}
    assert [words.split(",")[0] for words in broken(posing(wheel, None, other))] == [
        "gaps",
        f"{LANDS} in the mirror image of its launch",
    ]


@pytest.mark.parametrize("name", slow_after(1, ("cubic", "hopper", "juggler")))
def test_wrong_short_cuts_are_found(name):
    """The reduced flight, motions in closed form, and the extension at lift-off."""
    machine = MACHINES[name]
    model, (arc,) = machine.model, machine.model.reduction.statement.arcs
    phase = replace(arc.phase, field=changed(arc.phase.field, entries=slice(1, 2)), closed_form=None)
    statement = replace(model.reduction.statement, arcs=(replace(arc, phase=phase),))
    wrong = [{"reduction": replace(model.reduction, statement=statement, exact=None)}]
    wrong.append({"reduction": None, "release": lambda alpha, p: 1.01 * model.release(alpha, p) + 0.01})
    if model.reduction.exact:
        faster = lambda family, p: ({**model.reduction.exact(family, p)[0], "alpha": 4.5}, 1e-15)  # noqa: E731
        wrong.append({"reduction": replace(model.reduction, exact=faster)})
    for where in ("flight", "contact"):
        if form := getattr(model, where).closed_form:
            faster = lambda p, form=form: replace(form(p), squares=1.01 * form(p).squares)  # noqa: E731
            wrong.append({"reduction": None, where: replace(getattr(model, where), closed_form=faster)})
    wrong.append({"reduction": replace(model.reduction, gap_slope=changed(model.reduction.gap_slope))})
    found = [broken(posing(machine, replace(model, **changes))) for changes in wrong]
    assert any(words.startswith(REDUCED) for words in found[0])
    assert [words.startswith(REDUCED) for words in found[-1]] == [True]


def test_a_wrong_slope_of_the_lift_off_is_found():
    machine = MACHINES["bent inerter"]
    model = replace(machine.model, liftoff_slope=changed(machine.model.liftoff_slope))
    assert [words.startswith(LANDS) for words in broken(posing(machine, model))] == [True]


@SLOW
def test_a_force_without_numbers_is_found():
    machine = MACHINES["hopper"]
    contact = replace(machine.model.contact, closed_form=None, watch={"contact force": lambda x, p, q: np.nan})
    assert any(
        words.startswith(IN_CONTACT) for words in broken(posing(machine, replace(machine.model, contact=contact)))
    )


def test_what_is_not_stated_is_refused():
    with pytest.raises(InputError, match=r"a SimpleNamespace states no mechanics to check: state an orbits\.Mechanism"):
        check(SimpleNamespace(model=Hopper().model))
    with pytest.raises(InputError, match="an infinitely heavy hand is only a limit of mechanisms: state a Juggler"):
        check(HeavyHand())
