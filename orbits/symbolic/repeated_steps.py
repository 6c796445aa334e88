"""Functions that repeat a step, as sums over places do, interpreted as one graph or as a loop in machine code."""

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from .kernels import ElementwiseFunction
from .machine_code import CodedFunction
from .vector_code import VectorCode


def repeated(step: ca.Function, start: Sequence[float], constants: np.ndarray, columns: int = 0) -> ElementwiseFunction:
    """The function whose result is made from `start` by a step for each row of constants (K, k).

    step : an SX function (result before, row of constants, arguments ...) -> result after
    columns : where it is not 0, the first argument has this number of rows of K numbers, one row after the other, and a
        step takes a column of these
    """
    count, width = constants.shape
    sizes = [step.numel_in(i) for i in range(2, step.n_in())]
    symbols = [ca.SX.sym("a", size * (count if columns and not i else 1)) for i, size in enumerate(sizes)]
    total = ca.SX(ca.DM(start))
    for k, row in enumerate(constants):
        total = step(total, row, *([symbols[0][k::count], *symbols[1:]] if columns else symbols))

    def append(code: VectorCode, arguments: Sequence[Any]) -> list[list[str]]:
        rows = code.table(constants.ravel())

        def body(k: str, before: list[str]) -> list[str]:
            at = code.offset(code.place(rows), k, width)
            row = [code.get(code.moved(at, i)) for i in range(width)]
            if not columns:
                return code.graph(step, [before, row, *arguments])[0]
            at = code.offset(code.place(arguments[0].place), k)
            column = [code.get(code.moved(at, i * count)) for i in range(columns)]
            return code.graph(step, [before, row, column, *arguments[1:]])[0]

        return [code.loop(0, count - 1, body, list(map(code.splat, start)))]

    loop = CodedFunction([symbol.numel() for symbol in symbols], [len(start)], append, (0,))
    return ElementwiseFunction(ca.Function("repeated", symbols, [total]), loop)
