#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "base/test_folder.h"
#include "palpate/base/clock.h"
#include "server/test_client.h"
#include "server/test_host.h"

namespace palpate::server {
namespace {

using palpate::test::TemporaryFolder;
using palpate::test::write_private;
using palpate::testing::FakeRecording;
using palpate::testing::Json;
using palpate::testing::kPing;
using palpate::testing::masked_frame;
using palpate::testing::number_at;
using palpate::testing::request;
using palpate::testing::soon;
using palpate::testing::TestFrame;
using palpate::testing::TestServer;
using palpate::testing::TestSocket;
using palpate::testing::TestViewer;

constexpr const char* kControlToken = "control-token-0123456789";
constexpr const char* kViewToken = "view-token-0123456789";

// options of a server that asks for one of the tokens above
ViewerServerOptions guarded_options(const TemporaryFolder& folder) {
  ViewerServerOptions options;
  options.token_file = write_private(folder / "tokens",
                                     std::string("control ") + kControlToken + "\nview " + kViewToken + "\n");
  return options;
}

struct GuardedServer {
  TemporaryFolder folder;
  TestServer test{guarded_options(folder)};
};

TEST(Viewer, WelcomeStateAndPoses) {
  TestServer test;
  TestViewer viewer(test.port());
  EXPECT_EQ(viewer.opening().status, 101);
  // example of RFC 6455
  EXPECT_EQ(viewer.opening().field("Sec-WebSocket-Accept"), "s3pPLMBiTxaQ9kYGzzhZRbK+xOo=");
  EXPECT_EQ(viewer.opening().field("Sec-WebSocket-Protocol"), "palpate.v1");
  EXPECT_EQ(viewer.opening().field("Sec-WebSocket-Extensions"), "");
  EXPECT_EQ(viewer.greet(), Json::parse(R"({"type": "welcome", "role": "control", "learner": null,
      "may": ["look", "stop", "unseen", "hand", "feel", "plan", "play"], "protocol": 3})"));
  const Json state = viewer.text();
  EXPECT_EQ(state["type"], "state");
  EXPECT_EQ(state["viewers"], 1);
  EXPECT_EQ(state["pointer"], false);
  EXPECT_EQ(test.server->viewers(), 1);

  const std::int64_t before = monotonic_ns();
  std::string pose = viewer.pose();
  for (std::uint64_t sequence = number_at<std::uint64_t>(pose, 8), n = 1; n < 10; ++n) {
    pose = viewer.pose();
    ASSERT_EQ(pose.size(), 392u);
    EXPECT_EQ(pose.substr(0, 4), "PLPT");
    EXPECT_GT(number_at<std::uint64_t>(pose, 8), sequence);
    sequence = number_at<std::uint64_t>(pose, 8);
  }
  EXPECT_GT(number_at<std::int64_t>(pose, 32), before);
  EXPECT_LT(number_at<std::int64_t>(pose, 32), monotonic_ns());
  EXPECT_EQ(number_at<float>(pose, 96), 1);
  EXPECT_EQ(number_at<float>(pose, 96 + 84), 0.75f);
}

TEST(Viewer, SweepsReachEveryViewerOnceInOrder) {
  TestServer test;
  test.host.cut(450);
  TestViewer first(test.port());
  first.greet();
  std::uint64_t had = 0;
  const auto on_event = [](TestViewer& viewer, std::uint64_t& heard, std::uint64_t until) {
    while (heard < until) {
      const Json cut = viewer.text("cut");
      ASSERT_FALSE(cut.is_null());
      ASSERT_EQ(cut["first"], heard);
      ASSERT_LE(cut["sweeps"].size(), 200u);
      for (const Json& sweep : cut["sweeps"])
        ASSERT_EQ(sweep, Json::array({static_cast<double>(heard++), 0.0, 0.0, 0.0, 1.0, 0.0, 2.0}));
    }
    EXPECT_EQ(heard, until);
  };
  on_event(first, had, 450);
  // poses are interleaved, and a late viewer receives all sweeps
  EXPECT_FALSE(first.pose().empty());
  test.host.cut(3);
  on_event(first, had, 453);
  TestViewer later(test.port());
  later.greet();
  std::uint64_t later_had = 0;
  on_event(later, later_had, 453);
  // repeated sweeps are dropped first
  for (const std::uint64_t left : {200u, 0u}) {
    test.host.uncut(later_had - left);
    const Json none = later.text("cut");
    EXPECT_EQ(none["first"], left);
    EXPECT_TRUE(none["sweeps"].empty());
    later_had = left;
  }
  // other sweeps in place of some, the same number as before
  test.host.cut(50);
  on_event(later, later_had, 50);
  test.host.cut_anew(20, 20);
  later_had = 30;
  on_event(later, later_had, 50);
}

TEST(Viewer, StrokesAreUndoneAndDoneAgain) {
  TestServer test;
  test.host.change([](ViewedState& state) { state.strokes_to_undo = 1; });
  TestViewer viewer(test.port());
  viewer.greet();
  viewer.send({{"type", "redo"}, {"id", 1}});
  EXPECT_EQ(viewer.text("refused")["id"], 1);
  viewer.send({{"type", "undo"}, {"id", 2}});
  EXPECT_EQ(viewer.text("done")["id"], 2);
  EXPECT_EQ(viewer.text("state")["strokes"], (Json{{"undo", 0}, {"redo", 1}}));
  viewer.send({{"type", "redo"}, {"id", 3}});
  EXPECT_EQ(viewer.text("done")["id"], 3);
}

TEST(Viewer, HealthComesWithThePoses) {
  TestServer test;
  TestViewer viewer(test.port());
  viewer.greet();
  std::string pose = viewer.pose();
  while (!pose.empty() && number_at<float>(pose, 64) != 999) pose = viewer.pose();
  ASSERT_FALSE(pose.empty());
  EXPECT_EQ(number_at<std::uint32_t>(pose, 92), 7u);
}

// counted instead of timed: of three viewers together the slower ones get fewer poses
TEST(Viewer, EachHasItsOwnRate) {
  TestServer test;
  TestViewer fast(test.port()), slow(test.port());
  slow.greet({{"poses_hz", 5}});
  fast.greet({{"poses_hz", 120}});
  const auto tick_of = [](const std::string& pose) { return number_at<std::uint64_t>(pose, 16); };
  // its sequence has no gap, and 24 server periods lie between two of its poses; fewer after a stall of the
  // machine, but not every time
  std::uint64_t last = tick_of(slow.pose()), most = 0;
  for (std::uint64_t n = 2; n < 8; ++n) {
    const std::string pose = slow.pose();
    EXPECT_EQ(number_at<std::uint64_t>(pose, 8), n);
    most = std::max(most, tick_of(pose) - std::exchange(last, tick_of(pose)));
  }
  EXPECT_GT(most, 4u);
  EXPECT_FALSE(fast.pose().empty());
}

TEST(Viewer, NoSnapshotsWithoutViewers) {
  TestServer test;
  {
    TestViewer viewer(test.port());
    viewer.greet();
    viewer.pose();
  }
  ASSERT_TRUE(soon([&] { return test.server->viewers() == 0; }));
  int before = -1;
  EXPECT_TRUE(soon([&] {
    const int now = test.host.snapshots;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    return std::exchange(before, now) == now;
  }));
}

TEST(Viewer, RequestsAreGrantedAndRefused) {
  TestServer test;
  TestViewer viewer(test.port()), other(test.port());
  viewer.greet();
  other.greet();
  other.text("state");
  viewer.send({{"type", "set"}, {"id", 1}, {"max_force_N", 1.1}, {"method", "trilinear"}});
  EXPECT_EQ(viewer.text("done"), Json::parse(R"({"type": "done", "id": 1})"));
  // every viewer receives the state
  for (TestViewer* each : {&viewer, &other}) {
    Json state = each->text("state");
    while (!state.is_null() && state["method"] != "trilinear") state = each->text("state");
    EXPECT_EQ(state["max_force_N"], 1.1);
  }
  viewer.send({{"type", "set"}, {"id", 2}, {"max_force_N", 99}, {"paused", true}});
  EXPECT_EQ(viewer.text("refused"),
            Json::parse(R"({"type": "refused", "id": 2, "what": "is above what this device may give",
                            "where": "max_force_N", "how": "ask for less"})"));
  EXPECT_FALSE(test.host.state().paused);
  viewer.send({{"type", "tissue"}, {"id", 3}, {"tissue", 0}, {"stiffness_N_per_mm", 0.8}});
  EXPECT_EQ(viewer.text("done")["id"], 3);
  EXPECT_EQ(test.host.state().tissues[0].stiffness_N_per_mm, 0.8);
  viewer.send({{"type", "stop"}, {"id", 4}});
  EXPECT_EQ(viewer.text("done")["id"], 4);
  EXPECT_TRUE(test.host.state().stop);
  EXPECT_EQ(test.host.requested_by().number, 1u);
  EXPECT_TRUE(test.host.requested_by().control);
  // a rearm names the stop that it refers to; an outdated one is refused
  Json stopped = other.text("state");
  while (!stopped.is_null() && stopped["stop"].is_null()) stopped = other.text("state");
  EXPECT_EQ(stopped["emergency_stop"], true);
  EXPECT_EQ(stopped["stopped_by"], "viewer") << "another one than this";
  viewer.send({{"type", "stop"}, {"id", 5}});
  EXPECT_EQ(viewer.text("done")["id"], 5);
  other.send({{"type", "rearm"}, {"id", 4}, {"stop", stopped["stop"]}});
  EXPECT_EQ(other.text("refused")["where"], "stop");
  EXPECT_TRUE(test.host.state().stop);
  other.send({{"type", "rearm"}, {"id", 5}, {"stop", *test.host.state().stop}});
  EXPECT_EQ(other.text("done")["id"], 5);
  EXPECT_EQ(test.host.requested_by().number, 2u) << "in the order in which they said hello";
  EXPECT_FALSE(test.host.state().stop);
  viewer.send({{"type", "nonsense"}, {"id", 6}});
  EXPECT_EQ(viewer.text("refused")["id"], 6);
}

TEST(Viewer, ChangesOfOtherViewersAreReported) {
  TestServer test;
  TestViewer viewer(test.port());
  viewer.greet();
  EXPECT_EQ(viewer.text("state")["paused"], false);
  test.host.change([](ViewedState& state) { state.paused = true; });
  EXPECT_EQ(viewer.text("state")["paused"], true);
}

TEST(Viewer, StateNamesThePointerOwner) {
  GuardedServer guarded;
  std::optional<TestViewer> one(std::in_place, guarded.test.port());
  TestViewer other(guarded.test.port());
  const Json control{{"token", kControlToken}};
  one->greet(control);
  EXPECT_TRUE(one->text("state").at("pointer_by").is_null());
  other.greet(control);
  // other state messages may come first
  const auto is_reported = [](TestViewer& viewer, const Json& by) {
    for (int n = 0; n < 10; ++n)
      if (const Json state = viewer.text("state"); state.is_null() || state.at("pointer_by") == by)
        return !state.is_null();
    return false;
  };
  one->send({{"type", "pointer"}, {"id", 1}, {"take", true}});
  EXPECT_TRUE(is_reported(*one, "you"));
  EXPECT_TRUE(is_reported(other, "viewer"));
  other.send({{"type", "pointer"}, {"id", 1}, {"take", true}});
  EXPECT_EQ(other.text("refused")["what"], "another viewer moves the tip");
  one.reset();
  EXPECT_TRUE(is_reported(other, Json()));
  other.send({{"type", "pointer"}, {"id", 2}, {"take", true}});
  EXPECT_TRUE(is_reported(other, "you"));
}

TEST(Viewer, EnforcesRoles) {
  GuardedServer guarded;
  const int port = guarded.test.port();
  TestViewer viewer(port);
  EXPECT_EQ(viewer.greet({{"token", kViewToken}})["role"], "view");
  for (const Json& requested :
       {Json{{"type", "set"}, {"id", 1}, {"paused", true}},
        Json{{"type", "tissue"}, {"id", 1}, {"tissue", 0}, {"stiffness_N_per_mm", 1}},
        Json{{"type", "rearm"}, {"id", 1}, {"stop", 1}}, Json{{"type", "task"}, {"id", 1}, {"begin", "hold"}},
        Json{{"type", "task"}, {"id", 1}, {"end", true}},
        Json{{"type", "pointer"}, {"id", 1}, {"take", true}}}) {
    viewer.send(requested);
    EXPECT_EQ(viewer.text("refused")["where"], "role") << requested;
  }
  viewer.send({{"type", "tip"}, {"patient_mm", {7, 8, 9}}});
  // every viewer may stop
  viewer.send({{"type", "stop"}, {"id", 2}});
  EXPECT_EQ(viewer.text("done")["id"], 2);
  EXPECT_TRUE(guarded.test.host.state().stop);
  EXPECT_EQ(guarded.test.host.requested_by().number, 1u);
  EXPECT_FALSE(guarded.test.host.requested_by().control);
  EXPECT_FALSE(guarded.test.host.state().paused);
  EXPECT_FALSE(guarded.test.host.pointer_claimed);
  EXPECT_EQ(guarded.test.host.training().run, 0u);
  EXPECT_FALSE(guarded.test.host.pointer());

  TestViewer control(port);
  EXPECT_EQ(control.greet({{"token", kControlToken}})["role"], "control");
  control.send({{"type", "set"}, {"id", 3}, {"paused", true}});
  EXPECT_EQ(control.text("done")["id"], 3);
  const auto scene =
      request(port, "GET", "/api/scene", std::string("Authorization: Bearer ") + kViewToken + "\r\n");
  EXPECT_EQ(Json::parse(scene.body)["role"], "view");
}

TEST(Viewer, NoTokenNoView) {
  GuardedServer guarded;
  const int port = guarded.test.port();
  EXPECT_EQ(request(port, "GET", "/").status, 200);
  EXPECT_EQ(request(port, "GET", "/api/scene").status, 401);
  for (const Json& shown : {Json::object(), Json{{"token", "wrong-token-0123456789"}}, Json{{"token", ""}}}) {
    TestViewer viewer(port);
    EXPECT_TRUE(viewer.greet(shown).is_null()) << shown;
    EXPECT_EQ(viewer.close_code(), 0);
  }
  TestViewer viewer(port);
  viewer.send({{"type", "hello"}, {"protocol", 3}, {"token", "wrong-token-0123456789"}});
  EXPECT_EQ(viewer.close_code(), 4401);
  const std::string log = guarded.test.log.text();
  EXPECT_NE(log.find("127.0.0.1: a wrong token or none"), std::string::npos);
  EXPECT_EQ(log.find("0123456789"), std::string::npos);
}

// a late answer goes to the viewer that asked
TEST(Viewer, ConsentRequestsAreAnsweredLater) {
  TestServer test;
  test.host.ask_first();
  TestViewer one(test.port()), other(test.port());
  one.greet();
  other.greet();
  one.send({{"type", "set"}, {"id", 7}, {"paused", true}});
  EXPECT_EQ(one.text("asked"), Json::parse(R"({"type": "asked", "id": 7})"));
  other.send({{"type", "set"}, {"id", 8}, {"paused", true}});
  EXPECT_EQ(other.text("asked")["id"], 8);
  // a stop needs no consent
  one.send({{"type", "stop"}, {"id", 9}});
  EXPECT_EQ(one.text("done")["id"], 9);
  EXPECT_TRUE(test.host.state().stop);
  // a viewer that disconnected no longer waits
  other.socket().end_sending();
  EXPECT_TRUE(soon([&] { return test.host.requested() == 1; }));
  test.host.answer({});
  EXPECT_EQ(one.text("done")["id"], 7);
  one.send({{"type", "set"}, {"id", 10}, {"paused", true}});
  EXPECT_EQ(one.text("asked")["id"], 10);
  test.host.answer(Error{ErrorKind::kUsage, "it was declined", "", ""});
  EXPECT_EQ(
      one.text("refused"),
      Json::parse(R"({"type": "refused", "id": 10, "what": "it was declined", "where": "", "how": ""})"));
}

TEST(Viewer, PointerOwnerCanRearm) {
  TestServer test({}, {5, 4, 3}, "pointer");
  TestViewer first(test.port()), second(test.port());
  first.greet();
  second.greet();
  first.send({{"type", "stop"}, {"id", 1}});
  EXPECT_EQ(first.text("done")["id"], 1);
  const auto rearm = [&](TestViewer& viewer, int id) {
    viewer.send({{"type", "rearm"}, {"id", id}, {"stop", *test.host.state().stop}});
  };
  rearm(first, 2);
  EXPECT_EQ(first.text("refused")["id"], 2) << "nobody has the tip";
  first.send({{"type", "pointer"}, {"id", 3}, {"take", true}});
  EXPECT_EQ(first.text("done")["id"], 3);
  rearm(second, 4);
  EXPECT_EQ(second.text("refused")["id"], 4);
  EXPECT_TRUE(test.host.state().stop);
  rearm(first, 5);
  EXPECT_EQ(first.text("done")["id"], 5);
  EXPECT_FALSE(test.host.state().stop);
}

/// Server with a task.
struct TaskTest : ::testing::Test {
  explicit TaskTest(const std::string& input = "script")
      : test({}, {5, 4, 3}, input, {palpate::testing::test_task()}) {}
  TestServer test;
};

TEST_F(TaskTest, SubscribersGetProgressAndOneDebriefing) {
  TestViewer first(test.port()), plain(test.port());
  first.greet({{"task", true}});
  plain.greet();
  Json reported = first.text("task");
  EXPECT_EQ(reported["phase"], "none");
  first.send({{"type", "task"}, {"id", 1}, {"begin", "hold"}});
  EXPECT_EQ(first.text("done")["id"], 1);
  reported = first.text("task");
  EXPECT_EQ(reported["phase"], "running");
  EXPECT_EQ(reported["run"], 3);
  test.host.train_on(7);
  EXPECT_EQ(first.text("task")["time_s"], 7.0);
  first.send({{"type", "task"}, {"id", 2}, {"end", true}});
  EXPECT_EQ(first.text("done")["id"], 2);
  const Json debriefing = first.text("debriefing");
  EXPECT_EQ(debriefing["run"], 3);
  // a late viewer receives it as well
  TestViewer later(test.port());
  later.greet({{"task", true}});
  EXPECT_EQ(later.text("debriefing"), debriefing);
  EXPECT_EQ(later.text("task")["phase"], "over");
  // it is not repeated, and viewers without a subscription get nothing
  for (TestViewer* viewer : {&first, &plain}) {
    viewer->send({{"type", "set"}, {"id", 3}, {"paused", true}});
    for (Json next = viewer->text();; next = viewer->text()) {
      ASSERT_FALSE(next.is_null());
      EXPECT_NE(next["type"], "debriefing");
      EXPECT_FALSE(viewer == &plain && next["type"] == "task");
      if (next["type"] == "done") break;
    }
  }
}

struct TaskByPointer : TaskTest {
  TaskByPointer() : TaskTest("pointer") {}
};

TEST_F(TaskByPointer, PointerOwnerBeginsAndEndsRuns) {
  TestViewer first(test.port()), second(test.port());
  first.greet();
  second.greet();
  first.send({{"type", "pointer"}, {"id", 1}, {"take", true}});
  EXPECT_EQ(first.text("done")["id"], 1);
  second.send({{"type", "task"}, {"id", 2}, {"begin", "hold"}});
  EXPECT_EQ(second.text("refused")["id"], 2);
  first.send({{"type", "task"}, {"id", 3}, {"begin", "hold"}});
  EXPECT_EQ(first.text("done")["id"], 3);
  second.send({{"type", "task"}, {"id", 4}, {"end", true}});
  EXPECT_EQ(second.text("refused")["id"], 4);
  EXPECT_EQ(test.host.training().phase, ViewedTraining::Phase::kRunning);
  first.send({{"type", "task"}, {"id", 5}, {"end", true}});
  EXPECT_EQ(first.text("done")["id"], 5);
}

TEST(Viewer, ControlIsRequiredForPlayback) {
  TemporaryFolder folder;
  FakeRecording recording;
  ViewerServerOptions options = guarded_options(folder);
  options.port = 0;
  const auto server = ViewerServer::start(recording, options);
  ASSERT_TRUE(server.ok());
  TestViewer control((*server)->port()), view((*server)->port());
  control.greet({{"token", kControlToken}});
  view.greet({{"token", kViewToken}});
  control.send({{"type", "play"}, {"id", 2}, {"at_s", 12.25}, {"playing", true}, {"speed", -4}});
  EXPECT_EQ(control.text("done")["id"], 2);
  EXPECT_EQ(recording.played_at_s(), 12.25);
  EXPECT_EQ(recording.state().playback->speed, -4);
  // both viewers receive the state
  for (TestViewer* viewer : {&control, &view})
    while (viewer->text("state")["playback"]["playing"] != true) continue;
  view.send({{"type", "play"}, {"id", 3}, {"playing", false}});
  EXPECT_EQ(view.text("refused")["where"], "role");
  EXPECT_TRUE(recording.state().playback->playing);
  view.send({{"type", "stop"}, {"id", 4}});
  EXPECT_EQ(view.text("done")["id"], 4);
  EXPECT_FALSE(recording.state().playback->playing);
}

TEST(Viewer, ARecordingCannotBeChanged) {
  FakeRecording recording;
  ViewerServerOptions options;
  options.port = 0;
  const auto server = ViewerServer::start(recording, options);
  ASSERT_TRUE(server.ok());
  TestViewer viewer((*server)->port());
  viewer.greet();
  for (Json message :
       std::initializer_list<Json>{{{"type", "set"}, {"paused", true}},
                                   {{"type", "tissue"}, {"tissue", 0}, {"stiffness_N_per_mm", 1.0}},
                                   {{"type", "undo"}},
                                   {{"type", "rearm"}, {"stop", 1}},
                                   {{"type", "pointer"}, {"take", true}},
                                   {{"type", "task"}, {"begin", "hold"}}}) {
    message["id"] = 7;
    viewer.send(message);
    EXPECT_EQ(viewer.text("refused")["what"], "this is a recording: its contact settings cannot be changed")
        << message;
  }
}

TEST(Viewer, ASessionCannotBePlayed) {
  TestServer test;
  TestViewer viewer(test.port());
  viewer.greet();
  viewer.send({{"type", "play"}, {"id", 1}, {"playing", true}});
  EXPECT_EQ(viewer.text("refused")["what"], "this is a live session, not a recording");
}

TEST(Viewer, OneAtATimeMovesTheTip) {
  TestServer test;
  TestViewer first(test.port()), second(test.port());
  first.greet();
  second.greet();
  // before it has taken the pointer
  first.send({{"type", "tip"}, {"patient_mm", {7, 8, 9}}});
  first.send({{"type", "pointer"}, {"id", 1}, {"take", true}});
  EXPECT_EQ(first.text("done")["id"], 1);
  EXPECT_EQ(first.text("state")["pointer"], true);
  EXPECT_TRUE(test.host.pointer_claimed);
  EXPECT_FALSE(test.host.pointer());
  second.send({{"type", "pointer"}, {"id", 2}, {"take", true}});
  EXPECT_EQ(second.text("refused")["id"], 2);
  second.send({{"type", "pointer"}, {"id", 3}, {"take", false}});
  EXPECT_EQ(second.text("refused")["id"], 3);
  second.send({{"type", "tip"}, {"patient_mm", {70, 80, 90}}});
  first.send({{"type", "tip"}, {"patient_mm", {1, 2, 3}}});
  const auto pointer_is = [&](const auto& condition) {
    return soon([&] {
      const auto target = test.host.pointer();
      return condition(target);
    });
  };
  EXPECT_TRUE(pointer_is([](const auto& target) {
    return target && target->tip_patient_mm == std::array<double, 3>{1, 2, 3} && target->force_N == 0;
  }));
  first.send({{"type", "tip"}, {"patient_mm", {4, 5, 6}}, {"into", {0, 0, -1}}, {"force_N", 0.7}});
  EXPECT_TRUE(pointer_is([](const auto& target) {
    return target && target->into == std::array<double, 3>{0, 0, -1} && target->force_N == 0.7;
  }));
  // only the viewer that has the pointer releases it
  second.send({{"type", "lift"}});
  second.send({{"type", "stop"}, {"id", 9}});
  EXPECT_EQ(second.text("done")["id"], 9);
  EXPECT_TRUE(test.host.pointer());
  first.send({{"type", "lift"}});
  EXPECT_TRUE(pointer_is([](const auto& target) { return !target; }));
  // a viewer that disconnects releases the pointer
  first.socket().end_sending();
  EXPECT_TRUE(soon([&] { return !test.host.pointer_claimed; }));
  EXPECT_EQ(test.host.requested_by().number, 1u) << "by him, whom nobody asks any more";
  second.send({{"type", "pointer"}, {"id", 5}, {"take", true}});
  EXPECT_EQ(second.text("done")["id"], 5);
  EXPECT_EQ(test.host.requested_by().number, 2u);
  EXPECT_TRUE(test.host.requested_by().control);
  second.send({{"type", "pointer"}, {"id", 6}, {"take", false}});
  EXPECT_EQ(second.text("done")["id"], 6);
  EXPECT_FALSE(test.host.pointer_claimed);
}

TEST(Viewer, PingsAreAnswered) {
  TestServer test;
  TestViewer viewer(test.port());
  viewer.greet();
  viewer.socket().send(masked_frame(kPing, "are you there"));
  TestFrame next = viewer.frame();
  while (next.is_text() || next.is_binary()) next = viewer.frame();
  EXPECT_EQ(next.opcode, 10);
  EXPECT_EQ(next.payload, "are you there");
}

// A viewer that does not read: others continue without a gap, and when it reads again it gets few messages,
// ending with a recent one.
TEST(Viewer, SlowViewersDelayNoOneAndReceiveTheLatestPose) {
  // reference: a second server without a slow viewer, since a busy machine delays both
  TestServer test, undisturbed;
  TestViewer slow(test.port(), "", false, 4096), other(test.port()), beside(undisturbed.port());
  for (TestViewer* viewer : {&slow, &other, &beside}) viewer->greet({{"poses_hz", 120}});
  struct Sequence {
    std::uint64_t last, missed = 0;
    void observe(const std::string& pose) {
      missed += number_at<std::uint64_t>(pose, 8) - last - 1;
      last = number_at<std::uint64_t>(pose, 8);
    }
  };
  Sequence of_other{number_at<std::uint64_t>(other.pose(), 8)},
      of_beside{number_at<std::uint64_t>(beside.pose(), 8)};
  std::string pose;
  // a quarter of the server's time limit for non-reading viewers
  for (int n = 0; n < 300; ++n) {
    pose = other.pose();
    const std::string same_time = beside.pose();
    ASSERT_FALSE(pose.empty() || same_time.empty());
    of_other.observe(pose);
    of_beside.observe(same_time);
  }
  EXPECT_LT(of_other.missed, 30 + 2 * of_beside.missed);
  const std::uint64_t now = number_at<std::uint64_t>(pose, 16);
  std::uint64_t last = 0, got = 0;
  bool gap = false;
  while (last < now) {
    const std::string late = slow.pose();
    ASSERT_FALSE(late.empty());
    gap = gap || number_at<std::uint64_t>(late, 8) > got + 1;
    got = number_at<std::uint64_t>(late, 8);
    const std::uint64_t tick = number_at<std::uint64_t>(late, 16);
    EXPECT_GT(tick, last);
    last = tick;
  }
  EXPECT_TRUE(gap);
}

TEST(Viewer, ViewerThatStopsReadingIsDisconnected) {
  TestServer test;
  TestViewer stuck(test.port(), "", false, 4096);
  stuck.greet({{"poses_hz", 120}});
  ASSERT_TRUE(soon([&] { return test.server->viewers() == 1; }));
  EXPECT_TRUE(soon([&] { return test.server->viewers() == 0; }));
  EXPECT_NE(test.log.text().find("receives nothing"), std::string::npos);
}

// the queue of unread answers is bounded, and a stop is always carried out
TEST(Viewer, StopIsExecutedForAViewerThatReadsNoAnswers) {
  TestServer test;
  TestViewer stuck(test.port(), "", false, 4096);
  stuck.greet({{"poses_hz", 120}});
  // below the message rate limit, so that the limit is not what ends it
  const auto ask = [&](const Json& request) {
    std::this_thread::sleep_for(std::chrono::milliseconds(4));
    return stuck.send(request);
  };
  for (int n = 0; n < 600; ++n) ASSERT_TRUE(ask({{"type", "set"}, {"id", n}, {"max_force_N", 0.001 * n}}));
  ASSERT_TRUE(ask({{"type", "stop"}, {"id", 600}}));
  EXPECT_TRUE(soon([&] { return test.host.state().stop.has_value(); }));
  EXPECT_LT(test.host.state().max_force_N, 0.599) << "what cannot be answered is not done";
  EXPECT_NE(test.log.text().find("receives no answers"), std::string::npos);
  EXPECT_EQ(test.log.text().find("too many messages"), std::string::npos);
  EXPECT_TRUE(soon([&] { return test.server->viewers() == 0; }));
}

/// Viewers with tokens of each role.
struct Crowd {
  Crowd() {
    ViewerServerOptions options;
    options.token_file =
        write_private(folder / "tokens", std::string("control ") + kControl + "\nview " + kView + "\n");
    test.emplace(options);
  }
  /// Result of connecting: "welcome", or the close code.
  std::string comes(const char* token) {
    auto viewer = std::make_unique<TestViewer>(test->port());
    const Json welcome = viewer->greet({{"token", token}});
    if (welcome.is_null()) return "sent away";
    inside.push_back(std::move(viewer));
    return welcome["type"];
  }

