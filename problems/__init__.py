"""The machines, their springs and their gravity: each is imported when it is first asked for."""

from importlib import import_module
from typing import Any

_HOMES = {
    "Actuated": ".actuated",
    "Chain": ".chain",
    "HeavyHand": ".heavy_hand",
    "Hopper": ".hopper",
    "Juggler": ".juggler",
    "hopper_in_si": ".units",
    "juggler_in_si": ".units",
    "gravity": ".gravity",
    "springs": ".springs",
    "steering": ".steering",
}

__all__ = [
    "Actuated",
    "Chain",
    "HeavyHand",
    "Hopper",
    "Juggler",
    "gravity",
    "hopper_in_si",
    "juggler_in_si",
    "springs",
    "steering",
]


def __getattr__(name: str) -> Any:
    # The command line lives in this package and must answer --help before CasADi and NumPy are loaded.
    if name not in _HOMES:
        raise AttributeError(f"module 'problems' has no attribute '{name}'")
    module = import_module(_HOMES[name], __name__)
    return module if name in ("gravity", "springs", "steering") else getattr(module, name)
