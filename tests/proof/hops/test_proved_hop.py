"""Conditions of the motion of a periodic hop that are refuted or left open."""

from dataclasses import replace

import numpy as np

from orbits import prove_fixed_point
from orbits.mechanics import Inerter
from orbits.proof import proof_of_fixed_point
from orbits.returns.proofs import guessed_hop
from problems import Hopper, knee_hopper


def test_a_contact_that_goes_on_through_its_end_is_refuted():
    """A whole swing later the body passes the place of the lift-off again, as fast: a zero of the equations."""
    guess = guessed_hop(Hopper(), 4.5188, 0.03)
    later = replace(guess, contacts=(guess.contacts[0] + 2 * np.pi * np.sqrt(2),))
    proof = proof_of_fixed_point(Hopper(), later, "0.03", None, {}, None)
    assert not proof.proved
    assert proof.conditions["contact_force"] == "refuted"
    assert "fixed point of the return map" not in proof.statement
    assert "stable" not in proof.statement


def test_masses_that_pass_through_each_other():
    proof = prove_fixed_point(Hopper(rest_length=4.0), 4.5188, "0.03")
    assert proof.conditions["separation"] == "refuted"
    assert not proof.proved


def test_a_place_of_the_liftoff_that_depends_on_the_speed_is_left_open():
    """A moment of inertia of the knee makes the contact force depend on its speed; without one it is a spring's."""
    knee = knee_hopper()
    machine = replace(knee, elements=[*knee.elements, Inerter("knee", "0.5")])
    proof = prove_fixed_point(machine, 10.987573, "0.2")
    assert not proof.proved
    assert "the contact force depends on speeds" in proof.reasons[0]
