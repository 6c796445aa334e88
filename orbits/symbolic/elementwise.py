"""A CasADi function at many points: each of its instructions on all of them at once, not all of it at one by one."""

import casadi as ca
import numpy as np

from .calls import BufferedFunction, room_for


def single_assignment(function: ca.Function) -> list[tuple]:
    """An SX function's instructions (operation, arguments, constant) with work slots renamed, so that each result has a
    place of its own. An output's arguments are its source and where it goes, an input's where it comes from."""
    slot, program = {}, []
    for i in range(function.n_instructions()):
        op, source, target = function.instruction_id(i), function.instruction_input(i), function.instruction_output(i)
        constant = function.instruction_constant(i) if op == ca.OP_CONST else None
        if op == ca.OP_OUTPUT:
            program.append((op, (slot[source[0]], *target), None))
            continue
        arguments = tuple(source) if op == ca.OP_INPUT else tuple(slot[s] for s in source)
        slot[target[0]] = len(program)
        program.append((op, arguments, constant))
    return program


class ElementwiseFunction:
    """An SX function of vectors at several points: arguments (m, size) make results (m, rows).

    Ten to seventy times as fast as one point after another (a vector field at 6,400 points).
    """

    def __init__(self, function: ca.Function):
        symbols = function.sx_in()
        function = ca.Function("dense", symbols, [ca.densify(result) for result in function.call(symbols)])
        self._program = single_assignment(function)
        self._sizes = [function.numel_in(i) for i in range(function.n_in())]
        self._rows = [function.numel_out(i) for i in range(function.n_out())]
        self._calls: dict[int, BufferedFunction] = {}

    def __call__(self, *arguments) -> list[np.ndarray]:
        """Results of each point; an argument (1, size) is that of all."""
        count = max(len(argument) for argument in arguments)
        room = room_for(count)
        if room not in self._calls:
            self._calls[room] = BufferedFunction(self._function(room))
        call = self._calls[room]
        with call.lock:
            for memory, argument in zip(call.arguments, arguments, strict=True):
                memory = memory.reshape(-1, room)
                memory[:, :count] = np.transpose(argument)
                memory[:, count:] = argument[-1][:, None]
            call.trigger()
            return [flat.reshape(-1, room)[:, :count].T.copy() for flat in call.flat]

    def _function(self, count: int) -> ca.Function:
        """The function on matrices (count, size)."""
        arguments = [ca.MX.sym("x", count, size) for size in self._sizes]
        columns = [ca.horzsplit(argument) if argument.numel() else [] for argument in arguments]
        results = [[ca.MX.zeros(count)] * rows for rows in self._rows]
        values: list = []
        for op, places, constant in self._program:
            if op == ca.OP_OUTPUT:
                source, which, row = places
                results[which][row] = values[source] + ca.MX.zeros(count)
                values.append(None)
            elif op == ca.OP_INPUT:
                values.append(columns[places[0]][places[1]])
            elif op == ca.OP_CONST:
                values.append(ca.MX(constant))
            else:
                apply = ca.MX.unary if len(places) == 1 else ca.MX.binary
                values.append(apply(op, *(values[place] for place in places)))
        return ca.Function("rows", arguments, [ca.densify(ca.horzcat(*rows, ca.MX(count, 0))) for rows in results])
