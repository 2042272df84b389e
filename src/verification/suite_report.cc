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

Table arrange(const std::vector<Figure>& figures) {
  Table table;
  for (const Figure& figure : figures) {
    const auto slash = figure.name.rfind('/');
    const std::string path = slash == std::string::npos ? "" : figure.name.substr(0, slash);
    const std::string leaf = slash == std::string::npos ? figure.name : figure.name.substr(slash + 1);
    auto column = std::find(table.columns.begin(), table.columns.end(), leaf);
    if (column == table.columns.end()) column = table.columns.insert(column, leaf);
    const auto index = static_cast<std::size_t>(column - table.columns.begin());
    if (table.rows.empty() || table.rows.back().path != path || table.rows.back().unit != figure.unit ||
        table.rows.back().n != figure.n) {
      table.rows.push_back({path, figure.unit, figure.n, {}});
    }
    std::vector<const Figure*>& cells = table.rows.back().cells;
    cells.resize(std::max(cells.size(), index + 1), nullptr);
    cells[index] = &figure;
  }
  return table;
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
  const nlohmann::ordered_json json = {
      {"suite", report.suite}, {"machine", report.machine}, {"build", report.build}, {"figures", figures}};
  // bytes that are no UTF-8 are replaced rather than thrown at
  return json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

Result<void> write_json(const std::filesystem::path& file, const SuiteReport& report) {
  return write_file(file, to_json(report));
}

std::string to_table(const SuiteReport& report) {
  const Table table = arrange(report.figures);
  // a column for the mark of a figure beyond its limit keeps the numbers in line
  std::vector<std::string> head = {"figure"};
  for (const std::string& column : table.columns) head.push_back(column + " ");
  head.insert(head.end(), {"unit", "n"});
  std::vector<std::vector<std::string>> lines = {head};
  for (const Row& row : table.rows) {
    std::vector<std::string> line = {row.path};
    for (std::size_t c = 0; c < table.columns.size(); ++c) {
      const Figure* cell = c < row.cells.size() ? row.cells[c] : nullptr;
      line.push_back(cell == nullptr ? "" : formatted("%.3f", cell->value) + (cell->ok() ? " " : "!"));
    }
    line.push_back(row.unit);
    line.push_back(std::to_string(row.n));
    lines.push_back(std::move(line));
  }
  return "suite    " + report.suite + "\nmachine  " + report.machine + "\nbuild    " + report.build + "\n\n" +
         aligned(lines) + "\n" + limits_kept(report.figures);
}

}  // namespace palpate
