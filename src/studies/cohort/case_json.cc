#include <cmath>
#include <cstdio>

#include "palpate/base/printable.h"
#include "palpate/cohort/case.h"
#include "palpate/json/json.h"

namespace palpate {

std::string case_json(const CaseResult& result) {
  // JSON has no NaN: missing values are null
  const auto maybe = [](double value) { return std::isnan(value) ? Json() : Json(value); };
  char hash[17];
  std::snprintf(hash, sizeof hash, "%016llx", static_cast<unsigned long long>(result.run_hash));
  Json json{{"key", result.key},
            {"fault", result.fault},
            {"dims", result.dims},
            {"spacing_mm", {result.spacing_mm[0], result.spacing_mm[1], result.spacing_mm[2]}},
            {"palpated", result.palpated},
            {"held", result.held},
            {"failed_steps", result.failed_steps},
            {"largest_force_N", maybe(result.largest_force_N)},
            {"ticks", result.ticks},
            {"run_hash", hash},
            {"notes", result.notes},
            {"structures", Json::array()}};
  for (const StructureResult& s : result.structures)
    json["structures"].push_back({{"name", s.name},
                                  {"volume_mm3", s.volume_mm3},
                                  {"components", s.components},
                                  {"thinnest_mm", maybe(s.thinnest_mm)},
                                  {"gaps", s.gaps},
                                  {"touchable", s.touchable},
                                  {"held_s", maybe(s.held_s)},
                                  {"mean_force_N", maybe(s.mean_force_N)},
                                  {"peak_force_N", maybe(s.peak_force_N)}});
  // invalid UTF-8 in a name is preserved as far as possible
  return json.dump(1) + "\n";
}

std::optional<CaseResult> parse_case_json(std::string_view text) try {
  constexpr std::size_t kMaxStructures = 65'536, kMaxNotes = 10'000;
  const std::optional<Json> parsed = Json::parse(text);
  if (!parsed) return std::nullopt;
  const Json& json = *parsed;
  const auto maybe = [](const Json& value) { return value.is_null() ? kNotAvailable : value.get<double>(); };
  CaseResult result;
  result.key = json.at("key").get<std::string>();
  result.fault = printable(json.at("fault").get<std::string>());
  result.dims = json.at("dims").get<std::array<int, 3>>();
  const auto spacing = json.at("spacing_mm").get<std::array<double, 3>>();
  result.spacing_mm = Eigen::Vector3d(spacing[0], spacing[1], spacing[2]);
  result.palpated = json.at("palpated").get<int>();
  result.held = json.at("held").get<int>();
  result.failed_steps = json.at("failed_steps").get<int>();
  result.largest_force_N = maybe(json.at("largest_force_N"));
  result.ticks = json.at("ticks").get<std::uint64_t>();
  const auto hash = json.at("run_hash").get<std::string>();
  if (hash.size() != 16 || hash.find_first_not_of("0123456789abcdef") != hash.npos) return std::nullopt;
  result.run_hash = std::stoull(hash, nullptr, 16);
  for (const Json& note : json.at("notes")) result.notes.push_back(printable(note.get<std::string>()));
  for (const Json& s : json.at("structures")) {
    StructureResult one;
    one.name = s.at("name").get<std::string>();
    one.volume_mm3 = s.at("volume_mm3").get<double>();
    one.components = s.at("components").get<int>();
    one.thinnest_mm = maybe(s.at("thinnest_mm"));
    one.gaps = s.at("gaps").get<std::size_t>();
    one.touchable = s.at("touchable").get<bool>();
    one.held_s = maybe(s.at("held_s"));
    one.mean_force_N = maybe(s.at("mean_force_N"));
    one.peak_force_N = maybe(s.at("peak_force_N"));
    result.structures.push_back(std::move(one));
  }
  if (result.structures.size() > kMaxStructures || result.notes.size() > kMaxNotes) return std::nullopt;
  return result;
} catch (const JsonError&) {
  return std::nullopt;
}

}  // namespace palpate
