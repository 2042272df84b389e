#include <algorithm>
#include <cstdio>
#include <optional>

#include "palpate/verification/verification.h"

namespace palpate {
namespace {

std::string formatted(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string without_trailing_spaces(const std::string& line) {
  return line.substr(0, line.find_last_not_of(' ') + 1);
}

// Figures whose names differ only in the last part.
struct Row {
  std::string path, unit;
  std::uint64_t n;
  std::vector<const Figure*> cells;  // by column; null: none
};

struct Table {
  std::vector<std::string> columns;
  std::vector<Row> rows;
};

// A row whose first column is not in the table starts a new table.
std::vector<Table> arrange(const std::vector<Figure>& figures) {
  std::vector<Table> tables;
  for (const Figure& figure : figures) {
    const auto slash = figure.name.rfind('/');
    const std::string path = slash == std::string::npos ? "" : figure.name.substr(0, slash);
    const std::string leaf = slash == std::string::npos ? figure.name : figure.name.substr(slash + 1);
    const Row* last = tables.empty() ? nullptr : &tables.back().rows.back();
    const bool new_row =
        last == nullptr || last->path != path || last->unit != figure.unit || last->n != figure.n;
    const auto has_leaf = [&](const Table& table) {
      return std::find(table.columns.begin(), table.columns.end(), leaf) != table.columns.end();
    };
    if (new_row && (tables.empty() || !has_leaf(tables.back()))) tables.emplace_back();
    Table& table = tables.back();
    if (!has_leaf(table)) table.columns.push_back(leaf);
    if (new_row) table.rows.push_back({path, figure.unit, figure.n, {}});
    const auto column = std::find(table.columns.begin(), table.columns.end(), leaf) - table.columns.begin();
    std::vector<const Figure*>& cells = table.rows.back().cells;
    cells.resize(std::max(cells.size(), static_cast<std::size_t>(column) + 1), nullptr);
    cells[static_cast<std::size_t>(column)] = &figure;
  }
  return tables;
}

// Pads each cell to its column; the first column is left-aligned, the others right-aligned.
std::string aligned(const std::vector<std::vector<std::string>>& lines) {
  std::vector<std::size_t> widths;
  for (const auto& line : lines) {
    widths.resize(std::max(widths.size(), line.size()), 0);
    for (std::size_t i = 0; i < line.size(); ++i) widths[i] = std::max(widths[i], line[i].size());
  }
  std::string text;
  for (const auto& line : lines) {
    std::string row;
    for (std::size_t i = 0; i < line.size(); ++i) {
      const std::string padding(widths[i] - line[i].size(), ' ');
      row += i == 0 ? line[i] + padding : "  " + padding + line[i];
    }
    text += without_trailing_spaces(row) + "\n";
  }
  return text;
}

// counts are integers
std::string cell_text(const Figure& figure) {
  return formatted(figure.unit == "ticks" ? "%.0f" : "%.3f", figure.value) + (figure.ok() ? " " : "!");
}

// a separate column for the mark of figures beyond their limit keeps the numbers aligned
std::vector<std::vector<std::string>> lines_of(const Table& table) {
  std::vector<std::string> head = {"figure"};
  for (const std::string& column : table.columns) head.push_back(column + " ");
  head.insert(head.end(), {"unit", "n"});
  std::vector<std::vector<std::string>> lines = {head};
  for (const Row& row : table.rows) {
    std::vector<std::string> line = {row.path};
    for (std::size_t c = 0; c < table.columns.size(); ++c) {
      const Figure* cell = c < row.cells.size() ? row.cells[c] : nullptr;
      line.push_back(cell == nullptr ? "" : cell_text(*cell));
    }
    line.push_back(row.unit);
    line.push_back(std::to_string(row.n));
    lines.push_back(std::move(line));
  }
  return lines;
}

// A table with more rows is laid out as a WideTable for readability.
constexpr std::size_t kMaxRows = 40;

// The parts of a figure's name: first/middle/quantity/leaf.
struct NameParts {
  std::string first, middle, quantity, leaf;
};

std::optional<NameParts> parts_of(const std::string& name) {
  const auto first = name.find('/'), leaf = name.rfind('/');
  if (first == std::string::npos || first == leaf) return {};
  const auto quantity = name.rfind('/', leaf - 1);
  if (quantity == first) return {};
  return NameParts{name.substr(0, first), name.substr(first + 1, quantity - first - 1),
                   name.substr(quantity + 1, leaf - quantity - 1), name.substr(leaf + 1)};
}

// Figures with the same first part: a row per middle part, with the leaves of every quantity side by side.
struct WideTable {
  struct Column {
    std::string leaf;
    std::vector<const Figure*> cells;  // by row; null: none
  };
  struct Quantity {
    std::string name, unit;
    std::vector<Column> columns;
  };
  std::string first;
  std::vector<std::string> rows;
  std::vector<Quantity> quantities;

  void add(const NameParts& parts, const Figure& figure) {
    const auto row = std::find(rows.begin(), rows.end(), parts.middle);
    const auto index = static_cast<std::size_t>(row - rows.begin());
    if (row == rows.end()) rows.push_back(parts.middle);
    auto quantity = std::find_if(quantities.begin(), quantities.end(), [&](const Quantity& known) {
      return known.name == parts.quantity && known.unit == figure.unit;
    });
    if (quantity == quantities.end())
      quantity = quantities.insert(quantity, {parts.quantity, figure.unit, {}});
    auto column = std::find_if(quantity->columns.begin(), quantity->columns.end(),
                               [&](const Column& known) { return known.leaf == parts.leaf; });
    if (column == quantity->columns.end()) column = quantity->columns.insert(column, {parts.leaf, {}});
    column->cells.resize(std::max(column->cells.size(), index + 1), nullptr);
    column->cells[index] = &figure;
  }
};

std::string padded_left(const std::string& text, std::size_t width) {
  return std::string(width > text.size() ? width - text.size() : 0, ' ') + text;
}

std::string wide_text(const WideTable& table) {
  std::size_t width = table.first.size();
  for (const std::string& row : table.rows) width = std::max(width, row.size());
  const auto label = [&](const std::string& text) { return text + std::string(width - text.size(), ' '); };
  // the title of each quantity spans its columns; the first column is wide enough for it
  constexpr std::size_t kColumn = 10;
  std::string titles = label(""), heads = label(table.first);
  std::vector<std::string> lines;
  for (const std::string& row : table.rows) lines.push_back(label(row));
  for (const WideTable::Quantity& quantity : table.quantities) {
    const std::string title = "  " + quantity.name + ", " + quantity.unit + " ";
    const std::size_t columns = kColumn * quantity.columns.size();
    titles += padded_left(title, columns);
    const std::size_t spare = title.size() > columns ? title.size() - columns : 0;
    for (std::size_t c = 0; c < quantity.columns.size(); ++c) {
      const WideTable::Column& column = quantity.columns[c];
      const std::size_t column_width = kColumn + (c == 0 ? spare : 0);
      heads += padded_left(column.leaf + " ", column_width);
      for (std::size_t r = 0; r < lines.size(); ++r) {
        const Figure* cell = r < column.cells.size() ? column.cells[r] : nullptr;
        lines[r] += padded_left(cell == nullptr ? "" : cell_text(*cell), column_width);
      }
    }
  }
  std::string text;
  for (const std::string& line : lines) text += without_trailing_spaces(line) + "\n";
  return without_trailing_spaces(titles) + "\n" + without_trailing_spaces(heads) + "\n" + text;
}

// Empty if a name has fewer than four parts.
std::optional<std::string> wide_tables(const Table& table) {
  std::vector<WideTable> tables;
  for (const Row& row : table.rows) {
    for (const Figure* figure : row.cells) {
      if (figure == nullptr) continue;
      const auto parts = parts_of(figure->name);
      if (!parts) return {};
      if (tables.empty() || tables.back().first != parts->first) tables.push_back({parts->first, {}, {}});
      tables.back().add(*parts, *figure);
    }
  }
  std::string text;
  for (const WideTable& wide : tables) text += "\n" + wide_text(wide);
  return text;
}

std::string limits_met(const std::vector<Figure>& figures) {
  std::string broken;
  int limits = 0, within_limit = 0;
  for (const Figure& figure : figures) {
    if (!figure.limit) continue;
    ++limits;
    if (figure.ok()) {
      ++within_limit;
    } else {
      broken += "beyond its limit: " + figure.name + " " + formatted("%.4g", figure.value) + " > " +
                formatted("%.4g", *figure.limit) + " " + figure.unit + "\n";
    }
  }
  return std::to_string(within_limit) + " of " + std::to_string(limits) + " limits kept\n" + broken;
}

}  // namespace

std::string to_table(const SuiteReport& report) {
  std::string text;
  std::vector<std::vector<std::string>> head = {
      {"suite", report.suite}, {"machine", report.machine}, {"build", report.build}};
  for (const auto& [name, note] : report.notes) head.push_back({name, note});
  std::size_t width = 0;
  for (const auto& line : head) width = std::max(width, line[0].size());
  for (const auto& line : head)
    text += line[0] + std::string(width + 2 - line[0].size(), ' ') + line[1] + "\n";
  for (const Table& table : arrange(report.figures)) {
    const auto wide = table.rows.size() > kMaxRows ? wide_tables(table) : std::nullopt;
    text += wide ? *wide : "\n" + aligned(lines_of(table));
  }
  return text + "\n" + limits_met(report.figures);
}

}  // namespace palpate
