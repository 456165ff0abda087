#pragma once

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <rotavg/io/g2o_dialect.hpp>
#include <rotavg/io/graph_file.hpp>
#include <rotavg/io/source.hpp>
#include <rotavg/linalg/small_inverse.hpp>
#include <rotavg/reduction/priors.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

namespace rotavg::io {

// Pose graphs as g2o has them, in space or in the plane; pose family.
//
//     VERTEX_SE3:QUAT i  x y z  qx qy qz qw      EDGE_SE3:QUAT i j  x y z  qx qy qz qw  I11 … I66
//     VERTEX_SE2 i  x y theta                    EDGE_SE2 i j  x y theta  I11 … I33
//     FIX i …
//
// R_ij is the edge's rotation as it stands; its weight is SE-Sync's concentration
// kappa = 3 / (2 tr(Omega^-1)), Omega the rotation's block of the information (Rosen et al. 2019).

/// The pose of a node.
struct Vertex {
  NodeId node = 0;
  Vector3 position = Vector3::Zero();
  Matrix3 world_from_node = Matrix3::Identity();
};

/// A pose graph as its file has it.
struct PoseFile : GraphFile {
  int dimension = 3;                  ///< of space; 2 in the plane, where rotations are about z
  std::vector<Vector3> translations;  ///< (m,) of the edges: of j in the frame of i; none if all 0
  /// (m,) inverse covariances of these, in the frame of j; none: the identity.
  std::vector<Matrix3> translation_information;
  std::vector<Vertex> vertices;      ///< in the order of the nodes; of some there may be none
  std::vector<FixedRotation> fixed;  ///< of the vertices that the file fixes: for Priors
  std::string text;                  ///< all of it
};

namespace detail {

/// Reads one file; see read_g2o.
class G2oReader {
 public:
  G2oReader(const Source& source, const ReadOptions& options)
      : source_(source), options_(options) {}

  PoseFile read() {
    sort_lines();
    const std::size_t kind = edges_[1].size() > edges_[0].size() ? 1 : 0;
    dialect_ = &g2o_dialects[kind];
    if (edges_[kind].empty()) refuse_no_edges();
    for (std::size_t k = 0; k < 2; ++k) {
      if (k == kind) continue;
      if (!edges_[k].empty()) unknown_[g2o_dialects[k].edge] += edges_[k].size();
      if (!vertices_[k].empty()) unknown_[g2o_dialects[k].vertex] += vertices_[k].size();
    }
    file_.dimension = static_cast<int>(dialect_->dimension);
    read_vertices(vertices_[kind]);
    if (!unknown_.empty()) {
      std::size_t count = 0;
      for (const auto& tag : unknown_) count += tag.second;
      file_.notes.push_back(std::to_string(count) + (count > 1 ? " lines" : " line") +
                            " with unknown tags skipped (" + listed(unknown_) + ")");
    }
    read_edges(edges_[kind]);
    file_.text = source_.content().substr(source_.begin());
    return std::move(file_);
  }

 private:
  struct Tagged {
    Line line;
    NodeId i = 0, j = 0;
    std::vector<std::string_view> numbers() const {  // of which there is one at least
      return words_of(line.text);
    }
  };
  using Tags = std::map<std::string_view, std::size_t>;

  void sort_lines() {
    for (const Line& line : source_.lines()) {
      const std::string_view text = stripped(line.text);
      const std::string_view tag = text.substr(0, text.find_first_of(" \t\v\f"));
      bool known = tag == "FIX";
      if (known) {
        const auto ids = integers(line, words_of(text.substr(tag.size())));
        for (const NodeId id : ids) fixed_[id] = line.number;
      }
      for (std::size_t kind = 0; kind < 2; ++kind) {
        const bool edge = tag == g2o_dialects[kind].edge;
        if (!edge && tag != g2o_dialects[kind].vertex) continue;
        known = true;
        (edge ? edges_ : vertices_)[kind].push_back(tagged(line, tag, edge ? 2 : 1));
      }
      if (!known) ++unknown_[tag];
    }
  }

  /// The ids behind a tag, and the text behind them.
  Tagged tagged(const Line& line, std::string_view tag, std::size_t num_ids) const {
    std::string_view rest = stripped(line.text).substr(tag.size());
    std::vector<std::string_view> fields;
    for (rest = stripped(rest); fields.size() < num_ids && !rest.empty(); rest = stripped(rest)) {
      fields.push_back(rest.substr(0, rest.find_first_of(" \t\v\f")));
      rest.remove_prefix(fields.back().size());
    }
    const auto ids = integers(line, fields);
    if (rest.empty()) {
      source_.refuse(line.number, "found only " + std::to_string(fields.size()) + " values after " +
                                      shown(tag) + ", the line is truncated");
    }
    return {{line.number, rest}, ids[0], ids.back()};
  }

