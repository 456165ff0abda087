#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/io/graph_file.hpp>
#include <rotavg/io/node_table.hpp>
#include <rotavg/io/table.hpp>
#include <rotavg/linalg/symmetric_eigen.hpp>
#include <rotavg/types.hpp>

namespace rotavg::io {

// Text and CSV, one edge a line; pose family if not told otherwise.
//
//     i j qx qy qz qw [weight] [cxx cxy cxz cyy cyz czz]
//
// Ids are integers if all are, names otherwise ("007" is a name). Other columns and rotations:
// columns.hpp.

namespace detail {

/// Puts the edges of a table together.
class EdgeTableReader {
 public:
  EdgeTableReader(const Source& source, const ReadOptions& options)
      : source_(source), options_(options) {}

  GraphFile read(const std::vector<Row>& rows) {
    const Strings header{"i", "j", "qx", "qy", "qz", "qw", "weight"};
    const TableReader reader(source_, {{header.begin(), header.end() - 1}, header}, 2);
    const Table table = reader.read(rows, options_.columns);
    const Layout& layout = table.layout;
    const std::size_t size = layout.numbers().size();
    const std::vector<NodeId> ids = ids_of(source_, table, file_.ids);

    RotationNumbers rotations(source_, layout);
    EdgeList list(source_, options_);
    for (std::size_t k = 0; k < table.lines.size(); ++k) {
      const double* const numbers = table.numbers.data() + k * size;
      RelativeQuaternion m{ids[2 * k], ids[2 * k + 1], {}, 1.0};
      m.i_from_j = rotations.read(table.lines[k], numbers);
      if (options_.vision) m.i_from_j = m.i_from_j.conjugate();
      Matrix3 precision = Matrix3::Identity();
      if (!layout.covariance.empty() && !options_.unit_weights) {
        const Matrix3 C = covariance(table.lines[k], k, numbers + layout.rotation.size());
        m.weight = 3.0 / (C(0, 0) + C(1, 1) + C(2, 2));
        precision = inverse_symmetric(C);
      }
      if (layout.weight && !options_.unit_weights) m.weight = numbers[size - 1];
      file_.nodes.insert(file_.nodes.end(), {m.i, m.j});
      if (!list.add(table.lines[k], m, file_)) continue;
      if (layout.covariance.empty() || options_.unit_weights) continue;
      // R_ji exp([e]) is the transpose of exp([-e]) R_ij = R_ij exp([-R_ij^T e]).
      const Matrix3 R = m.i_from_j.normalized().toRotationMatrix();
      file_.precisions.push_back(options_.vision ? transposed_product(R, product(precision, R))
                                                 : precision);
    }
    rotations.tell(file_.notes);
    const std::string unread = layout.unread();
    if (!unread.empty()) file_.notes.push_back("columns not read: " + unread);
    list.finish(file_);
    return std::move(file_);
  }

 private:
  Matrix3 covariance(std::size_t line, std::size_t edge, const double* upper) const {
    Matrix3 C;
    C << upper[0], upper[1], upper[2], upper[1], upper[3], upper[4], upper[2], upper[4], upper[5];
    if (!is_positive_definite(C)) {
      const Vector3 values = symmetric_eigen(C).values;
      std::ostringstream found;
      found.precision(3);
      found << "edge " << edge << ": the covariance is not positive definite: its eigenvalues are "
            << values(0) << " to " << values(2)
            << ", expected the least above 1e-13 of the largest "
            << "entry";
      source_.refuse(line, found.str());
    }
    return C;
  }

