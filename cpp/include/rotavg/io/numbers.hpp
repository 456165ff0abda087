#pragma once

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <locale>
#include <sstream>
#include <string>
#include <string_view>
#include <system_error>

namespace rotavg::io {

// Numbers as text, whatever the locale.

inline bool is_digit(char c) { return c >= '0' && c <= '9'; }

/// Whether this is an integer of any size as everyone writes it: no +, no zeros before it.
inline bool is_plain_integer(const char* begin, const char* end) {
  if (begin < end && *begin == '-') {
    ++begin;
    if (end - begin == 1 && *begin == '0') return false;
  }
  if (begin == end || (end - begin > 1 && *begin == '0')) return false;
  return std::all_of(begin, end, is_digit);
}

/// A plain integer of 64 bits; false for all else.
inline bool read_integer(const char* begin, const char* end, std::int64_t& value) {
  if (!is_plain_integer(begin, end)) return false;
  const auto [stop, error] = std::from_chars(begin, end, value);
  return error == std::errc{} && stop == end;
}

/// A number of the classic locale where the library has no better way, or to tell what is too large
/// from what is too small.
inline bool read_number_by_stream(const std::string& text, double& value) {
  std::istringstream stream(text);
  stream.imbue(std::locale::classic());
  stream >> value;
  if (!stream) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    if (std::abs(value) < std::numeric_limits<double>::max()) return false;
    value = value < 0.0 ? -infinity : infinity;
  }
  return stream.peek() == std::istringstream::traits_type::eof();
}

/// A finite number in decimals, to the nearest double; false for all else.
inline bool read_number(const char* begin, const char* end, double& value) {
  if (begin == end) return false;
  const char* const digits = *begin == '+' || *begin == '-' ? begin + 1 : begin;
  if (digits == end || !(is_digit(*digits) || *digits == '.')) return false;
  const char* const start = *begin == '+' ? digits : begin;
#ifdef __cpp_lib_to_chars
  const auto [stop, error] = std::from_chars(start, end, value);
  return error == std::errc{} && stop == end;
#else
  return read_number_by_stream(std::string(start, end), value) && std::isfinite(value);
#endif
}

/// Letters of ASCII as small ones, all else as it is.
inline std::string lower(std::string_view text) {
  std::string letters(text);
  for (char& c : letters) c = static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
  return letters;
}

/// A number as anybody may write it: also one beyond the range of doubles, nan, inf or infinity.
inline bool read_any_number(std::string_view field, double& value) {
  const char *const begin = field.data(), *const end = begin + field.size();
  if (read_number(begin, end, value)) return true;
  std::string word = lower(field);
  const bool negative = !word.empty() && word[0] == '-';
  if (negative || (!word.empty() && word[0] == '+')) word.erase(0, 1);
  if (word == "nan" || word == "inf" || word == "infinity") {
    const double size = word == "nan" ? std::numeric_limits<double>::quiet_NaN()
                                      : std::numeric_limits<double>::infinity();
    value = negative ? -size : size;
    return true;
  }
  // A mantissa and an exponent: what is right, but out of range.
  std::size_t k = 0, given = 0;
  for (; k < word.size() && (is_digit(word[k]) || word[k] == '.'); ++k) given += word[k] != '.';
  const auto points = std::count(word.begin(), word.begin() + static_cast<std::ptrdiff_t>(k), '.');
  if (given == 0 || points > 1) return false;
  if (k < word.size()) {
    if (word[k++] != 'e') return false;
    if (k < word.size() && (word[k] == '+' || word[k] == '-')) ++k;
    if (k == word.size() ||
        !std::all_of(word.begin() + static_cast<std::ptrdiff_t>(k), word.end(), is_digit)) {
      return false;
    }
  }
  return read_number_by_stream((negative ? "-" : "") + word, value);
}

/// Appends the shortest text that reads back as this double, laid out as Python's repr: with an
/// exponent from 1e16 on and below 1e-4, and otherwise with a point.
inline void append_number(std::string& text, double value) {
#ifdef __cpp_lib_to_chars
  char digits[32];
  const char* const end =
      std::to_chars(digits, digits + sizeof digits, value, std::chars_format::scientific).ptr;
  const char* at = digits;
  if (std::isnan(value)) {
    text += "nan";
    return;
  }
  if (*at == '-') text += *at++;
  if (std::isinf(value)) {
    text += "inf";
    return;
  }
  const char* const mark = std::find(at, end, 'e');
  int exponent = 0;
  std::from_chars(mark[1] == '+' ? mark + 2 : mark + 1, end, exponent);
  if (exponent < -4 || exponent >= 16) {  // as it is
    text.append(at, end);
    return;
  }
  const int given = mark - at > 1 ? static_cast<int>(mark - at) - 1 : 1;  // digits
  const char* const behind = at + 2;                                      // those behind the first
  if (exponent < 0) {
    text += "0.";
    text.append(static_cast<std::size_t>(-exponent - 1), '0');
    text += *at;
    text.append(behind, static_cast<std::size_t>(given - 1));
    return;
  }
  text += *at;
  const int before = std::min(given - 1, exponent);
  text.append(behind, static_cast<std::size_t>(before));
  text.append(static_cast<std::size_t>(exponent - before), '0');
  text += '.';
  if (given - 1 > before) {
    text.append(behind + before, static_cast<std::size_t>(given - 1 - before));
  } else {
    text += '0';
  }
#else
  std::ostringstream stream;
  stream.imbue(std::locale::classic());
  stream.precision(17);
  stream << value;
  text += stream.str();
#endif
}

}  // namespace rotavg::io
