"""The equations of a machine, told apart from those of another one with the same name, parameters and words.

A description names a table or a Python function and does not state it, and of a mechanism it has the springs alone.
"""

from collections.abc import Iterator, Mapping
from hashlib import sha256
from typing import Any

import casadi as ca

from ..io import version
from ..laws import Algebraic, Parameters
from ..model import Machine, Model, Phase
from ..running import exclusive
from ..symbolic import cached

EQUATIONS = "equations"  # the key of the digest in a question's document


@exclusive
def digest_of_equations(machine: Machine) -> str:
    """A digest of a machine's equations as functions of its parameters, whatever the values of these.

    It is one of the graphs of CasADi, the same in all processes with the same version, which it begins with.
    """
    models, names = [machine.model], tuple(machine.values)
    if machine.model.hysteretic:
        from ..hops import Branches

        models += [each.model for each in Branches(machine).of.values()]
    digests = "".join(_digest_of_model(model, names) for model in models)
    return f"{version('casadi')} {sha256(digests.encode()).hexdigest()[:16]}"


def refuse_other_equations(about: Mapping[str, Any], machine: Machine) -> None:
    """Raise `ValueError` where a question in words is of a machine with other equations, as far as they compare."""
    known, own = about.get(EQUATIONS), digest_of_equations(machine)
    if known != own and str(known).startswith(f"{version('casadi')} "):
        raise ValueError("its machine has other equations, for example from another table of the same name")


@cached
def _digest_of_model(model: Model, names: tuple[str, ...]) -> str:
    """The digest of a model with parameters of these names."""
    symbols = [ca.SX.sym(name) for name in names]
    p = dict(zip(names, symbols, strict=True))
    found = sha256(repr((model.name, model.reversor, model.symmetry, names)).encode())
    for phase in (model.flight, model.contact):
        x = [ca.SX.sym(name) for name in phase.states]
        q = [ca.SX.sym(f"q{i}") for i in range(phase.pieces.size if phase.pieces else 0)]
        values = [*phase.field(x, p, q), *(watched(x, p, q) for watched in phase.watch.values())]
        values += [*_breaks_and_data(phase, p), *(_of_flight(model, x, p, q) if phase is model.flight else ())]
        known = [ca.vertcat(*map(ca.SX, each)) for each in (x, symbols, q)]
        found.update(ca.Function("equations", known, [*map(ca.SX, values)]).serialize().encode())
    return found.hexdigest()


def _breaks_and_data(phase: Phase, p: Parameters) -> Iterator[Algebraic]:
    """The breakpoints of a phase in pieces, with their data."""
    if phase.pieces is not None:
        breaks, data = phase.pieces.table(p)
        yield ca.vertcat(*map(ca.SX, breaks))
        yield from (ca.horzcat(*map(ca.SX, row)) for row in data)
        yield from (phase.pieces.unit(p), phase.pieces.origin(p), ca.DM(phase.pieces.coordinate))


def _of_flight(model: Model, x: list[ca.SX], p: Parameters, q: list[ca.SX]) -> Iterator[Algebraic]:
    """What a model says of a state in flight besides its motion: energy, gaps, lengths, impacts and other labels."""
    yield from model.flight_gradient(x, p, q)
    gaps = [model.gap(p), model.landing_gap and model.landing_gap(p), model.extension_of(p)]
    lengths = [model.separation(p), *model.heights(p).values()]
    yield from (each.at(x) for each in (*gaps, *lengths) if each is not None)
    yield from (model.impact_mass(x, p), *model.impact(x, p))
    for shift in (model.reversor_shift, model.symmetry_shift):
        yield from shift(p) if shift else ()
