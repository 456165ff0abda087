#pragma once

#include <algorithm>
#include <cstddef>
#include <map>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include <rotavg/graph/measurement_graph.hpp>
#include <rotavg/reduction/checked_priors.hpp>
#include <rotavg/reduction/priors.hpp>
#include <rotavg/types.hpp>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wsign-conversion"  // an Index is signed, a vector's size is not

namespace rotavg {

/// A node that is the picture of sensor s in frame f: R_i = Q_f C_s.
struct RigImage {
  NodeId node = 0;
  NodeId frame = 0;   ///< any number; need not be that of a node
  NodeId sensor = 0;  ///< likewise
};

/// The rotation of a sensor in its rig.
struct KnownSensor {
  NodeId sensor = 0;
  Matrix3 frame_from_sensor = Matrix3::Identity();  ///< C
};

/// Rigs some of whose sensors are where nobody knows. What hangs together by frames is one rig.
struct Rigs {
  std::vector<RigImage> images;
  std::vector<KnownSensor> known;
};

/// Where the rotation of a sensor in its rig comes from.
enum class SensorOrigin {
  known,      ///< it was given
  reference,  ///< none of its rig was given, and it is the first: I
  estimated,
};

/// Rigs of one graph, with rows for ids. Sensors are numbered in the order of their first nodes.
class RigLayout {
 public:
  /// @throws InvalidPrior for a node that is not in the graph, stands twice, or is the second of
  ///         its sensor in one frame; for a sensor that no node has, that is given twice, or whose
  ///         matrix is no rotation
  RigLayout(const MeasurementGraph& graph, const Rigs& rigs) {
    using Check = detail::PriorCheck;
    const Check check(graph);
    sensor_of_.assign(graph.nodes().size(), -1);
    frame_of_.assign(graph.nodes().size(), -1);
    std::map<NodeId, NodeId> seen;  // of every row the place in rigs.images
    for (std::size_t k = 0; k < rigs.images.size(); ++k) {
      const RigImage& image = rigs.images[k];
      const Index row = check.row(PriorKind::rig, image.node);
      if (!seen.emplace(row, static_cast<NodeId>(k)).second) {
        throw InvalidPrior(PriorKind::rig, image.node, "stands twice");
      }
    }
    std::map<NodeId, Index> row_of_sensor, row_of_frame;
    std::set<std::pair<Index, Index>> taken;
    for (const auto& [row, k] : seen) {
      const RigImage& image = rigs.images[k];
      const auto sensors = static_cast<Index>(row_of_sensor.size());
      const auto frames = static_cast<Index>(row_of_frame.size());
      sensor_of_[row] = row_of_sensor.emplace(image.sensor, sensors).first->second;
      frame_of_[row] = row_of_frame.emplace(image.frame, frames).first->second;
      if (sensor_of_[row] == sensors) sensors_.push_back(image.sensor);
      if (!taken.insert({frame_of_[row], sensor_of_[row]}).second) {
        throw InvalidPrior(PriorKind::rig, image.node, "is the second of its sensor in one frame");
      }
    }
    num_frames_ = static_cast<Index>(row_of_frame.size());
    origin_.assign(sensors_.size(), SensorOrigin::estimated);
    rotations_.assign(sensors_.size(), Matrix3::Identity());
    for (const KnownSensor& known : rigs.known) {
      const auto found = row_of_sensor.find(known.sensor);
      if (found == row_of_sensor.end()) {
        throw InvalidPrior(PriorKind::sensor, known.sensor, "is of a sensor that no node has");
      }
      const Index s = found->second;
      if (origin_[s] == SensorOrigin::known) {
        throw InvalidPrior(PriorKind::sensor, known.sensor, "stands twice");
      }
      origin_[s] = SensorOrigin::known;
      rotations_[s] = Check::rotation(PriorKind::sensor, known.sensor, known.frame_from_sensor);
    }
    choose_references();
  }

  Index num_sensors() const { return static_cast<Index>(sensors_.size()); }
  Index num_frames() const { return num_frames_; }
  const std::vector<NodeId>& sensors() const { return sensors_; }
  const std::vector<SensorOrigin>& origin() const { return origin_; }
  /// C of every sensor, frame_from_sensor; I of those that are to be estimated.
  const Rotations& rotations() const { return rotations_; }
  /// Rows (n,) of the nodes' sensors and frames; -1 of nodes that are in no rig.
  const std::vector<Index>& sensor_of() const { return sensor_of_; }
  const std::vector<Index>& frame_of() const { return frame_of_; }
  /// Labels (sensors,) of the rigs: sensors that hang together by frames.
  const std::vector<Index>& rig_of() const { return rig_of_; }

  bool is_estimated(Index sensor) const { return origin_[sensor] == SensorOrigin::estimated; }
  bool any_estimated() const {
    return std::find(origin_.begin(), origin_.end(), SensorOrigin::estimated) != origin_.end();
  }

  /// Priors with these rigs, all sensors held.
  /// @param C of every sensor
  Priors held(const MeasurementGraph& graph, Priors priors, const Rotations& C) const {
    return with_cameras(graph, std::move(priors), C, true);
  }
  /// The same without the sensors that are to be estimated: their nodes are frames by themselves.
  Priors without_estimated(const MeasurementGraph& graph, Priors priors) const {
    return with_cameras(graph, std::move(priors), rotations_, false);
  }

 private:
  Priors with_cameras(const MeasurementGraph& graph, Priors priors, const Rotations& C,
                      bool all) const {
    priors.rigs.clear();
    for (Index i = 0; i < graph.num_nodes(); ++i) {
      const Index s = sensor_of_[i];
      if (s < 0 || (!all && is_estimated(s))) continue;
      priors.rigs.push_back({graph.nodes()[i], frame_of_[i], C[s]});
    }
    return priors;
  }

  /// In every rig without a known sensor, the first is the reference.
  void choose_references() {
    std::vector<Index> parent(sensors_.size());
    std::iota(parent.begin(), parent.end(), 0);
    const auto find = [&](Index s) {
      while (parent[s] != s) s = parent[s] = parent[parent[s]];
      return s;
    };
    std::vector<Index> first(static_cast<std::size_t>(num_frames_), -1);
    for (std::size_t i = 0; i < frame_of_.size(); ++i) {
      if (frame_of_[i] < 0) continue;
      Index& other = first[frame_of_[i]];
      if (other < 0) other = sensor_of_[i];
      const Index a = find(other), b = find(sensor_of_[i]);
      parent[std::max(a, b)] = std::min(a, b);  // the first sensor stays the root
    }
    std::vector<bool> has_known(sensors_.size(), false);
    for (Index s = 0; s < num_sensors(); ++s) {
      rig_of_.push_back(find(s));
      if (origin_[s] == SensorOrigin::known) has_known[rig_of_[s]] = true;
    }
    for (Index s = 0; s < num_sensors(); ++s) {
      if (rig_of_[s] == s && !has_known[s]) origin_[s] = SensorOrigin::reference;
    }
  }

  std::vector<NodeId> sensors_;
  std::vector<SensorOrigin> origin_;
  Rotations rotations_;
  std::vector<Index> sensor_of_, frame_of_, rig_of_;
  Index num_frames_ = 0;
};

}  // namespace rotavg

#pragma GCC diagnostic pop
