#include "server/error_json.h"

#include <gtest/gtest.h>

#include <variant>

#include "palpate/scene/named_values.h"
#include "server/request.h"
#include "server/test_client.h"
#include "server/test_host.h"

namespace palpate::server {
namespace {

using palpate::testing::request;
using palpate::testing::TestServer;
using palpate::testing::TestViewer;
using WireJson = palpate::testing::Json;

namespace error_canary {

constexpr const char* kCanary = "DOE^CANARY";

Error with_canary() {
  return {ErrorKind::kOutput, "cannot be written, the disk is full",
          std::string("/home/") + kCanary + "/plan-" + kCanary + ".toml:7",
          "free some space or write elsewhere"};
}

/// Host that refuses everything with an error whose `where` is a file.
class Refusing : public testing::FakeHost {
 public:
  Refusing() { store_runs(); }
  using FakeHost::change;
  Result<RequestOutcome> set(const SettingsRequest& request) override {
    if (request.paused) return FakeHost::set(request);
    return with_canary();
  }
  Result<RequestOutcome> set(const TissueRequest&) override { return with_canary(); }
  Result<RequestOutcome> set(const StrokeRequest&) override { return with_canary(); }
  Result<void> rearm(const RearmRequest&) override { return with_canary(); }
  Result<void> claim_pointer(bool, const ViewerIdentity&) override { return with_canary(); }
  Result<void> train(const TaskRequest&) override { return with_canary(); }
  Result<void> teach(const LessonRequest&) override { return with_canary(); }
  Result<void> change(const PlanRequest&) override { return with_canary(); }
  Result<std::string> curves(const std::string&) const override { return with_canary(); }
  std::shared_ptr<const ViewedDebriefing> debriefing() const override {
    auto reported = testing::test_debriefing();
    reported.not_stored = with_canary();
    return std::make_shared<const ViewedDebriefing>(reported);
  }
};

/// Recording that cannot be read any further.
class Unreadable : public testing::FakeRecording {
 public:
  Result<void> play(const PlayRequest&) override { return with_canary(); }
};

std::string refusal_of_a_recording() {
  Unreadable host;
  ViewerServerOptions options;
  options.port = 0;
  const auto server = ViewerServer::start(host, options);
  PALPATE_CHECK(server.ok());
  TestViewer viewer((*server)->port());
  viewer.greet();
  viewer.send({{"type", "play"}, {"id", 1}, {"at_s", 1.0}});
  return viewer.text("refused").dump();
}

}  // namespace error_canary

TEST(ReportedError, WhereIsReportedOnlyForProtocolWords) {
  const palpate::Json reported = error_json(error_canary::with_canary());
  EXPECT_EQ(reported["what"], "cannot be written, the disk is full");
  EXPECT_EQ(reported["where"], "");
  EXPECT_EQ(reported["how"], "free some space or write elsewhere");
  for (const char* file : {"plan.toml", "plan.toml:7", "./role", "role.h5", "--plan", "/", "DOE"})
    EXPECT_EQ(error_json({ErrorKind::kBadInput, "x", file, ""})["where"], "") << file;
  for (const ForceMethodInfo& method : kForceMethods) EXPECT_TRUE(is_word_of_protocol(method.name));
  for (const auto& law : kTissueLaws) EXPECT_TRUE(is_word_of_protocol(law.name)) << law.name;
}

// for any invalid key the answer names it
TEST(ReportedError, RequestKeysAreProtocolWords) {
  const std::map<std::string, std::vector<const char*>> kKeys{
      {"set",
       {"method", "law", "friction", "viscosity", "passivity", "paused", "motor", "max_force_N",
        "rotation_wxyz"}},
      {"tissue", {"tissue", "stiffness_N_per_mm", "static_friction", "friction", "viscosity_N_s_per_mm"}},
      {"pointer", {"take"}},
      {"play", {"at_s", "playing", "speed"}},
      {"task", {"begin", "end"}},
      {"lesson", {"learner", "task", "names", "end"}},
      {"plan", {"version", "trajectory", "name", "entry_mm", "target_mm", "remove", "back_to", "save"}},
      {"rearm", {"stop", "code"}}};
  for (const auto& [type, keys] : kKeys)
    for (const char* key : keys) {
      const WireJson message{{"type", type}, {"id", 1}, {key, WireJson::array({1, 2})}};
      const auto parsed = parse_viewer_message(message.dump());
      ASSERT_TRUE(parsed && std::holds_alternative<Request>(*parsed)) << message;
      const auto* refusal = std::get_if<Error>(&std::get<Request>(*parsed).body);
      ASSERT_TRUE(refusal) << message;
      EXPECT_TRUE(is_word_of_protocol(refusal->where)) << message << refusal->where;
    }
}

TEST(ReportedError, ErrorsContainNoFileNames) {
  error_canary::Refusing host;
  host.edit_scene().input = "pointer";
  host.edit_scene().tasks = {testing::test_task()};
  host.rehearse({});
  host.change([](ViewedState& state) {
    state.playback.emplace();
    state.playback->failure = error_canary::with_canary();
    state.method_failure = state.law_failure = error_canary::with_canary();
  });
  testing::TestLog log;
  ViewerServerOptions options;
  options.port = 0;
  options.log = log.writer();
  const auto server = ViewerServer::start(host, options);
  ASSERT_TRUE(server.ok());
  const int port = (*server)->port();

  TestViewer viewer(port);
  std::string wire = viewer.opening().head;
  wire +=
      viewer.greet({{"task", true}, {"plan", true}, {"near", true}, {"navigation", true}, {"yielded", true}})
          .dump();
  const std::vector<WireJson> messages{
      {{"type", "set"}, {"method", "proxy"}},
      {{"type", "set"}, {"max_force_N", 1.0}},
      {{"type", "tissue"}, {"tissue", 0}, {"stiffness_N_per_mm", 1.0}},
      {{"type", "undo"}},
      {{"type", "redo"}},
      {{"type", "stop"}},
      {{"type", "rearm"}, {"stop", 1}},
      {{"type", "pointer"}, {"take", true}},
      {{"type", "task"}, {"begin", "hold"}},
      {{"type", "task"}, {"end", true}},
      {{"type", "lesson"}, {"task", "hold"}},
      {{"type", "lesson"}, {"end", true}},
      {{"type", "plan"}, {"version", 1}, {"save", true}},
      {{"type", "plan"}, {"version", 1}, {"trajectory", 0}, {"remove", true}}};
  int refused = 0, id = 0;
  for (WireJson message : messages) {
    message["id"] = ++id;
    viewer.send(message);
    while (true) {
      const WireJson answer = viewer.text();
      ASSERT_FALSE(answer.is_null()) << message;
      wire += answer.dump();
      if (answer["type"] == "refused") ++refused;
      if (answer.contains("id") && answer["id"] == id) break;
    }
  }
  EXPECT_EQ(refused, static_cast<int>(messages.size()) - 1) << "a stop is never refused";
  host.ask_first();
  viewer.send({{"type", "set"}, {"id", 99}, {"paused", true}});
  wire += viewer.text("asked").dump();
  host.answer(error_canary::with_canary());
  wire += viewer.text("refused").dump();
  for (const char* path : {"/", "/api/scene", "/api/curves", "/api/nothing"}) {
    const auto answer = request(port, "GET", path);
    wire += answer.head + answer.body;
  }
  wire += error_canary::refusal_of_a_recording();
  EXPECT_NE(wire.find("the disk is full"), std::string::npos) << "viewers are told the rest";
  EXPECT_NE(wire.find("not_stored"), std::string::npos);
  EXPECT_NE(wire.find("method_failed"), std::string::npos);
  EXPECT_EQ(wire.find(error_canary::kCanary), std::string::npos)
      << wire.substr(wire.find(error_canary::kCanary) - 100, 200);
  EXPECT_EQ(log.text().find(error_canary::kCanary), std::string::npos);
}

}  // namespace
}  // namespace palpate::server
