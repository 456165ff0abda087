#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <rotavg/io/columns.hpp>
#include <rotavg/io/rows.hpp>
#include <rotavg/io/source.hpp>

namespace rotavg::io::detail {

// Tables of rotations in text. The columns are as the caller says, as a header says (a first line
// of names, or the comment just above the first row), or else as the format has them.

/// The rows of a table.
struct Table {
  Layout layout;
  std::vector<std::string> ids;  ///< of all rows, one or two each, as they stand
  std::vector<double> numbers;   ///< of all rows, as layout.numbers() has them; finite
  std::vector<std::size_t> lines;
};

/// The layout that a row says, if it names the columns of a table: no field of it is a number.
inline std::optional<Layout> header_of(const Row& row, std::size_t num_ids) {
  std::vector<Strings> ways{row.fields};
  if (row.fields.empty()) {
    ways = {separated(row.text, row.text.find(';') != row.text.npos ? ';' : ','), loose(row.text)};
  }
  for (Strings& words : ways) {
    while (!words.empty() && words.back().empty()) words.pop_back();
    if (std::any_of(words.begin(), words.end(), is_number)) continue;
    for (std::string& word : words) {
      const std::size_t begin = word.find_first_not_of("\"' ");
      word =
          begin == word.npos ? "" : word.substr(begin, word.find_last_not_of("\"' ") + 1 - begin);
    }
    if (auto layout = layout_of(words, num_ids)) return layout;
  }
  return std::nullopt;
}

/// The words of the comment just above the first line that is none.
inline Strings title_of(const Source& source) {
  Strings words;
  for (std::string_view text : source.all_lines()) {
    text = stripped(text);
    if (text.empty()) continue;
    if (text[0] != '#') break;
    text.remove_prefix(std::min(text.find_first_not_of("# \t"), text.size()));
    std::string spaced(text);
    std::replace(spaced.begin(), spaced.end(), ';', ' ');
    words = loose(spaced);
  }
  return words;
}

/// Reads the rows of one table.
class TableReader {
 public:
  /// @param usual the columns that the format has, each with another number of them, fewest first
  TableReader(const Source& source, std::vector<Strings> usual, std::size_t num_ids)
      : source_(source), usual_(std::move(usual)), num_ids_(num_ids) {
    for (const std::string& word : usual_.front())
      expected_ += (expected_.empty() ? "" : " ") + word;
    for (std::size_t k = usual_.front().size(); k < usual_.back().size(); ++k) {
      expected_ += " [" + usual_.back()[k] + "]";
    }
  }

  /// @param columns what they are, whatever the file says; or ""
  Table read(const std::vector<Row>& rows, const std::string& columns) const {
    Table table;
    std::optional<Layout> layout;
    bool told = !columns.empty(), first = true;
    if (told) {
      layout = layout_of(loose(columns), num_ids_);
      if (!layout) {
        source_.refuse(0, "columns are " + columns + ", expected " + parts() + ", each once");
      }
    }
    for (const Row& row : rows) {
      if (!says_something(row)) continue;
      if (first) {
        if (is_separator_line(row)) continue;
        first = false;
        if (const auto here = header_of(row, num_ids_)) {
          layout = layout ? layout : here;
          told = true;
          continue;
        }
        if (!layout) {
          layout = by_title(row);
          told = layout.has_value();
        }
        if (!layout) layout = usual_layout(row);
      }
      add(table, row, *layout, told);
    }
    if (table.lines.empty()) {
      source_.refuse(0, std::string("the file has no ") + (num_ids_ == 2 ? "edges" : "rotations") +
                            ", expected " + expected_);
    }
    table.layout = *layout;
    return table;
  }

 private:
  static const char* parts() {
    return "i and j (or id), a rotation (qx qy qz qw, rx ry rz or r11 ... r33), and weight";
  }

  /// Whether there is more than separators, as below the rows of a spreadsheet.
  static bool says_something(const Row& row) {
    if (row.fields.empty()) return row.text.find_first_not_of(",; \t\r\f\v") != row.text.npos;
    return std::any_of(row.fields.begin(), row.fields.end(), [](auto& f) { return !f.empty(); });
  }

