#pragma once

#include <cstddef>
#include <map>
#include <set>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/io/g2o.hpp>
#include <rotavg/poses/positions.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

namespace rotavg::io::detail {

/// Turns every component as a whole such that the vertices that the file fixes keep their
/// rotations, or else its first node does. (Of several, the mean of what each asks for decides, and
/// they keep theirs all the same.)
/// @returns those vertices, which keep their positions, too
inline std::vector<Vertex> in_gauge_of(const PoseFile& file, const Components& components,
                                       Rotations& R) {
  std::map<NodeId, const Vertex*> given;
  std::set<NodeId> fixed;
  for (const Vertex& vertex : file.vertices) given[vertex.node] = &vertex;
  for (const FixedRotation& vertex : file.fixed) fixed.insert(vertex.node);
  std::vector<Vertex> all;
  for (const auto& nodes : components.nodes) {
    const auto id = [&](Index k) { return file.nodes[static_cast<std::size_t>(k)]; };
    std::vector<Index> anchors;
    for (const Index k : nodes) {
      if (fixed.count(id(k)) > 0) anchors.push_back(k);
    }
    if (anchors.empty() && given.count(id(nodes.front())) > 0) anchors.push_back(nodes.front());
    if (anchors.empty()) continue;
    const auto at = [](Index k) { return static_cast<std::size_t>(k); };
    Matrix3 asked = Matrix3::Zero();
    for (const Index k : anchors) {
      add(asked, product_transposed(given[id(k)]->world_from_node, R[at(k)]));
    }
    const Matrix3 turn = nearest_rotation(asked);
    for (const Index k : nodes) R[at(k)] = product(turn, R[at(k)]);
    for (const Index k : anchors) {
      R[at(k)] = given[id(k)]->world_from_node;
      all.push_back(*given[id(k)]);
    }
  }
  return all;
}

/// Positions (n,) that fit rotations in the gauge of the file: rotavg::positions of its
/// translations, where the vertices that keep their poses are held.
/// @param shares (m,) of the edges' information; empty: all of it
/// @throws std::invalid_argument where they cannot be solved for
inline std::vector<Vector3> fitted_positions(const PoseFile& file, const Rotations& R,
                                             const std::vector<Vertex>& anchors,
                                             const std::vector<double>& shares) {
  std::vector<FixedPosition> fixed;
  for (const Vertex& vertex : anchors) fixed.push_back({vertex.node, vertex.position});
  std::vector<Matrix3> information = file.translation_information;
  if (!shares.empty()) {
    information.resize(file.translations.size(), Matrix3::Identity());
    for (std::size_t k = 0; k < information.size(); ++k) information[k] *= shares[k];
  }
  return positions(file.graph(), R, file.translations, information, fixed);
}

/// Positions (n,) moved as the rotations of their components were turned, and to where the vertices
/// are that keep their poses: by the mean of what each asks for.
/// @param before, after (n,) the rotations
inline std::vector<Vector3> moved_positions(const PoseFile& file, const Components& components,
                                            const Rotations& before, const Rotations& after,
                                            const std::vector<Vertex>& anchors,
                                            std::vector<Vector3> p) {
  std::map<NodeId, Vector3> known;
  for (const Vertex& vertex : anchors) known[vertex.node] = vertex.position;
  for (const auto& nodes : components.nodes) {
    Vector3 offset = Vector3::Zero();
    double count = 0.0;
    for (const Index i : nodes) {
      const auto k = static_cast<std::size_t>(i);
      p[k] = product(after[k], product(transposed(before[k]), p[k]));
      const auto held = known.find(file.nodes[k]);
      if (held == known.end()) continue;
      offset += held->second - p[k];
      count += 1.0;
    }
    if (count == 0.0) continue;
    for (const Index i : nodes) {
      const auto k = static_cast<std::size_t>(i);
      const auto held = known.find(file.nodes[k]);
      p[k] = held == known.end() ? Vector3(p[k] + offset / count) : held->second;
    }
  }
  return p;
}

}  // namespace rotavg::io::detail
