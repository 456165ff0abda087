#pragma once

#include <functional>

#include <rotavg/linalg/flat.hpp>

namespace rotavg {

/// An approximate solution w of H w = -g by conjugate gradients (Steihaug 1983, without a radius).
/// It stops at |r|_P <= forcing |g|_P, and where the curvature is not positive: there with what it
/// has, or in the first step with the preconditioned gradient. This it is, too, where rounding has
/// taken from the directions that they are conjugate, so that w descends less than it should.
///
/// @tparam Vectors a dense matrix
template <typename Vectors>
class TruncatedCg {
 public:
  /// @param apply_hessian `apply_hessian(p, Hp)`
  /// @param precondition `precondition(r, z)`: z = P r, with P positive definite where it matters
  /// @param keep_going asked every few steps; false ends them with what there is
  template <typename Hessian, typename Preconditioner>
  const Vectors& operator()(const Vectors& g, double forcing, int max_steps, int num_threads,
                            Hessian&& apply_hessian, Preconditioner&& precondition,
                            const std::function<bool()>& keep_going = {}) {
    constexpr int steps_between_questions = 8;
    w_.setZero(g.rows(), g.cols());
    r_ = g;  // H w + g
    precondition(r_, z_);
    p_.setZero(g.rows(), g.cols());
    flat_combine(0.0, p_, -1.0, z_, num_threads);
    double rz = flat_dot(r_, z_, num_threads);
    const double enough = forcing * forcing * rz;
    double slope = 0.0;  // g^T w, by what the steps promise
    for (int k = 0; k < max_steps; ++k) {
      if (keep_going && k % steps_between_questions == steps_between_questions - 1 &&
          !keep_going()) {
        break;
      }
      apply_hessian(p_, Hp_);
      const double curvature = flat_dot(p_, Hp_, num_threads);
      if (!(curvature > 0.0)) {
        if (k == 0) return p_;
        break;
      }
      const double alpha = rz / curvature;
      slope -= alpha * rz;
      flat_combine(1.0, w_, alpha, p_, num_threads);
      flat_combine(1.0, r_, alpha, Hp_, num_threads);
      precondition(r_, z_);
      const double rz_next = flat_dot(r_, z_, num_threads);
      if (!(rz_next > enough)) break;
      flat_combine(rz_next / rz, p_, -1.0, z_, num_threads);
      rz = rz_next;
    }
    if (flat_dot(g, w_, num_threads) <= 0.5 * slope) return w_;
    precondition(g, z_);
    flat_combine(0.0, p_, -1.0, z_, num_threads);
    return p_;
  }

 private:
  Vectors w_, r_, z_, p_, Hp_;
};

}  // namespace rotavg