  const Source& source_;
  const ReadOptions& options_;
  GraphFile file_;
};

}  // namespace detail

/// Reads edges from lines of text.
/// @throws FormatError if the file cannot be read or holds something else
inline GraphFile read_text(const Source& source, const ReadOptions& options = {}) {
  return detail::EdgeTableReader(source, options).read(detail::text_rows(source));
}

/// Reads edges from CSV, where names may stand in quotes.
/// @throws FormatError if the file cannot be read or holds something else
inline GraphFile read_csv(const Source& source, const ReadOptions& options = {}) {
  return detail::EdgeTableReader(source, options).read(detail::csv_rows(source));
}

/// Reads a solution, or another table of rotations world_from_node, `id qx qy qz qw`.
/// @throws FormatError if the file cannot be read or holds something else
inline NodeTable<FixedRotation> read_text_rotations(const Source& source,
                                                    const ReadOptions& options = {}) {
  return detail::read_rotation_rows(source, detail::text_rows(source), options);
}
inline NodeTable<FixedRotation> read_csv_rotations(const Source& source,
                                                   const ReadOptions& options = {}) {
  return detail::read_rotation_rows(source, detail::csv_rows(source), options);
}

namespace detail {

/// How tables are written.
struct TableStyle {
  char separator;
  /// A name as it can stand in a row.
  /// @throws std::invalid_argument for one that would not come back as it is
  std::string spelt(const std::string& name) const {
    const bool plain = !name.empty() && name.find_first_of(" \t\r\n\v\f,;#") == name.npos;
    if (separator == ' ') {
      if (plain) return name;
      throw std::invalid_argument(
          "found a node of the name '" + name +
          "', expected no blank, comma, semicolon or # in it (CSV holds any "
          "name)");
    }
    if (name.empty() || name.find_first_of("\r\n\v\f") != name.npos) {
      throw std::invalid_argument("found a node of the name '" + name +
                                  "', expected one line of text");
    }
    if (plain && name.find('"') == name.npos) return name;
    std::string quoted_name = "\"";
    for (const char c : name) quoted_name += c == '"' ? std::string("\"\"") : std::string(1, c);
    return quoted_name + '"';
  }
  std::string header(const char* title, Strings words) const {
    std::string line;
    for (const std::string& word : words)
      line += (line.empty() ? "" : std::string(1, separator)) + word;
    if (separator == ',') return line + "\n";
    return std::string("# rotavg ") + title +
           ", pose family: R_i R_ij = R_j, R_i = world_from_i, R_ij = i_from_j; quaternions xyzw\n"
           "# " +
           line + "\n";
  }
  void append(std::string& text, const Vector4& q) const {
    for (int k = 0; k < 4; ++k) append_number(text += separator, q(k));
  }
};

inline std::string edge_table(const MeasurementGraph& graph, const NodeIds& ids, TableStyle style) {
  std::string text =
      style.header("measurement graph", {"i", "j", "qx", "qy", "qz", "qw", "weight"});
  Strings names;
  for (const NodeId node : graph.nodes()) names.push_back(style.spelt(ids.name(node)));
  for (const Edge& e : graph.edges()) {
    text += names[static_cast<std::size_t>(e.i)] + style.separator;
    text += names[static_cast<std::size_t>(e.j)];
    style.append(text, written_quaternion(e.quaternion));
    append_number(text += style.separator, e.weight);
    text += '\n';
  }
  return text;
}

inline std::string rotation_table(const std::vector<NodeId>& nodes, const Rotations& R,
                                  const NodeIds& ids, const std::vector<Index>& component,
                                  TableStyle style) {
  const auto fits = [&](std::size_t size) { return size == nodes.size(); };
  if (!fits(R.size()) || (!component.empty() && !fits(component.size()))) {
    throw std::invalid_argument("expected a rotation, and if any a component, for every node");
  }
  const bool several =
      std::any_of(component.begin(), component.end(), [](Index c) { return c > 0; });
  Strings words{"id", "qx", "qy", "qz", "qw"};
  if (several) words.push_back("component");
  std::string text = style.header("rotations", words);
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    text += style.spelt(ids.name(nodes[k]));
    style.append(text, written_quaternion(WeightedQuaternion(R[k])));
    if (several) text += style.separator + std::to_string(component[k]);
    text += '\n';
  }
  return text;
}

}  // namespace detail

/// A graph as text, or as CSV: a line for each edge, under a header.
/// @param ids what nodes are called
/// @throws std::invalid_argument for a name that the format cannot hold
inline std::string to_text(const MeasurementGraph& graph, const NodeIds& ids = {}) {
  return detail::edge_table(graph, ids, {' '});
}
inline std::string to_csv(const MeasurementGraph& graph, const NodeIds& ids = {}) {
  return detail::edge_table(graph, ids, {','});
}

/// Rotations world_from_node as text, or as CSV: a line for each node, under a header.
/// @param component (n,) labels, told where there are several: Components::label; or none
/// @throws std::invalid_argument as above, and unless there is a rotation for every node
inline std::string to_text(const std::vector<NodeId>& nodes, const Rotations& R,
                           const NodeIds& ids = {}, const std::vector<Index>& component = {}) {
  return detail::rotation_table(nodes, R, ids, component, {' '});
}
inline std::string to_csv(const std::vector<NodeId>& nodes, const Rotations& R,
                          const NodeIds& ids = {}, const std::vector<Index>& component = {}) {
  return detail::rotation_table(nodes, R, ids, component, {','});
}

}  // namespace rotavg::io
