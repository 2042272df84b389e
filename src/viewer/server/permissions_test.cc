#include "server/permissions.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <functional>
#include <map>
#include <optional>

#include "base/test_folder.h"
#include "palpate/base/file.h"
#include "server/test_client.h"
#include "server/test_host.h"

namespace palpate::server {
namespace {

using palpate::test::TemporaryFolder;
using palpate::test::write_private;
using palpate::testing::Json;
using palpate::testing::request;
using palpate::testing::test_task;
using palpate::testing::TestAnswer;
using palpate::testing::TestServer;
using palpate::testing::TestViewer;
using ::testing::HasSubstr;

const std::map<Role, std::string> kTokenOf{{Role::kView, "view-token-k7wq2mzr9xbt4hvc"},
                                           {Role::kControl, "control-token-k7wq2mzr9xbt4"},
                                           {Role::kLearner, "learner-token-k7wq2mzr9xbt4"},
                                           {Role::kTeacher, "teacher-token-k7wq2mzr9xbt4"}};
constexpr const char* kOtherLearner = "other-learner-k7wq2mzr9xbt4";

/// Server with tokens for one viewer of each role and for a second learner.
struct School {
  explicit School(std::vector<ViewedTask> tasks = {test_task()}, bool stores_runs = true)
      : test(options(), {5, 4, 3}, "pointer", std::move(tasks), {}, stores_runs) {}

  ViewerServerOptions options() {
    std::string lines = std::string("learner ") + kOtherLearner + " L007\n";
    for (const auto& [role, token] : kTokenOf)
      lines += std::string(name_of(role)) + " " + token + (role == Role::kLearner ? " L042\n" : "\n");
    ViewerServerOptions options;
    options.token_file = write_private(folder / "tokens", lines);
    return options;
  }
  /// Connects and says hello. @param more  further members of the hello
  std::unique_ptr<TestViewer> comes(const std::string& token, const Json& more = Json::object()) {
    auto viewer = std::make_unique<TestViewer>(test.port());
    Json hello{{"token", token}};
    hello.update(more);
    welcome = viewer->greet(hello);
    return viewer;
  }
  std::unique_ptr<TestViewer> comes(Role role, const Json& more = Json::object()) {
    return comes(kTokenOf.at(role), more);
  }
  TestAnswer get(const std::string& token, const std::string& path) {
    return request(test.port(), "GET", path, "Authorization: Bearer " + token + "\r\n");
  }

