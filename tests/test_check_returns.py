"""Saved theorems about hops that come back, verified by a second program, which sees false ones."""

import json
from copy import deepcopy
from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest
from proofs import restated

from orbits import ReturnMap, find, prove_doubling, prove_fixed_point
from orbits.check_returns import check_saved
from orbits.check_statement import statement_of
from orbits.proof import proof_of_fixed_point
from orbits.returns import Bifurcation
from orbits.returns.proofs import guessed_hop
from problems import Hopper, hopper_in_si

SLOW = pytest.mark.slow


def saved(proof):
    return json.loads(json.dumps(proof.document(), sort_keys=True))


@pytest.fixture(scope="module")
def bounce():
    """A hop with two impacts, which is a fixed point."""
    return saved(prove_fixed_point(Hopper(rest_length=9.0), 4.4876, "0.03"))


@pytest.fixture(scope="module")
def doubling():
    """Curve (d) of the paper's Fig. 8."""
    return saved(prove_doubling(Hopper(), Bifurcation("flip", 0.071587384137, (4.541763272853,), -1.0, 0)))


def proof_of_bilinear():
    alpha = find(machine := Hopper("bilinear")).alpha
    return prove_fixed_point(machine, ReturnMap(machine, 0.03).fixed_points(0.9 * alpha, 1.1 * alpha)[1], "0.03")


def proof_of_pair():
    return prove_fixed_point(Hopper(), ReturnMap(Hopper(), inject=0.12).periodic_hops(2, 4.48, 4.63)[0], "0.12")


def proof_in_si():
    return prove_fixed_point(hopper_in_si(30.0, 30.0, stiffness=8000.0, rest_length=2.0), 2.707, "0.02")


TRUE = {
    "interval": lambda: prove_fixed_point(Hopper(), 4.52, ("0.0299999", "0.0300001")),
    "bilinear": proof_of_bilinear,
    "pair": proof_of_pair,
    "SI": proof_in_si,
}


def test_a_fixed_point_with_a_bounce_is_verified(bounce):
    assert bounce["proved"]
    assert statement_of(bounce) == bounce["statement"]
    assert check_saved(bounce) == []


@SLOW
@pytest.mark.parametrize("name", TRUE)
def test_hops_that_come_back_are_verified(name):
    document = saved(TRUE[name]())
    assert document["proved"], document["reasons"]
    assert statement_of(document) == document["statement"]
    assert check_saved(document) == []


def moved(pair, by):
    return [str(Decimal(each) + Decimal(by)) for each in pair]


def changed(document, *path, to):
    """A copy with another value at a place, said wherever the file repeats itself."""
    found = inner = deepcopy(document)
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = to(inner[path[-1]]) if callable(to) else to
    if path[0] == "enclosures" and path[1] in found["parts"][0]["unknowns"]:
        found["parts"][0]["unknowns"][path[1]] = found["enclosures"][path[1]]
    pairs = found["machine"]["parameters"] | ({"inject": pair} if (pair := found["machine"]["injection"]) else {})
    found["parts"][0]["parameters"] = pairs
    again, parameters = ({name: {"low": low, "high": high} for name, (low, high) in each.items()}
                         for each in (found["enclosures"], pairs))  # fmt: skip
    radius = found["parts"][0]["uniqueness_radius"]
    return restated(found | again | {"parameters": parameters, "uniqueness_radius": radius})


# What is false, seen before any motion is followed: the place in the file, the value, and the reason.
SAID = {
    "a condition is missing": (("conditions",), {"clearance": "proved"}, "fewer conditions"),
    "not proved": (("proved",), False, "all proved"),
    "more": (("machine", "more"), "1", "more than this program verifies"),
    "another kind": (("kind",), "period doubling", "not the unknowns of a period doubling"),
    "a longer period": (("kind",), "periodic hops", "another kind than its unknowns"),
    "no uniqueness": (("parts", 0, "uniqueness_radius"), "0", "radius of uniqueness"),
    "radius": (("radius",), "1e-30", "less than half the width"),
    "family": (("family",), 1, "have a family"),
    "launch": (("machine", "launch"), "y2", "does not determine the coordinate"),
    "multiplier of 1": (("enclosures", "multiplier"), ["0.5", "8"], "may be 1 or -1"),
    "number": (("enclosures", "multiplier"), [7.2, 7.3], "not a text of decimal digits"),
}


