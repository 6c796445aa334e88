"""Results drawn: figures, animations and pages, above all that they show."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .animation import SPRING_END, animate_simulation, check_animation
    from .canvas import FIGURES, axes_or_new, colour_bar, headline, legend_below, new_axes, new_row, save_figure
    from .control_figures import finished_panels, mark_stages, panels_below
    from .pages.bokeh_figures import bokeh
    from .pages.family_view import FamilyData, FamilyFigure, family_data
    from .pages.hop_view import HopData, HopFigures, hop_data
    from .pages.law_view import LawData, LawFigure, law_data
    from .pages.map_view import MapData, MapFigure, map_data
    from .pages.saved_page import THEME
    from .plot import plot_family, plot_orbit, plot_simulation, spread, thumbnails
    from .simulators import check_folder
    from .style import COLOURS, SHADE, STYLE, label_of, small_type, unit_labels

__all__ = [*public_names(__name__)]
