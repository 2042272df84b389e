#include <cmath>
#include <cstdio>

#include "palpate/base/hash.h"
#include "palpate/base/table_field.h"
#include "palpate/json/json.h"
#include "palpate/records/records.h"

namespace palpate {
namespace {

std::string number(const std::optional<double>& value) {
  if (!value) return "";
  char text[40];
  std::snprintf(text, sizeof text, "%.17g", *value);
  return text;
}

std::string uuid_of(const RunRecord& run) {
  std::uint64_t halves[2];
  for (std::size_t n = 0; n < 2; ++n) {
    std::uint64_t hash = kHashSeed + n;
    for (const std::string* text : {&run.learner, &run.task_hash, &run.started_utc, &run.score_hash}) {
      hash_word(hash, text->size());
      hash_bytes(hash, text->data(), text->size());
    }
    halves[n] = hash_finish(hash);
  }
  // UUID version 8 (RFC 9562): custom
  halves[0] = (halves[0] & ~0xf000ull) | 0x8000ull;
  halves[1] = (halves[1] & ~(3ull << 62)) | (2ull << 62);
  char text[40];
  std::snprintf(text, sizeof text, "%08x-%04x-%04x-%04x-%012llx", static_cast<unsigned>(halves[0] >> 32),
                static_cast<unsigned>(halves[0] >> 16 & 0xffff), static_cast<unsigned>(halves[0] & 0xffff),
                static_cast<unsigned>(halves[1] >> 48),
                static_cast<unsigned long long>(halves[1] & 0xffffffffffffull));
  return text;
}

// percent-encodes characters that an IRI does not allow
std::string iri_part(const std::string& text) {
  std::string part;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '.';
    char coded[4];
    std::snprintf(coded, sizeof coded, "%%%02X", byte);
    part += plain ? std::string(1, c) : coded;
  }
  return part;
}

}  // namespace

std::string csv_heading() {
  return "run,learner,task,task_hash,started_utc,data_set,palpate_version,commit,device,hand,settings_hash,"
         "run_hash,"
         "score_hash,duration_s,in_band,metric,unit,value,at_least,at_most,counts,metric_in_band\r\n";
}

std::string csv_rows(const RunRecord& run) {
  std::string start = std::to_string(run.id);
  for (const std::string* text :
       {&run.learner, &run.task, &run.task_hash, &run.started_utc, &run.data_set, &run.palpate_version,
        &run.commit, &run.device, &run.hand, &run.settings_hash, &run.run_hash, &run.score_hash})
    start += "," + csv_field(*text);
  start += "," + number(run.duration_s) + "," + (run.in_band ? "1" : "0");
  if (run.metrics.empty()) return start + ",,,,,,,\r\n";
  std::string rows;
  for (const RunMetric& metric : run.metrics)
    rows += start + "," + csv_field(metric.name) + "," + csv_field(metric.unit) + "," + number(metric.value) +
            "," + number(metric.at_least) + "," + number(metric.at_most) + "," + (metric.counts ? "1" : "0") +
            "," + (metric.in_band ? "1" : "0") + "\r\n";
  return rows;
}

std::string iso_duration(double seconds) {
  char text[40];
  // xAPI compares durations with a precision of 0.01 s
  std::snprintf(text, sizeof text, "PT%.2fS",
                std::isfinite(seconds) && seconds > 0 ? std::min(seconds, 1e9) : 0.0);
  return text;
}

std::string xapi_statement(const RunRecord& run, const std::string& home_page, const MetricTitle& title_of) {
  constexpr const char* kOurs = "https://palpate.invalid/xapi/";
  int counted = 0, in_band = 0;
  Json metrics = Json::object();
  for (const RunMetric& metric : run.metrics) {
    counted += metric.counts;
    in_band += metric.counts && metric.in_band;
    Json entry{{"name", title_of(metric.name)},
               {"value", metric.value ? Json(*metric.value) : Json(nullptr)},
               {"unit", metric.unit}};
    if (metric.at_least) entry["at_least"] = *metric.at_least;
    if (metric.at_most) entry["at_most"] = *metric.at_most;
    metrics[metric.name] = entry;
  }
  Json result{{"success", run.in_band}, {"duration", iso_duration(run.duration_s)}};
  // fraction of the graded metrics, if any
  if (counted > 0) result["score"] = {{"scaled", static_cast<double>(in_band) / counted}};
  result["extensions"] = {{std::string(kOurs) + "metrics", metrics},
                          {std::string(kOurs) + "task_hash", run.task_hash},
                          {std::string(kOurs) + "score_hash", run.score_hash},
                          {std::string(kOurs) + "settings_hash", run.settings_hash}};
  const Json statement{
      {"id", uuid_of(run)},
      {"actor", {{"objectType", "Agent"}, {"account", {{"homePage", home_page}, {"name", run.learner}}}}},
      {"verb",
       {{"id",
         run.in_band ? "http://adlnet.gov/expapi/verbs/passed" : "http://adlnet.gov/expapi/verbs/failed"},
        {"display", {{"en", run.in_band ? "passed" : "failed"}}}}},
      {"object",
       {{"objectType", "Activity"},
        {"id", std::string(kOurs) + "tasks/" + iri_part(run.task)},
        {"definition",
         {{"type", "http://adlnet.gov/expapi/activities/simulation"}, {"name", {{"en", run.task}}}}}}},
      {"result", result},
      {"context", {{"platform", "palpate " + run.palpate_version}}},
      {"timestamp", run.started_utc}};
  return statement.dump();
}

}  // namespace palpate
