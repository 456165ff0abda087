#pragma once

// Lines of text in memory: where they begin, and what stands between blanks and separators in them.
// Nothing here knows Python, files, or what the numbers mean.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

namespace rotavg_python {

/// Part of the text: whole lines.
struct Lines {
  const char* begin;
  const char* end;
  std::int64_t first;  ///< number of the first line
};

/// Where line number `line` (from 1) begins: behind so many \n.
inline const char* begin_of_line(const char* begin, const char* end, std::int64_t line) {
  while (--line > 0 && begin < end) {
    const void* const feed = std::memchr(begin, '\n', static_cast<std::size_t>(end - begin));
    begin = feed == nullptr ? end : static_cast<const char*>(feed) + 1;
  }
  return begin;
}

/// The text in parts of about `size` bytes; the line numbers are not yet in them.
inline std::vector<Lines> parts_of(const char* begin, const char* end, std::ptrdiff_t size) {
  std::vector<Lines> parts;
  while (begin < end) {
    const char* stop = end - begin > size ? begin + size : end;
    if (stop < end) stop = begin_of_line(stop, end, 2);
    parts.push_back({begin, stop, 0});
    begin = stop;
  }
  return parts;
}

/// Number of lines; -1 where a zero or a \r that stands alone make it doubtful.
inline std::int64_t count_lines(const Lines& text) {
  const auto size = static_cast<std::size_t>(text.end - text.begin);
  if (std::memchr(text.begin, '\0', size) != nullptr) return -1;
  const char* at = text.begin;
  while ((at = static_cast<const char*>(
              std::memchr(at, '\r', static_cast<std::size_t>(text.end - at)))) != nullptr) {
    if (++at == text.end || *at != '\n') return -1;
  }
  return std::count(text.begin, text.end, '\n');
}

inline bool is_blank(char c) {
  return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f';
}

/// What a line holds, field by field.
class Fields {
 public:
  /// @param separator between fields; a blank for any number of blanks
  Fields(const char* begin, const char* end, char separator)
      : at_(begin), end_(end), separator_(separator) {
    skip_blanks();
  }

  bool done() const { return at_ == end_; }

  /// The next field; false if there is none. It may be empty only between separators.
  bool next(const char*& begin, const char*& end) {
    if (separator_ == ' ') {
      if (at_ == end_) return false;
      begin = at_;
      while (at_ < end_ && !is_blank(*at_)) ++at_;
      end = at_;
      skip_blanks();
      return true;
    }
    if (ended_) return false;
    begin = at_;
    while (at_ < end_ && *at_ != separator_) ++at_;
    end = at_;
    while (end > begin && is_blank(end[-1])) --end;
    ended_ = at_ == end_;
    if (!ended_) ++at_;
    skip_blanks();
    return true;
  }

 private:
  void skip_blanks() {
    while (at_ < end_ && is_blank(*at_)) ++at_;
  }

  const char* at_;
  const char* end_;
  char separator_;
  bool ended_ = false;
};

}  // namespace rotavg_python
