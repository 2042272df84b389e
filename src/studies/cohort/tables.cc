#include <algorithm>
#include <charconv>
#include <cmath>

#include "palpate/base/file.h"
#include "palpate/base/table_field.h"
#include "palpate/cohort/case.h"
#include "palpate/cohort/cohort_summary.h"
#include "palpate/json/json.h"
#include "palpate/report/cohort_page.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

using Cells = std::vector<double>;

/// A column of the table: title and value.
struct Figure {
  const char* title;
  const char* unit;
  int decimals;
};
constexpr Figure kOfCase[] = {
    {"structures", "", 0},  {"volume", "mm3", 1},      {"parts", "", 0}, {"thinnest", "mm", 2},
    {"gaps", "", 0},        {"palpated", "", 0},       {"held", "", 0},  {"failed steps", "", 0},
    {"mean force", "N", 3}, {"largest force", "N", 3},
};
constexpr Figure kOfStructure[] = {
    {"volume", "mm3", 1}, {"parts", "", 0},       {"thinnest", "mm", 2},  {"gaps", "", 0},
    {"held", "s", 2},     {"mean force", "N", 3}, {"peak force", "N", 3},
};

Cells cells_of_case(const CaseResult& result) {
  double volume = 0, thinnest = kNotAvailable, force = 0;
  double parts = 0, gaps = 0, forces = 0;
  for (const StructureResult& s : result.structures) {
    volume += s.volume_mm3;
    parts += s.components;
    gaps += static_cast<double>(s.gaps);
    // touchable structures only
    if (s.touchable && !std::isnan(s.thinnest_mm) && !(s.thinnest_mm >= thinnest)) thinnest = s.thinnest_mm;
    if (!std::isnan(s.mean_force_N)) force += s.mean_force_N, ++forces;
  }
  const bool ran = result.ticks > 0;
  const auto of_run = [&](double value) { return ran ? value : kNotAvailable; };
  if (result.structures.empty()) return Cells(std::size(kOfCase), kNotAvailable);
  return {static_cast<double>(result.structures.size()),
          volume,
          parts,
          thinnest,
          gaps,
          of_run(result.palpated),
          of_run(result.held),
          of_run(result.failed_steps),
          forces > 0 ? force / forces : kNotAvailable,
          of_run(result.largest_force_N)};
}

Cells cells_of_structure(const CaseResult& result, const std::string& name) {
  const auto s = std::ranges::find(result.structures, name, &StructureResult::name);
  if (s == result.structures.end()) return Cells(std::size(kOfStructure), kNotAvailable);
  return {s->volume_mm3,  static_cast<double>(s->components),
          s->thinnest_mm, static_cast<double>(s->gaps),
          s->held_s,      s->mean_force_N,
          s->peak_force_N};
}

/// Names of structures of all cases, in the order of their first occurrence.
std::vector<std::string> structures_of(const CohortResults& cohort) {
  std::vector<std::string> names;
  for (const auto& result : cohort.results) {
    if (!result) continue;
    for (const StructureResult& s : result->structures)
      if (std::ranges::find(names, s.name) == names.end()) names.push_back(s.name);
  }
  return names;
}

/// Number with a decimal point in any locale; empty if not available.
std::string decimal(double value, int decimals) {
  if (!std::isfinite(value)) return "";
  char text[400];
  const auto end = std::to_chars(text, text + sizeof text, value, std::chars_format::fixed, decimals).ptr;
  const std::string shown(text, end);
  // never "-0.00"
  return shown.find_first_not_of("-0.") == shown.npos && shown.front() == '-' ? shown.substr(1) : shown;
}

std::string state_of(const std::optional<CaseResult>& result) {
  if (!result) return "not done";
  return result->fault.empty() ? "done" : "failed";
}

}  // namespace

