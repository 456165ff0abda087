#pragma once

// Tables out of lines of text: what the readers of rotavg/io take from long files. It is quick
// where every line is as it should be; where one is not, it says no more than that, and the reader
// goes through the file again, line by line, to say what is wrong.

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <rotavg/io/numbers.hpp>
#include <rotavg/parallel/threads.hpp>

#include "lines.hpp"

namespace rotavg_python {

/// One kind of lines.
struct Kind {
  std::string tag;  ///< the first field; "" for lines without one
  /// What the other fields are: i an integer, s a name, n a number, _ something that is not read.
  std::string columns;
};

/// A field of a line, as its place in the text.
struct Place {
  std::int64_t begin;
  std::int64_t size;
};

/// What stands in the lines of one kind, row by row.
struct Rows {
  std::vector<std::int64_t> integers;
  std::vector<Place> names;
  std::vector<double> numbers;
  std::vector<std::int64_t> lines;
};

/// The lines with a tag that no kind has, as number of the line, its begin and its end.
using OtherLines = std::vector<std::array<std::int64_t, 3>>;

/// A part of the text, read.
struct Part {
  std::vector<Rows> rows;  ///< of each kind
  OtherLines others;
};

namespace detail {

class LineReader {
 public:
  LineReader(const char* text, char separator, const std::vector<Kind>& kinds)
      : text_(text), separator_(separator), kinds_(kinds) {}

  /// False at the first line that is not as its kind should be.
  bool read(const Lines& lines, Part& part) const {
    part.rows.resize(kinds_.size());
    std::int64_t number = lines.first;
    for (const char* at = lines.begin; at < lines.end; ++number) {
      const char* const stop = begin_of_line(at, lines.end, 2);
      const char* end = stop > at && stop[-1] == '\n' ? stop - 1 : stop;
      end = std::find(at, end, '#');
      Fields fields(at, end, separator_);
      if (!fields.done() && !read_line(fields, number, at, end, part)) return false;
      at = stop;
    }
    return true;
  }

 private:
  bool read_line(Fields& fields, std::int64_t number, const char* line, const char* line_end,
                 Part& part) const {
    std::size_t kind = 0;
    if (!kinds_[0].tag.empty()) {
      const char *begin = nullptr, *end = nullptr;
      fields.next(begin, end);
      const std::string_view tag(begin, static_cast<std::size_t>(end - begin));
      while (kind < kinds_.size() && kinds_[kind].tag != tag) ++kind;
      if (kind == kinds_.size()) {
        part.others.push_back({number, line - text_, line_end - text_});
        return true;
      }
    }
    Rows& rows = part.rows[kind];
    rows.lines.push_back(number);
    const char *begin = nullptr, *end = nullptr;
    for (const char column : kinds_[kind].columns) {
      if (!fields.next(begin, end) || !read_field(column, begin, end, rows)) return false;
    }
    while (fields.next(begin, end)) {  // separators may stand behind
      if (begin != end) return false;
    }
    return true;
  }

  bool read_field(char column, const char* begin, const char* end, Rows& rows) const {
    switch (column) {
      case 'n': {
        double value = 0.0;
        const bool good = rotavg::io::read_number(begin, end, value);
        rows.numbers.push_back(value);
        return good;
      }
      case 'i': {
        std::int64_t value = 0;
        const bool good = rotavg::io::read_integer(begin, end, value);
        rows.integers.push_back(value);
        return good;
      }
      case 's':
        if (begin == end) return false;
        rows.names.push_back({begin - text_, end - begin});
        [[fallthrough]];
      default:  // another separator in a field would have divided it
        return std::find_if(begin, end, [](char c) { return c == ',' || c == ';'; }) == end;
    }
  }

  const char* text_;
  char separator_;
  const std::vector<Kind>& kinds_;
};

}  // namespace detail

/// Reads the text from line number `first` (from 1) on. Blank lines are passed over, and what
/// stands behind a #. None of the parts where a line is not as it should be, or what ends a line is
/// not \n.
inline std::vector<Part> read_lines(const char* text, const char* end, std::int64_t first,
                                    char separator, const std::vector<Kind>& kinds,
                                    int num_threads) {
  constexpr std::ptrdiff_t size_of_part = 1 << 20;
  std::vector<Lines> lines = parts_of(begin_of_line(text, end, first), end, size_of_part);
  std::vector<Part> parts(lines.size());
  const auto count = static_cast<rotavg::Index>(lines.size());
  const auto at = [](rotavg::Index k) { return static_cast<std::size_t>(k); };

  std::vector<std::int64_t> counts(lines.size());
  rotavg::parallel_for(count, num_threads,
                       [&](rotavg::Index k) { counts[at(k)] = count_lines(lines[at(k)]); });
  for (std::size_t k = 0; k < lines.size(); ++k) {
    if (counts[k] < 0) return {};
    lines[k].first = first;
    first += counts[k];
  }
  const detail::LineReader reader(text, separator, kinds);
  std::atomic<bool> good{true};
  rotavg::parallel_for(count, num_threads, [&](rotavg::Index k) {
    if (!good) return;
    try {
      if (!reader.read(lines[at(k)], parts[at(k)])) good = false;
    } catch (const std::exception&) {  // no memory
      good = false;
    }
  });
  return good ? std::move(parts) : std::vector<Part>{};
}

}  // namespace rotavg_python