  TemporaryFolder folder;
  TestServer test;
  Json welcome;
};

/// Answer to a request: "done", or the refusal.
Json requested(TestViewer& viewer, Json message) {
  message["id"] = 5;
  viewer.send(message);
  while (true) {
    Json answer = viewer.text();
    if (answer.is_null() || answer["type"] == "done" || answer["type"] == "refused") return answer;
  }
}

TEST(Rights, DocumentedTableEqualsTheServers) {
  const std::string path = PALPATE_SOURCE_DIR "/docs/reference/viewer-protocol.md";
  const std::string begin = "<!-- rights begin -->\n", end = "<!-- rights end -->";
  std::string text = *read_file(path);
  const std::size_t first = text.find(begin) + begin.size(), last = text.find(end);
  ASSERT_NE(last, std::string::npos);
  if (std::getenv("PALPATE_UPDATE_DOCS")) {
    text.replace(first, last - first, permissions_table());
    ASSERT_TRUE(write_file(path, text).ok());
    return;
  }
  EXPECT_EQ(text.substr(first, last - first), permissions_table())
      << "PALPATE_UPDATE_DOCS=1 server_test --gtest_filter='Rights.TheTable*'";
}

// the server enforces every cell of the table that a message can test
TEST(Rights, ServerEnforcesEveryCell) {
  const std::map<Permission, std::vector<Json>> kMessages{
      {Permission::kStop, {{{"type", "stop"}}}},
      {Permission::kOperateTool,
       {{{"type", "pointer"}, {"take", true}},
        {{"type", "set"}, {"paused", true}},
        {{"type", "set"}, {"motor", true}},
        {{"type", "set"}, {"rotation_wxyz", {1, 0, 0, 0}}},
        {{"type", "task"}, {"begin", "hold"}},
        {{"type", "task"}, {"end", true}}}},
      {Permission::kChangeContact,
       {{{"type", "set"}, {"method", "trilinear"}},
        {{"type", "set"}, {"law", "elastic"}},
        {{"type", "set"}, {"friction", false}},
        {{"type", "set"}, {"viscosity", false}},
        {{"type", "set"}, {"passivity", false}},
        {{"type", "set"}, {"paused", false}, {"max_force_N", 1.0}},
        {{"type", "tissue"}, {"tissue", 0}, {"stiffness_N_per_mm", 1.0}}}},
      {Permission::kPlan, {{{"type", "plan"}, {"version", 1}, {"save", true}}}},
      {Permission::kPlay, {{{"type", "play"}, {"at_s", 1.0}}}},
      {Permission::kLesson,
       {{{"type", "lesson"}, {"learner", "L042"}},
        {{"type", "lesson"}, {"task", "hold"}},
        {{"type", "lesson"}, {"names", false}},
        {{"type", "lesson"}, {"pointer", ""}},
        {{"type", "lesson"}, {"end", true}}}}};
  for (const bool has_tasks : {true, false})
    for (const Role role : kRoles) {
      for (const auto& [right, messages] : kMessages) {
        School school(has_tasks ? std::vector{test_task()} : std::vector<ViewedTask>());
        school.test.host.rehearse({});
        const auto viewer = school.comes(role);
        EXPECT_EQ(school.welcome["role"], name_of(role));
        for (const Json& message : messages) {
          const Json answer = requested(*viewer, message);
          const std::string of = std::string(name_of(role)) + message.dump();
          if (is_permitted(role, right, has_tasks)) {
            EXPECT_TRUE(answer["type"] == "done" || answer["where"] != "role") << of << answer;
            continue;
          }
          EXPECT_EQ(answer["type"], "refused") << of;
          EXPECT_EQ(answer["where"], "role") << of;
          EXPECT_EQ(answer["what"], missing_permission(role, right).what) << of;
        }
      }
    }
}

TEST(Rights, RefusalNamesTheRequiredRole) {
  EXPECT_EQ(missing_permission(Role::kLearner, Permission::kChangeContact).what,
            "in a session with tasks only a viewer with control or a teacher may change contact settings");
  EXPECT_EQ(missing_permission(Role::kLearner, Permission::kChangeContact).remedy,
            "connect with a token for control or teacher");
  EXPECT_EQ(missing_permission(Role::kView, Permission::kOperateTool).what,
            "only a viewer with control, a learner or a teacher may operate the tool");
  EXPECT_EQ(missing_permission(Role::kLearner, Permission::kLesson).what,
            "only a teacher may lead the lesson");
}

TEST(Rights, RefusedRequestsHaveNoEffect) {
  School school;
  const auto learner = school.comes(Role::kLearner);
  EXPECT_EQ(school.welcome["learner"], "L042");
  EXPECT_EQ(school.welcome["may"], Json({"look", "stop", "hand", "own_runs"}));
  requested(*learner, {{"type", "set"}, {"paused", true}, {"max_force_N", 0.5}});
  requested(*learner, {{"type", "tissue"}, {"tissue", 0}, {"stiffness_N_per_mm", 9.0}});
  requested(*learner, {{"type", "lesson"}, {"end", true}});
  const ViewedState state = school.test.host.state();
  EXPECT_FALSE(state.paused);
  EXPECT_EQ(state.max_force_N, 1.4);
  EXPECT_EQ(state.tissues[0].stiffness_N_per_mm, 1.5);
  EXPECT_FALSE(school.test.host.ended());
}

TEST(Rights, ALearnerSeesHisOrHerOwnCurvesAlone) {
  School school;
  EXPECT_EQ(school.get(kTokenOf.at(Role::kLearner), "/api/curves").body, "<p>L042</p>");
  EXPECT_EQ(school.get(kOtherLearner, "/api/curves").body, "<p>L007</p>");
  EXPECT_EQ(school.get(kTokenOf.at(Role::kTeacher), "/api/curves").body, "<p>everybody</p>");
  for (const Role role : {Role::kView, Role::kControl}) {
    const TestAnswer refused = school.get(kTokenOf.at(role), "/api/curves");
    EXPECT_EQ(refused.status, 403) << name_of(role);
    EXPECT_THAT(refused.body, HasSubstr("teachers may see learning curves"));
  }
  EXPECT_EQ(school.get("no-token-k7wq2mzr9xbt4hvc", "/api/curves").status, 401);
  // only the token determines the learner
  for (const char* path : {"/api/curves?learner=L007", "/api/curves/L007"})
    EXPECT_EQ(school.get(kTokenOf.at(Role::kLearner), path).status, 404) << path;
  School unkept({test_task()}, false);
  EXPECT_EQ(unkept.get(kTokenOf.at(Role::kTeacher), "/api/curves").status, 404);
  unkept.comes(Role::kTeacher);
  EXPECT_THAT(unkept.welcome["may"], ::testing::Not(::testing::Contains("all_runs")));
}

TEST(Rights, ALearnerDoesTasksAsHimOrHerselfAlone) {
  School school;
  const auto teacher = school.comes(Role::kTeacher), one = school.comes(Role::kLearner, {{"task", true}}),
             other = school.comes(kOtherLearner, {{"task", true}});
  // the run is attributed to the token's pseudonym
  EXPECT_EQ(requested(*one, {{"type", "task"}, {"begin", "hold"}})["type"], "done");
  EXPECT_EQ(school.test.host.training().learner, "L042");
  // only a teacher can end another learner's run
  EXPECT_EQ(requested(*other, {{"type", "task"}, {"end", true}})["where"], "learner");
  const Json during_run = requested(*other, {{"type", "pointer"}, {"take", true}});
  EXPECT_EQ(during_run["where"], "learner");
  EXPECT_EQ(during_run["what"], "the run in progress belongs to another learner");
  EXPECT_EQ(requested(*teacher, {{"type", "task"}, {"end", true}})["type"], "done");
  // the debriefing goes to that learner and to the teacher
  EXPECT_EQ(one->text("debriefing")["runs"], 4);
  other->send({{"type", "stop"}, {"id", 9}});
  for (Json reported = other->text(); !reported.is_null() && reported["type"] != "done";
       reported = other->text())
    EXPECT_NE(reported["type"], "debriefing");

  // a teacher chooses the learner, with or without the pointer
  EXPECT_EQ(requested(*one, {{"type", "pointer"}, {"take", true}})["type"], "done");
  EXPECT_EQ(requested(*teacher, {{"type", "lesson"}, {"learner", "L007"}})["type"], "done");
  EXPECT_EQ(requested(*one, {{"type", "task"}, {"begin", "hold"}})["where"], "learner");
  EXPECT_TRUE(school.test.host.pointer_claimed) << "whoever is named gets it";
  const Json not_chosen = requested(*one, {{"type", "pointer"}, {"take", true}});
  EXPECT_EQ(not_chosen["where"], "learner");
  EXPECT_EQ(not_chosen["what"], "it is another learner's turn");
  EXPECT_EQ(requested(*other, {{"type", "pointer"}, {"take", true}})["type"], "done");
  EXPECT_EQ(requested(*teacher, {{"type", "task"}, {"begin", "hold"}})["type"], "done");
  EXPECT_EQ(school.test.host.training().learner, "L007");
  EXPECT_EQ(requested(*teacher, {{"type", "lesson"}, {"end", true}})["type"], "done");
  EXPECT_TRUE(school.test.host.ended());
}

// a session that ends while a run is in progress scores it while its viewers are still connected
TEST(Rights, LessonEndIsAnsweredAndDebriefedBeforeClosing) {
  School school;
  const auto teacher = school.comes(Role::kTeacher), one = school.comes(Role::kLearner, {{"task", true}});
  EXPECT_EQ(requested(*one, {{"type", "task"}, {"begin", "hold"}})["type"], "done");
  teacher->send({{"type", "lesson"}, {"end", true}, {"id", 9}});
  ASSERT_TRUE(soon([&] { return school.test.host.ended(); }));
  TaskRequest end;
  end.end = true;
  ASSERT_TRUE(school.test.host.train(end).ok());
  school.test.server.reset();
  EXPECT_EQ(teacher->text("done")["id"], 9);
  EXPECT_EQ(teacher->close_code(), 1001);
  EXPECT_EQ(one->text("debriefing")["runs"], 4);
  EXPECT_EQ(one->text("task")["phase"], "over");
  EXPECT_EQ(one->close_code(), 1001);
}

/// Newest state of which something holds.
Json state_when(TestViewer& viewer, const std::function<bool(const Json&)>& holds) {
  Json state = viewer.text("state");
  while (!state.is_null() && !holds(state)) state = viewer.text("state");
  return state;
}

TEST(Rights, TeacherAssignsThePointer) {
  School school;
  // the teacher's page comes first, and takes the pointer
  const auto teacher = school.comes(Role::kTeacher);
  EXPECT_EQ(requested(*teacher, {{"type", "pointer"}, {"take", true}})["type"], "done");
  // states that come before an answer are lost to whoever asks
  const auto watch = school.comes(Role::kTeacher);
  const auto one = school.comes(Role::kLearner);
  EXPECT_EQ(requested(*one, {{"type", "pointer"}, {"take", true}})["type"], "refused")
      << "the teacher has it";
  EXPECT_EQ(requested(*teacher, {{"type", "lesson"}, {"learner", "L042"}})["type"], "done");
  EXPECT_FALSE(state_when(*one, [](const Json& state) { return state["pointer"] == true; }).is_null());
  const Json listed =
      state_when(*watch, [](const Json& state) { return state["lesson"]["learners"][1]["pointer"] == true; });
  EXPECT_EQ(listed["lesson"]["learners"],
            Json::parse(R"([{"learner": "L007", "here": false, "pointer": false},
                            {"learner": "L042", "here": true, "pointer": true}])"));

  // a learner that is named before the page is open gets the pointer with the hello
  EXPECT_EQ(requested(*teacher, {{"type", "lesson"}, {"learner", "L007"}})["type"], "done");
  EXPECT_FALSE(school.test.host.pointer_claimed) << "nobody has it meanwhile";
  EXPECT_EQ(requested(*teacher, {{"type", "lesson"}, {"pointer", "L007"}})["where"], "pointer") << "not here";
  EXPECT_EQ(requested(*teacher, {{"type", "lesson"}, {"pointer", "L042"}})["where"], "pointer")
      << "not meant";
  const auto other = school.comes(kOtherLearner);
  EXPECT_FALSE(state_when(*other, [](const Json& state) { return state["pointer"] == true; }).is_null());

  // a teacher takes it from a learner, and passes it
  EXPECT_EQ(requested(*teacher, {{"type", "lesson"}, {"pointer", ""}})["type"], "done");
  EXPECT_FALSE(state_when(*other, [](const Json& state) { return state["pointer_by"].is_null(); }).is_null());
  EXPECT_EQ(requested(*teacher, {{"type", "lesson"}, {"learner", ""}, {"pointer", "L042"}})["type"], "done");
  const Json passed = state_when(*one, [](const Json& state) { return state["pointer"] == true; });
  ASSERT_FALSE(passed.is_null());
  EXPECT_TRUE(passed["lesson"]["learners"].is_null()) << "only a teacher gets the list";

  EXPECT_EQ(requested(*teacher, {{"type", "lesson"}, {"end", true}})["type"], "done");
  EXPECT_FALSE(state_when(*one, [](const Json& state) { return state["lesson"]["over"] == true; }).is_null());
}

}  // namespace
}  // namespace palpate::server
