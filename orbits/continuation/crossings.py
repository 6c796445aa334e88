"""Where multipliers of the map of launches cross the unit circle along a curve of orbits: events on request."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from ..simulation.lossless_hops import CROSSINGS, is_crossing
from .curve import Curve, CurvePoint, CurvePoints, Watch
from .events import Segment


class CrossingSegment(Segment):
    """The curve between two neighbouring points, with the crossings of the unit circle among its events."""

    of_curve: Curve

    def _sign_changes(self, watch: Watch) -> Iterator[tuple[str, float, CurvePoint]]:
        yield from super()._sign_changes(watch)
        for kind in CROSSINGS:
            if (share := self.zero(partial(self._crossing, kind))) is not None:
                point = self(share)
                if is_crossing(kind, self.curve.others(CurvePoints.of([point]))[0]):
                    yield kind, share, point

    def _crossing(self, kind: str, point: CurvePoint) -> float:
        return float(CROSSINGS[kind](self.curve.others(CurvePoints.of([point])))[0])

    @classmethod
    def _test_signs(cls, points: CurvePoints) -> np.ndarray:
        others = cls.of_curve.others(points)
        crossings = [test(others) >= 0 for test in CROSSINGS.values()]
        return np.column_stack([super()._test_signs(points), *crossings])


def with_crossings(segments: type[Segment], curve: Curve) -> type[Segment]:
    """A kind of segments of a curve, with the crossings of the unit circle among their events."""
    return type("Crossing", (CrossingSegment,), {"tests": segments.tests, "of_curve": curve})
