"""COLMAP as a partner: its pose graphs, its databases, and its mapper behind rotavg's rotations.

COLMAP is in the vision family (camera_from_world, qvec w x y z maps image 1 to image 2); graphs and
solutions here are in the pose family, as everywhere. What needs pycolmap (extra [colmap]) says so.
"""

from rotavg.colmap.averaging import run_rotation_averaging
from rotavg.colmap.create import create_database
from rotavg.colmap.gravity import run_gravity_refinement
from rotavg.colmap.mapper import Model, Reconstruction, reconstruct
from rotavg.colmap.pose_graph import from_pose_graph, to_pose_graph
from rotavg.colmap.two_views import write_rotations

__all__ = [
    "Model",
    "Reconstruction",
    "create_database",
    "from_pose_graph",
    "reconstruct",
    "run_gravity_refinement",
    "run_rotation_averaging",
    "to_pose_graph",
    "write_rotations",
]
