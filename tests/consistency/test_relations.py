"""Relations among the fields of a model: which of them a wrong factor, piece, number or length breaks."""

from dataclasses import replace

import numpy as np
import pytest

from orbits import Mechanism, NoOrbit, check, find
from orbits.consistency.verdict import algebraic_relations, suspects
from orbits.errors import InconsistentModel
from orbits.mechanics import Mass, Spring
from problems import Hopper
from tests.consistency.by_hand import by_hand
from tests.consistency.checked_machines import BROKEN, MACHINES, at, named, with_model


def test_a_factor_of_one_force_is_told_where_another_has_its_unit():
    """Of two forces in different units nothing tells which is wrong: both are named, by the relation of the two."""
    machine = Hopper("r + 0.3*r**3", rest_length=20.0)
    model, force = machine.model, machine.model.contact.watch["contact force"]
    phase = replace(model.contact, watch={"contact force": lambda x, p, q: 1.01 * force(x, p, q)})
    for changes in ({"contact": phase}, {"tension": lambda x, p, q: 1.01 * model.tension(x, p, q)}):
        with pytest.raises(InconsistentModel, match=r"one unit: off by 0\.0\d+ \(tension, .*contact\.watch"):
            find(with_model(machine, replace(model, **changes)))
    si = MACHINES["in SI"].model
    for name in ("length", "force", "energy"):
        units = lambda p, name=name: replace(si.units(p), **{name: 1.01 * getattr(si.units(p), name)})  # noqa: E731
        relations = algebraic_relations(replace(si, units=units), MACHINES["in SI"].values)
        assert suspects(relations) == ("units",)


def test_a_factor_of_the_energy_or_of_all_impacts_is_told():
    """Which of the two is wrong nothing says: one of them is named."""
    model = by_hand(BROKEN["hopper"])
    for field in ("flight_gradient", "impact_mass"):
        whole = getattr(model, field)
        scaled = {
            "flight_gradient": lambda x, p, q, whole=whole: [1.01 * each for each in whole(x, p, q)],
            "impact_mass": lambda x, p, whole=whole: 1.01 * whole(x, p),
        }
        assert named(BROKEN["hopper"], replace(model, **{field: scaled[field]})) == ("impact_mass",)


def test_pieces_in_the_wrong_place_are_named():
    machine = MACHINES["in pieces"]
    model = replace(machine.model, reduction=None)
    for which, coordinate in (("contact", (-1.0, 0.0)), ("flight", (0.0, 0.0, 1.0, 0.0)), ("flight", (1.0, 0.0))):
        phase = getattr(model, which)
        wrong = replace(phase, pieces=replace(phase.pieces, coordinate=coordinate))
        assert named(machine, replace(model, **{which: wrong})) == (f"{which}.pieces",)
    phase = replace(model.flight, pieces=replace(model.flight.pieces, coordinate=(1.0, 0.0, 0.0, 0.0)))
    with pytest.raises(InconsistentModel, match=r"by its flight\.pieces: .*continuous where its pieces meet"):
        check(with_model(machine, replace(model, flight=phase)))


def test_a_machine_that_is_damped_and_says_it_is_not():
    machine = MACHINES["damped"]
    assert named(machine, replace(machine.model, conservative=True)) == ("conservative",)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_no_number_is_named(value):
    machine = Hopper("r + 0.3*r**3", rest_length=20.0)
    model = replace(machine.model, reduction=None)
    wrong = {
        "impact_mass": lambda x, p: value,
        "impact": lambda x, p: [0.0, 0.0, 0.0, value],
        "embed": np.where(model.embed, value, 0.0),
        "flight_gradient": at(model.flight_gradient, 3, value),
    }
    for field, change in wrong.items():
        assert named(machine, replace(model, **{field: change})) == (field,)
    nowhere = replace(model.flight, field=at(model.flight.field, 3, value))
    with pytest.raises(InconsistentModel, match=r"its flight\.field gives no numbers"):
        check(with_model(machine, replace(model, flight=nowhere)))
    with pytest.raises(NoOrbit):
        find(with_model(machine, replace(model, flight=nowhere)))


def test_a_separation_with_a_length_beside_it_is_consistent():
    """Coordinates are counted from the unloaded spring, whose length is in the separation alone."""
    machine = Mechanism(
        ("body", "foot"),
        [Mass("body", "m1"), Mass("foot", "m2"), Spring("body - foot", "k*r")],
        gap="foot",
        parameters={"m1": 1.0, "m2": 1.0, "k": 1.0},
        separation="body - foot + 8",
    )
    assert check(machine)
