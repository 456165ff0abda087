"""A solution as one JSON object: what `rotavg solve --json` prints."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

import rotavg
from rotavg.graph.conventions import quaternions_from_matrices
from rotavg.solving.kept import kept_degrees, median_high_largest
from rotavg.solving.printed import verdict_sentence
from rotavg.solving.trajectory import doubted_odometry, strained_trust
from rotavg.solving.uncertainty import rms_degrees

_MOST = 5  # of a kind in the diagnosis


def _robust(solution: rotavg.Solution) -> dict[str, Any] | None:
    r = solution.robust
    if r is None:
        return None
    return {
        "loss": r.loss,
        "scale_deg": math.degrees(r.scale),
        "noise_deg": math.degrees(r.noise),
        "noise_shows": r.noise_shows,
        "threshold_deg": math.degrees(r.threshold),
        "objective": r.objective,
        "outliers": int(solution.is_outlier.sum()),
        "verdicts": dict(Counter(r.edge_verdicts.tolist())),
        "unchecked": int(solution.is_unchecked.sum()),
        "hanging": [len(group) for group in solution.hanging_groups],
        "parts": r.num_parts,
        "favoured": int(r.is_favoured.sum()),
        "odometry_doubt": doubted_odometry(solution),
        "trust_doubt": strained_trust(solution),
        "weak_parts": r.num_parts - solution.num_parts_given,
        "strained": r.num_strained,
        "alternatives": [alternative.summary() for alternative in r.alternatives],
        "prior_outliers": {
            kind: fit.nodes[fit.is_outlier].tolist()
            for kind, fit in (("absolute", r.absolute_priors), ("gravity", r.gravity_priors))
            if fit is not None
        },
    }


def _residuals(solution: rotavg.Solution) -> dict[str, float]:
    """Of the edges that a robust loss has kept, and how many these are."""
    median, high, largest = median_high_largest(solution)
    edges = len(kept_degrees(solution))
    return {
        "edges": edges, "median_deg": median, "percentile_95_deg": high, "largest_deg": largest,
    }  # fmt: skip


def _uncertainty(solution: rotavg.Solution) -> dict[str, Any] | None:
    known = solution.known_covariances
    if known is None:
        return None
    rms = rms_degrees(known)
    return {
        "median_deg": float(np.median(rms)),
        "largest_deg": rms.max(),
        "beyond_half_a_turn": int((rms > 180.0).sum()),
    }


def _priors(solution: rotavg.Solution) -> dict[str, int] | None:
    if solution.grounded is None:
        return None
    priors = solution.grounded.priors
    return {
        "fixed": len(priors.fixed),
        "absolute": len(priors.absolute),
        "gravity": len(priors.gravity),
        "rigs": len(priors.rigs) if isinstance(priors.rigs, Mapping) else 0,
    }


def _rigs(solution: rotavg.Solution) -> dict[str, Any] | None:
    fit = solution.rigs
    if fit is None:
        return None
    quaternions = quaternions_from_matrices(fit.rotations)
    return {
        "frames": len(fit.frames),
        "sensors": [
            {
                "sensor": sensor,
                "origin": origin,
                "determined": bool(determined),
                "rig_from_sensor_xyzw": quaternion.tolist(),
            }
            for sensor, origin, determined, quaternion in zip(
                fit.sensors, fit.origin, fit.determined, quaternions
            )
        ],
        "alone": list(fit.alone),
        "lower_bound": fit.lower_bound,
        "joint_gap": fit.joint_gap,
        "relative_gradient": fit.relative_gradient,
        "sentence": fit.sentence,
    }


def _diagnosis(solution: rotavg.Solution) -> dict[str, Any]:
    """The nodes that cost most, and the edges that contradict most; five each."""
    diagnosis = rotavg.diagnose(solution)
    costly = sorted(diagnosis.nodes.items(), key=lambda item: -item[1].cost)[:_MOST]
    angles, edges = solution.residual_angles, solution.graph.edges
    return {
        "nodes": [
            {"node": node, "share": s.share, "edges": s.edges, "outliers": s.outliers}
            for node, s in costly
        ],
        "contradictions": len(diagnosis.contradictions()),
        "edges": [
            {"edge": edges[k].tolist(), "residual_deg": math.degrees(angles[k])}
            for k in diagnosis.contradictions(_MOST)
        ],
    }


def _poses(poses: rotavg.PoseSolution | None) -> dict[str, Any] | None:
    if poses is None:
        return None
    return {
        "chi2": poses.chi2,
        "chi2_start": poses.chi2_start,
        "status": poses.status.name.lower(),
        "iterations": poses.iterations,
        "loss": poses.loss,
        "loss_scale": poses.loss_scale if math.isfinite(poses.loss_scale) else None,
        "outliers": int(poses.is_outlier.sum()),
    }


def summary(
    solution: rotavg.Solution,
    read: float,
    total: float,
    poses: rotavg.PoseSolution | None = None,
    fit: rotavg.TranslationFit | None = None,
) -> dict[str, Any]:
    """What `print(solution)` tells, but for advice, and more digits of it.

    Args:
        solution: what came out.
        read: seconds that reading took.
        total: seconds of everything.
        poses: what it was refined to.
        fit: how well positions fit the translations.
    """
    c = solution.certificate
    return {
        "nodes": solution.graph.num_nodes,
        "edges": solution.graph.num_edges,
        "components": solution.num_components,
        "component_sizes": np.sort(np.bincount(solution.component))[::-1].tolist(),
        "method": solution.method,
        "reason": solution.reason,
        "init": solution.init,
        "status": solution.status.name.lower(),
        "solved": solution.solved,
        "anisotropic": solution.anisotropic or None,
        "objective": solution.objective,
        "gradient_norm": solution.gradient_norm,
        "relative_gradient": solution.relative_gradient,
        "iterations": solution.iterations,
        "certificate": None
        if c is None
        else {
            "verdict": c.verdict.value,
            "lambda_min": c.lambda_min,
            "gap": c.gap,
            "relative_gap": c.relative_gap,
            "method": c.method,
            "failure_probability": c.failure_probability,
            "shortfall": c.shortfall.value,
            "tolerance": c.tolerance,
            "sentence": verdict_sentence(solution, c),
        },
        "residuals": _residuals(solution),
        "robust": _robust(solution),
        "priors": _priors(solution),
        "rigs": _rigs(solution),
        "diagnosis": _diagnosis(solution),
        "uncertainty": _uncertainty(solution),
        "poses": _poses(poses),
        "translations": None if fit is None else fit.summary(),
        "notes": list(solution.graph.notes),
        "seconds": {
            "read": read,
            "init": solution.timings.init,
            "solve": solution.timings.solve,
            "certify": solution.timings.certify,
            "total": total,
        },
    }
