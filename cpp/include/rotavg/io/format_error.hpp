#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>

namespace rotavg::io {

/// A file that does not hold what its format asks for, or cannot be read or written. The message
/// reads `file:line: what was found, what was expected`.
class FormatError : public std::invalid_argument {
 public:
  /// @param line counted from 1; 0 where no line is to blame
  FormatError(const std::string& file, std::size_t line, const std::string& reason)
      : std::invalid_argument(file + (line > 0 ? ":" + std::to_string(line) : "") + ": " + reason),
        file_(file),
        line_(line) {}

  const std::string& file() const { return file_; }
  std::size_t line() const { return line_; }

 private:
  std::string file_;
  std::size_t line_;
};

}  // namespace rotavg::io
