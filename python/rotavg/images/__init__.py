"""From photographs to a measurement graph: features, matches, two-view geometry (extra [images]).

    measured = rotavg.images.measure("photographs")
    solution = rotavg.solve(measured.graph)
    solution["photo001.jpg"]

A layer on top of OpenCV (features, matching, robust estimation), Pillow (reading) and SciPy
(refinement), all imported when they are needed.
"""

from rotavg.images.features import Photograph
from rotavg.images.pipeline import Measurement, Pair, measure
from rotavg.images.two_view import NoGeometryError, TwoView

__all__ = ["Measurement", "NoGeometryError", "Pair", "Photograph", "TwoView", "measure"]
