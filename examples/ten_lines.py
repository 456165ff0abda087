"""Arrays in ten lines: measured relative rotations in, certified absolute rotations out."""

import numpy as np

import rotavg

# Four cameras on a turntable, 90 degrees apart, each pair of neighbours measured with some error.
edges = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 2)]
degrees_about_z = [91, 89.5, 90, 90.5, 179]
rotvecs = np.radians([[0, 0, angle] for angle in degrees_about_z])

graph = rotavg.MeasurementGraph.from_rotvecs(edges, rotvecs)  # R_ij = i_from_j
solution = rotavg.solve(graph)

for node, R in zip(graph.nodes, solution.rotations):  # world_from_node
    print(node, f"{np.degrees(np.arctan2(R[1, 0], R[0, 0])):7.2f} deg")
print(solution.certificate.verdict)
