"""Machines are held against mechanics: those of the library hold, and so does one that is written by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from orbits import InputError, Model, check, find, starts
from orbits.errors import InconsistentModel
from orbits.model import Affine, Phase
from orbits.model.model import DERIVED_FIELDS
from problems import Chain, Hopper, chain_hand, plate_hopper
from problems.laws import springs
from tests.consistency.by_hand import by_hand
from tests.consistency.checked_machines import MACHINES, with_model

SLOW = pytest.mark.slow


# Each has what others have too: it is another kind of machine, or its laws and units are of another kind.
OTHERS = ("damped juggler", "varying juggler", "actuated juggler", "juggler in SI", "inerter in SI")


@pytest.mark.parametrize("name", [pytest.param(name, marks=SLOW if name in OTHERS else ()) for name in MACHINES])
def test_machines_hold(name):
    checked = check(MACHINES[name])
    assert len(checked.relations) >= 25
    assert checked.largest < 0.1
    table = str(checked).splitlines()
    assert table[0].endswith(f"{len(checked.relations)} relations hold")
    assert len(table) == 2 + len(checked.relations) + len(checked.left_out)


@pytest.mark.parametrize("machine", [plate_hopper(), chain_hand()], ids=lambda machine: machine.name)
def test_machines_of_three_masses_hold_along_their_own_hops(machine):
    checked = check(machine, start=starts(machine, 4.0, 4.0)[0])
    assert any("orbit's flight" in each.words for each in checked.relations)
    assert checked.largest < 0.1


@pytest.mark.slow
def test_a_table_of_measurements_holds():
    x = np.linspace(-5, 5, 41)
    assert check(Hopper(springs.table((x, x + 0.05 * x**3)), rest_length=20.0)).largest < 0.1


def test_a_chain_holds_along_its_own_hop():
    """It is `starts(chain, 4.0, 4.0)[0]`."""
    start = {"liftoff": 0.66993275, "alpha": 3.967468, "y1": 2.5671563, "y1'": 1.5957524}
    start |= {"duration": 2.5758617, "contact_duration": 3.168004}
    checked = check(Chain([1.0, 2.0, 0.7], ["r", "r + 0.1*r**3"]), start=start)
    assert any("orbit's flight" in each.words for each in checked.relations)
    assert checked.largest < 0.1


def inerter_by_hand(**changes) -> SimpleNamespace:
    """A hopper of masses m1 and m2 with a spring k and an inerter b between, gravity 1, written by hand; the inerter's
    force is b times the acceleration of the extension."""

    def flight(x, p, q):
        spring = p["k"] * (x[0] - x[2])
        relative = -spring / (p["m1"] * p["m2"] / (p["m1"] + p["m2"]) + p["b"])
        share = p["m2"] / (p["m1"] + p["m2"])
        return [x[1], -1 + share * relative, x[3], -1 - (1 - share) * relative]

    def contact(x, p, q):
        return [x[1], -(p["k"] * x[0] + p["m1"]) / (p["m1"] + p["b"])]

    def rho(p):
        return (p["m1"] * p["m2"] + p["b"] * (p["m1"] + p["m2"])) / (p["k"] * p["m1"])

    def gradient(x, p, q):
        spring, moved = p["k"] * (x[0] - x[2]), p["b"] * (x[1] - x[3])
        return [spring + p["m1"], p["m1"] * x[1] + moved, p["m2"] - spring, p["m2"] * x[3] - moved]

    def guess(family, p):
        mu = p["m1"] * p["m2"] / (p["m1"] + p["m2"])
        half = 4.4934 * np.sqrt((mu + p["b"]) / p["k"])
        return {"liftoff": rho(p), "alpha": (1 + p["m2"] / p["m1"]) * half, "duration": half}

    p = {"m1": 1.3, "m2": 0.7, "k": 2.0, "b": 0.4}
    fields = {
        "name": "hopper with an inerter",
        "flight": Phase("flight", ("y1", "y1'", "y2", "y2'"), flight),
        "contact": Phase("contact", ("y1", "y1'"), contact, {"contact force": lambda x, p, q: (
            p["m2"] - p["k"] * x[0] + p["b"] * (p["k"] * x[0] + p["m1"]) / (p["m1"] + p["b"])
        )}),
        "reversor": (1, -1, 1, -1),
        "release": lambda alpha, p: np.full(np.shape(alpha), rho(p)),
        "embed": np.eye(4, 2),
        "flight_gradient": gradient,
        "extension": Affine((1.0, 0.0, -1.0, 0.0)),
        "gap": lambda p: Affine((0.0, 0.0, 1.0, 0.0)),
        "separation": lambda p: None,
        "heights": lambda p: {"body": Affine((1.0, 0.0, 0.0, 0.0)), "foot": Affine((0.0, 0.0, 1.0, 0.0))},
        "impact_mass": lambda x, p: p["m2"] + p["b"] * p["m1"] / (p["m1"] + p["b"]),
        "impact": lambda x, p: [0.0, p["b"] / (p["m1"] + p["b"]), 0.0, 1.0],
        "violations": dict.fromkeys(("gap", "pull", "separation", "end"), "it is no motion"),
        "springs": (("foot", "body"),),
        "tension": lambda x, p, q: p["k"] * (x[0] - x[2]),
        "guess": guess,
    }  # fmt: skip
    told = {"machine": "hopper with an inerter", "spring": "k*r", "gravity": "1", "mass_ratio": 1.0, "parameters": p}
    told |= {"rest_length": None, "restitution": 0.0, "laws_in": "units of the machine"}
    machine = SimpleNamespace(model=Model(**{**fields, **changes}), values=p, units=None, restitution=0.0)
    machine.describe, machine.with_values, machine.rest_length = lambda: told, lambda **values: machine, None
    return machine


def test_a_machine_written_by_hand_with_coupled_inertia():
    """With an inerter the half flight obeys tan x = x, x = omega T/2 with omega**2 = k/(mu + b)."""
    machine = inerter_by_hand()
    assert check(machine).largest < 0.1
    p, orbit = machine.values, find(machine)
    omega = np.sqrt(p["k"] / (p["m1"] * p["m2"] / (p["m1"] + p["m2"]) + p["b"]))
    assert omega * orbit.flight_time / 2 == pytest.approx(4.493409457909064, rel=1e-13)
    # What a hopper without an inerter would have.
    plain = {
        "impact": lambda x, p: [0.0, 0.0, 0.0, 1.0],
        "impact_mass": lambda x, p: p["m2"],
        "contact": replace(machine.model.contact, watch={"contact force": lambda x, p, q: p["m2"] - p["k"] * x[0]}),
        "release": lambda alpha, p: np.full(np.shape(alpha), p["m2"] / p["k"]),
    }
    for field, wrong in plain.items():
        with pytest.raises(InconsistentModel) as error:
            find(inerter_by_hand(**{field: wrong}))
        assert error.value.fields == ("contact.watch" if field == "contact" else field,)
    with pytest.raises(InconsistentModel) as error:
        find(inerter_by_hand(**plain))
    assert len(error.value.fields) > 1


def test_wrong_guesses_are_told():
    machine = Hopper("r + 0.3*r**3", rest_length=20.0)
    model = by_hand(machine)
    half = lambda family, p: {name: 0.5 * value for name, value in model.guess(family, p).items()}  # noqa: E731
    none = lambda family, p: {"liftoff": 1.0}  # noqa: E731
    faster = replace(machine.model.relative, rate=lambda p: 2.0)
    scale = lambda p: model.search(p)._replace(scale=-1.0)  # noqa: E731
    for field, wrong in (("guess", half), ("guess", none), ("guess", faster), ("search", scale)):
        with pytest.raises(InconsistentModel) as error:
            check(with_model(machine, replace(model, **{field: wrong})))
        assert error.value.fields == (field,)
    with pytest.raises(InconsistentModel, match="its guess has no 'duration'"):
        find(with_model(machine, replace(model, guess=none)), method="half orbit")


@pytest.mark.parametrize("name", DERIVED_FIELDS)
def test_what_follows_from_other_fields_is_not_stated(name):
    with pytest.raises(InputError, match=f"states no '{name}', which follows from its .*: leave it out"):
        inerter_by_hand(**{name: None})
