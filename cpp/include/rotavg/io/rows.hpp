#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <rotavg/io/columns.hpp>
#include <rotavg/io/source.hpp>

namespace rotavg::io::detail {

// Rows of text or CSV, and their fields. Between the fields of a row stand semicolons, commas or
// blanks. Where a line has semicolons, a comma in a number is a decimal point.

using Strings = std::vector<std::string>;

/// A row as it stands, or of quoted CSV its fields.
struct Row {
  std::size_t line = 0;
  std::string_view text;
  std::vector<std::string> fields;  ///< without quotes; then there is no text

  bool is_separated() const {
    return !fields.empty() || text.find(',') != text.npos || text.find(';') != text.npos;
  }
};

/// What stands between separators, without blanks around it.
inline Strings separated(std::string_view text, char separator) {
  Strings fields;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(separator, at), text.size());
    fields.emplace_back(stripped(text.substr(at, end - at)));
    at = end + 1;
  }
  return fields;
}

/// What stands between blanks and commas.
inline Strings loose(std::string_view text) {
  std::string spaced(text);
  std::replace(spaced.begin(), spaced.end(), ',', ' ');
  const auto words = words_of(spaced);
  return {words.begin(), words.end()};
}

/// The fields of a row, of which there should be so many; empty ones only of `named` columns.
inline Strings fields_of(const Row& row, const std::vector<std::size_t>& counts, bool named) {
  if (!row.is_separated()) return loose(row.text);
  const bool semicolons = row.text.find(';') != row.text.npos;
  Strings fields =
      row.fields.empty() ? separated(row.text, semicolons ? ';' : ',') : Strings(row.fields);
  const std::size_t most = *std::max_element(counts.begin(), counts.end());
  while (fields.size() > most && stripped(fields.back()).empty()) fields.pop_back();
  if (!row.fields.empty() || semicolons) return fields;
  const bool full = std::none_of(fields.begin(), fields.end(), [](auto& f) { return f.empty(); });
  const bool fits = std::find(counts.begin(), counts.end(), fields.size()) != counts.end();
  return fits && (named || full) ? fields : loose(row.text);
}

inline bool is_number(const std::string& field) {
  double value = 0.0;
  return read_any_number(field, value);
}

/// The lines as rows.
inline std::vector<Row> text_rows(const Source& source) {
  std::vector<Row> rows;
  for (const Line& line : source.lines()) rows.push_back({line.number, line.text, {}});
  return rows;
}

/// Reads what stands between double quotes; returns the place behind the second.
inline std::size_t quoted(const Source& source, std::size_t line, std::string_view text,
                          std::size_t at, std::string& field) {
  for (; at < text.size(); ++at) {
    if (text[at] == '"') {
      if (text.substr(at + 1, 1) != "\"") return at + 1;
      ++at;
    }
    field += text[at];
  }
  source.refuse(line, "found no CSV: a quote is not closed");
}

/// The rows of CSV, where a name may stand between double quotes, "" a quote in it (RFC 4180).
/// Lines that begin with # are comments.
inline std::vector<Row> csv_rows(const Source& source) {
  if (source.content().find('"') == std::string::npos) return text_rows(source);
  source.lines();  // refuses what is binary
  std::vector<Row> rows;
  char separator = 0;
  std::size_t number = 0;
  for (const std::string_view text : source.all_lines()) {
    ++number;
    const std::string_view said = stripped(text);
    if (said.empty() || said[0] == '#') continue;
    if (separator == 0) {
      const auto count = [&](char c) { return std::count(text.begin(), text.end(), c); };
      separator = count(';') > count(',') ? ';' : ',';
    }
    Row row{number, {}, {""}};
    for (std::size_t k = 0; k < text.size(); ++k) {
      std::string& field = row.fields.back();
      if (text[k] == separator) {
        row.fields.emplace_back();
      } else if (text[k] == ' ' && field.empty()) {  // before a field
      } else if (text[k] != '"' || !field.empty()) {
        field += text[k];
      } else {
        const std::size_t behind = quoted(source, number, text, k + 1, field);
        if (behind < text.size() && text[behind] != separator) {
          source.refuse(number,
                        "found no CSV: '" + std::string(1, separator) + "' expected after '\"'");
        }
        k = behind - 1;
      }
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace rotavg::io::detail
