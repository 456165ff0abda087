"""Pictures of graphs and solutions, by Matplotlib (the extra [plot]).

Every function draws into the axes `ax` and returns it; without one it makes a figure. Large graphs
are aggregated or thinned, and big collections rasterised, so that files stay small.
"""

from rotavg.plot.adjacency import adjacency
from rotavg.plot.convergence import convergence
from rotavg.plot.poses import orientations, trajectory
from rotavg.plot.residuals import residuals
from rotavg.plot.spectrum import spectrum

__all__ = ["adjacency", "convergence", "orientations", "residuals", "spectrum", "trajectory"]