std::string cohort_tsv(const CohortResults& cohort) {
  const auto structures = structures_of(cohort);
  std::string text = "case\tstate\tfault\tdims\tspacing_mm";
  const auto head = [&](const std::string& before, const Figure& figure) {
    std::string title = std::string(figure.title) + (*figure.unit ? std::string("_") + figure.unit : "");
    std::ranges::replace(title, ' ', '_');
    text += "\t" + before + title;
  };
  for (const Figure& figure : kOfCase) head("", figure);
  text += "\tticks\trun_hash";
  for (const std::string& name : structures)
    for (const Figure& figure : kOfStructure) head(tsv_field(name) + ":", figure);
  text += "\n";
  for (std::size_t n = 0; n < cohort.cases.size(); ++n) {
    const auto& result = cohort.results[n];
    const CaseResult shown = result.value_or(CaseResult());
    text += tsv_field(cohort.cases[n].name) + "\t" + state_of(result) + "\t" + tsv_field(shown.fault);
    if (shown.structures.empty()) {
      text += "\t\t";
    } else {
      text += "\t" + std::to_string(shown.dims[0]) + "x" + std::to_string(shown.dims[1]) + "x" +
              std::to_string(shown.dims[2]) + "\t";
      for (int a = 0; a < 3; ++a) text += (a > 0 ? "x" : "") + decimal(shown.spacing_mm[a], 4);
    }
    const auto put = [&](const Cells& cells, const Figure* figures) {
      for (std::size_t c = 0; c < cells.size(); ++c) text += "\t" + decimal(cells[c], figures[c].decimals);
    };
    put(cells_of_case(shown), kOfCase);
    char hash[40] = "\t\t";
    if (shown.ticks > 0)
      std::snprintf(hash, sizeof hash, "\t%llu\t%016llx", static_cast<unsigned long long>(shown.ticks),
                    static_cast<unsigned long long>(shown.run_hash));
    text += hash;
    for (const std::string& name : structures) put(cells_of_structure(shown, name), kOfStructure);
    text += "\n";
  }
  return text;
}

std::string times_tsv(const CohortResults& cohort, const fs::path& folder) {
  std::string text = "case\tread_s\tcheck_s\tpalpate_s\tpicture_s\n";
  for (std::size_t n = 0; n < cohort.cases.size(); ++n) {
    text += tsv_field(cohort.cases[n].name);
    const auto file = read_file(case_folder(folder, static_cast<int>(n) + 1) / "times.json", 4096);
    const std::optional<Json> times = Json::parse(file ? *file : "");
    for (const char* name : {"read_s", "check_s", "palpate_s", "picture_s"}) {
      const Json* seconds = times ? times->find(name) : nullptr;
      const bool there = seconds != nullptr && seconds->is_number();
      text += "\t" + decimal(there ? seconds->get<double>() : kNotAvailable, 3);
    }
    text += "\n";
  }
  return text;
}

std::string cohort_page(const CohortResults& cohort, const fs::path& folder, const std::string& program) {
  CohortPage page;
  page.program = program;
  const auto add = [&](const std::string& group, const Figure& figure) {
    page.columns.push_back({group, figure.title, figure.unit, figure.decimals});
  };
  const auto structures = structures_of(cohort);
  for (const Figure& figure : kOfCase) add("", figure);
  for (const std::string& name : structures)
    for (const Figure& figure : kOfStructure) add(name, figure);
  for (std::size_t n = 0; n < cohort.cases.size(); ++n) {
    const auto& result = cohort.results[n];
    const CaseResult shown = result.value_or(CaseResult());
    CohortPage::Row row;
    row.name = cohort.cases[n].name;
    row.state = state_of(result);
    row.fault = shown.fault;
    row.notes = shown.notes;
    row.values = cells_of_case(shown);
    for (const std::string& name : structures)
      for (const double value : cells_of_structure(shown, name)) row.values.push_back(value);
    constexpr std::size_t kMaxPicture = std::size_t{1} << 22;
    if (const auto png = read_file(case_folder(folder, static_cast<int>(n) + 1) / "picture.png", kMaxPicture);
        png && result)
      row.picture_png.assign(png->begin(), png->end());
    page.rows.push_back(std::move(row));
  }
  return cohort_html(page);
}

}  // namespace palpate
