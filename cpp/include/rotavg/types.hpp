#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include <Eigen/Core>

// NaN and infinities are told from numbers, and a proof counts on the roundings of IEEE 754.
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "rotavg proves nothing with -ffast-math, -Ofast or -ffinite-math-only: compile without"
#endif

namespace rotavg {

using Matrix3 = Eigen::Matrix3d;
using Vector3 = Eigen::Vector3d;

/// Row of a node or of an edge: 0 … n-1. Every result follows this order.
using Index = int;

/// The name a user gives a node.
using NodeId = std::int64_t;

/// One rotation per node, `world_from_i`: x_world = R_i x_i, so that R_i R_ij = R_j.
using Rotations = std::vector<Matrix3>;

/// The largest relative error of one rounded operation, u = 2^-53.
constexpr double unit_roundoff = 0.5 * std::numeric_limits<double>::epsilon();

}  // namespace rotavg
