#include <nlohmann/json.hpp>

#include "palpate/base/file.h"
#include "palpate/verification/verification.h"

namespace palpate {

std::string to_json(const SuiteReport& report) {
  nlohmann::ordered_json figures = nlohmann::ordered_json::object();
  for (const Figure& figure : report.figures) {
    nlohmann::ordered_json& entry = figures[figure.name];
    entry = {{"value", figure.value}, {"unit", figure.unit}, {"n", figure.n}};
    if (figure.limit) entry["limit"] = *figure.limit;
  }
  nlohmann::ordered_json notes = nlohmann::ordered_json::object();
  for (const auto& [name, text] : report.notes) notes[name] = text;
  const nlohmann::ordered_json json = {{"suite", report.suite}, {"machine", report.machine},
                                       {"build", report.build}, {"date", report.date},
                                       {"notes", notes},        {"figures", figures}};
  // bytes that are no UTF-8 are replaced rather than thrown at
  return json.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

Result<void> write_json(const std::filesystem::path& file, const SuiteReport& report) {
  return write_file(file, to_json(report));
}

}  // namespace palpate
