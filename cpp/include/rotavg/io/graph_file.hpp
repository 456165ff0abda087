#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/io/node_ids.hpp>
#include <rotavg/io/source.hpp>
#include <rotavg/linalg/symmetric_eigen.hpp>
#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

namespace rotavg::io {

struct ReadOptions {
  bool unit_weights = false;     ///< weigh every edge 1, whatever the file says
  bool skip_self_edges = false;  ///< leave out edges from a node to itself; else they are refused
  /// Of text and CSV: the rotations are of the vision family (R_i = camera_from_world, R_ij = R_j
  /// R_i^T), and transposed.
  bool vision = false;
  /// Of text and CSV without a header: what the columns are, "i,j,qw,qx,qy,qz,weight".
  std::string columns;
};

/// A measurement graph as a file has it. m counts the edges that are used.
struct GraphFile {
  std::vector<RelativeQuaternion> measurements;  ///< (m,)
  std::vector<NodeId> nodes;                     ///< rising; those without an edge are among them
  NodeIds ids;                                   ///< of names, in rising order
  /// (m,) what AnisotropicGraph takes: the inverse covariance of every R_ij, radians^-2, in the
  /// frame of j. None where the file has none.
  std::vector<Matrix3> precisions;
  std::vector<std::string> notes;  ///< what a user should know of what was read

  MeasurementGraph graph() const {
    return MeasurementGraph(
        measurements.size(), [this](std::size_t k) { return measurements[k]; }, nodes);
  }
};

namespace detail {

/// The inverse of a symmetric matrix by its minors; NaN where it is not positive definite.
inline Matrix3 inverse_symmetric(const Matrix3& A) {
  double scale = 0.0;
  for (int k = 0; k < 9; ++k) scale = std::max(scale, std::abs(A(k)));
  Matrix3 adjugate;
  const Matrix3 B = A / scale;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) {
      const int a = (c + 1) % 3, b = (c + 2) % 3, d = (r + 1) % 3, e = (r + 2) % 3;
      adjugate(r, c) = B(a, d) * B(b, e) - B(a, e) * B(b, d);
    }
  }
  const double det = B(0, 0) * adjugate(0, 0) + B(0, 1) * adjugate(1, 0) + B(0, 2) * adjugate(2, 0);
  const bool definite = B(0, 0) > 0.0 && adjugate(2, 2) > 0.0 && det > 0.0;
  return adjugate / (definite ? det * scale : std::numeric_limits<double>::quiet_NaN());
}

/// Whether a symmetric matrix is finite and, beyond rounding, positive definite.
inline bool is_positive_definite(const Matrix3& A) {
  double size = 0.0;
  for (int k = 0; k < 9; ++k) size = std::max(size, std::abs(A(k)));
  return is_finite(A) && size > 0.0 && symmetric_eigen(A / size).values(0) > 1e-13;
}

/// What is wrong with a quaternion of a file, if it is further from unit length than by rounding.
class Lengths {
 public:
  /// @throws FormatError for zero, and for a length that is off by more than .1
  void check(const Source& source, std::size_t line, const Vector4& q) {
    const double length = std::sqrt(q(0) * q(0) + q(1) * q(1) + q(2) * q(2) + q(3) * q(3));
    if (q(0) == 0.0 && q(1) == 0.0 && q(2) == 0.0 && q(3) == 0.0) {
      source.refuse(line, "the quaternion is zero, expected one of length 1");
    }
    const double off = std::abs(length - 1.0);
    if (!(off <= 0.1)) {
      source.refuse(line, "found a quaternion of length " + six_digits(length) +
                              ", expected length 1 (are the columns in another order?)");
    }
    if (off <= 1e-3) return;
    if (count_++ == 0) first_ = line;
    most_ = std::max(most_, off);
  }
  void tell(std::vector<std::string>& notes) const {
    if (count_ == 0) return;
    notes.push_back(std::to_string(count_) + (count_ > 1 ? " quaternions" : " quaternion") +
                    " normalised whose length was not 1 (off by up to " + six_digits(most_) +
                    (count_ > 1 ? ", first in line " : ", in line ") + std::to_string(first_) +
                    ")");
  }

 private:
  std::size_t count_ = 0, first_ = 0;
  double most_ = 0.0;
};

/// Puts a file's edges together: checks each, and leaves out those that are not used.
class EdgeList {
 public:
  EdgeList(const Source& source, const ReadOptions& options) : source_(source), options_(options) {}

  /// Whether the next edge is used.
  /// @throws FormatError, which names the line, for one that no graph can hold
  bool add(std::size_t line, const RelativeQuaternion& m, GraphFile& file) {
    const auto edge = static_cast<Index>(count_++);
    const bool skipped = m.i == m.j && options_.skip_self_edges;
    if (m.weight == 0.0 || skipped) {
      if (m.weight == 0.0 && zero_++ == 0) first_zero_ = {m.i, m.j};
      if (m.weight != 0.0 && self_++ == 0) first_self_ = {m.i, m.j};
      return false;
    }
    try {
      check_measurement(edge, m);
    } catch (const InvalidEdge& error) {
      source_.refuse(line, "edge " + std::to_string(edge) + " (" + arrow(file, {m.i, m.j}) +
                               "): " + error.reason());
    }
    file.measurements.push_back(m);
    return true;
  }

  /// @throws FormatError if no edge is left
  void finish(GraphFile& file) const {
    if (file.measurements.empty()) {
      const char* const why = self_ == 0 ? "weight 0" : "weight 0 or joins a node to itself";
      source_.refuse(0, std::string("every edge has ") + why + ", expected at least one to use");
    }
    tell(file, zero_, "of weight 0", first_zero_);
    tell(file, self_, "from a node to itself", first_self_);
    std::sort(file.nodes.begin(), file.nodes.end());
    file.nodes.erase(std::unique(file.nodes.begin(), file.nodes.end()), file.nodes.end());
  }

 private:
  using Ends = std::pair<NodeId, NodeId>;

  static std::string arrow(const GraphFile& file, const Ends& ends) {
    const char* const quote = file.ids.empty() ? "" : "'";
    return quote + file.ids.name(ends.first) + quote + " -> " + quote + file.ids.name(ends.second) +
           quote;
  }
  static void tell(GraphFile& file, std::size_t count, const char* what, const Ends& first) {
    if (count == 0) return;
    file.notes.push_back(std::to_string(count) + (count > 1 ? " edges " : " edge ") + what +
                         (count > 1 ? " are not used (the first: " : " is not used (it: ") +
                         arrow(file, first) + ")");
  }

  const Source& source_;
  const ReadOptions& options_;
  std::size_t count_ = 0, zero_ = 0, self_ = 0;
  Ends first_zero_, first_self_;
};

/// The edges' quaternion as files have it: of length 1, w >= 0, without -0.
inline Vector4 written_quaternion(const WeightedQuaternion& given) {
  WeightedQuaternion q = given;
  const double length = q.norm();
  if (std::abs(length - 1.0) > 1e-15) q.coeffs() /= length;
  double first = q.w();
  for (int k = 0; k < 3 && first == 0.0; ++k) first = q.coeffs()(k);
  const double sign = first < 0.0 ? -1.0 : 1.0;
  return {sign * q.x() + 0.0, sign * q.y() + 0.0, sign * q.z() + 0.0, sign * q.w() + 0.0};
}

}  // namespace detail

}  // namespace rotavg::io
