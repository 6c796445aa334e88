"""The machines, their springs and their gravity: each module is imported when a name in it is first used."""

from importlib import import_module
from typing import Any

_HOMES = {
    "Actuated": ".steering.actuated",
    "Actuator": ".steering.actuated",
    "Chain": ".machines.chain",
    "Disturbed": ".steering.disturbed",
    "Driven": ".steering.driven",
    "DrivenFamily": ".steering.driven_family",
    "HeavyHand": ".machines.heavy_hand",
    "Hopper": ".machines.hopper",
    "Juggler": ".machines.juggler",
    "chain_hand": ".machines.chain_hand",
    "explore": ".explorer.server",
    "hopper_in_si": ".machines.in_si",
    "inerter_hopper": ".machines.inerter",
    "juggler_in_si": ".machines.in_si",
    "knee_hopper": ".machines.knee",
    "plate_hopper": ".machines.plate",
    "rimless_wheel": ".machines.steps",
    "rocking_block": ".machines.steps",
    "runner": ".machines.runner",
    "shuttle": ".machines.steps",
}
_MODULES = {"gravity": ".laws.gravity", "springs": ".laws.springs", "steering": ".steering"}

__all__ = [*_HOMES, *_MODULES]


def __getattr__(name: str) -> Any:
    # The command line lives in this package and must answer --help before CasADi and NumPy are loaded.
    if name in _MODULES:
        return import_module(_MODULES[name], __name__)
    if name not in _HOMES:
        raise AttributeError(f"module 'problems' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name], __name__), name)
