"""Fig. 4: reconstructions from photographs, with the rotations that rotavg found."""

from __future__ import annotations

import io
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.base.errors import require
from rotavg.colmap import create_database, reconstruct
from rotavg.colmap.draw import VIEWS, Scene, draw, read_scene
from rotavg.images.features import find_photographs
from rotavg.reproduce.experiment import Outcome
from rotavg.reproduce.photographs import errors_deg, experiment, find_references, measure_all


def run(
    folder: str | os.PathLike[str],
    *,
    references: str | os.PathLike[str] | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda text: None,
    **options: Any,
) -> Outcome:
    """Photographs to features to rotations to points; draws a photograph beside its scene.

    Args:
        folder: of photographs, or of folders of some: ET and kermit here, as the paper's other
            photographs are not public.
        references: folder of NAME_glomap_rotations.txt, to compare with.
        seed: of the robust estimation and of the mapper.
        progress: receives what is being done now.
        options: of `images.measure`.
    """
    require("matplotlib", "plot")
    rows, scenes = [], {}
    for name, path, measured in measure_all(folder, progress, seed=seed, **options):
        progress(f"{name}: reconstruction")
        with tempfile.TemporaryDirectory() as temporary:
            database, output = Path(temporary) / "images.db", Path(temporary) / "scene"
            create_database(database, measured)
            found = reconstruct(database, path, output, seed=seed, num_threads=1)
            scene = read_scene(found.models[0].path)
        truth = find_references(references, name)
        before = dict(zip(found.solution.graph.nodes.tolist(), found.solution.rotations))
        after = dict(zip(scene.names, scene.world_from_camera))
        scenes[name] = find_photographs(path)[0], scene
        rows.append({
            "name": name,
            "images": len(measured.photographs),
            "images_in_model": found.models[0].images,
            "points": found.models[0].points,
            "reprojection_error": found.models[0].reprojection_error,
            "dropped": found.dropped,
            "rotavg_error_deg": _median(errors_deg(before, truth)),
            "final_error_deg": _median(errors_deg(after, truth)),
        })  # fmt: skip
    return Outcome(_markdown(rows), {"seed": seed, "rows": rows}, _pictures(scenes))


def _median(errors: NDArray[np.float64]) -> float:
    return float(np.median(errors)) if len(errors) else float("nan")


def _markdown(rows: list[dict[str, Any]]) -> str:
    lines = [
        "| data set | images in the model | points | reprojection error [px] "
        "| rotavg's R_i off by (median) | after bundle adjustment |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        errors = [row["rotavg_error_deg"], row["final_error_deg"]]
        shown = [f"{error:.2f} deg" if np.isfinite(error) else "" for error in errors]
        lines.append(
            f"| {row['name']} | {row['images_in_model']} of {row['images']} | {row['points']} "
            f"| {row['reprojection_error']:.2f} | {shown[0]} | {shown[1]} |"
        )
    return "\n".join(lines) + "\n"


def _pictures(scenes: dict[str, tuple[Path, Scene]]) -> dict[str, bytes]:
    """A row for each data set: a photograph, the scene from behind the cameras, and from above."""
    figures = require("matplotlib.figure", "plot")
    pil = require("PIL.Image", "images")
    figure: Any = figures.Figure(figsize=(10, 3.4 * len(scenes)), layout="constrained")
    axes = figure.subplots(len(scenes), 1 + len(VIEWS), squeeze=False)
    for row, (name, (photograph, scene)) in zip(axes, scenes.items()):
        with pil.open(photograph) as image:
            row[0].imshow(np.asarray(image.convert("RGB")))
        row[0].set_axis_off()
        row[0].set_title(f"{name}: one of {len(scene.names)} photographs")
        for ax, (title, angles) in zip(row[1:], VIEWS.items()):
            draw(scene, ax, **angles)
            ax.set_title(f"{title} (red)" if "cameras" in title else title)
    saved = {}
    for suffix, metadata in (("png", {"Software": None}), ("pdf", {"CreationDate": None})):
        stream = io.BytesIO()
        figure.savefig(stream, format=suffix, dpi=200, metadata=metadata)
        saved[suffix] = stream.getvalue()
    return saved


EXPERIMENT = experiment("fig4", "Fig. 4: reconstructions from photographs", run)
