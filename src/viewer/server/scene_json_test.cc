#include "server/scene_json.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "server/test_host.h"

namespace palpate::server {
namespace {

StateRecipient reader(std::uint32_t number, std::uint32_t pointer_owner, int viewers) {
  return {number, {Role::kControl, {}}, pointer_owner, viewers, false, false};
}

using Json = nlohmann::json;
using palpate::testing::FakeHost;

TEST(SceneJson, HasTheDocumentsKeys) {
  FakeHost host;
  const VolumeFacts facts{"0f3a000000000001", 2, -5, {-7, 8}, false};
  const Json json = Json::parse(scene_json(host.scene(), host.state(), facts, {Role::kControl, {}}, false));
  EXPECT_EQ(json["protocol"], 3);
  EXPECT_TRUE(json["palpate"].is_string());
  EXPECT_EQ(json["role"], "control");
  EXPECT_EQ(json["side"], "left");
  EXPECT_EQ(json["oriented"], true);
  EXPECT_EQ(json["modality"], "ct");
  EXPECT_EQ(json["volume"], Json::parse(R"({
    "hash": "0f3a000000000001", "dims": [5, 4, 3],
    "patient_from_voxel": [[0.5, 0, 0, -60], [0, 0.75, 0, -64], [0, 0, 2, -31], [0, 0, 0, 1]],
    "scan": {"scale": 2.0, "offset": -5.0, "window": [12, 480], "range": [-7, 8]},
    "labels": {"type": "uint8"}})"));
  EXPECT_EQ(json["world_from_patient"],
            Json::parse("[[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]"));
  EXPECT_EQ(
      json["structures"],
      Json::parse(R"([{"label": 1, "name": "femur", "colour": [240, 220, 190], "tissue": 0, "within": []},
                            {"label": 2, "name": "tibia", "colour": [10, 20, 30], "tissue": -1, "within": [1]}])"));
  EXPECT_EQ(json["tissues"], Json::parse(R"([
    {"name": "bone", "touchable": true, "protection": "none", "colour": [240, 220, 190], "opacity": 1.0, "stiffness_N_per_mm": 1.5,
     "static_friction": 0.2, "friction": 0.15, "viscosity_N_s_per_mm": 0.001, "rests_on": []},
    {"name": "skin", "touchable": false, "protection": "none", "colour": [1, 2, 3], "opacity": 0.25, "stiffness_N_per_mm": 0.3,
     "static_friction": 0.0, "friction": 0.0, "viscosity_N_s_per_mm": 0.0, "rests_on": [0]}])"));
  EXPECT_EQ(json["tool"],
            Json::parse(R"({"name": "point", "radius_mm": 0.0, "cuts": false, "points_mm": [[0, 0, 0]],
                                          "burr": "cone", "capsules": [{"from_mm": [0, 0, 0], "to_mm": [0, 0, 40],
                                                        "radius_mm": 1.5, "end_radius_mm": 2.0}], "shaver": false, "revolutions_per_s": 0, "flutes": 0})"));
  EXPECT_EQ(json["tools"][0], json["tool"]);
  EXPECT_EQ(json["tools"][1], Json::parse(R"({"name": "drill", "radius_mm": 2.0, "cuts": true, "burr": "ball",
                                              "points_mm": [[0, 0, 0]], "capsules": [], "shaver": true, "revolutions_per_s": 0, "flutes": 0})"));
  EXPECT_EQ(json["tools"].size(), 2u) << "one for each device";
  EXPECT_EQ(json["methods"], Json::parse(R"(["proxy", "trilinear"])"));
  EXPECT_EQ(json["laws"], Json::parse(R"(["elastic", "neo-hookean"])"));
  EXPECT_EQ(json["device"]["input"], "script");
  EXPECT_EQ(json["limits"]["max_force_N"], 1.4);
  EXPECT_EQ(json["rate_hz"], 1000);
  EXPECT_EQ(json.size(), 24u);
  EXPECT_EQ(json["caveats"], Json::array());
  EXPECT_TRUE(json["distances"].is_null());
  EXPECT_TRUE(json["no_go"].empty());
  EXPECT_TRUE(json["tasks"].empty());
  EXPECT_TRUE(json["recording"].is_null());
}

TEST(SceneJson, UnknownValuesAreNull) {
  FakeHost host;
  host.edit_scene().scan = nullptr;
  const Json json = Json::parse(scene_json(host.scene(), host.state(), {}, {Role::kView, {}}, false));
  EXPECT_TRUE(json["volume"]["scan"].is_null());
  EXPECT_TRUE(json["device"]["peak_force_N"].is_null());
  EXPECT_EQ(json["role"], "view");
}

TEST(SceneJson, HasTheCaveatsOfTheModel) {
  FakeHost host;
  host.edit_scene().caveats = {{"force", "two tissues are felt as one\x1b[2J"}};
  const Json json = Json::parse(scene_json(host.scene(), host.state(), {}, {Role::kView, {}}, false));
  EXPECT_EQ(json["caveats"],
            Json::parse(R"([{"concerns": "force", "text": "two tissues are felt as one\\u001b[2J"}])"));
}

TEST(SceneJson, HasNoGoRegions) {
  FakeHost host;
  host.edit_scene().distance_reach_mm = 15;
  host.edit_scene().no_go = {{"artery\x1b[2J", 2, LabelId{2}},
                             {"behind", 1, ViewedNoGo::Plane{{1, 2, 3}, {0, -1, 0}}},
                             {"ball", 0.5, ViewedNoGo::Ball{{4, 5, 6}, 7.5}}};
  const Json json = Json::parse(scene_json(host.scene(), host.state(), {}, {Role::kView, {}}, false));
  EXPECT_EQ(json["distances"], Json::parse(R"({"reach_mm": 15.0})"));
  EXPECT_EQ(json["no_go"], Json::parse(R"([
    {"name": "artery\\u001b[2J", "keep_away_mm": 2.0, "label": 2, "plane": null, "ball": null},
    {"name": "behind", "keep_away_mm": 1.0, "label": null, "plane": {"point_mm": [1, 2, 3], "outward": [0, -1, 0]}, "ball": null},
    {"name": "ball", "keep_away_mm": 0.5, "label": null, "plane": null, "ball": {"centre_mm": [4, 5, 6], "radius_mm": 7.5}}])"));
}

TEST(SceneJson, NamesThatAreNoUtf8DoNotHarm) {
  FakeHost host;
  host.edit_scene().structures[0].name = "f\xff\"</script>\n";
  const Json json = Json::parse(scene_json(host.scene(), host.state(), {}, {Role::kView, {}}, false));
  EXPECT_EQ(json["structures"][0]["name"], "f\\xff\"</script>\\u000a");
}

TEST(SceneJson, DescribesARecording) {
  FakeHost host;
  host.edit_scene().recording = ViewedRecording{
      300,   0.5,
      0.799, {{0.6, 0.7, 1, 1.25, 1}},
      2,     {{0.55, "settings", {"method"}, -1, "viewer", 3}, {0.6, "model", {}, 1, "key", 0}},
      0,     {0, 1.25}};
  const Json json = Json::parse(scene_json(host.scene(), host.state(), {}, {Role::kView, {}}, false));
  EXPECT_EQ(json["recording"], Json::parse(R"({
    "ticks": 300, "begin_s": 0.5, "end_s": 0.799, "contacts": [[0.6, 0.7, 1, 1.25, 1]], "contacts_left_out": 2,
    "events": [{"time_s": 0.55, "kind": "settings", "changed": ["method"], "tissue": null, "by": "viewer", "viewer": 3},
               {"time_s": 0.6, "kind": "model", "changed": [], "tissue": 1, "by": "key", "viewer": null}],
    "events_left_out": 0, "force_N": [0.0, 1.25]})"));
  ViewedState state = host.state();
  state.playback = {true, -2, Error{ErrorKind::kBadInput, "has changed", "run.h5", "open it again"}};
  EXPECT_EQ(Json::parse(state_json(state, reader(1, 0, 1)))["playback"],
            Json::parse(R"({"playing": true, "speed": -2.0,
                            "failed": {"what": "has changed", "where": "", "how": "open it again"}})"));
}

TEST(SceneJson, StateAndAnswers) {
  FakeHost host;
  ViewedState cut = host.state();
  cut.removed_mm3 = {{1, 12.5}};
  cut.broken_off_mm3 = 0.5;
  cut.nearest_mm = {{1, 0.5}};
  cut.strokes_to_undo = 2;
  cut.strokes_to_redo = 1;
  EXPECT_EQ(Json::parse(state_json(cut, reader(1, 1, 2))), Json::parse(R"({
    "type": "state", "method": "proxy", "law": "elastic", "law_awaited": null, "law_failed": null, "law_cells": null, "method_awaited": null, "method_failed": null, "friction": true, "viscosity": true, "passivity": true, "paused": false, "motor": false, "vibration": false, "motor_is_on": false,
    "emergency_stop": false, "stop": null, "stopped_by": null, "max_force_N": 1.4, "rotation_wxyz": [1, 0, 0, 0], "model_version": 1, "strokes": {"undo": 2, "redo": 1}, "removed": [{"label": 1, "mm3": 12.5}], "broken_off_mm3": 0.5, "nearest": [{"label": 1, "mm": 0.5}],
    "tissues": [{"stiffness_N_per_mm": 1.5, "static_friction": 0.2, "friction": 0.15, "viscosity_N_s_per_mm": 0.001},
                {"stiffness_N_per_mm": 0.3, "static_friction": 0, "friction": 0, "viscosity_N_s_per_mm": 0}],
    "armed": false, "recording": false, "playback": null, "viewers": 2, "pointer": true, "pointer_by": "you",
    "lesson": {"learner": null, "of_another": false, "task": null, "names": false, "redacted": false, "learners": null,
               "over": false}})"));
  // the learner is disclosed to teachers and to that learner only
  cut.lesson = {"L042", "hold"};
  for (const auto& [who, learner, of_another] :
       {std::tuple(AuthenticatedViewer{Role::kTeacher, {}}, Json("L042"), false),
        std::tuple(AuthenticatedViewer{Role::kLearner, "L042"}, Json("L042"), false),
        std::tuple(AuthenticatedViewer{Role::kLearner, "L007"}, Json(), true),
        std::tuple(AuthenticatedViewer{Role::kControl, {}}, Json(), false),
        std::tuple(AuthenticatedViewer{Role::kView, {}}, Json(), false)}) {
    const Json lesson = Json::parse(state_json(cut, {1, who, 0, 1, false, false}))["lesson"];
    EXPECT_EQ(lesson["learner"], learner) << name_of(who.role);
    EXPECT_EQ(lesson["of_another"], of_another) << name_of(who.role);
    EXPECT_EQ(lesson["task"], "hold");
  }
  for (const auto& [pointer_owner, by] :
       {std::pair(0u, Json()), std::pair(1u, Json("you")), std::pair(2u, Json("viewer"))}) {
    const Json parsed = Json::parse(state_json(cut, reader(1, pointer_owner, 2)));
    EXPECT_EQ(parsed["pointer"], pointer_owner == 1);
    EXPECT_EQ(parsed["pointer_by"], by);
  }
  ViewedState state = host.state();
  state.method_awaited = "trilinear";
  state.method_failure = Error{ErrorKind::kUnavailable, "no memory", "b-spline", "choose another"};
  state.law_awaited = "layers";
  state.law_cell_mm = 1.5;
  state.requested_cell_mm = 1.25;
  state.law_failure = Error{ErrorKind::kBadInput, "was cut", "elastic", "begin with it"};
  const Json json = Json::parse(state_json(state, reader(1, 1, 2)));
  EXPECT_EQ(json["law_awaited"], "layers");
  EXPECT_EQ(json["law_cells"], Json::parse(R"({"mm": 1.5, "requested_mm": 1.25})"));
  EXPECT_EQ(json["law_failed"],
            Json::parse(R"({"what": "was cut", "where": "elastic", "how": "begin with it"})"));
  EXPECT_EQ(json["method_awaited"], "trilinear");
  EXPECT_EQ(json["method_failed"],
            Json::parse(R"({"what": "no memory", "where": "b-spline", "how": "choose another"})"));
  // originator of the stop, from the receiver's point of view; null without a stop
  state.stopped_by = StoppedBy::kViewer;
  state.stopped_by_viewer = 3;
  EXPECT_TRUE(Json::parse(state_json(state, reader(3, 1, 2)))["stopped_by"].is_null());
  state.stop = 7;
  EXPECT_EQ(Json::parse(state_json(state, reader(3, 1, 2)))["stopped_by"], "you");
  EXPECT_EQ(Json::parse(state_json(state, reader(1, 1, 2)))["stopped_by"], "viewer");
  state.stopped_by = StoppedBy::kKey;
  EXPECT_EQ(Json::parse(state_json(state, reader(3, 1, 2)))["stopped_by"], "key");
  state.stopped_by = StoppedBy::kSession;
  EXPECT_EQ(Json::parse(state_json(state, reader(3, 1, 2)))["stopped_by"], "palpate");
  EXPECT_EQ(
      Json::parse(welcome_json({Role::kView, {}}, false, false)),
      Json::parse(
          R"({"type": "welcome", "role": "view", "learner": null, "may": ["look", "stop", "unseen"], "protocol": 3})"));
  EXPECT_EQ(Json::parse(welcome_json({Role::kLearner, "L042"}, true, true)),
            Json::parse(R"({"type": "welcome", "role": "learner", "learner": "L042",
                            "may": ["look", "stop", "hand", "own_runs"], "protocol": 3})"));
  EXPECT_EQ(Json::parse(done_json(7)), Json::parse(R"({"type": "done", "id": 7})"));
  EXPECT_EQ(
      Json::parse(refused_json(8, {ErrorKind::kUsage, "is too much", "max_force_N", "ask for less"})),
      Json::parse(
          R"({"type": "refused", "id": 8, "what": "is too much", "where": "max_force_N", "how": "ask for less"})"));
  EXPECT_EQ(hash_text(0x0f3a000000000001), "0f3a000000000001");
}

TEST(NavigationJson, AsTheDocumentHasIt) {
  ViewedNavigation navigation{1, true, 0.3049, ViewedNavigation::Error{0.8049, 1.4151, true}};
  EXPECT_EQ(Json::parse(navigation_json(navigation)),
            Json::parse(R"({"type": "navigation", "device": 1, "seen": true,
    "fre_mm": 0.3, "tre_mm": 0.8, "tre_95_mm": 1.42, "far": true})"));
  navigation.tip.reset();
  EXPECT_EQ(Json::parse(navigation_json(navigation)),
            Json::parse(R"({"type": "navigation", "device": 1, "seen": true,
    "fre_mm": 0.3, "tre_mm": null, "tre_95_mm": null, "far": false})"));
}

}  // namespace
}  // namespace palpate::server
