#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "palpate/verification.h"

namespace palpate {
namespace {

std::string formatted(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

// Figures whose names differ in the last part only.
struct Row {
  std::string path, unit;
  std::uint64_t n;
  std::vector<const Figure*> cells;  // by column; null: none
};

struct Table {
  std::vector<std::string> columns;
  std::vector<Row> rows;
};

// A row whose first column is new to the table begins another table.
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

// Each cell padded to its column; the first to the left, the others to the right.
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
    text += row.substr(0, row.find_last_not_of(' ') + 1) + "\n";
  }
  return text;
}

// counts are whole
std::string cell_text(const Figure& figure) {
  return formatted(figure.unit == "ticks" ? "%.0f" : "%.3f", figure.value) + (figure.ok() ? " " : "!");
}

// a column for the mark of a figure beyond its limit keeps the numbers in line
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

std::string limits_kept(const std::vector<Figure>& figures) {
  std::string broken;
  int limits = 0, kept = 0;
  for (const Figure& figure : figures) {
    if (!figure.limit) continue;
    ++limits;
    if (figure.ok()) {
      ++kept;
    } else {
      broken += "beyond its limit: " + figure.name + " " + formatted("%.4g", figure.value) + " > " +
                formatted("%.4g", *figure.limit) + " " + figure.unit + "\n";
    }
  }
  return std::to_string(kept) + " of " + std::to_string(limits) + " limits kept\n" + broken;
}

}  // namespace

std::string to_json(const SuiteReport& report) {
  nlohmann::ordered_json figures = nlohmann::ordered_json::object();
  for (const Figure& figure : report.figures) {
    nlohmann::ordered_json& entry = figures[figure.name];
    entry = {{"value", figure.value}, {"unit", figure.unit}, {"n", figure.n}};
    if (figure.limit) entry["limit"] = *figure.limit;
  }
  nlohmann::ordered_json notes = nlohmann::ordered_json::object();
  for (const auto& [name, text] : report.notes) notes[name] = text;
  const nlohmann::ordered_json json = {{"suite", report.suite},
                                       {"machine", report.machine},
                                       {"build", report.build},
                                       {"notes", notes},
                                       {"figures", figures}};
  // bytes that are no UTF-8 are replaced rather than thrown at
  return json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

Result<void> write_json(const std::filesystem::path& file, const SuiteReport& report) {
  return write_file(file, to_json(report));
}

std::string to_table(const SuiteReport& report) {
  std::string text;
  std::vector<std::vector<std::string>> head = {
      {"suite", report.suite}, {"machine", report.machine}, {"build", report.build}};
  for (const auto& [name, note] : report.notes) head.push_back({name, note});
  std::size_t width = 0;
  for (const auto& line : head) width = std::max(width, line[0].size());
  for (const auto& line : head)
    text += line[0] + std::string(width + 2 - line[0].size(), ' ') + line[1] + "\n";
  for (const Table& table : arrange(report.figures)) text += "\n" + aligned(lines_of(table));
  return text + "\n" + limits_kept(report.figures);
}

}  // namespace palpate
