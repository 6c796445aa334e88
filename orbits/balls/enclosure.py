"""Rigorous motions of a set of starts: the centre with high accuracy, and the derivatives by the unknowns.

The starts are c + M w, where w are the deviations of the unknowns, within their radii, and M the derivatives of the
start by them. By the mean value theorem the states later are c(t) + D(t) w, with D(t) in an enclosure of derivatives
over all of the set. These are stored as Q M, with a rounded orthogonal matrix Q that turns with the motion and an
interval matrix M: the product of many interval matrices would grow with every turn of the motion (the wrapping effect;
R. Lohner's method, as in CAPD: T. Kapela, M. Mrozek, D. Wilczak, P. Zgliczynski, Communications in Nonlinear Science
and Numerical Simulation 101, 2021).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from flint import arb, arb_mat, ctx

from ..exact import Unproved, check_proof_time
from .crossing import NO_BREAKPOINTS, Breakpoints, advance_step
from .programs import EachLaw
from .rigorous_step import SETS, SPREADING, Step, System


class Fineness(NamedTuple):
    """How derivatives are enclosed: the order of polynomials, their accuracy, and the bits of balls."""

    order: int
    accuracy: float
    bits: int


# Coarse derivatives are multiplied by deviations that are small themselves; fine ones are results.
COARSE, FINE = Fineness(order=12, accuracy=2.0**-30, bits=64), Fineness(order=18, accuracy=2.0**-50, bits=100)
TOO_LONG = f"the motion takes more than {SETS.most_steps} steps"


@dataclass(frozen=True)
class Variation:
    """A system of n states, first moving ones and then constant ones, with its variational equations.

    size : n, the number of states
    moving : m, the number of moving states
    systems : the states alone, one system for each law of a phase that is smooth in pieces
    varied : the states, and after them the derivatives of the m moving states by all n, row by row; likewise
    """

    size: int
    moving: int
    systems: EachLaw[System]
    varied: EachLaw[System]


@dataclass(frozen=True)
class Piece:
    """A step that begins at a time of the motion, which lasts from 0 to 1, with the laws that hold in it."""

    begins: arb
    step: Step
    laws: tuple[int, ...]


@dataclass(frozen=True)
class Passage:
    """An enclosure of the motions of a set of starts, over the times from 0 to 1.

    pieces : the steps, whose tubes hold all of these motions
    start, finish : enclosures (n,) of the first and of the final states of all
    end : enclosures (n,) of the final state of the centre alone
    slopes : enclosures (n, unknowns) of the derivatives of the final states of all
    """

    pieces: list[Piece]
    start: list[arb]
    finish: list[arb]
    end: list[arb]
    slopes: arb_mat


def order_for(bits: int) -> int:
    """The order of the polynomials that enclose a centre to a number of bits."""
    return max(COARSE.order, round(SETS.order_per_bit * bits))


def fineness_for(bits: int) -> Fineness:
    """How derivatives are enclosed to a number of bits."""
    return Fineness(order_for(bits), 2.0**-bits, bits + COARSE.bits)


def follow_centre(
    systems: EachLaw[System], breakpoints: Breakpoints, law: int, start: Sequence[arb],
    length: arb, bits: int,
) -> tuple[list[arb], int]:  # fmt: skip
    """Enclosures (n,) of the state a short time after a start (n,) in the piece of a law, by tubes alone, which grow
    with every step; and the law there."""
    states, left = list(start), length
    for _ in range(SETS.most_steps):
        check_proof_time()
        centre, spread = [value.mid() for value in states], [value.rad() for value in states]
        advance = advance_step(systems, breakpoints, law, centre, spread, left, order_for(bits), 2.0**-bits)
        states, law = advance.step.end(), advance.law
        if not advance.step.h < left:
            return states, law
        left = left - advance.step.h
    raise Unproved(TOO_LONG)


def follow_set(
    variation: Variation, start: Sequence[arb], by_unknowns: arb_mat, radii: arb_mat,
    bits: int, fineness: Fineness = COARSE, breakpoints: Breakpoints = NO_BREAKPOINTS,
) -> Passage:  # fmt: skip
    """The motions over the times from 0 to 1 of the starts from enclosures (n,) of a centre, by deviations of the
    unknowns within radii (unknowns, 1), with enclosures (n, unknowns) of the derivatives of the start by them."""
    n, m = variation.size, variation.moving
    identity = [arb(int(i == j)) for i in range(m) for j in range(n)]
    frame, inner = unit_matrix(n), by_unknowns
    # The error of the centre, in the frame.
    centre, error = [value.mid() for value in start], arb_mat(n, 1, [arb(0, value.rad()) for value in start])
    pieces, at, law = list[Piece](), arb(0), breakpoints.laws_of(_moved(start, by_unknowns * radii))[0]
    while True:
        if len(pieces) == SETS.most_steps:
            raise Unproved(TOO_LONG)
        check_proof_time()
        within = inner * radii + error
        deviations = frame * within
        spread = [deviations[i, 0].abs_upper() for i in range(n)]
        left = 1 - at
        if len(pieces) >= SETS.observed_steps:
            covered = at - pieces[-SETS.observed_steps].begins
            if SETS.observed_steps * left > SETS.hopeless * (SETS.most_steps - len(pieces)) * covered:
                raise Unproved(SPREADING if max(spread) > SETS.spread * max(map(abs, centre)) else TOO_LONG)
        with ctx.workprec(fineness.bits):
            advance = advance_step(
                variation.varied, breakpoints, law, [*centre, *identity], [*spread, *[arb(0)] * (m * n)],
                left, fineness.order, fineness.accuracy,
            )  # fmt: skip
            step = advance.step
            by_start = step.end()[n:]
        rows = [by_start[i * n : (i + 1) * n] for i in range(m)] + unit_matrix(n).tolist()[m:]
        transition = arb_mat(rows)
        end, law = follow_centre(variation.systems, breakpoints, law, centre, step.h, bits)
        if law != advance.law:
            raise Unproved("the centre of the set does not cross a breakpoint with the rest of it")
        pieces.append(Piece(at, Step(step.h, step.polynomials[:n], step.tube[:n]), advance.laws))
        turned = transition * frame
        frame, inverse = orthogonal_frame(turned, [float(within[j, 0].abs_upper()) for j in range(n)])
        inner, centre = (inverse * turned) * inner, [value.mid() for value in end]
        fresh = arb_mat(n, 1, [arb(0, value.rad()) for value in end])
        error = (inverse * turned) * error + inverse * fresh
        if not step.h < left:
            whole, end = frame * inner, _moved(centre, frame * error)
            return Passage(pieces, _moved(start, by_unknowns * radii), _moved(end, whole * radii), end, whole)
        at = at + step.h


def _moved(centre: Sequence[arb], deviations: arb_mat) -> list[arb]:
    return [value + deviations[i, 0] for i, value in enumerate(centre)]


def unit_matrix(n: int) -> arb_mat:
    """The unit matrix (n, n)."""
    return arb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])


def orthogonal_frame(matrix: arb_mat, extents: Sequence[float]) -> tuple[arb_mat, arb_mat]:
    """The orthogonal factor of a matrix (n, n), rounded, and an enclosure of its inverse. Its columns are taken in
    descending order of the reach of a box of these extents (n,) along them: so the frame follows the set in the
    directions in which it is long."""
    middles = np.array([[float(value.mid()) for value in row] for row in matrix.tolist()])
    reaches = np.linalg.norm(middles, axis=0) * np.array(extents)
    factor, _ = np.linalg.qr(middles[:, np.argsort(-reaches, kind="stable")])
    exact = arb_mat([[arb(value) for value in row] for row in factor.tolist()])
    return exact, exact.inv()
