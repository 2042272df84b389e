#include "palpate/base/file.h"
#include "palpate/json/json.h"
#include "palpate/verification/verification.h"

namespace palpate {

std::string to_json(const SuiteReport& report) {
  Json figures = Json::object();
  for (const Figure& figure : report.figures) {
    Json& entry = figures[figure.name];
    entry = {{"value", figure.value}, {"unit", figure.unit}, {"n", figure.n}};
    if (figure.limit) entry["limit"] = *figure.limit;
  }
  Json notes = Json::object();
  for (const auto& [name, text] : report.notes) notes[name] = text;
  const Json json = {{"suite", report.suite}, {"machine", report.machine},
                     {"build", report.build}, {"date", report.date},
                     {"notes", notes},        {"figures", figures}};
  // invalid UTF-8 is replaced instead of throwing
  return json.dump(2) + "\n";
}

Result<void> write_json(const std::filesystem::path& file, const SuiteReport& report) {
  return write_file(file, to_json(report));
}

}  // namespace palpate
