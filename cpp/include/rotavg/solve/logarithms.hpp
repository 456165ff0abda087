#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/graph/components.hpp>
#include <rotavg/graph/elimination.hpp>
#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/linalg/block_cholesky.hpp>
#include <rotavg/linalg/flat.hpp>
#include <rotavg/problem/gauge.hpp>
#include <rotavg/problem/gradient.hpp>
#include <rotavg/problem/hessian.hpp>
#include <rotavg/reduction/gravity_pairs.hpp>
#include <rotavg/so3/lie.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/solve/monitor.hpp>
#include <rotavg/solve/options.hpp>
#include <rotavg/solve/result.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// r_ij = log(R_ij^T R_i^T R_j).
inline Vector3 log_residual(const Edge& e, const Rotations& R) {
  return log_so3(transposed_product(product(R[e.i], e.i_from_j()), R[e.j]));
}

/// The objective of logarithms, F(R) = sum of
///
///     r^T Omega r,   r = log(R_ij^T R_i^T R_j)     of an edge,
///     h theta^2,     theta the angle from R_i d to R_j g     of a pair of gravity's edges,
///
/// d = R_ij g, h the mean of tr(Omega) of the two: of all rotations that take d to g one that turns
/// by theta is the nearest, and gravity knows no other of them better.
class LogObjective {
 public:
  /// What an edge adds: to the objective, to the gradient at j (at i it is the opposite), and to
  /// the Hessian, A at ii and jj and -A at ij.
  struct Term {
    double cost = 0.0;
    Vector3 gradient = Vector3::Zero();
    Matrix3 hessian = Matrix3::Zero();
  };

  /// @param graph, gravity must outlive this object
  /// @param information (m,) Omega of every edge; must outlive this object
  LogObjective(const MeasurementGraph& graph, const std::vector<Matrix3>& information,
               const GravityPairs& gravity)
      : graph_(graph),
        information_(information),
        gravity_(gravity),
        kind_(information.size(), Kind::edge) {
    std::vector<bool> is_held(gravity.free_heading.size(), false);  // of every label
    for (const Index first : gravity.first) {
      kind_[first] = Kind::gravity;
      kind_[first + 1] = Kind::second_of_gravity;
      if (gravity.free_heading.empty()) continue;
      const Index part = gravity.free_heading[graph.edges()[first].i];
      if (part < 0 || is_held[part]) continue;
      is_held[part] = true;
      kind_[first] = Kind::gravity_of_free_heading;
    }
  }

  const MeasurementGraph& graph() const { return graph_; }
  const std::vector<Matrix3>& information() const { return information_; }

  double operator()(const Rotations& R) const {
    double sum = 0.0;
    for (Index k = 0; k < graph_.num_edges(); ++k) sum += cost(k, R);
    return sum;
  }

  Term linearized(Index k, const Rotations& R) const {
    switch (kind_[k]) {
      case Kind::edge:
        return edge_term(k, R);
      case Kind::gravity:
      case Kind::gravity_of_free_heading:
        return gravity_term(k, R);
      case Kind::second_of_gravity:
        break;
    }
    return {};
  }

 private:
  enum class Kind : unsigned char {
    edge,
    gravity,
    gravity_of_free_heading,  ///< the first of its part
    second_of_gravity,
  };

  double gravity_precision(Index k) const {
    return 0.5 * (information_[k].trace() + information_[k + 1].trace());
  }
  /// R_i d and R_j g.
  std::pair<Vector3, Vector3> directions(Index k, const Rotations& R) const {
    const Edge& e = graph_.edges()[k];
    return {product(R[e.i], product(e.i_from_j(), gravity_.down)), product(R[e.j], gravity_.down)};
  }
  static double angle(const Vector3& x, const Vector3& g) {
    const Vector3 across = cross(x, g);
    return std::atan2(std::sqrt(dot(across, across)), dot(x, g));
  }

  double cost(Index k, const Rotations& R) const {
    switch (kind_[k]) {
      case Kind::edge: {
        const Vector3 r = log_residual(graph_.edges()[k], R);
        return std::max(dot(r, product(information_[k], r)), 0.0);  // it may be singular
      }
      case Kind::gravity:
      case Kind::gravity_of_free_heading: {
        const auto [x, g] = directions(k, R);
        const double theta = angle(x, g);
        return gravity_precision(k) * theta * theta;
      }
      case Kind::second_of_gravity:
        break;
    }
    return 0.0;
  }

  /// Gauss and Newton's Hessian.
  Term edge_term(Index k, const Rotations& R) const {
    const Edge& e = graph_.edges()[k];
    const Vector3 r = log_residual(e, R);
    const Matrix3 A = product_transposed(inverse_right_jacobian(r), R[e.j]);
    const Vector3 pull = product(information_[k], r), g = product(transposed(A), pull);
    Term term;
    term.cost = std::max(dot(r, pull), 0.0);
    term.gradient = 2.0 * g;
    term.hessian = transposed_product(A, product(information_[k], A));
    term.hessian *= 2.0;
    return term;
  }

  /// With n = x x g / |x x g| and t = n x x, turning i about n brings x towards g, and theta^2
  /// bends by 2 about n and by 2 theta cot(theta), where that is positive, about t. About x it is
  /// flat; where F is so for a whole part, the metric is not, in one of its nodes.
  Term gravity_term(Index k, const Rotations& R) const {
    constexpr double least = 0.1;
    const auto [x, g] = directions(k, R);
    const double h = gravity_precision(k), theta = angle(x, g);
    const Vector3 across = cross(x, g);
    const double sine = std::sqrt(dot(across, across));
    Term term;
    term.cost = h * theta * theta;
    if (kind_[k] == Kind::gravity) term.hessian = outer_product(Vector3(-2.0 * h * x), x);
    add_to_diagonal(term.hessian, 2.0 * h);
    if (!(sine > 0.0)) return term;  // there, or at the top
    const Vector3 n = (1.0 / sine) * across, t = cross(n, x);
    term.gradient = (2.0 * h * theta) * n;
    const double bend = std::max(least, theta * dot(x, g) / sine);
    term.hessian += outer_product(Vector3(2.0 * h * (bend - 1.0) * t), t);
    return term;
  }

