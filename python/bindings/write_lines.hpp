#pragma once

// Lines of text from tables, to the byte as Python would write them.

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include <rotavg/io/numbers.hpp>
#include <rotavg/parallel/threads.hpp>

namespace rotavg_python {

/// A table to write: in every line the tag, the integers and the numbers of a row, and a tail.
struct Output {
  std::string tag;  ///< with what divides it from the integers; or ""
  char separator = ' ';
  bool short_zeros = false;  ///< 0 for a zero of either sign, not 0.0
  std::string tail;          ///< what all lines end with, the \n included
  const std::int64_t* integers = nullptr;
  std::size_t num_integers = 0;  ///< in a row
  const double* numbers = nullptr;
  std::size_t num_numbers = 0;  ///< in a row
};

inline void append_row(std::string& text, const Output& table, std::size_t row) {
  text += table.tag;
  char digits[24];
  bool first = true;
  const auto divide = [&] {
    if (!first) text += table.separator;
    first = false;
  };
  for (std::size_t k = 0; k < table.num_integers; ++k) {
    divide();
    const auto end =
        std::to_chars(digits, digits + sizeof digits, table.integers[row * table.num_integers + k]);
    text.append(digits, end.ptr);
  }
  for (std::size_t k = 0; k < table.num_numbers; ++k) {
    divide();
    const double value = table.numbers[row * table.num_numbers + k];
    if (table.short_zeros && value == 0.0) {
      text += '0';
    } else {
      rotavg::io::append_number(text, value);
    }
  }
  text += table.tail;
}

/// The lines of the rows, part by part.
inline std::vector<std::string> write_lines(const Output& table, std::size_t rows,
                                            int num_threads) {
  constexpr std::size_t rows_of_part = 1 << 13;
  std::vector<std::string> parts((rows + rows_of_part - 1) / rows_of_part);
  const std::size_t width =
      table.tag.size() + 21 * table.num_integers + 25 * table.num_numbers + table.tail.size();
  for (std::string& part : parts) part.reserve(rows_of_part * width);
  rotavg::parallel_for(static_cast<rotavg::Index>(parts.size()), num_threads, [&](auto part) {
    const auto k = static_cast<std::size_t>(part);
    const std::size_t end = std::min(rows, (k + 1) * rows_of_part);
    for (std::size_t row = k * rows_of_part; row < end; ++row) append_row(parts[k], table, row);
  });
  return parts;
}

}  // namespace rotavg_python
