"""All solvers that are compared. Their adapters are imported only in the process that runs them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

from rotavg.solving.solve import Method


@dataclass(frozen=True)
class Solver:
    """A solver by name, and where its adapter is.

    Attributes:
        name: as in the tables.
        adapter: "module:Class" of its `Adapter`.
        variant: handed to the adapter.
        about: what it is and how it is used here.
        robust: it minimises a robust cost, so that its objective cannot be the least.
    """

    name: str
    adapter: str
    variant: str = ""
    about: str = ""
    robust: bool = False


_ROTAVG = "benchmarks.peers.rotavg_methods:Rotavg"
_SHONAN = "benchmarks.peers.gtsam_shonan:Shonan"
_STAIRCASE = "benchmarks.peers.gtsam_staircase:Staircase"
_FAST_SYNC = "benchmarks.peers.gtsam_fast_sync:FastSync"
_PAPER = "benchmarks.peers.numpy_paper:"

SOLVERS = (
    Solver("rotavg", _ROTAVG, "certified", "rotavg.solve as it comes, with the certificate"),
    *(
        Solver(f"rotavg-{method}", _ROTAVG, method, f'method="{method}", without a certificate')
        for method in get_args(Method)
    ),
    Solver("gtsam-shonan", _SHONAN, "random", "ShonanAveraging3 as it comes: a random start"),
    Solver("gtsam-shonan-tree", _SHONAN, "tree", "ShonanAveraging3 from the shortest paths"),
    Solver(
        "gtsam-staircase",
        _STAIRCASE,
        about="RiemannianStaircaseOptimizer of GTSAM 4.3, from the shortest paths",
    ),
    Solver("gtsam-fastsync", _FAST_SYNC, "", "fastSyncRot3, a linear method"),
    Solver(
        "gtsam-fastsync-lm",
        _FAST_SYNC,
        "lm",
        "fastSyncRot3, then Levenberg-Marquardt on FrobeniusBetweenFactorRot3",
    ),
    Solver(
        "pytheia",
        "benchmarks.peers.theia:Theia",
        about="RobustRotationEstimator (L1, then reweighted least squares), from the shortest "
        "paths; unit weights",
        robust=True,
    ),
    Solver(
        "pycolmap",
        "benchmarks.peers.colmap:Colmap",
        about="run_rotation_averaging (L1, then Geman-McClure), from its own tree; unit weights",
        robust=True,
    ),
    Solver("numpy-bcd", _PAPER + "Bcd", about="Algorithm 2 of the paper in NumPy"),
    Solver("numpy-sum", _PAPER + "Sum", "min_eigenvalue", "Algorithm 3 of the paper in NumPy"),
    Solver(
        "numpy-gpm", _PAPER + "Sum", "zero", "Algorithm 3 with mu = 0: generalised power method"
    ),
    Solver(
        "scipy-lbfgs",
        "benchmarks.peers.scipy_lbfgs:Lbfgs",
        about="scipy.optimize L-BFGS-B over rotation vectors, analytic gradient",
    ),
    Solver(
        "pymanopt",
        "benchmarks.peers.pymanopt_rtr:TrustRegions",
        about="Riemannian trust regions on SO(3)^n, analytic derivatives",
    ),
)
