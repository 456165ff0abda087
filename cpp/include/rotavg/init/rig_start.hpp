#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <rotavg/linalg/small_eigen.hpp>
#include <rotavg/reduction/rig_layout.hpp>
#include <rotavg/so3/nearest.hpp>
#include <rotavg/so3/small_products.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// The rotation with the least sum of chordal distances to those given, at least one, by
/// reweighting (Weiszfeld 1937; Hartley, Aftab and Trumpf 2011) from the best of some of them: half
/// of them may be anywhere.
inline Matrix3 median_rotation(const Rotations& given) {
  constexpr std::size_t candidates = 24;
  constexpr double rounded = 1e-6;  // below it, a residual counts as its square
  constexpr int max_steps = 50;
  constexpr double settled = 1e-10;
  const std::size_t stride = (given.size() + candidates - 1) / candidates;
  Matrix3 median = given.front();
  double least = -1.0;
  for (std::size_t a = 0; a < given.size(); a += stride) {
    double sum = 0.0;
    for (const Matrix3& R : given) sum += (R - given[a]).norm();
    if (least < 0.0 || sum < least) {
      least = sum;
      median = given[a];
    }
  }
  for (int k = 0; k < max_steps; ++k) {
    Matrix3 sum = Matrix3::Zero();
    for (const Matrix3& R : given) sum += R / std::max(rounded, (R - median).norm());
    const Matrix3 next = nearest_rotation(sum);
    const double step = (next - median).norm();
    median = next;
    if (step <= settled) break;
  }
  return median;
}

namespace detail {

/// The rotation X with Q_f X = G R_f for all frames f and some rotation G, the hand-eye problem:
/// the nearest to the left singular vector of sum R_f^T (x) Q_f^T, as
///
///     sum_f tr((Q_f X)^T G R_f) = vec(X)^T (sum_f R_f^T (x) Q_f^T) vec(G).
///
/// @param pairs Q_f and R_f
inline Matrix3 hand_eye(const std::vector<std::pair<Matrix3, Matrix3>>& pairs) {
  using Matrix9 = Eigen::Matrix<double, 9, 9>;
  Matrix9 K = Matrix9::Zero();
  for (const auto& [Q, R] : pairs) {
    for (int a = 0; a < 3; ++a) {
      for (int b = 0; b < 3; ++b) K.block<3, 3>(3 * a, 3 * b) += R(b, a) * Q.transpose();
    }
  }
  const Eigen::VectorXd x = small_eigen(K * K.transpose()).vectors.col(8);
  const Matrix3 X = Eigen::Map<const Matrix3>(x.data());
  return nearest_rotation(determinant(X) < 0.0 ? Matrix3(-X) : X);
}

/// Finds one sensor more, where its images and those of known sensors are in different parts: from
/// how both turn from frame to frame.
/// @returns whether there was one with three frames or more
inline bool sensor_across_parts(const RigLayout& rigs, const Rotations& R,
                                const std::vector<Index>& label,
                                const std::vector<std::vector<Index>>& frames,
                                std::vector<bool>& done, Rotations& C) {
  std::map<std::array<Index, 3>, std::vector<std::pair<Matrix3, Matrix3>>> found;
  for (const std::vector<Index>& images : frames) {
    std::set<std::array<Index, 3>> seen;  // one pair of a frame
    for (const Index i : images) {
      const Index s = rigs.sensor_of()[i];
      if (done[s]) continue;
      for (const Index j : images) {
        const Index t = rigs.sensor_of()[j];
        const std::array<Index, 3> key = {s, label[i], label[j]};
        if (!done[t] || !seen.insert(key).second) continue;
        found[key].push_back({R[j] * C[t].transpose(), R[i]});
      }
    }
  }
  const auto most = std::max_element(found.begin(), found.end(), [](const auto& a, const auto& b) {
    return a.second.size() < b.second.size();
  });
  if (most == found.end() || most->second.size() < 3) return false;
  const Index s = most->first[0];
  C[s] = hand_eye(most->second);
  done[s] = true;
  return true;
}

}  // namespace detail

/// The rotations of sensors in their rigs from those of all images: C_s is the median over frames
/// of C_t R_j^T R_i, with i and j the images of s and of a sensor t that is known by then; first
/// the sensor that most frames speak of. Where no image is in one part with those of known sensors,
/// C_s is what makes both turn alike from frame to frame.
///
/// @param R (n,) world_from_node
/// @param label (n,) images with different labels say nothing of each other
/// @returns C of every sensor; I where no frame tells
inline Rotations sensors_from_images(const RigLayout& rigs, const Rotations& R,
                                     const std::vector<Index>& label) {
  std::vector<std::vector<Index>> frames(static_cast<std::size_t>(rigs.num_frames()));
  for (std::size_t i = 0; i < R.size(); ++i) {
    if (rigs.frame_of()[i] >= 0) frames[rigs.frame_of()[i]].push_back(static_cast<Index>(i));
  }
  Rotations C = rigs.rotations();
  std::vector<bool> done;
  for (Index s = 0; s < rigs.num_sensors(); ++s) done.push_back(!rigs.is_estimated(s));
  for (;;) {
    std::vector<Rotations> samples(C.size());
    for (const std::vector<Index>& images : frames) {
      for (const Index i : images) {
        const Index s = rigs.sensor_of()[i];
        if (done[s]) continue;
        for (const Index j : images) {
          const Index t = rigs.sensor_of()[j];
          if (done[t] && label[i] == label[j]) {
            samples[s].push_back(C[t] * R[j].transpose() * R[i]);
          }
        }
      }
    }
    const auto most = std::max_element(
        samples.begin(), samples.end(),
        [](const Rotations& a, const Rotations& b) { return a.size() < b.size(); });
    if (most == samples.end()) return C;
    if (most->empty()) {
      if (!detail::sensor_across_parts(rigs, R, label, frames, done, C)) return C;
      continue;
    }
    const auto s = most - samples.begin();
    C[s] = median_rotation(*most);
    done[s] = true;
  }
}

}  // namespace rotavg

#pragma GCC diagnostic pop
