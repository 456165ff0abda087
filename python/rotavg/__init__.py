"""Rotation averaging with a proof of optimality.

A measurement graph of relative rotations goes in, absolute rotations with a certificate come out:

    graph = rotavg.read("torus3D.g2o")
    solution = rotavg.solve(graph)
    print(solution)
    rotavg.write("solved.g2o", solution)

Convention (pose family): R_i is world_from_i, R_ij is i_from_j, and R_i R_ij = R_j. Angles are
radians, quaternions xyzw.

    MeasurementGraph    the measurements; from arrays, SciPy, NetworkX, pandas
    read, write         files of many formats; read_rotations, write_edges, write_covariances
    read_priors         what they know beside the measurements: priors, rigs, gravity; read_rigs
    solve               the rotations: a Solution, with a Certificate
    certify             the certificate of rotations from elsewhere
    Online              the same while edges come and go
    Priors              what is known beforehand: fixed rotations, gravity, rigs
    simulate, compare   graphs with known truth, and errors
    hardness            how hard a graph is; cycle_evidence, which edges are suspicious;
                        suggest_reading and doubts, what may have been read the wrong way
    plot, report        pictures and pages (extras)
    images, colmap      from photographs, and on to a scene (extras)

Everything that is raised on purpose is a rotavg.Error. `help` of a name says more; pages about all
of it are in the folder docs of the sources, with a tutorial to begin with.
"""

import importlib
from typing import TYPE_CHECKING, Any

from rotavg._core import Progress, __version__
from rotavg.base.errors import (
    ArgumentTypeError,
    Error,
    FileAccessError,
    FormatError,
    GraphError,
    IncompleteWarning,
    MissingExtraError,
    OptionError,
    SolverError,
    UnknownNodeError,
)
from rotavg.graph.known_rotations import KnownRotations
from rotavg.graph.means import karcher_mean
from rotavg.graph.measurement_graph import MeasurementGraph
from rotavg.graph.nearest import nearest_rotation
from rotavg.graph.translations import RelativeTranslations
from rotavg.priors.priors import Priors, Rigs
from rotavg.priors.rigs import RigFit
from rotavg.solving.certificate import Certificate, ComponentCertificate, Shortfall, Verdict
from rotavg.solving.certify import certify
from rotavg.solving.cycle_evidence import CycleEvidence, cycle_evidence
from rotavg.solving.diagnosis import Diagnosis, Share, diagnose
from rotavg.solving.headings import solve_headings
from rotavg.solving.objective import gradient, objective
from rotavg.solving.online import Online
from rotavg.solving.online_solution import OnlineSolution
from rotavg.solving.robust import PriorFit, RobustFit
from rotavg.solving.solution import Interrupted, Solution
from rotavg.solving.solve import solve
from rotavg.solving.status import Status, Timings, Trace

if TYPE_CHECKING:
    from rotavg.evaluation.compare import Comparison, compare
    from rotavg.evaluation.doubts import doubts
    from rotavg.evaluation.hardness import Hardness, hardness
    from rotavg.evaluation.readings import SuggestedReading, suggest_reading
    from rotavg.io import (
        read,
        read_priors,
        read_rigs,
        read_rotations,
        write,
        write_covariances,
        write_diagnostics,
        write_edges,
    )
    from rotavg.priors.refined_gravity import refined_gravity
    from rotavg.simulation.simulate import Simulation, simulate
    from rotavg.solving.pose_refinement import PoseSolution, refine_poses
    from rotavg.solving.positions import positions
    from rotavg.solving.translation_fit import TranslationFit, translation_fit

# What not every program needs is imported at its first use: reading alone is half of the modules.
_AT_FIRST_USE = {
    "Comparison": "rotavg.evaluation.compare",
    "compare": "rotavg.evaluation.compare",
    "doubts": "rotavg.evaluation.doubts",
    "Hardness": "rotavg.evaluation.hardness",
    "hardness": "rotavg.evaluation.hardness",
    "SuggestedReading": "rotavg.evaluation.readings",
    "suggest_reading": "rotavg.evaluation.readings",
    "read": "rotavg.io",
    "read_priors": "rotavg.io",
    "read_rigs": "rotavg.io",
    "read_rotations": "rotavg.io",
    "write": "rotavg.io",
    "write_covariances": "rotavg.io",
    "write_diagnostics": "rotavg.io",
    "write_edges": "rotavg.io",
    "refined_gravity": "rotavg.priors.refined_gravity",
    "Simulation": "rotavg.simulation.simulate",
    "simulate": "rotavg.simulation.simulate",
    "PoseSolution": "rotavg.solving.pose_refinement",
    "refine_poses": "rotavg.solving.pose_refinement",
    "positions": "rotavg.solving.positions",
    "TranslationFit": "rotavg.solving.translation_fit",
    "translation_fit": "rotavg.solving.translation_fit",
}


# So are these modules, as rotavg.plot and so on; what they need beyond numpy are extras.
_MODULES = ("colmap", "distributed", "images", "io", "partners", "plot", "report", "reproduce")


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f"rotavg.{name}")
    if name not in _AT_FIRST_USE:
        raise AttributeError(f"module 'rotavg' has no attribute {name!r}")
    value = getattr(importlib.import_module(_AT_FIRST_USE[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted((*__all__, *_MODULES))


__all__ = [
    "ArgumentTypeError",
    "Certificate",
    "Comparison",
    "ComponentCertificate",
    "CycleEvidence",
    "Diagnosis",
    "Error",
    "FileAccessError",
    "FormatError",
    "GraphError",
    "Hardness",
    "IncompleteWarning",
    "Interrupted",
    "KnownRotations",
    "MeasurementGraph",
    "MissingExtraError",
    "Online",
    "OnlineSolution",
    "OptionError",
    "PoseSolution",
    "PriorFit",
    "Priors",
    "Progress",
    "RelativeTranslations",
    "RigFit",
    "Rigs",
    "RobustFit",
    "Share",
    "Shortfall",
    "Simulation",
    "Solution",
    "SolverError",
    "Status",
    "SuggestedReading",
    "Timings",
    "Trace",
    "TranslationFit",
    "UnknownNodeError",
    "Verdict",
    "__version__",
    "certify",
    "compare",
    "cycle_evidence",
    "diagnose",
    "doubts",
    "gradient",
    "hardness",
    "karcher_mean",
    "nearest_rotation",
    "objective",
    "positions",
    "read",
    "read_priors",
    "read_rigs",
    "read_rotations",
    "refine_poses",
    "refined_gravity",
    "simulate",
    "solve",
    "solve_headings",
    "suggest_reading",
    "translation_fit",
    "write",
    "write_covariances",
    "write_diagnostics",
    "write_edges",
]
