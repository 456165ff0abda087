"""COLMAP and pycolmap as partners: their pose graphs, databases and rotation averaging.

COLMAP is in the vision family (camera_from_world); graphs and solutions here are in the pose
family, as everywhere.
"""

from rotavg.colmap.averaging import run_rotation_averaging
from rotavg.colmap.pose_graph import from_pose_graph, to_pose_graph

__all__ = ["from_pose_graph", "run_rotation_averaging", "to_pose_graph"]
