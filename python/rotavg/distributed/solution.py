"""What a distributed solve ends with."""

from __future__ import annotations

import io
import weakref
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.distributed.network import Network
from rotavg.distributed.part import Part
from rotavg.distributed.rounds import Round
from rotavg.io import atomic
from rotavg.solving.certificate import Certificate, Verdict
from rotavg.solving.printed_robust import proof_sentence


@dataclass(frozen=True)
class RobustFit:
    """What the robust loss has found out.

    Attributes:
        scale: of the loss, radians, of an edge with the median weight.
        noise: of the measurements, radians.
        threshold: edges with larger residuals are outliers: 3 times the noise
            (`rotavg.solve` goes up to 10 times where it has heavy tails).
        num_outliers: how many.
        settled: what share of all weight the last reweighting moved.
    """

    scale: float
    noise: float
    threshold: float
    num_outliers: int
    settled: float


@dataclass(frozen=True, eq=False)
class DistributedSolution:
    """Rotations, still where they were found, and what is known of them.

    In `with solve(...) as solution:` the processes that were started for it end with it.

    Attributes:
        objective: sum of w |R_i R_ij - R_j|^2.
        relative_gradient: max |g_i| / deg_i, radians.
        converged: whether that is below the tolerance.
        reason: why the rounds ended.
        certificate: how far the objective can be from the optimum; None if it was not asked for.
        robust: with a robust loss, what that has found out.
        rounds: what every round ended with.
        num_nodes, num_edges, num_parts: of the graph.
        network, rotations: the parts, and the rotations of their own nodes: futures of Dask's.
        processes: that were started for it.
    """

    objective: float
    relative_gradient: float
    converged: bool
    reason: str
    certificate: Certificate | None
    robust: RobustFit | None
    rounds: tuple[Round, ...]
    num_nodes: int
    num_edges: int
    num_parts: int
    network: Network = field(repr=False)
    rotations: list[Any] = field(repr=False)
    processes: ExitStack = field(repr=False, default_factory=ExitStack)

    def __post_init__(self) -> None:
        weakref.finalize(self, self.processes.close)

    def with_certificate(self, certificate: Certificate) -> DistributedSolution:
        """The same solution, certified; the processes go over to that."""
        return replace(self, certificate=certificate, processes=self.processes.pop_all())

    def close(self) -> None:
        """End the processes that were started for it, if any, and with them its rotations."""
        self.processes.close()

    def __enter__(self) -> DistributedSolution:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def solved(self) -> bool:
        """Whether it converged, and, where that was asked for, is certified."""
        certified = self.certificate is None or self.certificate.verdict != Verdict.NOT_CERTIFIED
        return self.converged and certified

    def by_part(self) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
        """Ids and rotations (k, 3, 3) world_from_node, part after part: one at a time is here."""
        for answer in self.network.each(_answer, self.rotations):
            yield answer.result()

    def gather(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """All ids, rising, and their rotations (n, 3, 3) world_from_node."""
        found = list(self.by_part())
        nodes = np.concatenate([ids for ids, _ in found])
        order = np.argsort(nodes)
        return nodes[order], np.concatenate([R for _, R in found])[order]

    def write(self, folder: Path | str) -> None:
        """One file part-NNNNN.npz for each part, with `nodes` and `rotations`, by the workers.

        Raises FileAccessError if that cannot be; each file is written whole or not touched.
        """
        atomic.make_folder(Path(folder))
        self.network.gather(self.network.each(_write, self.rotations, folder=str(folder)))

    @property
    def verdict_sentence(self) -> str | None:
        """What is proved, of which edges; None without a certificate.

        (Weak parts, and other answers that are possible, are not looked for across workers.)
        """
        if self.certificate is None:
            return None
        if self.robust is None:
            return self.certificate.sentence
        count = f"{self.robust.num_outliers} of {self.num_edges} edges rejected"
        return proof_sentence(self.certificate.sentence, [count])

    def __str__(self) -> str:
        lines = [
            f"objective       {self.objective:.12g}",
            f"gradient        {self.relative_gradient:.2g} rad, {self.reason}",
            f"graph           {self.num_nodes} nodes and {self.num_edges} edges, "
            f"in {self.num_parts} parts",
            f"rounds          {self.rounds[-1].number}",
        ]
        if self.robust is not None:
            lines.append(
                f"robust          {self.robust.num_outliers} outliers, of more than "
                f"{np.degrees(self.robust.threshold):.3g} deg"
            )
        if self.certificate is not None:
            lines.append(f"certificate     {self.verdict_sentence}")
        return "\n".join(lines)


class Interrupted(KeyboardInterrupt):
    """Ctrl-C after the rounds had ended, before the certificate was there.

    Attributes:
        solution: what had been reached; its certificate says that it is missing.
    """

    def __init__(self, solution: DistributedSolution) -> None:
        super().__init__("interrupted before the certificate was there")
        self.solution = solution


def _answer(part: Part, own: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    return part.nodes[: part.num_own], own


def _write(part: Part, own: NDArray[np.float64], folder: str) -> None:
    stream = io.BytesIO()
    np.savez(stream, nodes=part.nodes[: part.num_own], rotations=own)
    atomic.write_files({Path(folder) / f"part-{part.number:05d}.npz": stream.getvalue()})
