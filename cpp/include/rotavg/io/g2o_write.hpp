#pragma once

#include <algorithm>
#include <cstddef>
#include <map>
#include <set>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/io/g2o.hpp>
#include <rotavg/io/g2o_dialect.hpp>
#include <rotavg/io/graph_file.hpp>
#include <rotavg/io/vertex_poses.hpp>
#include <rotavg/types.hpp>

namespace rotavg::io {

namespace detail {

/// Appends numbers with blanks before them, zeros as 0.
inline void append_short(std::string& text, const std::vector<double>& numbers) {
  for (const double number : numbers) {
    text += ' ';
    if (number == 0.0) {
      text += '0';
    } else {
      append_number(text, number);
    }
  }
}

inline std::string vertex_line(const G2oDialect& dialect, NodeId node, const Vector3& position,
                               const Matrix3& R) {
  std::vector<double> pose(position.data(), position.data() + dialect.dimension);
  dialect.write(R, pose);
  std::string line = std::string(dialect.vertex) + " " + std::to_string(node);
  append_short(line, pose);
  return line;
}

}  // namespace detail

/// A graph as g2o, in space: with R a vertex for every node, without one for those that no edge
/// tells of. A weight w is the information 2 w I about the rotation; translations are zero.
/// @param R (n,) or none
/// @param positions (n,) or none: all zero
/// @throws std::invalid_argument for another number of either
inline std::string to_g2o(const MeasurementGraph& graph, const Rotations& R = {},
                          const std::vector<Vector3>& positions = {}) {
  const detail::G2oDialect& dialect = detail::g2o_dialects[0];
  const auto n = static_cast<std::size_t>(graph.num_nodes());
  if ((!R.empty() && R.size() != n) || (!positions.empty() && positions.size() != n)) {
    throw std::invalid_argument("expected a rotation, and if any a position, for every node");
  }
  std::string text;
  for (std::size_t k = 0; k < n; ++k) {
    if (R.empty() && !graph.row(static_cast<Index>(k)).empty()) continue;
    text += detail::vertex_line(dialect, graph.nodes()[k],
                                positions.empty() ? Vector3::Zero().eval() : positions[k],
                                R.empty() ? Matrix3::Identity().eval() : R[k]);
    text += '\n';
  }
  for (const Edge& e : graph.edges()) {
    const Vector4 q = detail::written_quaternion(e.quaternion);
    std::vector<double> numbers{0.0, 0.0, 0.0, q(0), q(1), q(2), q(3)};
    for (int r = 0; r < 6; ++r) {
      for (int c = r; c < 6; ++c) numbers.push_back(r != c ? 0.0 : r < 3 ? 1.0 : 2.0 * e.weight);
    }
    const auto id = [&](Index k) {
      return ' ' + std::to_string(graph.nodes()[static_cast<std::size_t>(k)]);
    };
    text += std::string(dialect.edge) + id(e.i) + id(e.j);
    detail::append_short(text, numbers);
    text += '\n';
  }
  return text;
}

namespace detail {

/// The file with other poses; to_g2o.
/// @param positions (n,) or none: then vertices keep theirs
inline std::string put_back(const PoseFile& file, const Rotations& R,
                            const std::vector<Vector3>& positions) {
  const std::size_t n = file.nodes.size();
  const G2oDialect& dialect = g2o_dialects[file.dimension == 3 ? 0 : 1];
  std::map<NodeId, std::size_t> row;
  for (std::size_t k = 0; k < n; ++k) row[file.nodes[k]] = k;
  std::set<NodeId> fixed;
  for (const FixedRotation& vertex : file.fixed) fixed.insert(vertex.node);

  auto missing = row;
  std::string text, ending;
  std::size_t first_edge = 0;
  const std::string_view content = file.text;
  for (std::size_t at = 0, stop = 0; at < content.size(); at = stop) {
    const std::size_t end = std::min(content.find_first_of("\r\n", at), content.size());
    stop = std::min(end + (content.substr(end, 2) == "\r\n" ? 2 : 1), content.size());
    const std::string_view line = content.substr(at, stop - at);
    const auto words = words_of(line.substr(0, line.find('#')));
    if (ending.empty() && !words.empty() && words[0] == dialect.edge) {
      first_edge = text.size();
      ending = end < stop ? content.substr(end, stop - end) : "\n";
    }
    NodeId node = 0;
    if (!words.empty() && words[0] == dialect.vertex) {
      node = std::stoll(std::string(words[1]));
      missing.erase(node);
    }
    if (words.empty() || words[0] != dialect.vertex || fixed.count(node) > 0) {
      text += line;
      continue;
    }
    // What stays, the numbers that change, and what stands behind them.
    const std::size_t k = row.at(node);
    std::vector<double> pose;
    if (!positions.empty()) {
      pose.assign(positions[k].data(), positions[k].data() + dialect.dimension);
    }
    dialect.write(R[k], pose);
    const std::string_view kept = words[positions.empty() ? 1 + dialect.dimension : 1];
    const auto place_behind = [&](std::string_view word) {
      return static_cast<std::size_t>(word.data() + word.size() - line.data());
    };
    text += line.substr(0, place_behind(kept));
    append_short(text, pose);
    text += line.substr(place_behind(words.back()));
  }
  std::string added;
  for (const auto& [node, k] : missing) {
    const Vector3 position = positions.empty() ? Vector3::Zero().eval() : positions[k];
    added += vertex_line(dialect, node, position, R[k]) + ending;
  }
  return text.insert(first_edge, added);
}

inline void require_one_pose_each(const PoseFile& file, std::size_t rotations,
                                  std::size_t positions) {
  const std::size_t n = file.nodes.size();
  if (rotations == n && positions == n) return;
  throw std::invalid_argument("expected a rotation, and if any a position, for every node");
}

}  // namespace detail

/// Which positions vertices get.
enum class VertexPositions {
  fitted,  ///< those that fit the new rotations best (rotavg::positions)
  kept,    ///< those that they have, which will not fit the new rotations
};

/// A solution as the file that its graph came from, with new poses: a vertex gets its rotation, in
/// the gauge of the file (detail::in_gauge_of), and the position that fits it; one that the file
/// fixes keeps its pose. Nodes without a vertex get one. Every other byte stays. Where the file has
/// no translations to fit positions to, vertices keep theirs.
/// @param R (n,) in the order of the nodes
/// @param components those of the solution
/// @param edge_shares (m,) what a robust loss has left of the edges, which then counts for
///        positions, too: RobustSolution::edge_weights over the given weights; empty: all of them
/// @throws std::invalid_argument for another number of rotations or shares, and where positions
///         cannot be solved for
inline std::string to_g2o(const PoseFile& file, Rotations R, const Components& components,
                          VertexPositions which = VertexPositions::fitted,
                          const std::vector<double>& edge_shares = {}) {
  detail::require_one_pose_each(file, R.size(), R.size());
  const std::vector<Vertex> anchors = detail::in_gauge_of(file, components, R);
  if (which == VertexPositions::kept || file.translations.empty()) {
    return detail::put_back(file, R, {});
  }
  if (!edge_shares.empty() && edge_shares.size() != file.translations.size()) {
    throw std::invalid_argument("expected a share for every edge, or none");
  }
  return detail::put_back(file, R, detail::fitted_positions(file, R, anchors, edge_shares));
}

/// The same with positions (n,) of your own, in the world of R: they are turned and moved with it
/// into the gauge of the file.
/// @throws std::invalid_argument for another number of rotations or positions
inline std::string to_g2o(const PoseFile& file, const Rotations& R, const Components& components,
                          const std::vector<Vector3>& positions) {
  detail::require_one_pose_each(file, R.size(), positions.size());
  Rotations turned = R;
  const std::vector<Vertex> anchors = detail::in_gauge_of(file, components, turned);
  return detail::put_back(file, turned,
                          detail::moved_positions(file, components, R, turned, anchors, positions));
}

}  // namespace rotavg::io
