#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <regex>

#include "palpate/json/json.h"
#include "palpate/records/records.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;

std::string titled(std::string_view stored) {
  return "Name of " + std::string(stored);
}

RunRecord exported_run() {
  RunRecord run;
  run.id = 7;
  run.learner = "=L1,\"2\"";
  run.task = "Find the nodule / 2";
  run.task_hash = "0f";
  run.started_utc = "2026-01-02T03:04:05Z";
  run.palpate_version = "0.1.0";
  run.score_hash = "aa";
  run.duration_s = 61.256;
  run.in_band = false;
  run.metrics = {{"time", "s", 61.256, {}, 95, true, true},
                 {"answer_error", "mm", {}, {}, 5, true, false},
                 {"peak_force", "N", 0.1, {}, {}, false, false}};
  return run;
}

TEST(Csv, HasALineForEachMetric) {
  const std::string rows = csv_rows(exported_run());
  EXPECT_THAT(rows, ::testing::StartsWith("7,\"'=L1,\"\"2\"\"\",Find the nodule / 2,0f,"));
  EXPECT_EQ(std::count(rows.begin(), rows.end(), '\n'), 3);
  EXPECT_THAT(rows, HasSubstr(",answer_error,mm,,,5,1,0\r\n"));
  // numbers survive the round trip exactly
  EXPECT_THAT(rows, HasSubstr("0.10000000000000001"));
  const std::string heading = csv_heading();
  RunRecord plain = exported_run();
  plain.learner = "L1";
  const std::string row = csv_rows(plain).substr(0, csv_rows(plain).find('\r'));
  EXPECT_EQ(std::count(row.begin(), row.end(), ','), std::count(heading.begin(), heading.end(), ','));
  plain.metrics.clear();
  const std::string bare = csv_rows(plain);
  EXPECT_EQ(std::count(bare.begin(), bare.end(), ','), std::count(heading.begin(), heading.end(), ','));
}

TEST(Xapi, IsAStatementOfItsStandard) {
  const Json json = Json::parse(xapi_statement(exported_run(), "https://school.example", titled)).value();
  EXPECT_TRUE(
      std::regex_match(json["id"].get<std::string>(),
                       std::regex("[0-9a-f]{8}-[0-9a-f]{4}-8[0-9a-f]{3}-[89ab][0-9a-f]{3}-[0-9a-f]{12}")));
  EXPECT_EQ(json["actor"]["account"]["name"], "=L1,\"2\"");
  EXPECT_EQ(json["actor"]["account"]["homePage"], "https://school.example");
  EXPECT_EQ(json["verb"]["id"], "http://adlnet.gov/expapi/verbs/failed");
  EXPECT_EQ(json["object"]["id"], "https://palpate.invalid/xapi/tasks/Find%20the%20nodule%20%2F%202");
  EXPECT_EQ(json["result"]["success"], false);
  EXPECT_EQ(json["result"]["score"]["scaled"], 0.5);
  EXPECT_EQ(json["result"]["duration"], "PT61.26S");
  EXPECT_EQ(json["timestamp"], "2026-01-02T03:04:05Z");
  EXPECT_EQ(json["result"]["extensions"]["https://palpate.invalid/xapi/metrics"]["answer_error"]["name"],
            "Name of answer_error");
  EXPECT_TRUE(json["result"]["extensions"]["https://palpate.invalid/xapi/metrics"]["answer_error"]["value"]
                  .is_null());
}

TEST(Xapi, TheSameRunHasTheSameId) {
  const auto id = [](const RunRecord& run) {
    return Json::parse(xapi_statement(run, "https://a", titled)).value().at("id");
  };
  RunRecord run = exported_run();
  EXPECT_EQ(id(run), id(run));
  run.score_hash = "ab";
  EXPECT_NE(id(run), id(exported_run()));
  run = exported_run();
  run.learner = "L2";
  EXPECT_NE(id(run), id(exported_run()));
}

TEST(Xapi, DurationsAreIso) {
  EXPECT_EQ(iso_duration(0), "PT0.00S");
  EXPECT_EQ(iso_duration(-3), "PT0.00S");
  EXPECT_EQ(iso_duration(3600.5), "PT3600.50S");
}

}  // namespace
}  // namespace palpate