@pytest.mark.parametrize("name", SAID)
def test_what_a_file_says_besides(bounce, name):
    path, value, reason = SAID[name]
    (found,) = check_saved(changed(bounce, *path, to=value))
    assert reason in found


FALSE = {
    "alpha": (("enclosures", "alpha"), lambda pair: moved(pair, "1e-20")),
    "contact time": (("enclosures", "contact_time"), lambda pair: moved(pair, "1e-18")),
    "exact liftoff": (("enclosures", "liftoff"), ["1.000000000000000001"] * 2),
    "multiplier": (("enclosures", "multiplier"), lambda pair: moved(pair, "-2e-13")),
    "injection": (("machine", "injection"), ["0.0300000000000000001"] * 2),
    "spring": (("machine", "springs", 0, "force"), ["r + 1e-18*r**3"]),
    "a hostile gravity": (("machine", "gravity"), "1e300"),
    "uniqueness": (("parts", 0, "uniqueness_radius"), "3"),
    "separation": (("machine", "separation"), "rest_length + y1 - y2 - 5"),
    "separation in flight": (("machine", "separation"), "rest_length + y2 - y1 - 5"),
}


@pytest.mark.parametrize("name", [pytest.param(name, marks=() if name == "alpha" else SLOW) for name in FALSE])
def test_a_changed_number_is_refused(bounce, name):
    path, value = FALSE[name]
    false = changed(bounce, *path, to=value)
    assert false["statement"] != bounce["statement"]
    assert len(check_saved(false)) == 1


@SLOW
def test_a_number_beside_the_place_of_the_launch_is_refused():
    """It is closer than the enclosures of the program, so that only the exact force distinguishes it."""
    document = saved(prove_fixed_point(Hopper(), 4.5188, "0.03"))
    assert document["enclosures"]["liftoff"] == ["1", "1"]
    false = changed(document, "enclosures", "liftoff", to=["1." + "0" * 60 + "1"] * 2)
    assert check_saved(false) == ["liftoff is not shown to lie in its enclosure"]


@SLOW
def test_motions_that_are_no_hops_of_the_map_are_refused():
    """Zeros of the equations: a contact that goes on through its end, and a fixed point that is said to be of period
    two."""
    guess = guessed_hop(Hopper(), 4.5188, 0.03)
    later = replace(guess, contacts=(guess.contacts[0] + 2 * np.pi * np.sqrt(2),))
    false = saved(proof_of_fixed_point(Hopper(), later, "0.03", None, {}, None))
    false |= {"proved": True, "reasons": [], "conditions": dict.fromkeys(false["conditions"], "proved")}
    assert check_saved(restated(false)) == ["a sign along the motion cannot be decided"]
    repeats = {name: 2 * getattr(guess, name) for name in ("launches", "flights", "contacts")}
    twice = saved(proof_of_fixed_point(Hopper(), replace(guess, **repeats), "0.03", None, {}, None))
    twice |= {"proved": True, "reasons": [], "conditions": dict.fromkeys(twice["conditions"], "proved")}
    assert check_saved(restated(twice)) == ["the launch speed may come back after 1 hops"]


@SLOW
def test_a_period_doubling_is_verified(doubling):
    assert doubling["proved"]
    assert statement_of(doubling) == doubling["statement"]
    assert check_saved(doubling) == []


@SLOW
def test_a_changed_injection_of_a_doubling_is_refused(doubling):
    false = changed(doubling, "enclosures", "inject", to=lambda pair: moved(pair, "1e-18"))
    assert check_saved(false) == ["inject lies outside of its enclosure"]