  /// The line (sep=;) that tells spreadsheets the separator.
  static bool is_separator_line(const Row& row) {
    std::string said(stripped(row.text));
    for (const std::string& field : row.fields) said += (said.empty() ? "" : ";") + field;
    return lower(said.substr(0, 4)) == "sep=" &&
           (said.size() <= 5 || said.find_first_not_of(",;", 5) == said.npos);
  }

  std::optional<Layout> by_title(const Row& row) const {
    const Strings title = title_of(source_);
    auto layout = layout_of(title, num_ids_);
    if (layout && fields_of(row, {title.size()}, true).size() != title.size()) layout.reset();
    return layout;
  }

  /// The format's own layout of as many columns as the first row has.
  Layout usual_layout(const Row& row) const {
    std::vector<std::size_t> counts;
    for (const Strings& words : usual_) counts.push_back(words.size());
    const Strings fields = fields_of(row, counts, false);
    if (fields.size() > 2 && std::none_of(fields.begin(), fields.end(), is_number)) {
      std::string found = "found the header";
      for (const std::string& field : fields) found += " " + shown(field);
      if (num_ids_ == 2 && header_of(row, 1)) {
        source_.refuse(row.line, found +
                                     ": this looks like a solution (id and a rotation), "
                                     "expected edges: " +
                                     expected_);
      }
      source_.refuse(row.line, found + ", expected " + expected_ + "; in a header " + parts() +
                                   "; or say what the columns are (ReadOptions::columns)");
    }
    for (const Strings& words : usual_) {
      if (words.size() == fields.size()) return *layout_of(words, num_ids_);
    }
    const std::string found = count_of(fields.size());
    if (num_ids_ == 1) source_.refuse(row.line, found + ", expected " + expected_);
    if (fields.size() == 5) {
      source_.refuse(row.line, found +
                                   ": this looks like a solution (id qx qy qz qw), expected "
                                   "edges: " +
                                   expected_);
    }
    std::string what;
    for (const std::size_t count : counts)
      what += (what.empty() ? "" : " or ") + std::to_string(count);
    what += ": " + expected_;
    if (fields.size() > 2) {
      what += "; or a header, or ReadOptions::columns, that says what the columns are";
    }
    source_.refuse(row.line, found + ", expected " + what);
  }

  void add(Table& table, const Row& row, const Layout& layout, bool told) const {
    const std::size_t count = layout.words.size();
    Strings fields = fields_of(row, {count}, told);
    if (fields.size() != count) refuse_count(row.line, fields.size(), layout, told);
    for (const std::size_t place : layout.numbers()) {
      std::string& field = fields[place];
      if (stripped(field).empty()) {
        source_.refuse(row.line, layout.words[place] + " is empty, expected a number");
      }
      std::replace(field.begin(), field.end(), ',', '.');
      const double value = number_in(source_, row.line, stripped(field));
      if (!std::isfinite(value)) {
        source_.refuse(row.line,
                       "found " + std::string(stripped(field)) + ", expected a finite number");
      }
      table.numbers.push_back(value);
    }
    for (const std::size_t place : layout.ids) table.ids.push_back(std::move(fields[place]));
    table.lines.push_back(row.line);
  }

  static std::string count_of(std::size_t fields) {
    return "found " + std::to_string(fields) + (fields == 1 ? " field" : " fields");
  }
  [[noreturn]] void refuse_count(std::size_t line, std::size_t here, const Layout& layout,
                                 bool told) const {
    const std::string found = count_of(here);
    const std::size_t count = layout.words.size();
    if (told) {
      std::string words;
      for (const std::string& word : layout.words) words += (words.empty() ? "" : " ") + word;
      source_.refuse(line, found + ", expected " + words);
    }
    if (num_ids_ == 1) source_.refuse(line, found + ", expected " + expected_);
    if (here < 3) {
      source_.refuse(line, found + ", expected " + std::to_string(count) + ": " + expected_);
    }
    source_.refuse(line, "found " + std::to_string(here - 2) + " numbers after the ids, expected " +
                             std::to_string(count - 2));
  }

  const Source& source_;
  std::vector<Strings> usual_;
  std::size_t num_ids_;
  std::string expected_;
};

}  // namespace rotavg::io::detail
