"""Springs and gravity by name, by formula and by measurement."""

from typing import TYPE_CHECKING

from orbits.public_names import public_names

if TYPE_CHECKING:
    from . import gravity, springs
    from .gravity import as_gravity
    from .springs import HYSTERETIC_KINDS, as_spring, formula, table_options

__all__ = [*public_names(__name__)]
