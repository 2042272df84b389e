#include "server/task_json.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "server/test_host.h"

namespace palpate::server {
namespace {

using Json = nlohmann::json;

TEST(TaskJson, ATaskHasTheDocumentsKeys) {
  const Json json = Json::parse(task_json(testing::test_task()).dump());
  EXPECT_EQ(json, Json::parse(R"json({
    "name": "hold", "title": "Hold\\u001b[31m", "briefing": "Press.\nGently.", "quiz": true, "ordered": true, "ends_with_steps": false,
    "time_limit_s": 60.0, "answer_s": null, "to_find": [2], "in_a_row": 3, "scope": {"optics_deg": 30.0, "back_mm": 8.0},
    "regions": [{"name": "front", "middle_mm": [1.0, 2.0, 3.0], "radius_mm": 12.5, "outward": [0.0, -1.0, 0.0]}],
    "steps": [{"name": "push", "kind": "touch", "region": 0, "force_N": [0.8, null], "seconds": 3.0, "coverage": 0.5, "seen": true}],
    "forces": [{"labels": [1, 2], "band_N": [0.8, 1.2], "limit_N": null}],
    "protected": [{"labels": [2], "limit_N": 0.2}],
    "metrics": [{"name": "peak_force", "unit": "N", "labels": [1], "more_is_better": false, "at_least": null, "at_most": 8.5, "basis": "Tuijthof"},
                {"name": "time", "unit": "s", "labels": [], "more_is_better": false, "at_least": null, "at_most": null, "basis": null}]})json"));
}

TEST(TaskJson, HowFarARunIs) {
  ViewedTraining training;
  Json json = Json::parse(training_json(training));
  EXPECT_EQ(json["type"], "task");
  EXPECT_EQ(json["phase"], "none");
  EXPECT_TRUE(json["task"].is_null());
  training = testing::test_training();
  json = Json::parse(training_json(training));
  EXPECT_EQ(
      json,
      Json::parse(
          R"({"type": "task", "phase": "running", "run": 3, "task": "hold", "time_s": 1.235, "done": [false],
    "share": [0.333], "forces_N": [1.1], "protected_N": [0.0], "touch_N": 1.5, "unseen": true, "missing_s": 0.0,
    "events": [{"kind": "over_limit", "part": 0, "time_s": 1.0, "force_N": 2.6}], "events_before": 4, "keeps": true})"));
}

TEST(TaskJson, ADebriefingHasEveryDigitOfItsFigures) {
  ViewedDebriefing debriefing = testing::test_debriefing();
  Json json = Json::parse(debriefing_json(debriefing));
  EXPECT_EQ(json["type"], "debriefing");
  EXPECT_EQ(json["metrics"][0]["value"].get<double>(), 0.1 + 0.2) << "bit for bit";
  EXPECT_TRUE(json["metrics"][1]["value"].is_null());
  EXPECT_TRUE(json["metrics"][1]["best"].is_null());
  EXPECT_EQ(json["samples"],
            Json::parse("[[0.02, 1.0, 2.0, 3.457, 1.5, 1.1], [0.04, null, null, null, 0.0, 0.0]]"));
  EXPECT_EQ(json["patches"], Json::parse("[[0.5, 1.5, 2.5, 1], [0.5, 1.5, 3.5, 0]]"));
  EXPECT_EQ(json["kept"], 17);
  EXPECT_TRUE(json["not_stored"].is_null());
  EXPECT_EQ(json["answer_mm"], Json::parse("[1.0, 2.0, 3.0]"));
  EXPECT_TRUE(json["to_find_mm"].is_null());
  EXPECT_EQ(json.size(), 23u);
  debriefing.run_id.reset();
  debriefing.not_stored = Error{ErrorKind::kOutput, "the disk is full", "/home/x/records.db", "make room"};
  json = Json::parse(debriefing_json(debriefing));
  EXPECT_EQ(json["not_stored"]["what"], "the disk is full");
  EXPECT_EQ(json["not_stored"]["where"], "") << "no path leaves the machine";
}

}  // namespace
}  // namespace palpate::server
