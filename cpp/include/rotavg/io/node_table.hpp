#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement.hpp>
#include <rotavg/io/graph_file.hpp>
#include <rotavg/io/node_ids.hpp>
#include <rotavg/io/table.hpp>
#include <rotavg/reduction/priors.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

namespace rotavg::io {

/// What a file says of nodes: `FixedRotation`s or `GravityPrior`s.
template <typename Prior>
struct NodeTable {
  std::vector<Prior> rows;
  NodeIds ids;  ///< of names, in rising order
  std::vector<std::string> notes;
};

/// What a file says of the nodes of a graph, with the ids that these have there; what it says of
/// others is left out.
///
///     priors.gravity = of_graph(read_gravity("gravity.txt"), file);
///
template <typename Prior>
std::vector<Prior> of_graph(const NodeTable<Prior>& table, const GraphFile& graph) {
  std::vector<Prior> found;
  for (Prior prior : table.rows) {
    const auto id = graph.ids.find(table.ids.name(prior.node));
    if (!id || !std::binary_search(graph.nodes.begin(), graph.nodes.end(), *id)) continue;
    prior.node = *id;
    found.push_back(prior);
  }
  return found;
}

namespace detail {

/// Whether this is UTF-8, but for what nobody writes.
inline bool is_utf8(const std::string& text) {
  for (std::size_t k = 0; k < text.size();) {
    const auto c = static_cast<unsigned char>(text[k++]);
    int follow = c < 0x80 ? 0 : c < 0xc2 ? -1 : c < 0xe0 ? 1 : c < 0xf0 ? 2 : c < 0xf5 ? 3 : -1;
    if (follow < 0) return false;
    for (; follow > 0; --follow, ++k) {
      if (k == text.size() || (static_cast<unsigned char>(text[k]) & 0xc0) != 0x80) return false;
    }
  }
  return true;
}

/// The ids in a table: integers if all are such and spelt as usual, otherwise names, which get
/// numbers in rising order.
inline std::vector<NodeId> ids_of(const Source& source, const Table& table, NodeIds& names) {
  const std::vector<std::string>& fields = table.ids;
  std::vector<NodeId> ids;
  const bool integers = std::all_of(fields.begin(), fields.end(), [](const std::string& field) {
    return is_plain_integer(field.data(), field.data() + field.size());
  });
  const std::size_t each = table.layout.ids.size();
  if (integers) {
    for (std::size_t k = 0; k < fields.size(); ++k) {
      NodeId id = 0;
      if (!read_integer(fields[k].data(), fields[k].data() + fields[k].size(), id)) {
        source.refuse(table.lines[k / each],
                      "found the node " + shown(fields[k]) + ", expected an integer of 64 bits");
      }
      ids.push_back(id);
    }
    return ids;
  }
  std::vector<std::string> distinct(fields);
  std::sort(distinct.begin(), distinct.end());
  for (const std::string& name : distinct) names.add(name);
  for (std::size_t k = 0; k < fields.size(); ++k) {
    if (!is_utf8(fields[k])) source.refuse(table.lines[k / each], "the names are not UTF-8");
    ids.push_back(names.add(fields[k]));
  }
  return ids;
}

/// Rotations from the numbers in a table's rows, of whatever kind.
class RotationNumbers {
 public:
  RotationNumbers(const Source& source, const Layout& layout) : source_(source), layout_(layout) {}

  WeightedQuaternion read(std::size_t line, const double* numbers) {
    if (layout_.rotation.size() == 4) {
      const Vector4 q(numbers[0], numbers[1], numbers[2], numbers[3]);
      lengths_.check(source_, line, q);
      return WeightedQuaternion(q);
    }
    if (layout_.rotation.size() == 3) {
      const Vector3 v(numbers[0], numbers[1], numbers[2]);
      constexpr double longest = 6.283185307179586 + 0.01;
      if (!(v.norm() <= longest)) {
        source_.refuse(line, "found a rotation vector of length " + six_digits(v.norm()) +
                                 ", expected radians, at most 2 pi");
      }
      return WeightedQuaternion(exp_quaternion(v).coeffs());
    }
    Matrix3 M;
    for (int k = 0; k < 9; ++k) M(k / 3, k % 3) = numbers[k];
    return WeightedQuaternion(checked(line, M));
  }

  void tell(std::vector<std::string>& notes) const {
    lengths_.tell(notes);
    if (count_ == 0) return;
    notes.push_back(std::to_string(count_) + (count_ > 1 ? " matrices" : " matrix") +
                    " replaced by the nearest rotation, as R^T R was not the identity (off by up "
                    "to " +
                    six_digits(most_) + (count_ > 1 ? ", first in line " : ", in line ") +
                    std::to_string(first_) + ")");
  }

