"""The machines, their springs and their gravity: each module is imported when a name in it is first used."""

from importlib import import_module
from typing import Any

_HOMES = {
    "Actuated": ".actuated",
    "Chain": ".chain",
    "Disturbed": ".disturbed",
    "Driven": ".driven",
    "HeavyHand": ".juggler",
    "Hopper": ".hopper",
    "Juggler": ".juggler",
    "chain_hand": ".hand",
    "explore": ".explorer.server",
    "hopper_in_si": ".units",
    "inerter_hopper": ".inerter",
    "juggler_in_si": ".units",
    "knee_hopper": ".knee",
    "plate_hopper": ".plate",
}
_MODULES = ("gravity", "springs", "steering")

__all__ = [*_HOMES, *_MODULES]


def __getattr__(name: str) -> Any:
    # The command line lives in this package and must answer --help before CasADi and NumPy are loaded.
    if name in _MODULES:
        return import_module(f".{name}", __name__)
    if name not in _HOMES:
        raise AttributeError(f"module 'problems' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name], __name__), name)
