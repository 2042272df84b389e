#include <iomanip>
#include <iostream>

#include "apps/command/text.h"
#include "info.h"
#include "palpate/volume_io/identifiers.h"

namespace palpate::app {
namespace {

Json identifiers_json(const IdentifierReport& report) {
  Json rows = Json::array();
  for (const IdentifierRow& row : report.rows) {
    Json json{{"kind", description_of(row.kind)},
              {"what", row.what},
              {"files", row.files},
              {"different", row.different}};
    if (!row.example.empty()) json["example"] = row.example;
    rows.push_back(std::move(json));
  }
  return {{"files", report.files},
          {"identifiers", std::move(rows)},
          {"burnt_in_unsaid", report.burnt_in_unstated},
          {"notes", report.notes}};
}

void print_identifiers(std::ostream& out, const IdentifierReport& report) {
  const auto files = [](std::size_t count) {
    return std::to_string(count) + (count == 1 ? " file" : " files");
  };
  out << "in " << files(report.files) << " of DICOM";
  if (report.rows.empty()) out << ": no patient identifiers";
  out << '\n';
  std::optional<IdentifierKind> kind;
  for (const IdentifierRow& row : report.rows) {
    if (kind != row.kind) out << '\n' << description_of(row.kind) << '\n';
    kind = row.kind;
    out << "  " << std::left << std::setw(48) << row.what << " in " << files(row.files);
    if (row.different > 1)
      out << ", " << row.different << (row.different == kMaxIdentifierValues ? " or more values" : " values");
    if (!row.example.empty()) out << ": " << row.example;
    out << '\n';
  }
  if (report.burnt_in_unstated > 0)
    print_wrapped(out,
                  files(report.burnt_in_unstated) +
                      " do not state whether text is burnt into the pixels (BurnedInAnnotation (0028,0301)): "
                      "inspect them",
                  "\n", "");
  for (const std::string& note : report.notes) print_wrapped(out, note, "  - ", "    ");
}

}  // namespace

int run_identifiers(const InfoOptions& options, Console& console) {
  const auto report = find_identifiers(options.file, options.keep_identifiers, console.progress());
  if (!report) return console.fail(report.error());
  if (options.json)
    std::cout << identifiers_json(*report).dump(2) << '\n';
  else
    print_identifiers(std::cout, *report);
  return kExitOk;
}

}  // namespace palpate::app
