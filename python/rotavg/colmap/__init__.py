"""COLMAP as a partner: its databases in and out, and its mapper behind rotavg's rotations.

COLMAP's rotations are vision family (camera_from_world, qvec w x y z maps image 1 to image 2).
The mapper and new databases need pycolmap (extra [colmap]); a database's two-view geometries are
read and written without it.
"""

from rotavg.colmap.create import create_database
from rotavg.colmap.mapper import Model, Reconstruction, reconstruct
from rotavg.colmap.two_views import read_graph, write_rotations

__all__ = [
    "Model",
    "Reconstruction",
    "create_database",
    "read_graph",
    "reconstruct",
    "write_rotations",
]
