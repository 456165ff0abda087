#pragma once

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <istream>
#include <iterator>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include <rotavg/io/format_error.hpp>
#include <rotavg/io/numbers.hpp>

namespace rotavg::io {

/// A line of a file that is neither blank nor a comment: its number, from 1, and what stands before
/// a # in it.
struct Line {
  std::size_t number = 0;
  std::string_view text;
};

/// What to read: a file, by its path, or a stream. Holds all of its content.
class Source {
 public:
  /// @throws FormatError if the file cannot be read
  Source(const std::string& path) : name_(path) {  // NOLINT: read_g2o("in.g2o")
    errno = std::filesystem::is_directory(path) ? EISDIR : 0;
    std::ifstream stream(path, std::ios::binary);
    if (errno == 0 && stream) content_.assign(std::istreambuf_iterator<char>(stream), {});
    if (errno != 0 || !stream) {
      refuse(0, "cannot be read: " + std::generic_category().message(errno != 0 ? errno : EIO));
    }
  }
  Source(const char* path) : Source(std::string(path)) {}
  /// @param name for errors
  Source(std::istream& stream, std::string name = "input") : name_(std::move(name)) {
    content_.assign(std::istreambuf_iterator<char>(stream), {});
  }

  const std::string& name() const { return name_; }
  const std::string& content() const { return content_; }

  /// Where the content begins, behind a byte order mark.
  std::size_t begin() const { return content_.compare(0, 3, "\xef\xbb\xbf") == 0 ? 3 : 0; }

  [[noreturn]] void refuse(std::size_t line, const std::string& reason) const {
    throw FormatError(name_, line, reason);
  }

  /// All lines, without what ends them: LF, CRLF or CR.
  std::vector<std::string_view> all_lines() const {
    std::vector<std::string_view> lines;
    const std::string_view text = content_;
    for (std::size_t at = begin(); at < text.size();) {
      const std::size_t end = std::min(text.find_first_of("\r\n", at), text.size());
      lines.push_back(text.substr(at, end - at));
      at = end + (text.substr(end, 2) == "\r\n" ? 2 : 1);
    }
    return lines;
  }

  /// The lines that say something.
  /// @param expected what the file should hold
  /// @throws FormatError for an empty file, and for a binary one
  std::vector<Line> lines(const char* expected = "a measurement graph") const {
    if (content_.find_first_not_of(" \t\r\n\v\f") == std::string::npos) {
      refuse(0, std::string("the file is empty, expected ") + expected);
    }
    const std::size_t zero = content_.find('\0');
    if (zero != std::string::npos) {
      const auto end = content_.begin() + static_cast<std::ptrdiff_t>(zero);
      const auto line = static_cast<std::size_t>(std::count(content_.begin(), end, '\n')) + 1;
      refuse(line, "the file is binary, expected lines of text");
    }
    std::vector<Line> found;
    std::size_t number = 0;
    for (std::string_view text : all_lines()) {
      ++number;
      text = text.substr(0, text.find('#'));
      if (text.find_first_not_of(" \t\v\f") != text.npos) found.push_back({number, text});
    }
    return found;
  }

 private:
  std::string name_;
  std::string content_;
};

namespace detail {

/// Without blanks around it.
inline std::string_view stripped(std::string_view text) {
  constexpr const char* blanks = " \t\r\n\v\f";
  const std::size_t begin = text.find_first_not_of(blanks);
  if (begin == text.npos) return {};
  return text.substr(begin, text.find_last_not_of(blanks) + 1 - begin);
}

/// What stands between blanks.
inline std::vector<std::string_view> words_of(std::string_view text) {
  constexpr const char* blanks = " \t\r\n\v\f";
  std::vector<std::string_view> words;
  for (std::size_t at = text.find_first_not_of(blanks); at != text.npos;) {
    const std::size_t end = std::min(text.find_first_of(blanks, at), text.size());
    words.push_back(text.substr(at, end - at));
    at = text.find_first_not_of(blanks, end);
  }
  return words;
}

/// A field as messages show it, cut short if it is long.
inline std::string shown(std::string_view field) {
  const bool is_long = field.size() > 40;
  std::string text(1, '\'');  // not "'" + ...: GCC 12 takes that for an overlap (its bug 105651)
  text += field.substr(0, is_long ? 37 : 40);
  text += is_long ? "...'" : "'";
  return text;
}

/// The number in a field of a line.
/// @throws FormatError if there is none
inline double number_in(const Source& source, std::size_t line, std::string_view field) {
  double value = 0.0;
  if (!read_any_number(field, value)) {
    source.refuse(line, "found " + shown(field) + ", expected a number");
  }
  return value;
}

}  // namespace detail

/// Writes a file whole or not at all: to a new one beside it that then takes its place. Pipes and
/// devices are written to directly.
/// @throws FormatError if it cannot be written; what was there before is as it was
inline void write_file(const std::string& path, const std::string& content) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  fs::path target = path;
  for (int links = 0; links < 40 && fs::is_symlink(target, ignored); ++links) {
    target = target.parent_path() / fs::read_symlink(target, ignored);  // a link stays a link
  }
  const bool exists = fs::exists(target, ignored);
  const bool direct = exists && !fs::is_regular_file(target, ignored);
  const auto refuse = [&](const std::string& reason) {
    throw FormatError(path, 0, "cannot be written: " + reason);
  };
  errno = 0;
  fs::path place = target;
  if (!direct) {
    if (exists && !std::ofstream(target, std::ios::app)) {  // write protected
      refuse(std::generic_category().message(errno));
    }
    place += ".new";
  }
  std::ofstream stream(place, std::ios::binary);
  stream << content << std::flush;
  const int error = errno;
  stream.close();
  if (!stream) {
    if (!direct) fs::remove(place, ignored);
    refuse(std::generic_category().message(error != 0 ? error : EIO));
  }
  if (direct) return;
  std::error_code problem;
  if (exists) fs::permissions(place, fs::status(target, ignored).permissions(), ignored);
  fs::rename(place, target, problem);
  if (problem) {
    fs::remove(place, ignored);
    refuse(problem.message());
  }
}

}  // namespace rotavg::io
