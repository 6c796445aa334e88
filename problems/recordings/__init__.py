"""Records of test stands: their columns and rows, their cycles and branches, and the smooth curves through these."""

from typing import TYPE_CHECKING

from orbits.public_names import public_names

if TYPE_CHECKING:
    from .bench_record import BenchRecord, read_record
    from .channels import channels_of, observed
    from .chosen_branch import choose
    from .hop_fit import SAMPLE, fit
    from .hop_result import HopFit
    from .measured_rows import MeasuredRows
    from .smoothing import SMOOTHING, SmoothCurve, SmoothCurves, curve_of, with_drifts
    from .text_rows import text_of

__all__ = [*public_names(__name__)]
