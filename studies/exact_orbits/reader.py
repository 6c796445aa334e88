"""Reads a case of exact orbits, in plain Python without packages: a file to copy, or to translate."""

import ast
import functools
import json
import math
import operator
from pathlib import Path

FUNCTIONS = {"abs": abs, "max": max, "min": min, "USub": operator.neg, "Add": operator.add, "Sub": operator.sub}
FUNCTIONS |= {"Mult": operator.mul, "Div": operator.truediv, "Pow": operator.pow}
FUNCTIONS |= {name: getattr(math, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt")}
tree = functools.cache(lambda text: ast.parse(text, mode="eval").body)


def value(node, names, texts):
    """The value of a formula's syntax tree, from the values of some names and the texts of all others."""
    if isinstance(node, ast.Constant):
        return node.value
    if isinstance(node, ast.Name):
        return names[node.id] if node.id in names else value(tree(str(texts[node.id])), names, texts)
    called = isinstance(node, ast.Call)
    parts = [part for part in (node.args if called else ast.iter_child_nodes(node)) if isinstance(part, ast.expr)]
    return FUNCTIONS[node.func.id if called else type(node.op).__name__](*[value(part, names, texts) for part in parts])


class Case(dict):
    """The file's dictionary, as `Case("cases/linear_hop.json")`; t is the time, x a dictionary of the states."""

    def __init__(self, path):
        super().__init__(json.loads(Path(path).read_text(encoding="utf-8")))
        self.unknowns = {name: each["value"] for name, each in self["unknowns"].items()}

    def at(self, text, t=0.0, x=()):
        """The value of a formula, as a guard; or values by name, of derivatives, a reset or the state at the start."""
        if isinstance(text, dict):
            return {name: self.at(each, t, x) for name, each in text.items()}
        return value(tree(str(text)), {**self.unknowns, "t": t, **dict(x)}, self["parameters"] | self["formulas"])
