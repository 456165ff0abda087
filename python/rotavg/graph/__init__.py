"""The measurement graph: ids, conventions, rotations, covariances and translations of its edges."""