  const MeasurementGraph& graph_;
  const std::vector<Matrix3>& information_;
  const GravityPairs& gravity_;
  std::vector<Kind> kind_;
};

namespace detail {

/// F and what Gauss and Newton need of it at some rotations.
class LogLinearization {
 public:
  LogLinearization(const LogObjective& objective, const Rotations& R)
      : graph_(objective.graph()),
        hessian_(graph_.edges().size()),
        gradient_(graph_.num_nodes(), 3),
        stiffness_(R.size(), 0.0) {
    gradient_.setZero();
    for (std::size_t k = 0; k < hessian_.size(); ++k) {
      const Edge& e = graph_.edges()[k];
      const LogObjective::Term term = objective.linearized(static_cast<Index>(k), R);
      objective_ += term.cost;
      hessian_[k] = term.hessian;
      for (int a = 0; a < 3; ++a) {
        gradient_(e.i, a) -= term.gradient(a);
        gradient_(e.j, a) += term.gradient(a);
        stiffness_[e.i] += objective.information()[k](a, a) / 3.0;
        stiffness_[e.j] += objective.information()[k](a, a) / 3.0;
      }
    }
  }

  double objective() const { return objective_; }
  const NodeVectors& gradient() const { return gradient_; }

  /// Relative as of (3): about four times the angle by which a node would turn.
  GradientNorm gradient_norm() const {
    GradientNorm norm{std::sqrt(flat_dot(gradient_, gradient_)), 0.0};
    for (std::size_t i = 0; i < stiffness_.size(); ++i) {
      if (stiffness_[i] == 0.0) continue;
      const Vector3 g = row_of(gradient_, static_cast<Index>(i));
      const double size = std::sqrt(dot(g, g));
      norm.relative = std::max(norm.relative, 2.0 * size / stiffness_[i]);
    }
    return norm;
  }

  BlockCholesky<3>::Blocks hessian(Elimination& elimination) const {
    return elimination.assemble<3>(
        [&](Index i) {
          Matrix3 sum = Matrix3::Zero();
          for (const HalfEdge& h : graph_.row(i)) sum += hessian_[h.edge()];
          return sum;
        },
        [&](Index k) -> Matrix3 { return -hessian_[k]; });
  }

 private:
  const MeasurementGraph& graph_;
  std::vector<Matrix3> hessian_;  // of every edge
  NodeVectors gradient_;
  std::vector<double> stiffness_;
  double objective_ = 0.0;
};

}  // namespace detail

/// A local minimum of the objective of logarithms, by the method of Gauss and Newton in R_i <-
/// exp(w_i) R_i, with a line search (Armijo).
/// @param R the initial value, world_from_i
inline IterationResult minimise_logarithms(const LogObjective& objective, Rotations R,
                                           const IterationOptions& options) {
  constexpr int max_halvings = 40;
  constexpr double sufficient = 1e-4;
  const MeasurementGraph& graph = objective.graph();
  const Components components = connected_components(graph);
  std::vector<Elimination> eliminations =
      grounded_eliminations(graph, components, resolve_num_threads(options.num_threads));
  Monitor monitor(graph, R, options);
  double step = 0.0;
  bool settled = false;
  for (;;) {
    const detail::LogLinearization at_R(objective, R);
    if (monitor.should_stop(at_R.objective(), at_R.gradient_norm(), step, settled)) break;

    NodeVectors w = NodeVectors::Zero(graph.num_nodes(), 3);
    for (Elimination& elimination : eliminations) {
      if (elimination.size() == 0) continue;
      BlockCholesky<3> cholesky(elimination.symbolic(), elimination.num_threads());
      const auto outcome =
          cholesky.factorize(at_R.hessian(elimination), 0.0, [&] { return monitor.keep_going(); });
      if (outcome != CholeskyOutcome::positive_definite) continue;  // rounding, or stopped
      Eigen::MatrixXd right(cholesky.size(), 1);
      for (Index a = 0; a < elimination.size(); ++a) {
        for (int k = 0; k < 3; ++k) right(3 * a + k) = -at_R.gradient()(elimination.node(a), k);
      }
      cholesky.solve_in_place(right);
      for (Index a = 0; a < elimination.size(); ++a) {
        for (int k = 0; k < 3; ++k) w(elimination.node(a), k) = right(3 * a + k);
      }
    }

    const double slope = flat_dot(at_R.gradient(), w);
    const double rounding = 1e-14 * at_R.objective();
    settled = true;
    double t = 1.0;
    for (int k = 0; k < max_halvings && slope < 0.0; ++k, t *= 0.5) {
      Rotations next = R;
      for (std::size_t i = 0; i < next.size(); ++i) {
        next[i] = turned(R[i], t * row_of(w, static_cast<Index>(i)));
      }
      if (objective(next) <= at_R.objective() + sufficient * t * slope + rounding) {
        settled = false;
        R = std::move(next);
        break;
      }
    }
    step = settled ? 0.0 : t * std::sqrt(2.0 / 3.0 * flat_dot(w, w) / graph.num_nodes());
  }
  fix_gauge(components, R);
  return std::move(monitor).result(std::move(R));
}

}  // namespace rotavg

#pragma GCC diagnostic pop
