"""The instructions of a CasADi SX function in single-assignment form, for whoever evaluates or transforms its graph."""

from typing import NamedTuple

import casadi as ca


class Instruction(NamedTuple):
    """One scalar operation; `arguments` are the positions of the instructions whose results it takes.

    The arguments of an OP_INPUT are (which input, which element), those of an OP_OUTPUT (source, which output, which
    element). `constant` is the value of an OP_CONST, else None.
    """

    op: int
    arguments: tuple[int, ...]
    constant: float | None


def single_assignment(function: ca.Function) -> list[Instruction]:
    """The instructions of an SX function, with work slots renamed so that no result overwrites another."""
    position: dict[int, int] = {}  # of the instruction whose result each work slot holds
    instructions = []
    for i in range(function.n_instructions()):
        op, source, target = function.instruction_id(i), function.instruction_input(i), function.instruction_output(i)
        if op == ca.OP_OUTPUT:
            instructions.append(Instruction(op, (position[source[0]], *target), None))
            continue
        arguments = tuple(source) if op == ca.OP_INPUT else tuple(position[slot] for slot in source)
        constant = function.instruction_constant(i) if op == ca.OP_CONST else None
        position[target[0]] = len(instructions)
        instructions.append(Instruction(op, arguments, constant))
    return instructions
