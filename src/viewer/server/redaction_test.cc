#include "server/redaction.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <random>
#include <type_traits>

#include "base/test_folder.h"
#include "base/test_seed.h"
#include "server/distance_message.h"
#include "server/pose_message.h"
#include "server/redacted_region.h"
#include "server/scene_json.h"
#include "server/test_client.h"
#include "server/test_host.h"

namespace palpate::server {
namespace {

using palpate::test::TemporaryFolder;
using palpate::test::write_private;
using palpate::testing::FakeHost;
using palpate::testing::Json;
using palpate::testing::number_at;
using palpate::testing::request;
using palpate::testing::test_task;
using palpate::testing::TestAnswer;
using palpate::testing::TestServer;
using palpate::testing::TestViewer;

constexpr const char *kLearnerToken = "learner-token-k7wq2mzr9xbt4",
                     *kTeacherToken = "teacher-token-k7wq2mzr9xbt4";

using Index3 = std::array<int, 3>;
constexpr Index3 kHere{9, 12, 12}, kElsewhere{14, 11, 15};

/// Replaces the host's scene by a block of label 1 that contains a ball of label 2, to be found; label 3 lies
/// at its edge.
void hide_a_ball(FakeHost& host, const Index3& at = kHere, int radius = 5) {
  GridGeometry grid;
  grid.dims = {24, 24, 24};
  grid.spacing_mm = {1, 1, 1};
  Volume<LabelId> labels(grid);
  for (int k = 0; k < 24; ++k)
    for (int j = 0; j < 24; ++j)
      for (int i = 0; i < 24; ++i) {
        const Index3 off{i - at[0], j - at[1], k - at[2]};
        const bool in_ball = off[0] * off[0] + off[1] * off[1] + off[2] * off[2] <= radius * radius;
        labels.at(i, j, k) = in_ball ? 2 : i < 4 ? 3 : j > 3 ? 1 : 0;
      }
  ViewedScene& scene = host.edit_scene();
  scene.labels = label_bricks(labels);
  // other voxels, other hash
  scene.content_hash = scene.labels->content_hash();
  auto scan = std::make_shared<Volume<float>>(grid);
  scene.scan = scan;
  scene.structures = {{1, "soft_tissue", {240, 220, 190}, 0, {}},
                      {2, "nodule", {10, 20, 30}, 1, {1}},
                      {3, "rib", {9, 9, 9}, -1, {2}}};
  scene.tissues = {{"skin", true, {240, 220, 190}, 1, {}}, {"nodule", true, {1, 2, 3}, 0.25, {0}}};
  scene.tools = {{"point", 0, false, "", {{0, 0, 0}}, {}}};
  scene.tasks = {test_task()};
  scene.tasks[0].regions = {{"block", {}, 0, {}, ViewedTask::Region::Extent{{1, 2}, {}, {}, {}, 0, {}}},
                            {"ball", {}, 0, {}, ViewedTask::Region::Extent{{2}, {}, {}, {}, 0, {}}}};
  for (ViewedTask::Region& region : scene.tasks[0].regions) region = region_in(scene, region);
  scene.caveats = {{"force", "tissues of 0.1 to 0.2 N/mm are felt as one"}};
  scene.no_go = {{"nodule", 1, LabelId{2}}};
  scene.distance_reach_mm = 20;
}

DeviceTick on_the_ball() {
  DeviceTick device;
  device.label = 2;
  device.path_label = {1, 2};
  device.path_depth_mm = {3, 1};
  device.path_share = {0.4, 0.6};
  device.contact_label = {1, 2, 3};
  device.contact_part = {0, 1, 2};
  device.contact_N = {0.5, 1.5, 0.25};
  device.contact_patient_mm = {1, 2, 3, 4, 5, 6, 7, 8, 9};
  device.near_label = {2, 1, 3};
  device.near_mm = {-1, 0.5, 7};
  return device;
}

TEST(Redaction, HiddenStructuresTakeTheLabelOfTheirSurroundings) {
  FakeHost host;
  hide_a_ball(host);
  const Redaction redaction(host.scene());
  const Volume<LabelId> before = host.scene().labels->dense(), after = redaction.scene().labels->dense();
  for (std::size_t v = 0; v < before.voxels().size(); ++v)
    ASSERT_EQ(after.voxels()[v], before.voxels()[v] == 2 ? 1 : before.voxels()[v]);
  EXPECT_NE(redaction.scene().content_hash, host.scene().content_hash);
  EXPECT_TRUE(redaction.is_hidden(2));
  EXPECT_FALSE(redaction.is_hidden(3));
}

TEST(Redaction, NoMessageNamesTheHiddenStructure) {
  FakeHost host;
  hide_a_ball(host);
  host.edit_scene().recording.emplace().contacts = {{0, 1, 2, 1, 0}};
  ViewedState state = host.state();
  state.removed_mm3 = {{1, 1}, {2, 1}};
  state.nearest_mm = {{2, 1}};
  const Redaction redaction(host.scene());
  const Json json =
      Json::parse(scene_json(redaction.scene(), redaction.of(state), {}, {Role::kLearner, "L042"}, false));
  const std::string text = json.dump();
  for (const char* name : {"nodule", "soft_tissue", "rib", "skin"})
    EXPECT_EQ(text.find(name), std::string::npos) << name;
  // absent from structures and tissues, and from every list of them
  ASSERT_EQ(json["structures"].size(), 2u);
  EXPECT_EQ(json["structures"][1]["label"], 3);
  EXPECT_EQ(json["structures"][1]["within"], Json::array()) << "it may be within a hidden one";
  ASSERT_EQ(json["tissues"].size(), 1u);
  EXPECT_EQ(json["tasks"][0]["to_find"], Json::array());
  EXPECT_EQ(json["tasks"][0]["forces"][0]["labels"], Json({1}));
  EXPECT_EQ(json["tasks"][0]["protected"][0]["labels"], Json::array());
  EXPECT_EQ(json["recording"]["contacts"], Json::array());
  EXPECT_EQ(json["caveats"], Json::array());
  EXPECT_EQ(json["no_go"], Json::array());
  EXPECT_TRUE(json["distances"].is_null());
  EXPECT_TRUE(redaction.of(state).removed_mm3.empty());
  EXPECT_TRUE(redaction.of(state).nearest_mm.empty());
  EXPECT_EQ(redaction.of(state).tissues.size(), 1u);
}

/// Bytes of every message computed from a tick.
std::string messages_of(const TickRecord& tick, const ViewedHealth& health = {}) {
  const PoseMessage pose(tick, {}, health, 0);
  const DistanceMessage near(tick);
  return std::string(pose.bytes()) + std::string(near.bytes());
}

/// Tick with random bytes except for the allowed values: pose, total force, and the results of requests.
TickRecord random_tick(std::mt19937& random, const DeviceTick& device_tick) {
  TickRecord tick;
  static_assert(std::is_trivially_copyable_v<DeviceTick>);
  std::array<unsigned char, sizeof(DeviceTick)> bytes{};
  for (unsigned char& byte : bytes) byte = static_cast<unsigned char>(random());
  std::memcpy(&tick.device[0], bytes.data(), bytes.size());
  DeviceTick& device = tick.device[0];
  device.tip_patient_mm = device_tick.tip_patient_mm;
  device.orientation_wxyz = device_tick.orientation_wxyz;
  device.velocity_patient_mm_s = device_tick.velocity_patient_mm_s;
  device.buttons = device_tick.buttons;
  device.force_N = device_tick.force_N;
  device.limit_N = device_tick.limit_N;
  device.heat = device_tick.heat;
  constexpr std::uint32_t kOfThePose = kFlagNotFinite | kFlagOutside | kFlagPaused | kFlagRotationIgnored |
                                       kFlagThermal | kFlagRamp | kFlagStale | kFlagJump | kFlagDeviceFault |
                                       kFlagHalted | kFlagEmergencyStop | kFlagClutched | kFlagBlend;
  device.flags = (device.flags & ~kOfThePose) | (device_tick.flags & kOfThePose);
  tick.state_hash = random();
  tick.compute_s = tick.lateness_s = 1e-6 * static_cast<double>(random() % 1000);
  tick.solver_frame = static_cast<std::uint32_t>(random());
  return tick;
}

DeviceTick random_pose(std::mt19937& random) {
  std::uniform_real_distribution<double> coordinate(-2, 26), force(-2, 2);
  DeviceTick device;
  for (double& mm : device.tip_patient_mm) mm = coordinate(random);
  for (double& N : device.force_N) N = random() % 4 == 0 ? 0 : force(random);
  device.limit_N = 1.5;
  device.flags = static_cast<std::uint32_t>(random());
  return device;
}

TEST(Redaction, MessagesFollowFromThePoseAndTheTotalForce) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  FakeHost here, elsewhere;
  hide_a_ball(here, kHere);
  hide_a_ball(elsewhere, kElsewhere, 4);
  const Redaction redaction(here.scene()), other_redaction(elsewhere.scene());
  int touches = 0;
  for (int n = 0; n < 2000; ++n) {
    const DeviceTick device = random_pose(random);
    const TickRecord one = redaction.of(random_tick(random, device)),
                     other = other_redaction.of(random_tick(random, device));
    ASSERT_EQ(messages_of(one), messages_of(other)) << n;
    touches += one.device[0].label != 0;
  }
  EXPECT_GT(touches, 200) << "or nothing was looked at";
}

TEST(Redaction, TipInTheHiddenStructureIsShownOnTheRedactedSurface) {
  FakeHost host;
  hide_a_ball(host);
  const Redaction redaction(host.scene());
  TickRecord tick;
  // World's axes are those of FakeHost's scene: the patient's y is World's -z
  tick.device[0].tip_patient_mm = {15, 5, 12};
  tick.device[0].force_N = {0, 0, 1.25};
  tick.device[0].limit_N = 3;
  tick.device[0].label = 2;
  const DeviceTick device = redaction.of(tick).device[0];
  EXPECT_EQ(device.label, 1);
  EXPECT_NEAR(device.proxy_patient_mm[1], 3.5, 1e-9) << "half a voxel before the first of the block";
  EXPECT_NEAR(device.depth_mm, 1.5, 1e-9);
  EXPECT_NEAR(device.normal_patient[1], -1, 1e-9);
  EXPECT_EQ(device.unclamped_force_N, 1.25);
  EXPECT_EQ(device.flags, kFlagContact);
  tick.device[0].limit_N = 1.25;
  EXPECT_EQ(redaction.of(tick).device[0].flags, kFlagContact | kFlagClamped);
  // contact of a tool with a radius includes the radius
  host.edit_scene().tools = {{"ball", 2, false, "", {{0, 0, 0}}, {}}};
  EXPECT_NEAR(Redaction(host.scene()).of(tick).device[0].depth_mm, 3.5, 1e-9);
  // the force is published even where nothing visible is in contact
  tick.device[0].tip_patient_mm = {15, -5, 12};
  EXPECT_EQ(redaction.of(tick).device[0].label, 0);
  EXPECT_EQ(redaction.of(tick).device[0].unclamped_force_N, 1.25);
}

TEST(Redaction, OmitsContactsWhereAToolMayHaveCut) {
  FakeHost host;
  hide_a_ball(host);
  host.edit_scene().tools = {{"burr", 0, true, "ball", {{0, 0, 0}}, {}}};
  TickRecord tick;
  tick.device[0].tip_patient_mm = {15, 5, 12};
  tick.device[0].force_N = {0, 0, 1.25};
  tick.device[0].limit_N = 3;
  tick.device[0].label = 2;
  const DeviceTick device = Redaction(host.scene()).of(tick).device[0];
  EXPECT_EQ(device.label, 0);
  EXPECT_EQ(device.flags, 0u);
  EXPECT_TRUE(std::isnan(device.depth_mm));
  EXPECT_EQ(device.proxy_patient_mm, tick.device[0].tip_patient_mm);
}

TEST(Redaction, PlaneRegionsAreReportedWhilePushing) {
  FakeHost host;
  hide_a_ball(host);
  host.edit_scene().no_go = {{"wall", 1, ViewedNoGo::Plane{{0, 0, 0}, {0, 0, 1}}}};
  TickRecord tick;
  tick.device[0].no_go = 1;
  tick.device[0].no_go_depth_mm = 0.5;
  tick.device[0].flags = kFlagNoGo;
  const Redaction of_planes(host.scene());
  EXPECT_EQ(of_planes.of(tick).device[0].no_go_depth_mm, 0.5);
  EXPECT_EQ(of_planes.of(tick).device[0].flags, kFlagNoGo);
  // with a structure among the regions, the region reported depends on that structure
  host.edit_scene().no_go.push_back({"rib", 1, LabelId{3}});
  const Redaction of_structures(host.scene());
  EXPECT_EQ(of_structures.scene().no_go.size(), 2u);
  EXPECT_EQ(of_structures.of(tick).device[0].no_go, 0);
  EXPECT_EQ(of_structures.of(tick).device[0].flags, 0u);
}

TEST(Redaction, RunReportsTotalForcesAndVisibleSteps) {
  FakeHost host;
  hide_a_ball(host);
  ViewedTask& task = host.edit_scene().tasks[0];
  task.steps = {{"push", "touch", 0, {1, kNoValue}, 0.2, 0, false},
                {"find", "touch", 1, {1, kNoValue}, 0.2, 0, false}};
  const Redaction redaction(host.scene());
  ViewedTraining run = palpate::testing::test_training();
  // from the evaluator: the ball is in contact, not the block
  run.done = {false, true};
  run.fraction = {0, 1};
  run.protected_N = {0.7};
  run.events = {{"over_limit", 0, 1, 2.6}, {"step_done", 1, 1, 1}, {"ended", 0, 2, 0.3}};
  RedactedSteps steps(redaction.scene());
  steps.follow(run);
  TickRecord tick;
  for (int n = 0; n < 15; ++n) {
    tick.time_s = 0.01 * n;
    tick.device[0].label = 1;
    tick.device[0].proxy_patient_mm = {9, 12, 12};
    tick.device[0].force_N = {0, 3, 4};
    steps.observe(tick);
  }
  ViewedTraining training = redaction.of(run, steps, tick);
  EXPECT_EQ(training.done, std::vector<bool>({false, false}));
  EXPECT_NEAR(training.fraction[0], 0.7, 1e-9);
  EXPECT_EQ(training.fraction[1], 0) << "a region of hidden structures has no place";
  EXPECT_EQ(training.forces_N, std::vector<double>({5}));
  EXPECT_EQ(training.protected_N, std::vector<double>({0})) << "it is hidden";
  EXPECT_EQ(training.touch_N, 5);
  EXPECT_FALSE(training.unseen);
  ASSERT_EQ(training.events.size(), 1u);
  EXPECT_STREQ(training.events[0].kind, "ended");
  EXPECT_EQ(training.events_before, 0u);
  EXPECT_EQ(training.time_s, run.time_s);
  EXPECT_EQ(training.phase, run.phase);
  // the hold is interrupted
  tick.time_s += 0.01;
  tick.device[0].force_N = {};
  steps.observe(tick);
  EXPECT_EQ(steps.fraction()[0], 0);
  tick.device[0].force_N = {0, 3, 4};
  for (int n = 0; n < 30; ++n) {
    tick.time_s += 0.01;
    steps.observe(tick);
  }
  EXPECT_EQ(steps.done(), std::vector<bool>({true, false}));
  ++run.run;
  steps.follow(run);
  EXPECT_EQ(steps.done(), std::vector<bool>({false, false}));
}

TEST(Redaction, OmitsComputeTimes) {
  FakeHost host;
  hide_a_ball(host);
  const ViewedHealth health = Redaction(host.scene()).of(ViewedHealth{999, 1, 2, 3, 4, 5, 6, 7});
  EXPECT_EQ(health.rate_hz, 999);
  EXPECT_EQ(health.compute_p50_us, 0);
  EXPECT_EQ(health.lateness_max_us, 0);
  EXPECT_EQ(health.stalls, 7u);
}

TEST(Redaction, OmitsRemovedTissue) {
  FakeHost host;
  hide_a_ball(host);
  const Redaction redaction(host.scene());
  RedactedCuts cuts(host.scene().labels, redaction.scene().labels);
  EXPECT_EQ(cuts.of(host.scene().labels), redaction.scene().labels);
  const auto cut = [&](const Bricks<LabelId>& labels, const std::array<int, 3>& at) {
    return std::make_shared<const Bricks<LabelId>>(labels.with({{at, {1, 1, 1}}, {0}}));
  };
  const auto once = cut(*host.scene().labels, {9, 12, 12}), twice = cut(*once, {20, 12, 12});
  cuts.of(once);
  const auto both = cuts.of(twice);
  EXPECT_EQ(both->at(9, 12, 12), 0);
  EXPECT_EQ(both->at(20, 12, 12), 0);
  EXPECT_EQ(both->at(9, 12, 13), 1);
  // undoing a stroke restores the redacted labels
  EXPECT_EQ(cuts.of(cut(*host.scene().labels, {20, 12, 12}))->at(9, 12, 12), 1);
  EXPECT_EQ(cuts.of(host.scene().labels)->content_hash(), redaction.scene().labels->content_hash());
}

/// Server with a quiz, a learner and a teacher.
struct Quiz {
  explicit Quiz(const Index3& at = kHere) {
    hide_a_ball(host, at);
    host.bring_near(on_the_ball());
    ViewerServerOptions options;
    options.port = 0;
    options.token_file = write_private(folder / "tokens", std::string("learner ") + kLearnerToken +
                                                              " L042\nteacher " + kTeacherToken + "\n");
    server = *ViewerServer::start(host, options);
  }
  TestAnswer get(const char* token, const std::string& path) const {
    return request(server->port(), "GET", path, std::string("Authorization: Bearer ") + token + "\r\n");
  }
  Json scene(const char* token) const { return Json::parse(get(token, "/api/scene").body); }
  std::string labels(const char* token) const {
    return get(token, "/api/volume/labels/" + scene(token)["volume"]["hash"].get<std::string>()).body;
  }
  TemporaryFolder folder;
  FakeHost host;
  std::unique_ptr<ViewerServer> server;
};

TEST(Redaction, LearnersReceiveNoDataOfTheHiddenStructure) {
  const Quiz quiz;
  const std::string hash = quiz.scene(kTeacherToken)["volume"]["hash"],
                    redacted = quiz.scene(kLearnerToken)["volume"]["hash"];
  EXPECT_NE(hash, redacted);
  EXPECT_EQ(quiz.get(kLearnerToken, "/api/scene").body.find("nodule"), std::string::npos);
  EXPECT_NE(quiz.get(kTeacherToken, "/api/scene").body.find("nodule"), std::string::npos);
  EXPECT_EQ(quiz.labels(kLearnerToken).find('\2'), std::string::npos);
  EXPECT_NE(quiz.labels(kTeacherToken).find('\2'), std::string::npos);
  // the teacher's URL is not valid for the learner
  EXPECT_EQ(quiz.get(kLearnerToken, "/api/volume/labels/" + hash).status, 404);
  EXPECT_EQ(quiz.get(kLearnerToken, "/api/picture/" + hash + "?view=32,32,0,0,-20,0.7,0,0,0,0.7,0").status,
            404);

  // poses: structure in contact, layers, supporting contacts, stiffness
  TestViewer learner(quiz.server->port()), teacher(quiz.server->port());
  learner.greet({{"token", kLearnerToken}, {"near", true}});
  teacher.greet({{"token", kTeacherToken}});
  // no distances before the first pose
  const std::string reported = learner.pose(), open = teacher.pose();
  ASSERT_EQ(reported.substr(0, 4), "PLPT");
  constexpr std::size_t kDevice = 96;
  EXPECT_EQ(number_at<std::uint16_t>(open, kDevice + 96), 2);
  EXPECT_EQ(number_at<std::uint16_t>(reported, kDevice + 96), 0);
  EXPECT_EQ(number_at<std::uint16_t>(reported, kDevice + 104), 0);
  EXPECT_EQ(number_at<std::uint16_t>(reported, kDevice + 176), 0);
  EXPECT_EQ(number_at<float>(reported, kDevice + 84), 0);
  EXPECT_EQ(number_at<float>(open, kDevice + 84), 0.75f);
}

TEST(Redaction, OnlyUnredactedViewersReceiveTickBundles) {
  Quiz quiz;
  TestViewer learner(quiz.server->port()), teacher(quiz.server->port());
  learner.greet({{"token", kLearnerToken}, {"ticks", true}, {"poses_hz", 120}});
  teacher.greet({{"token", kTeacherToken}, {"ticks", true}, {"poses_hz", 120}});
  const auto next_bundle = [](TestViewer& viewer) {
    std::string bytes = viewer.pose();
    while (!bytes.empty() && !bytes.starts_with("PLPB")) bytes = viewer.pose();
    return bytes;
  };
  const auto add = [&quiz](std::uint64_t tick) {
    TickRecord record;
    record.tick = tick;
    quiz.host.history.add(record);
  };
  add(1);
  // the teacher's bundle, and ten poses of the learner without one
  EXPECT_EQ(number_at<std::uint64_t>(next_bundle(teacher), 32), 1u);
  for (int n = 0; n < 10; ++n) EXPECT_TRUE(learner.pose().starts_with("PLPT"));
  // when names are shown, ticks from then on
  teacher.send({{"type", "lesson"}, {"id", 1}, {"names", true}});
  EXPECT_EQ(teacher.text("done")["id"], 1);
  add(2);
  EXPECT_EQ(number_at<std::uint64_t>(next_bundle(learner), 32), 2u);
}

/// Everything that a server sends to a learner by HTTP: heads, hashes, sizes and bodies.
std::vector<std::string> answers_to_a_learner(const Quiz& quiz) {
  std::vector<std::string> answers;
  const auto ask = [&](const std::string& path, const std::string& fields = "") {
    const TestAnswer answer =
        request(quiz.server->port(), "GET", path,
                std::string("Authorization: Bearer ") + kLearnerToken + "\r\n" + fields);
    std::string head = answer.head;
    // the port, which differs between the servers
    const std::string port = ":" + std::to_string(quiz.server->port());
    if (const std::size_t at = head.find(port); at != std::string::npos) head.erase(at, port.size());
    answers.push_back(head + answer.body);
    return answer;
  };
  const std::string hash = Json::parse(ask("/api/scene").body)["volume"]["hash"];
  for (const std::string query : {"", "?shrink=1", "?shrink=2", "?shrink=4"})
    for (const std::string fields : {"", "Accept-Encoding: gzip\r\n"}) {
      ask("/api/volume/labels/" + hash + query, fields);
      ask("/api/volume/scan/" + hash + query, fields);
    }
  for (const std::string look : {"", "&looks=f0dcbe6009090900", "&looks=f0dcbe00000000ff09090900"})
    ask("/api/picture/" + hash + "?view=40,40,0,0,-20,0.6,0,0,0,0.6,0" + look);
  ask("/api/curves");
  ask("/api/volume/labels/0000000000000000");
  return answers;
}

TEST(Redaction, LearnerMessagesAreIndependentOfTheHiddenPosition) {
  const Quiz here(kHere), elsewhere(kElsewhere);
  EXPECT_NE(here.host.scene().content_hash, elsewhere.host.scene().content_hash);
  const auto one = answers_to_a_learner(here), other = answers_to_a_learner(elsewhere);
  ASSERT_EQ(one.size(), other.size());
  for (std::size_t n = 0; n < one.size(); ++n) EXPECT_EQ(one[n], other[n]) << n;

  TestViewer learner(here.server->port()), other_learner(elsewhere.server->port());
  const Json hello = {
      {"token", kLearnerToken}, {"near", true}, {"task", true}, {"plan", true}, {"yielded", true}};
  EXPECT_EQ(learner.greet(hello), other_learner.greet(hello));
  EXPECT_EQ(learner.text("state"), other_learner.text("state"));
  EXPECT_EQ(learner.text("task"), other_learner.text("task"));
}

TEST(Redaction, HiddenChangesTriggerNoMessage) {
  Quiz quiz;
  TestViewer learner(quiz.server->port()), teacher(quiz.server->port());
  teacher.greet({{"token", kTeacherToken}});
  learner.greet({{"token", kLearnerToken}});
  const auto removed_of_it = [](double mm3) {
    return [mm3](ViewedState& state) { state.removed_mm3 = {{2, mm3}}; };
  };
  while (teacher.text("state")["viewers"] != 2) {
  }
  for (const double mm3 : {1.0, 2.0, 3.0}) {
    quiz.host.change(removed_of_it(mm3));
    Json reported = teacher.text("state");
    while (reported["removed"].empty() || reported["removed"][0]["mm3"] != mm3)
      reported = teacher.text("state");
  }
  quiz.host.change([](ViewedState& state) { state.viscosity = !state.viscosity; });
  int states = 0;
  for (Json is_reported = learner.text("state"); is_reported["viscosity"] == true;
       is_reported = learner.text("state"))
    ++states;
  EXPECT_LE(states, 2) << "those of the beginning";
}

TEST(Redaction, PlansAreNotSent) {
  Quiz quiz;
  ViewedPlan plan;
  plan.trajectories = {{"to the nodule", {1, 2, 3}, {9, 12, 12}, {}, {}, {}, {}}};
  quiz.host.rehearse(plan);
  TestViewer learner(quiz.server->port()), teacher(quiz.server->port());
  learner.greet({{"token", kLearnerToken}, {"plan", true}});
  teacher.greet({{"token", kTeacherToken}, {"plan", true}});
  EXPECT_EQ(teacher.text("plan")["trajectories"].size(), 1u);
  for (int n = 0; n < 20; ++n) ASSERT_EQ(learner.frame().payload.find("nodule"), std::string::npos);
  teacher.send({{"type", "lesson"}, {"id", 1}, {"names", true}});
  EXPECT_EQ(learner.text("plan")["trajectories"].size(), 1u) << "until names are shown";
}

TEST(Redaction, APictureShowsNothingOfIt) {
  const Quiz quiz;
  const std::string redacted = quiz.scene(kLearnerToken)["volume"]["hash"],
                    hash = quiz.scene(kTeacherToken)["volume"]["hash"];
  const std::string view = "?view=40,40,0,0,-20,0.6,0,0,0,0.6,0";
  const auto structure_indices = [](const TestAnswer& answer) { return answer.body.substr(24 + 5 * 1600); };
  const auto picture = [](const TestAnswer& answer) { return answer.body.substr(24, 3 * 1600); };
  // soft tissue transparent and the hidden structure opaque: it would be visible alone
  const std::string appearances = "&looks=f0dcbe000a141eff09090900",
                    redacted_appearances = "&looks=f0dcbe0009090900";
  const TestAnswer open = quiz.get(kTeacherToken, "/api/picture/" + hash + view + appearances);
  const TestAnswer reported =
      quiz.get(kLearnerToken, "/api/picture/" + redacted + view + redacted_appearances);
  ASSERT_EQ(reported.status, 200);
  EXPECT_NE(structure_indices(open).find('\2'), std::string::npos);
  EXPECT_EQ(structure_indices(reported), std::string(1600, '\0')) << "nothing is seen";
  // soft tissue half transparent: no boundary visible between equal looks
  const TestAnswer half =
      quiz.get(kLearnerToken, "/api/picture/" + redacted + view + "&looks=f0dcbe6009090900");
  FakeHost without;
  hide_a_ball(without);
  Redaction redaction(without.scene());
  without.edit_scene() = redaction.scene();
  ViewerServerOptions options;
  options.port = 0;
  const auto server = *ViewerServer::start(without, options);
  const std::string its_hash = hash_text(without.scene().content_hash);
  const TestAnswer alike =
      request(server->port(), "GET", "/api/picture/" + its_hash + view + "&looks=f0dcbe6009090900");
  ASSERT_EQ(alike.status, 200);
  EXPECT_EQ(picture(half), picture(alike));
  EXPECT_EQ(structure_indices(half), structure_indices(alike));
}

TEST(Redaction, TeacherTogglesRedaction) {
  const Quiz quiz;
  TestViewer learner(quiz.server->port()), teacher(quiz.server->port());
  learner.greet({{"token", kLearnerToken}});
  teacher.greet({{"token", kTeacherToken}});
  const auto is_reported = [&](bool redacted) {
    for (int n = 0; n < 20; ++n)
      if (learner.text("state")["lesson"]["redacted"] == redacted) return true;
    return false;
  };
  EXPECT_TRUE(is_reported(true));
  teacher.send({{"type", "lesson"}, {"id", 1}, {"names", true}});
  EXPECT_TRUE(is_reported(false));
  EXPECT_EQ(quiz.scene(kLearnerToken)["structures"], quiz.scene(kTeacherToken)["structures"]);
  EXPECT_NE(quiz.labels(kLearnerToken).find('\2'), std::string::npos);
  teacher.send({{"type", "lesson"}, {"id", 2}, {"names", false}});
  EXPECT_TRUE(is_reported(true));
  EXPECT_EQ(quiz.labels(kLearnerToken).find('\2'), std::string::npos);
}

}  // namespace
}  // namespace palpate::server