  std::vector<NodeId> integers(const Line& line,
                               const std::vector<std::string_view>& fields) const {
    std::vector<NodeId> ids;
    for (const std::string_view field : fields) {
      NodeId id = 0;
      const std::size_t plus = field[0] == '+' ? 1 : 0;
      const char* const end = field.data() + field.size();
      const auto [stop, error] = std::from_chars(field.data() + plus, end, id);
      if (error != std::errc{} || stop != end || (plus == 1 && field.substr(1, 1) == "-")) {
        std::string all;
        for (const std::string_view f : fields) {
          if (!all.empty()) all += ' ';
          all += shown(f);
        }
        source_.refuse(line.number, "found " + all + " for node ids, expected integers");
      }
      ids.push_back(id);
    }
    return ids;
  }

  [[noreturn]] void refuse_no_edges() const {
    Tags tags = unknown_;
    for (std::size_t k = 0; k < 2; ++k) {
      if (!vertices_[k].empty()) tags[g2o_dialects[k].vertex] = vertices_[k].size();
    }
    source_.refuse(0, "the file has no edges: no line EDGE_SE3:QUAT, EDGE_SE2" +
                          (tags.empty() ? "" : "; found " + listed(tags)));
  }
  /// The commonest.
  static std::string listed(const Tags& tags) {
    std::vector<std::pair<std::string_view, std::size_t>> all(tags.begin(), tags.end());
    std::stable_sort(all.begin(), all.end(), [](auto& a, auto& b) { return a.second > b.second; });
    std::string text;
    for (std::size_t k = 0; k < std::min<std::size_t>(all.size(), 5); ++k) {
      const std::string name = shown(all[k].first);
      text += (k > 0 ? ", " : "") + name.substr(1, name.size() - 2) + ": " +
              std::to_string(all[k].second);
    }
    return text + (all.size() > 5 ? ", ..." : "");
  }

  std::vector<double> numbers(const Tagged& tagged, std::size_t count) const {
    const auto fields = tagged.numbers();
    std::vector<double> values;
    for (const auto field : fields) values.push_back(number_in(source_, tagged.line.number, field));
    if (values.size() != count) {
      source_.refuse(tagged.line.number, "found " + std::to_string(values.size()) +
                                             " numbers after the ids, expected " +
                                             std::to_string(count));
    }
    return values;
  }
  void check_finite(const Tagged& tagged, const std::vector<double>& values,
                    std::size_t count) const {
    for (std::size_t k = 0; k < count; ++k) {
      if (std::isfinite(values[k])) continue;
      source_.refuse(tagged.line.number,
                     "found " + six_digits(values[k]) + ", expected a finite number");
    }
  }

  void read_vertices(const std::vector<Tagged>& lines) {
    std::map<NodeId, Vertex> poses;
    for (const Tagged& tagged : lines) {
      const std::vector<double> pose = numbers(tagged, dialect_->num_pose);
      const auto fix = fixed_.find(tagged.i);
      if (fix != fixed_.end()) {
        check_finite(tagged, pose, pose.size());
        if (dialect_->dimension == 3) {
          lengths_.check(source_, tagged.line.number, {pose[3], pose[4], pose[5], pose[6]});
        }
      }
      file_.nodes.push_back(tagged.i);
      double size = 0.0, turn = dialect_->dimension == 2 ? 1.0 : 0.0;
      for (const double value : pose) size += std::abs(value);
      for (std::size_t k = 3; k < pose.size(); ++k) turn = std::max(turn, std::abs(pose[k]));
      poses.erase(tagged.i);  // the last one counts
      if (!std::isfinite(size) || turn == 0.0) continue;
      WeightedQuaternion q = dialect_->rotation(pose.data());
      if (dialect_->dimension == 3) q.coeffs() /= turn;
      poses[tagged.i] = {tagged.i, dialect_->position(pose.data()),
                         q.normalized().toRotationMatrix()};
    }
    for (const auto& [node, vertex] : poses) file_.vertices.push_back(vertex);
  }

