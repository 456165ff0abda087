"""What a robust loss found, for people."""

from __future__ import annotations

from collections import Counter

import numpy as np

from rotavg.solving.robust import RobustFit

_SHOWN = 3  # alternatives in print


def robust_rows(fit: RobustFit, num_parts_given: int) -> list[tuple[str, str]]:
    """Names and sentences for a printed report.

    Args:
        fit: what it has made of the edges.
        num_parts_given: how many parts there are if no edge is an outlier.
    """
    counts = Counter(fit.edge_verdicts.tolist())
    reasons = [
        (counts["robust_weight"] + counts["weak_part"], "by their residuals"),
        (counts["cycle_check"], "by the cycle check"),
        (counts["excluded"], "excluded"),
    ]
    total = sum(count for count, _ in reasons)
    scales = fit.edge_scales[np.isfinite(fit.edge_scales)]
    of_what = " at the median weight" if (scales != 1.0).any() else ""
    how = ", ".join(f"{count} {reason}" for count, reason in reasons if count)
    about = "about" if fit.noise_shows else "at least"
    rows = [
        (
            "loss",
            f"{fit.loss}, scale {np.degrees(fit.scale):.3g} deg, noise {about} "
            f"{np.degrees(fit.noise):.3g} deg{of_what}, robust objective "
            f"{fit.objective:.9g}",
        ),
        (
            "outliers",
            f"{total} of {len(fit.edge_verdicts)} edges, beyond "
            f"{np.degrees(min(fit.threshold, np.pi)):.3g} deg{of_what}"
            + (f": {how}" if counts["cycle_check"] or counts["excluded"] else ""),
        ),
    ]
    for what, of_kind in (("absolute", fit.absolute_priors), ("gravity", fit.gravity_priors)):
        if of_kind is not None:
            rows.append(
                (
                    what,
                    f"{int(of_kind.is_outlier.sum())} of {len(of_kind.nodes)} priors are outliers, "
                    f"beyond {np.degrees(min(of_kind.threshold, np.pi)):.3g} deg",
                )
            )
    if counts["trusted"]:
        rows.append(("trusted", f"{counts['trusted']} edges that the loss does not touch"))
    if fit.is_favoured.any():
        some = "edge" if fit.is_favoured.sum() == 1 else "edges"
        rows.append(
            (
                "odometry",
                f"{int(fit.is_favoured.sum())} {some} between consecutive numbers: giving up one "
                "costs as much as six others (trusted=[] for all alike)",
            )
        )
    if counts["bridge"]:
        some = "1 edge" if counts["bridge"] == 1 else f"{counts['bridge']} edges"
        rows.append(("bridges", f"{some} that no cycle checks"))
    weak = fit.num_parts - num_parts_given
    if weak > 0:
        edges = f" ({counts['weak_part']} edges)" if counts["weak_part"] else ""
        rows.append(
            (
                "weak parts",
                f"{weak} beside the main {'one' if num_parts_given == 1 else 'ones'}: held by "
                f"outliers alone{edges}",
            )
        )
    shown, more = fit.alternatives[:_SHOWN], fit.alternatives[_SHOWN:]
    rows += [("alternative", alternative.sentence) for alternative in shown]
    if more:
        rows += [("", f"{len(more)} more in `robust.alternatives` and --json")]
    return rows


def proof_sentence(sentence: str, doubts: list[str]) -> str:
    """What a certificate says (`sentence`) of a robust answer, and what is in doubt.

    A proof that is of all rotations is of the least squares; other sentences have an end already.
    """
    of_all = sentence.startswith("proved") and " of the " not in sentence
    kept = " of the least squares on the edges it kept; "
    return f"{sentence}{kept if of_all else '; on the edges it kept, '}{', '.join(doubts)}"


def rejected(fit: RobustFit) -> str:
    """How many edges it has rejected."""
    count = int((~np.isin(fit.edge_verdicts, ("inlier", "bridge", "trusted"))).sum())
    return f"{count} of {len(fit.edge_verdicts)} edges rejected"


def doubts_of(fit: RobustFit, num_parts_given: int, hanging: int) -> list[str]:
    """What speaks against an answer, in a few words each.

    Args:
        fit: what it has made of the edges.
        num_parts_given: how many parts there are if no edge is an outlier.
        hanging: how many groups of nodes nothing checks against the rest.
    """
    doubts = []
    if not fit.noise_shows:
        doubts.append("too few edges agree to tell noise from errors")
    if fit.num_strained > 0:
        edges = "1 kept edge" if fit.num_strained == 1 else f"{fit.num_strained} kept edges"
        doubts.append(f"{edges} far off once the priors are met")
    weak = fit.num_parts - num_parts_given
    if weak > 0:
        doubts.append(f"{weak} part{'s' * (weak > 1)} on rejected edges only")
    if hanging > 0:
        doubts.append(f"{hanging} group{'s' * (hanging > 1)} that nothing checks")
    if fit.alternatives:
        some = len(fit.alternatives)
        answers = "another answer is" if some == 1 else f"{some} other answers are"
        doubts.append(f"{answers} possible")
    return doubts
