#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <rotavg/io/numbers.hpp>

namespace rotavg::io::detail {

// What the columns of a table of rotations are, by the names that people give them.
//
//     i j, or id                        node ids; from/to, name1/name2, image_id1/image_id2 …
//     qx qy qz qw, in any order         a quaternion
//     rx ry rz                          a rotation vector in radians
//     r11 r12 … r33, or r00 … r22       a matrix, row and column
//     weight                            if there is one
//     cxx cxy cxz cyy cyz czz           the covariance of the rotation, radians^2, if there is one
//
// Other columns are not read.

/// Where what stands in a row of a table.
struct Layout {
  std::vector<std::string> words;     ///< the names of all columns, as given
  std::vector<std::size_t> ids;       ///< one or two
  std::vector<std::size_t> rotation;  ///< 4: x y z w, 3: a vector, or 9 row by row
  std::vector<std::size_t> covariance;
  std::optional<std::size_t> weight, component;

  /// Places of all that must be numbers.
  std::vector<std::size_t> numbers() const {
    std::vector<std::size_t> places(rotation);
    places.insert(places.end(), covariance.begin(), covariance.end());
    if (weight) places.push_back(*weight);
    return places;
  }
  /// Names of the columns that are not read, with commas between them.
  std::string unread() const {
    std::vector<std::size_t> read = numbers();
    read.insert(read.end(), ids.begin(), ids.end());
    if (component) read.push_back(*component);
    std::string names;
    for (std::size_t k = 0; k < words.size(); ++k) {
      if (std::find(read.begin(), read.end(), k) != read.end()) continue;
      if (words[k].empty() || words[k] == "_") continue;
      names += (names.empty() ? "" : ", ") + words[k];
    }
    return names;
  }
};

namespace columns {

using Words = std::vector<std::string>;

inline bool is_one_of(std::string_view word, std::initializer_list<std::string_view> words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

inline bool is_node(std::string_view word) {
  return is_one_of(word,
                   {"id", "node", "nodeid", "image", "imageid", "img", "imgid", "name", "imagename",
                    "frame", "frameid", "cam", "camera", "view", "idx", "index"});
}
inline bool is_node_or_file(std::string_view word) {
  return is_node(word) || is_one_of(word, {"filename", "file", "timestamp"});
}

/// What is before the last `count` letters, if these are among some; else something else.
inline std::string_view before(std::string_view word, std::size_t count, std::string_view letters) {
  if (word.size() <= count) return "?";
  const std::string_view last = word.substr(word.size() - count);
  if (last.find_first_not_of(letters) != last.npos) return "?";
  return word.substr(0, word.size() - count);
}

/// One of our names for a column, or else the word.
inline std::string our_name(const std::string& word, bool zero_based) {
  const auto last = [&](std::size_t count) { return word.substr(word.size() - count); };
  if (is_one_of(before(word, 2, "012"), {"r", "m", "rot"}) && zero_based) {
    std::string place = last(2);
    for (char& c : place) ++c;
    return "r" + place;
  }
  if (is_one_of(before(word, 1, "xyzw"), {"q", "quat", "quaternion"})) return "q" + last(1);
  if (is_one_of(before(word, 1, "xyz"),
                {"r", "rv", "rvec", "rotvec", "rot", "rotationvector", "w", "omega", "so3"})) {
    return "r" + last(1);
  }
  if (is_one_of(before(word, 2, "123"), {"r", "m", "rot"})) return "r" + last(2);
  return word == "weights" ? "weight" : word;
}

/// What tells the ends of an edge apart: image1, id_i …; 0 without such.
inline char mark_of(std::string_view word) {
  if (is_node(before(word, 1, "012ijab"))) return word.back();
  for (const std::string_view start : {"from", "to", "source", "target", "src", "dst"}) {
    if (word.substr(0, start.size()) == start && is_node_or_file(word.substr(start.size()))) {
      return is_one_of(start, {"from", "source", "src"}) ? 'i' : 'j';
    }
  }
  return 0;
}

/// Places of i and j; none unless each is there once.
inline std::vector<std::size_t> edge_ends(const Words& words) {
  std::vector<char> marks;
  for (const std::string& word : words) marks.push_back(mark_of(word));
  const bool zero_based = std::find(marks.begin(), marks.end(), '0') != marks.end();
  std::array<std::vector<std::size_t>, 2> places;
  for (std::size_t k = 0; k < words.size(); ++k) {
    const char mark = marks[k];
    const bool first = is_one_of(words[k], {"i", "from", "source", "src", "first", "u"}) ||
                       mark == 'i' || mark == 'a' || mark == (zero_based ? '0' : '1');
    const bool second = is_one_of(words[k], {"j", "to", "target", "dst", "second", "v"}) ||
                        mark == 'j' || mark == 'b' || mark == (zero_based ? '1' : '2');
    if (first || second) places[first ? 0 : 1].push_back(k);
  }
  if (places[0].size() != 1 || places[1].size() != 1) return {};
  return {places[0][0], places[1][0]};
}

/// Place of the node's id; none unless there is one.
inline std::vector<std::size_t> node(const Words& words) {
  std::vector<std::size_t> named_id, others;
  for (std::size_t k = 0; k < words.size(); ++k) {
    if (words[k] == "id") named_id.push_back(k);
    if (is_node_or_file(words[k])) others.push_back(k);
  }
  const auto& places = named_id.empty() ? others : named_id;
  return places.size() == 1 ? places : std::vector<std::size_t>{};
}

/// Places of the names, the first of each; none unless all are there.
inline std::vector<std::size_t> places_of(const Words& names,
                                          std::initializer_list<const char*> wanted) {
  std::vector<std::size_t> places;
  for (const char* const name : wanted) {
    const auto place = std::find(names.begin(), names.end(), name);
    if (place == names.end()) return {};
    places.push_back(static_cast<std::size_t>(place - names.begin()));
  }
  return places;
}

inline std::vector<std::size_t> rotation(const Words& names) {
  auto places = places_of(names, {"qx", "qy", "qz", "qw"});
  if (places.empty()) {
    places = places_of(names, {"r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33"});
  }
  return places.empty() ? places_of(names, {"rx", "ry", "rz"}) : places;
}

}  // namespace columns

/// The layout that these names of columns say; none where a part is not there, or twice.
/// @param num_ids 2 of edges, 1 of nodes
inline std::optional<Layout> layout_of(const std::vector<std::string>& words, std::size_t num_ids) {
  columns::Words plain;
  for (const std::string& word : words) {
    std::string letters;
    for (const char c : lower(word)) {
      if ((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9')) letters += c;
    }
    plain.push_back(letters);
  }
  const bool zero_based = std::any_of(plain.begin(), plain.end(), [](const std::string& word) {
    return columns::is_one_of(columns::before(word, 2, "012"), {"r", "m", "rot"}) &&
           word.substr(word.size() - 2).find('0') != word.npos;
  });
  columns::Words names;
  for (const std::string& word : plain) names.push_back(columns::our_name(word, zero_based));
  Layout layout;
  layout.rotation = columns::rotation(names);
  if (layout.rotation.empty()) {
    for (std::string& name : names) {
      if (columns::is_one_of(name, {"x", "y", "z", "w"})) name = "q" + name;
    }
    layout.rotation = columns::rotation(names);
  }
  if (layout.rotation.empty()) return std::nullopt;
  layout.words = words;
  layout.ids = num_ids == 2 ? columns::edge_ends(plain) : columns::node(plain);
  if (num_ids == 2) {
    layout.covariance = columns::places_of(names, {"cxx", "cxy", "cxz", "cyy", "cyz", "czz"});
  }
  // A w that is not of a quaternion is a weight.
  const auto weight = std::find(names.begin(), names.end(), "weight");
  const bool spelt = weight != names.end();
  const auto w = spelt ? weight : std::find(names.begin(), names.end(), "w");
  std::vector<std::size_t> single = layout.numbers();
  if (w != names.end()) {
    single.push_back(static_cast<std::size_t>(w - names.begin()));
    if (num_ids == 2) layout.weight = single.back();
  }
  const auto component = std::find(names.begin(), names.end(), "component");
  if (component != names.end() && num_ids == 1) {
    layout.component = static_cast<std::size_t>(component - names.begin());
  }
  const bool twice = std::any_of(single.begin(), single.end(), [&](std::size_t place) {
    return std::count(names.begin(), names.end(), names[place]) > 1;
  });
  if (layout.ids.empty() || twice) return std::nullopt;
  return layout;
}

}  // namespace rotavg::io::detail