  void read_edges(const std::vector<Tagged>& lines) {
    const std::size_t num_pose = dialect_->num_pose;
    bool some_long = false, some_short = false;
    if (options_.unit_weights || lines[0].numbers().size() == num_pose) {
      for (const Tagged& tagged : lines) {
        const std::size_t count = tagged.numbers().size();
        some_short = some_short || count == num_pose;
        some_long = some_long || count != num_pose;
      }
    }
    const std::size_t full = num_pose + dialect_->num_information;
    if (some_short && !some_long && !options_.unit_weights) {
      source_.refuse(lines[0].line.number, "found " + std::to_string(num_pose) +
                                               " numbers after the ids, no information, expected " +
                                               std::to_string(full) +
                                               " (read with unit weights where there is none)");
    }
    bool moved = false, some_bad = false;
    std::size_t first_bad = 0;  // information about a translation that is not positive definite
    bool precise = !options_.unit_weights && dialect_->dimension == 3;
    EdgeList list(source_, options_);
    Lengths lengths;
    for (const Tagged& tagged : lines) {
      const bool bare = some_short && options_.unit_weights && tagged.numbers().size() == num_pose;
      const std::vector<double> values = numbers(tagged, bare ? num_pose : full);
      check_finite(tagged, values, options_.unit_weights ? num_pose : full);
      RelativeQuaternion m{tagged.i, tagged.j, dialect_->rotation(values.data()), 1.0};
      Matrix3 omega = Matrix3::Identity();
      if (!options_.unit_weights) {
        omega = dialect_->rotation_information(values.data() + num_pose);
        m.weight = (omega.array() == 0.0).all() ? 0.0 : concentration(omega);
        if (std::isnan(m.weight)) {
          source_.refuse(tagged.line.number,
                         "the rotation part of the information matrix is not positive definite, "
                         "expected one that is (or read with unit weights, which ignore it)");
        }
      }
      if (dialect_->dimension == 3) {
        lengths.check(source_, tagged.line.number, m.i_from_j.coeffs());
      }
      file_.nodes.insert(file_.nodes.end(), {m.i, m.j});
      Matrix3 about_translation = Matrix3::Identity();
      if (!some_short) {
        about_translation = dialect_->translation_information(values.data() + num_pose);
        if (!some_bad && !has_positive_minors(about_translation)) {
          some_bad = true;
          first_bad = static_cast<std::size_t>(&tagged - lines.data());
        }
      }
      if (!list.add(tagged.line.number, m, file_)) continue;
      file_.translation_information.push_back(about_translation);
      file_.translations.push_back(dialect_->position(values.data()));
      moved = moved || !file_.translations.back().isZero(0.0);
      if (precise && !is_positive_definite(inverse_symmetric(omega))) {
        precise = false;
        file_.notes.push_back("covariances not used: the information about the rotation in line " +
                              std::to_string(tagged.line.number) +
                              " is too uneven about its axes to be inverted");
      }
      if (precise) file_.precisions.push_back(omega);
    }
    lengths.tell(file_.notes);
    if (some_short && !some_long) {
      file_.notes.push_back("the edges have no information: every edge weighs 1");
    }
    if (moved && some_bad) {
      file_.notes.push_back(
          "translations not used: the information about them is not positive definite (edge " +
          std::to_string(first_bad) + ")");
    }
    if (!moved || some_bad) file_.translations.clear();
    if (!moved || some_bad || some_short) file_.translation_information.clear();
    if (!precise) file_.precisions.clear();
    list.finish(file_);
    for (const Vertex& vertex : file_.vertices) {
      if (fixed_.count(vertex.node) == 0) continue;
      file_.fixed.push_back({vertex.node, vertex.world_from_node});
    }
  }

  const Source& source_;
  const ReadOptions& options_;
  const G2oDialect* dialect_ = nullptr;
  std::array<std::vector<Tagged>, 2> edges_, vertices_;
  std::map<NodeId, std::size_t> fixed_;  // and the lines that say so
  Tags unknown_;
  Lengths lengths_;
  PoseFile file_;
};

}  // namespace detail

/// Reads a pose graph. Lines with other tags are skipped, and told in the notes.
///
///     const rotavg::io::PoseFile file = rotavg::io::read_g2o("in.g2o");
///     const rotavg::MeasurementGraph graph = file.graph();
///
/// @throws FormatError if the file cannot be read or holds something else
inline PoseFile read_g2o(const Source& source, const ReadOptions& options = {}) {
  return detail::G2oReader(source, options).read();
}

}  // namespace rotavg::io
