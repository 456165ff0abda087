#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include <rotavg/io/numbers.hpp>
#include <rotavg/types.hpp>

namespace rotavg::io {

/// What nodes are called: names, which stand for 0, 1, 2 …, or where there are none, their numbers.
///
///     NodeIds ids;
///     const MeasurementGraph graph({{ids.add("left"), ids.add("right"), R}});
///     ids.name(graph.nodes()[0])  // "left"
class NodeIds {
 public:
  /// The id of a name, a new one if it is not known yet.
  NodeId add(const std::string& name) {
    const auto [place, is_new] = id_of_.emplace(name, static_cast<NodeId>(names_.size()));
    if (is_new) names_.push_back(name);
    return place->second;
  }

  /// The id of a name or, where there are none, of a number.
  std::optional<NodeId> find(const std::string& name) const {
    if (names_.empty()) {
      NodeId id = 0;
      const char* const text = name.data();
      return read_integer(text, text + name.size(), id) ? std::optional<NodeId>(id) : std::nullopt;
    }
    const auto place = id_of_.find(name);
    return place == id_of_.end() ? std::nullopt : std::optional<NodeId>(place->second);
  }

  /// What a node is called.
  /// @throws std::out_of_range if there are names, but none for this id
  std::string name(NodeId id) const {
    return names_.empty() ? std::to_string(id) : names_.at(static_cast<std::size_t>(id));
  }

  /// Whether nodes are called by their numbers.
  bool empty() const { return names_.empty(); }
  std::size_t size() const { return names_.size(); }

 private:
  std::vector<std::string> names_;
  std::unordered_map<std::string, NodeId> id_of_;
};

}  // namespace rotavg::io
