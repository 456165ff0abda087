#pragma once

#include <cstddef>
#include <iterator>
#include <vector>

#include <rotavg/so3/quaternion.hpp>
#include <rotavg/types.hpp>

namespace rotavg {

/// A measurement with its ends as rows of the graph, as it is held: R_i R_ij ~ R_j.
struct QuaternionEdge {
  WeightedQuaternion i_from_j;  ///< sqrt(w) times the quaternion of R_ij
  Index i;
  Index j;
};

/// The same, and its weight.
struct Edge {
  Index i;
  Index j;
  double weight;
  WeightedQuaternion quaternion;  ///< sqrt(w) times that of R_ij

  /// R_ij.
  Matrix3 i_from_j() const {
    Matrix3 R = weighted_rotation(quaternion);
    R /= quaternion.squaredNorm();
    return R;
  }
};

/// An edge seen from one of its ends l, with the weight folded in: what the neighbour q says of l
/// is R_l ~ R_q R_ql.
struct HalfEdge {
  WeightedQuaternion node_from_l;  ///< of R_ql
  Index node;                      ///< q
  Index edge_and_end;

  Index edge() const { return edge_and_end / 2; }
  /// Whether l is the end i of the edge, so that R_ql is the transpose of the measured R_ij.
  bool is_i() const { return edge_and_end % 2 == 0; }
};

/// Where the half-edges of a node lead, as it is held.
struct EdgeEnd {
  Index node;
  Index edge_and_end;
};

/// A range of what is put together as it is looked at: `source[position]` makes a Value.
/// @tparam Size of the range: unsigned as a vector's, or an Index
template <typename Value, typename Source, typename Size>
class MadeRange {
 public:
  class Iterator {
   public:
    using iterator_category = std::input_iterator_tag;
    using value_type = Value;
    using difference_type = std::ptrdiff_t;
    using pointer = const Value*;
    using reference = Value;

    Iterator(Source source, std::size_t position) : source_(source), position_(position) {}
    Value operator*() const { return source_[position_]; }
    Iterator& operator++() {
      ++position_;
      return *this;
    }
    bool operator==(const Iterator& other) const { return position_ == other.position_; }
    bool operator!=(const Iterator& other) const { return position_ != other.position_; }

   private:
    Source source_;
    std::size_t position_;
  };

  MadeRange(Source source, std::size_t size) : source_(source), size_(size) {}
  Iterator begin() const { return {source_, 0}; }
  Iterator end() const { return {source_, size_}; }
  Value operator[](std::size_t k) const { return source_[k]; }
  Size size() const { return static_cast<Size>(size_); }
  bool empty() const { return size_ == 0; }

 private:
  Source source_;
  std::size_t size_;
};

/// Makes the edges of a graph.
struct EdgeSource {
  const QuaternionEdge* edges;
  const double* weights;

  Edge operator[](std::size_t k) const {
    const QuaternionEdge& e = edges[k];
    return {e.i, e.j, weights[k], e.i_from_j};
  }
};

/// Makes the half-edges of a node.
struct HalfEdgeSource {
  const EdgeEnd* ends;
  const QuaternionEdge* edges;

  HalfEdge operator[](std::size_t k) const {
    const EdgeEnd end = ends[k];
    const WeightedQuaternion& q = edges[static_cast<std::size_t>(end.edge_and_end / 2)].i_from_j;
    const double sign = end.edge_and_end % 2 == 0 ? -1.0 : 1.0;  // conjugated at the end i
    return {{q.w(), sign * q.x(), sign * q.y(), sign * q.z()}, end.node, end.edge_and_end};
  }
};

/// The edges of a graph, in the order in which they were given.
using Edges = MadeRange<Edge, EdgeSource, std::size_t>;
/// The half-edges of a node, in the order of the edges: its block row of the paper's Rt (4).
using HalfEdges = MadeRange<HalfEdge, HalfEdgeSource, Index>;

}  // namespace rotavg