 private:
  Matrix3 checked(std::size_t line, const Matrix3& M) {
    constexpr double most_of_text = 0.05;  // of matrices with two decimals, and three times that
    const double error = orthogonality_error(M);
    if (std::isfinite(error) && determinant(M) < 0.0) {
      source_.refuse(line, "the matrix is not a rotation: its determinant is " +
                               six_digits(determinant(M)) + " (a reflection); expected +1");
    }
    if (!(error <= most_of_text)) {
      source_.refuse(line, "the matrix is not a rotation: R^T R differs from the identity by " +
                               six_digits(error) + "; expected at most " +
                               six_digits(most_of_text));
    }
    if (error > max_orthogonality_error) {
      if (count_++ == 0) first_ = line;
      most_ = std::max(most_, error);
    }
    return error > negligible_orthogonality_error ? nearest_rotation(M) : M;
  }

  const Source& source_;
  const Layout& layout_;
  Lengths lengths_;
  std::size_t count_ = 0, first_ = 0;
  double most_ = 0.0;
};

/// Rotations of nodes from the rows of a table.
inline NodeTable<FixedRotation> read_rotation_rows(const Source& source,
                                                   const std::vector<Row>& rows,
                                                   const ReadOptions& options) {
  const TableReader reader(source, {{"id", "qx", "qy", "qz", "qw"}}, 1);
  const Table table = reader.read(rows, options.columns);
  NodeTable<FixedRotation> found;
  const std::vector<NodeId> ids = ids_of(source, table, found.ids);
  const std::size_t size = table.layout.numbers().size();
  RotationNumbers rotations(source, table.layout);
  std::map<NodeId, std::size_t> seen;
  for (std::size_t k = 0; k < ids.size(); ++k) {
    const auto [place, is_new] = seen.emplace(ids[k], table.lines[k]);
    if (!is_new) {
      const std::string quote = found.ids.empty() ? "" : "'";
      source.refuse(table.lines[k], "node " + quote + found.ids.name(ids[k]) + quote +
                                        " is listed more than once, before in line " +
                                        std::to_string(place->second));
    }
    WeightedQuaternion q = rotations.read(table.lines[k], table.numbers.data() + k * size);
    if (options.vision) q = q.conjugate();
    found.rows.push_back({ids[k], q.normalized().toRotationMatrix()});
  }
  rotations.tell(found.notes);
  return found;
}

}  // namespace detail

/// Reads gravity as GLOMAP has it, `NAME gx gy gz`: down in the frame of the camera.
/// @param weight of every prior
/// @throws FormatError if the file cannot be read or holds something else
inline NodeTable<GravityPrior> read_gravity(const Source& source, double weight = 1.0) {
  detail::Table table;
  table.layout.ids = {0};
  for (const Line& line : source.lines()) {
    const auto words = detail::words_of(line.text);
    if (words.size() < 2) source.refuse(line.number, "found 1 field, expected NAME gx gy gz");
    for (std::size_t k = 1; k < words.size(); ++k) {
      const double value = detail::number_in(source, line.number, words[k]);
      if (!std::isfinite(value)) {
        source.refuse(line.number,
                      "found " + detail::shown(words[k]) + ", expected a finite number");
      }
      table.numbers.push_back(value);
    }
    if (words.size() != 4) {
      source.refuse(line.number, "found " + std::to_string(words.size() - 1) +
                                     " numbers after the ids, expected 3");
    }
    table.ids.emplace_back(words[0]);
    table.lines.push_back(line.number);
  }
  if (table.ids.empty()) source.refuse(0, "the file has no directions, expected NAME gx gy gz");
  NodeTable<GravityPrior> found;
  const std::vector<NodeId> ids = detail::ids_of(source, table, found.ids);
  for (std::size_t k = 0; k < ids.size(); ++k) {
    const double* const g = table.numbers.data() + 3 * k;
    found.rows.push_back({ids[k], {g[0], g[1], g[2]}, weight});
  }
  return found;
}

/// Gravity as GLOMAP reads it.
/// @throws std::invalid_argument for a name that would not come back as it is
inline std::string to_gravity_text(const std::vector<GravityPrior>& gravity,
                                   const NodeIds& ids = {}) {
  std::string text;
  for (const GravityPrior& prior : gravity) {
    const std::string name = ids.name(prior.node);
    if (name.empty() || name.find_first_of(" \t\r\n\v\f,#") != name.npos) {
      throw std::invalid_argument("found a node of the name '" + name +
                                  "', expected no blank, comma or # in it");
    }
    text += name;
    for (int k = 0; k < 3; ++k) append_number(text += ' ', prior.down(k));
    text += '\n';
  }
  return text;
}

}  // namespace rotavg::io
