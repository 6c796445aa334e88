"""Shared by the tests of the page: scenes, and a query as a server has it."""

from dataclasses import replace
from urllib.parse import parse_qs

import pytest

from problems.explorer import Scene, beginning
from problems.explorer.scene import DroppedRows
from problems.laws import springs

ROWS = DroppedRows("leg spring.csv", springs.SAMPLE.read_text(encoding="utf-8"), "mean")
SHORT_ROWS = DroppedRows("rows.csv", "extension,force\n" + "\n".join(f"{r},{r + r**3 / 50}" for r in range(-20, 21)))
IN_SI = beginning("hopper", True)
SCENES = {
    "cubic": beginning("hopper"),
    "juggler": beginning("juggler"),
    "in SI": IN_SI,
    "linear in SI": beginning("juggler", True),
    "named": Scene(spring="tanh", numbers={"b": 0.1}, family=2).complete(),
    "potential": Scene(spring="potential:r**2/2 + c*r**4", numbers={"c": 0.02, "rest_length": 9.0}).complete(),
    "gravity": Scene(gravity="exp(-z/H)", numbers={"H": 90.0}).complete(),
    "sphere": replace(IN_SI, gravity="inverse_square", numbers={**IN_SI.numbers, "R": 1e4}).complete(),
    "restitution": replace(
        beginning("hopper"), numbers={**beginning("hopper").numbers, "restitution": 0.25}
    ).complete(),
    "rows": Scene(rows=SHORT_ROWS, along="mass_ratio").complete(),
    "measured leg": replace(IN_SI, rows=ROWS).complete(),
    "around": replace(beginning("hopper"), launch=2.5, along="rest_length", start=(0.8290513811936318, 2.94, 2.9)),
}
SCENES |= {
    "wheel": beginning("wheel", True),
    "small rocker": Scene("rocker", numbers={"inertia_ratio": 0.7, "gravity_ratio": 0.5}, family=2),
    "runner": beginning("runner"),
    "runner in SI": beginning("runner", True).with_numbers(friction=0.5).complete(),
    "two feet": beginning("alternating-hopper"),
    "two feet in SI": beginning("alternating-hopper", True),
    "cubic shuttle": replace(beginning("shuttle"), spring="r + beta*r**3").complete(),
}
given = pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)


def arguments(query: str) -> dict[str, list[bytes]]:
    """A query as a server has it."""
    return {name: [each.encode() for each in values] for name, values in parse_qs(query).items()}
