#include "link/veil.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/test_folder.h"
#include "link/scene_json.h"
#include "link/test_client.h"
#include "link/test_host.h"

namespace palpate::link {
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

/// A block of label 1 with a ball of label 2 in it, which is to be found; label 3 lies at its edge.
void hide_a_ball(FakeHost& host) {
  GridGeometry grid;
  grid.dims = {24, 24, 24};
  grid.spacing_mm = {1, 1, 1};
  Volume<LabelId> labels(grid);
  for (int k = 0; k < 24; ++k)
    for (int j = 0; j < 24; ++j)
      for (int i = 0; i < 24; ++i) {
        const bool in_ball = (i - 9) * (i - 9) + (j - 12) * (j - 12) + (k - 12) * (k - 12) <= 25;
        labels.at(i, j, k) = in_ball ? 2 : i < 4 ? 3 : j > 3 ? 1 : 0;
      }
  ViewedScene& scene = host.edit_scene();
  scene.labels = label_bricks(labels);
  auto scan = std::make_shared<Volume<float>>(grid);
  scene.scan = scan;
  scene.structures = {
      {1, "soft_tissue", {240, 220, 190}, 0}, {2, "nodule", {10, 20, 30}, 1}, {3, "rib", {9, 9, 9}, -1}};
  scene.tissues = {{"skin", true, {240, 220, 190}, 1, {}}, {"nodule", true, {1, 2, 3}, 0.25, {0}}};
  scene.tasks = {test_task()};
  scene.no_go = {{"nodule", 1, LabelId{2}}};
  scene.told_reach_mm = 20;
}

DeviceTick on_the_ball() {
  DeviceTick device;
  device.label = 2;
  device.felt_label = {1, 2};
  device.felt_depth_mm = {3, 1};
  device.felt_share = {0.4, 0.6};
  device.contact_label = {1, 2, 3};
  device.contact_part = {0, 1, 2};
  device.contact_N = {0.5, 1.5, 0.25};
  device.contact_patient_mm = {1, 2, 3, 4, 5, 6, 7, 8, 9};
  device.near_label = {2, 1, 3};
  device.near_mm = {-1, 0.5, 7};
  return device;
}

TEST(Veil, WhatIsToBeFoundIsVoxelsOfWhatLiesAroundIt) {
  FakeHost host;
  hide_a_ball(host);
  const Veil veil(host.scene());
  const Volume<LabelId> before = host.scene().labels->dense(), after = veil.scene().labels->dense();
  for (std::size_t v = 0; v < before.voxels().size(); ++v)
    ASSERT_EQ(after.voxels()[v], before.voxels()[v] == 2 ? 1 : before.voxels()[v]);
  EXPECT_NE(veil.scene().content_hash, host.scene().content_hash);
  EXPECT_EQ(veil.shown(2), 1);
  EXPECT_EQ(veil.shown(3), 3);
}

TEST(Veil, NothingThatIsToldNamesIt) {
  FakeHost host;
  hide_a_ball(host);
  host.edit_scene().recording.emplace().contacts = {{0, 1, 2, 1, 0}};
  ViewedState state = host.state();
  state.removed_mm3 = {{1, 1}, {2, 1}};
  state.nearest_mm = {{2, 1}};
  const Veil veil(host.scene());
  const Json json =
      Json::parse(scene_json(veil.scene(), veil.of(state), {}, {Role::kLearner, "L042"}, false));
  const std::string text = json.dump();
  for (const char* name : {"nodule", "soft_tissue", "rib", "skin"})
    EXPECT_EQ(text.find(name), std::string::npos) << name;
  EXPECT_EQ(json["structures"][1]["colour"], json["structures"][0]["colour"]);
  EXPECT_EQ(json["structures"][1]["tissue"], 0);
  EXPECT_EQ(json["tissues"][1]["stiffness_N_per_mm"], json["tissues"][0]["stiffness_N_per_mm"]);
  EXPECT_EQ(json["tissues"][1]["opacity"], json["tissues"][0]["opacity"]);
  EXPECT_EQ(json["tasks"][0]["to_find"], Json::array());
  EXPECT_EQ(json["tasks"][0]["forces"][0]["labels"], Json({1, 1}));
  EXPECT_EQ(json["recording"]["contacts"][0][2], 1);
  EXPECT_EQ(json["no_go"][0]["label"], 1);
  EXPECT_EQ(veil.of(state).removed_mm3.size(), 1u);
  EXPECT_TRUE(veil.of(state).nearest_mm.empty());

  TickRecord tick;
  tick.device[0] = on_the_ball();
  const DeviceTick seen = veil.of(tick).device[0];
  EXPECT_EQ(seen.label, 1);
  EXPECT_EQ(seen.felt_label, DeviceTick().felt_label);
  EXPECT_EQ(seen.felt_depth_mm, DeviceTick().felt_depth_mm);
  EXPECT_EQ((std::array{seen.contact_label[0], seen.contact_label[1], seen.contact_label[2]}),
            (std::array<std::uint16_t, 3>{1, 3, 0}));
  EXPECT_EQ(seen.contact_N[1], 0.25);
  EXPECT_EQ(seen.contact_N[2], 0);
  EXPECT_EQ(seen.contact_patient_mm[3], 7);
  EXPECT_EQ(seen.contact_patient_mm[6], 0);
  EXPECT_EQ((std::array{seen.near_label[0], seen.near_label[1], seen.near_label[2]}),
            (std::array<std::uint16_t, 3>{1, 3, 0}));
  EXPECT_EQ(seen.near_mm[1], 7);
  // what is touched first is there to be seen
  tick.device[0].contact_label = {2};
  EXPECT_EQ(veil.of(tick).device[0].contact_label[0], 1);
}

/// A server with a quiz, a learner and a teacher.
struct Quiz {
  Quiz() {
    hide_a_ball(host);
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

TEST(Veil, ALearnerIsToldNothingOfItByAnyWay) {
  const Quiz quiz;
  const std::string hash = quiz.scene(kTeacherToken)["volume"]["hash"],
                    veiled = quiz.scene(kLearnerToken)["volume"]["hash"];
  EXPECT_NE(hash, veiled);
  EXPECT_EQ(quiz.get(kLearnerToken, "/api/scene").body.find("nodule"), std::string::npos);
  EXPECT_NE(quiz.get(kTeacherToken, "/api/scene").body.find("nodule"), std::string::npos);
  EXPECT_EQ(quiz.labels(kLearnerToken).find('\2'), std::string::npos);
  EXPECT_NE(quiz.labels(kTeacherToken).find('\2'), std::string::npos);
  // the other's address is none of his
  EXPECT_EQ(quiz.get(kLearnerToken, "/api/volume/labels/" + hash).status, 404);
  EXPECT_EQ(quiz.get(kLearnerToken, "/api/picture/" + hash + "?view=32,32,0,0,-20,0.7,0,0,0,0.7,0").status,
            404);

  // poses: what is touched, what it comes from, where it leans, how stiff it is
  TestViewer learner(quiz.server->port()), teacher(quiz.server->port());
  learner.greet({{"token", kLearnerToken}, {"near", true}});
  teacher.greet({{"token", kTeacherToken}});
  // what is near comes once, before the first pose
  const std::string near = learner.pose(), told = learner.pose(), open = teacher.pose();
  constexpr std::size_t kDevice = 96;
  EXPECT_EQ(number_at<std::uint16_t>(open, kDevice + 96), 2);
  EXPECT_EQ(number_at<std::uint16_t>(told, kDevice + 96), 1);
  EXPECT_EQ(number_at<std::uint16_t>(told, kDevice + 104), 0);
  EXPECT_EQ(number_at<float>(told, kDevice + 84), 0);
  EXPECT_EQ(number_at<float>(open, kDevice + 84), 0.75f);
  ASSERT_EQ(near.substr(0, 4), "PLPN");
  EXPECT_EQ(number_at<std::uint16_t>(near, 24 + 12), 1);
}

TEST(Veil, APictureShowsNothingOfIt) {
  const Quiz quiz;
  const std::string veiled = quiz.scene(kLearnerToken)["volume"]["hash"],
                    hash = quiz.scene(kTeacherToken)["volume"]["hash"];
  const std::string view = "?view=40,40,0,0,-20,0.6,0,0,0,0.6,0";
  const auto places = [](const TestAnswer& answer) { return answer.body.substr(24 + 5 * 1600); };
  const auto picture = [](const TestAnswer& answer) { return answer.body.substr(24, 3 * 1600); };
  // soft tissue clear and what is hidden solid: it would stand there alone
  const std::string looks = "&looks=f0dcbe000a141eff09090900";
  const TestAnswer open = quiz.get(kTeacherToken, "/api/picture/" + hash + view + looks);
  const TestAnswer told = quiz.get(kLearnerToken, "/api/picture/" + veiled + view + looks);
  ASSERT_EQ(told.status, 200);
  EXPECT_NE(places(open).find('\2'), std::string::npos);
  EXPECT_EQ(places(told), std::string(1600, '\0')) << "nothing is seen";
  // soft tissue half clear: no border is seen between what looks the same
  const TestAnswer half =
      quiz.get(kLearnerToken, "/api/picture/" + veiled + view + "&looks=f0dcbe600a141eff09090900");
  FakeHost without;
  hide_a_ball(without);
  Veil veil(without.scene());
  without.edit_scene() = veil.scene();
  ViewerServerOptions options;
  options.port = 0;
  const auto server = *ViewerServer::start(without, options);
  const std::string its_hash = hash_text(without.scene().content_hash);
  const TestAnswer alike =
      request(server->port(), "GET", "/api/picture/" + its_hash + view + "&looks=f0dcbe600a141eff09090900");
  ASSERT_EQ(alike.status, 200);
  EXPECT_EQ(picture(half), picture(alike));
  EXPECT_EQ(places(half), places(alike));
}

TEST(Veil, ATeacherLiftsItAndLaysItAgain) {
  const Quiz quiz;
  TestViewer learner(quiz.server->port()), teacher(quiz.server->port());
  learner.greet({{"token", kLearnerToken}});
  teacher.greet({{"token", kTeacherToken}});
  const auto is_told = [&](bool veiled) {
    for (int n = 0; n < 20; ++n)
      if (learner.text("state")["lesson"]["veiled"] == veiled) return true;
    return false;
  };
  EXPECT_TRUE(is_told(true));
  teacher.send({{"type", "lesson"}, {"id", 1}, {"names", true}});
  EXPECT_TRUE(is_told(false));
  EXPECT_EQ(quiz.scene(kLearnerToken)["structures"], quiz.scene(kTeacherToken)["structures"]);
  EXPECT_NE(quiz.labels(kLearnerToken).find('\2'), std::string::npos);
  teacher.send({{"type", "lesson"}, {"id", 2}, {"names", false}});
  EXPECT_TRUE(is_told(true));
  EXPECT_EQ(quiz.labels(kLearnerToken).find('\2'), std::string::npos);
}

}  // namespace
}  // namespace palpate::link