  static constexpr const char *kControl = "control-token-control", *kView = "view-token-view-token";
  const TemporaryFolder folder;
  std::optional<TestServer> test;
  std::vector<std::unique_ptr<TestViewer>> inside;
};

TEST(Viewer, AtMostSixtyFour) {
  Crowd crowd;
  for (int n = 0; n < 64; ++n) ASSERT_EQ(crowd.comes(Crowd::kControl), "welcome") << n;
  EXPECT_EQ(crowd.comes(Crowd::kControl), "sent away");
  EXPECT_EQ(crowd.comes(Crowd::kView), "sent away");
  TestViewer late(crowd.test->port());
  late.send({{"type", "hello"}, {"protocol", 3}, {"token", Crowd::kControl}});
  EXPECT_EQ(late.close_code(), 1013);
  // the page is still served, and a viewer that leaves frees its place
  EXPECT_EQ(request(crowd.test->port(), "GET", "/").status, 200);
  crowd.inside.pop_back();
  EXPECT_TRUE(soon([&] { return crowd.comes(Crowd::kControl) == "welcome"; }));
}

TEST(Viewer, ViewOnlyClientsCannotLockOutControl) {
  Crowd crowd;
  for (int n = 0; n < 62; ++n) ASSERT_EQ(crowd.comes(Crowd::kView), "welcome") << n;
  for (int n = 0; n < 5; ++n) EXPECT_EQ(crowd.comes(Crowd::kView), "sent away") << "two places are kept";
  // two reserved places, and further viewers with control displace others
  for (int n = 0; n < 5; ++n) EXPECT_EQ(crowd.comes(Crowd::kControl), "welcome") << n;
  // the most recent ones are closed; earlier viewers are not affected
  for (const std::size_t removed : {59, 60, 61})
    EXPECT_EQ(crowd.inside[removed]->close_code(), 1013) << removed;
  for (const std::size_t stays : {0, 1, 58, 62, 66})
    EXPECT_FALSE(crowd.inside[stays]->pose().empty()) << stays;
  EXPECT_TRUE(soon([&] { return crowd.test->server->viewers() == 64; }));
  EXPECT_EQ(crowd.comes(Crowd::kView), "sent away");
}

TEST(Viewer, SilentClientsCannotLockOutViewers) {
  Crowd crowd;
  // even if nearly every place is taken
  for (int n = 0; n < 62; ++n) ASSERT_EQ(crowd.comes(Crowd::kView), "welcome") << n;
  std::vector<std::unique_ptr<TestViewer>> silent;
  for (int n = 0; n < 40; ++n) {
    silent.push_back(std::make_unique<TestViewer>(crowd.test->port()));
    ASSERT_EQ(silent.back()->opening().status, 101) << n;
  }
  EXPECT_EQ(crowd.comes(Crowd::kControl), "welcome");
  EXPECT_EQ(silent.front()->close_code(), 1013) << "the first of them";
}

// sent to subscribers on a change, and to late subscribers
TEST(Viewer, TipErrorIsSentToSubscribers) {
  TestServer test;
  TestViewer viewer(test.port()), other(test.port());
  viewer.greet({{"navigation", true}});
  other.greet();
  test.host.navigate({0, true, 0.3, ViewedNavigation::Error{0.8, 1.4, false}});
  EXPECT_EQ(viewer.text("navigation")["tre_mm"], 0.8);
  test.host.navigate({0, true, 0.3, ViewedNavigation::Error{0.9, 1.5, false}});
  EXPECT_EQ(viewer.text("navigation")["tre_mm"], 0.9);
  TestViewer late(test.port());
  late.greet({{"navigation", true}});
  EXPECT_EQ(late.text("navigation")["tre_95_mm"], 1.5);
  other.send({{"type", "stop"}, {"id", 1}});
  for (Json next = other.text(); next["type"] != "done"; next = other.text())
    EXPECT_NE(next["type"], "navigation") << "one that did not ask";
}

}  // namespace
}  // namespace palpate::server
