"""The page to play with: a machine, its lossless hop, the family and the return map around it, live in the browser."""

from typing import TYPE_CHECKING

from orbits.public_names import public_names

if TYPE_CHECKING:
    from .forms import scene_of_statement
    from .processes import prepare
    from .scene import Scene, beginning
    from .server import explore, run

__all__ = [*public_names(__name__)]
