"""From a graph to its rotations: solving, certificates, robust losses, covariances, positions."""
