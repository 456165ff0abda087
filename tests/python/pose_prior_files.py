"""Files of pose graphs with priors, for tests."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotavg.graph.conventions import matrices_from_rotvecs, quaternions_from_matrices

Floats = NDArray[np.float64]
I3 = np.eye(3)
IDENTITY = "PARAMS_SE3OFFSET 0 0 0 0 0 0 0 1"


def numbers(values: Any) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(values))


def upper(matrix: Floats) -> str:
    return numbers(matrix[np.triu_indices(len(matrix))])


def turn(*rotvec: float) -> Floats:
    return matrices_from_rotvecs(np.array([rotvec]))[0]


def pose(R: Floats, p: Any) -> str:
    return f"{numbers(p)} {numbers(quaternions_from_matrices(R[None])[0])}"


class Scene:
    """A pose graph in the world of its priors: poses, exact or noisy edges, and information."""

    def __init__(self, seed: int, n: int = 8, noise: float = 0.0, parts: int = 1) -> None:
        rng = np.random.default_rng(seed)
        self.rng, self.n = rng, n
        self.R = matrices_from_rotvecs(rng.normal(size=(n * parts, 3)))
        self.p = rng.normal(scale=5.0, size=(n * parts, 3))
        steps = [(i, (i + d) % n) for i in range(n) for d in (1, 2)]
        self.edges = [(i + k * n, j + k * n) for k in range(parts) for i, j in steps]
        self.Z = [
            (
                self.R[i].T @ self.R[j] @ turn(*rng.normal(scale=noise, size=3)),
                self.R[i].T @ (self.p[j] - self.p[i]) + rng.normal(scale=noise, size=3),
            )
            for i, j in self.edges
        ]
        self.omega = [self.information(100.0) for _ in self.edges]

    def information(self, size: float) -> Floats:
        """(6, 6), translation first, of rotations that are as certain about all axes."""
        A = self.rng.normal(size=(3, 3))
        result = np.zeros((6, 6))
        result[:3, :3] = size * (A @ A.T + I3)
        result[3:, 3:] = size * self.rng.uniform(1, 3) * I3
        return result

    def g2o(self, path: Path, *priors: str, vertices: bool = True) -> Path:
        far = turn(1.0, 2.0, 0.5)  # the file's poses are in another world
        lines = [
            f"VERTEX_SE3:QUAT {i} {pose(far @ R, far @ p + 7)}"
            for i, (R, p) in enumerate(zip(self.R, self.p))
        ]
        lines = lines if vertices else []
        lines += [
            f"EDGE_SE3:QUAT {i} {j} {pose(*Z)} {upper(omega)}"
            for (i, j), Z, omega in zip(self.edges, self.Z, self.omega)
        ]
        path.write_text("\n".join([*lines, *priors]) + "\n")
        return path

    def pyfg(self, path: Path, *priors: str) -> Path:
        lines = [
            f"EDGE_SE3:QUAT 0.0 A{i} A{j} {pose(*Z)} {upper(np.linalg.inv(omega))}"
            for (i, j), Z, omega in zip(self.edges, self.Z, self.omega)
        ]
        path.write_text("\n".join([*lines, *priors]) + "\n")
        return path

    def jrl(self, path: Path, *priors: dict[str, Any]) -> Path:
        factors: list[dict[str, Any]] = [
            {
                "type": "BetweenFactorPose3",
                "key1": i,
                "key2": j,
                "measurement": value(*Z),
                "covariance": rotation_first(np.linalg.inv(omega)),
            }
            for (i, j), Z, omega in zip(self.edges, self.Z, self.omega)
        ]
        log = [{"stamp": 0, "measurements": [*factors, *priors]}]
        path.write_text(json.dumps({"name": "x", "robots": ["a"], "measurements": {"a": log}}))
        return path


def value(R: Floats, p: Any) -> dict[str, Any]:
    x, y, z, w = quaternions_from_matrices(R[None])[0].tolist()
    return {"type": "Pose3", "translation": np.ravel(p).tolist(), "rotation": [w, x, y, z]}


def rotation_first(matrix: Floats) -> list[float]:
    order = [3, 4, 5, 0, 1, 2]
    return matrix[np.ix_(order, order)].ravel().tolist()  # type: ignore[no-any-return]


def prior_factor(node: int, R: Floats, p: Any, covariance: Floats) -> dict[str, Any]:
    return {
        "type": "PriorFactorPose3",
        "key": node,
        "prior": value(R, p),
        "covariance": rotation_first(covariance),
    }


def g2o_prior(node: int, R: Floats, p: Any, omega: Floats, parameter: int = 0) -> str:
    return f"EDGE_SE3_PRIOR {node} {parameter} {pose(R, p)} {upper(omega)}"


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rotavg", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def angle(A: Floats, B: Floats) -> float:
    return float(np.linalg.norm(A - B))
