"""Rotation averaging with a proof of optimality.

A measurement graph of relative rotations goes in, absolute rotations with a certificate come out:

    graph = rotavg.read("torus3D.g2o")
    solution = rotavg.solve(graph)
    print(solution)
    rotavg.write("solved.g2o", solution)

Convention (pose family): R_i is world_from_i, R_ij is i_from_j, and R_i R_ij = R_j.
"""

from rotavg._core import Progress, __version__
from rotavg.certificate import Certificate, ComponentCertificate, Verdict
from rotavg.compare import Comparison, compare
from rotavg.errors import (
    Error,
    FileAccessError,
    FormatError,
    GraphError,
    IncompleteWarning,
    MissingExtraError,
    OptionError,
    SolverError,
)
from rotavg.graph import MeasurementGraph
from rotavg.hardness import Hardness, hardness
from rotavg.io import read, read_rotations, write, write_covariances, write_edges
from rotavg.known import KnownRotations
from rotavg.positions import positions
from rotavg.priors import Priors
from rotavg.robust import CycleEvidence, RobustFit, cycle_evidence
from rotavg.simulate import Simulation, simulate
from rotavg.solution import Solution, Status, Timings, Trace
from rotavg.solve import certify, gradient, objective, solve
from rotavg.translations import RelativeTranslations

__all__ = [
    "Certificate",
    "Comparison",
    "ComponentCertificate",
    "CycleEvidence",
    "Error",
    "FileAccessError",
    "FormatError",
    "GraphError",
    "Hardness",
    "IncompleteWarning",
    "KnownRotations",
    "MeasurementGraph",
    "MissingExtraError",
    "OptionError",
    "Priors",
    "Progress",
    "RelativeTranslations",
    "RobustFit",
    "Simulation",
    "Solution",
    "SolverError",
    "Status",
    "Timings",
    "Trace",
    "Verdict",
    "__version__",
    "certify",
    "compare",
    "cycle_evidence",
    "gradient",
    "hardness",
    "objective",
    "positions",
    "read",
    "read_rotations",
    "simulate",
    "solve",
    "write",
    "write_covariances",
    "write_edges",
]
