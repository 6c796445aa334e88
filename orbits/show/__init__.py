"""Results drawn: figures, animations and pages, above all that they show."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .animation import SPRING_END, animate_simulation, check_animation
    from .control_figures import finished_panels, mark_stages, panels_below
    from .pages.bokeh_figures import bokeh
    from .pages.family_view import FamilyData, FamilyFigure, family_data
    from .pages.hop_view import HopData, HopFigures, hop_data
    from .pages.law_view import LawData, LawFigure, law_data
    from .pages.map_view import MapData, MapFigure, map_data
    from .plot import (
        COLOURS,
        FIGURES,
        axes_or_new,
        legend_below,
        plot_family,
        plot_simulation,
        save_figure,
        spread,
        thumbnails,
        unit_labels,
    )
    from .simulators import check_folder

__all__ = [*public_names(__name__)]
