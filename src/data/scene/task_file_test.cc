#include "palpate/scene/task_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "base/test_folder.h"

namespace palpate {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

constexpr const char* kWholeTask = R"(title = "Probe"
briefing = "Do it."
data_set = "knee-phantom:side=right"
ordered = true
quiz = true
end = "recording"
time_limit = 95
in_a_row = 2
[[region]]
name = "tip"
structures = ["medial_meniscus", 12]
landmark = "anterior"
radius = 8
half = "left"
[[region]]
name = "pouch"
point = [1, 2, 3.5]
radius = 10
[[region]]
name = "front"
structures = ["femur"]
plane_point = [0, 0, 0]
plane_normal = [0, -3, 0]
[[step]]
name = "push"
region = "tip"
force = [2, 3.6]
seconds = 0.5
seen = true
[[step]]
name = "go there"
region = "pouch"
kind = "visit"
[[step]]
name = "sweep"
region = "front"
kind = "cover"
coverage = 0.25
[[force]]
structures = ["medial_meniscus"]
band = [1.6, 3.6]
limit = 8.5
[[protected]]
structures = ["nerve"]
limit = 0.1
[answer]
structures = ["nodule"]
seconds = 2
[scope]
optics = 70
back = 4.5
[[drawn]]
key = "lesion-depth"
range = [2, 8]
step = 0.1
[[drawn]]
key = "lesion-in"
words = ["femur", "tibia"]
[[metric]]
name = "peak_force"
structures = ["medial_meniscus"]
at_most = 8.5
basis = "somebody"
[[metric]]
name = "answer_error"
)";

TEST(ParseTask, ReadsEveryKey) {
  const auto task = parse_task(kWholeTask, "task.toml");
  ASSERT_TRUE(task.ok()) << task.error().message();
  EXPECT_EQ(task->title, "Probe");
  EXPECT_EQ(task->briefing, "Do it.");
  EXPECT_TRUE(task->ordered);
  EXPECT_TRUE(task->quiz);
  EXPECT_EQ(task->end, TaskEnd::kRecording);
  EXPECT_EQ(task->time_limit_s, 95);
  EXPECT_EQ(task->in_a_row, 2);
  ASSERT_EQ(task->regions.size(), 3u);
  EXPECT_EQ(std::get<int>(task->regions[0].structures[1]), 12);
  EXPECT_EQ(*task->regions[0].landmark, Vector<Patient>(0, -1, 0));
  EXPECT_EQ(*task->regions[0].half, Vector<Patient>(1, 0, 0));
  EXPECT_EQ(task->regions[1].point->z(), 3.5);
  EXPECT_EQ(*task->regions[2].plane_normal, Vector<Patient>(0, -1, 0));
  ASSERT_EQ(task->steps.size(), 3u);
  EXPECT_EQ(task->steps[0].force_N, (std::array<double, 2>{2, 3.6}));
  EXPECT_EQ(task->steps[1].kind, StepKind::kVisit);
  EXPECT_EQ(task->steps[2].coverage, 0.25);
  EXPECT_EQ(task->steps[2].region, 2u);
  EXPECT_EQ(task->forces[0].limit_N, 8.5);
  EXPECT_EQ(task->protections[0].limit_N, 0.1);
  EXPECT_EQ(task->answer->seconds, 2);
  EXPECT_TRUE(task->metrics[0].counts());
  EXPECT_FALSE(task->metrics[1].counts());
  EXPECT_EQ(task->metrics[0].basis, "somebody");
  EXPECT_TRUE(task->steps[0].seen);
  EXPECT_FALSE(task->steps[1].seen);
  EXPECT_EQ(task->scope->optics, (ScopeOptics{70, 4.5}));
  EXPECT_FALSE(task->plan);
}

constexpr const char* kHole = R"(title = "Hole"
[[trajectory]]
name = "in"
entry = [0, 0, 10]
target = [0, 0, 0]
[[region]]
name = "hole"
shape = "sphere"
trajectory = "in"
radius = 3
)";
constexpr const char* kTakeOff = R"(title = "Take off"
data_set = "knee-phantom:burr=4"
plan = "hole.toml"
[[step]]
name = "take it off"
kind = "remove"
region = "hole"
coverage = 0.9
[[metric]]
name = "removed_in_plan"
)";

TEST(LoadTask, LoadsThePlanNextToTheTask) {
  const test::TemporaryFolder folder;
  const auto file = folder / "task.toml";
  test::write_text(file, kTakeOff);
  EXPECT_THAT(load_task(file.string()).error().message(),
              AllOf(HasSubstr("task.toml:3: the plan \"hole.toml\" cannot be used"), HasSubstr("hole.toml")));
  test::write_text(folder / "hole.toml", kHole);
  const auto task = load_task(file.string());
  ASSERT_TRUE(task.ok()) << task.error().message();
  ASSERT_TRUE(task->plan);
  EXPECT_EQ(task->steps[0].kind, StepKind::kRemove);
  EXPECT_EQ(task->steps[0].region, 0u);
  EXPECT_EQ(drawn_data_set(*task, 7), "knee-phantom:burr=4") << "a plan is one patient's";
  // a changed plan changes the hash of the task
  test::write_text(folder / "hole.toml", std::string(kHole) + "# wider\n");
  EXPECT_NE(load_task(file.string())->text_hash, task->text_hash);

  const auto wrong = [&](const std::string& before, const std::string& after) {
    std::string text = kTakeOff;
    text.replace(text.find(before), before.size(), after);
    test::write_text(file, text);
    const auto refused = load_task(file.string());
    EXPECT_FALSE(refused.ok()) << after;
    return refused.ok() ? "" : refused.error().message();
  };
  EXPECT_THAT(wrong("region = \"hole\"", "region = \"hale\""),
              AllOf(HasSubstr("task.toml:7: the plan has no region"), HasSubstr("did you mean \"hole\"")));
  EXPECT_THAT(wrong("plan = \"hole.toml\"\n", ""), HasSubstr("but the task has no plan"));
  EXPECT_THAT(wrong("coverage = 0.9", "seconds = 1"), HasSubstr("seconds is not for a step"));
  EXPECT_THAT(wrong("removed_in_plan", "protected_removed"), HasSubstr("without a [[protected]]"));
  EXPECT_THAT(wrong("removed_in_plan", "unseen_time"), HasSubstr("without a [scope]"));
  EXPECT_THAT(wrong("removed_in_plan", "hidden_time"), HasSubstr("without a [microscope]"));
  EXPECT_THAT(wrong("removed_in_plan", "bone_left"), HasSubstr("bone_left without structures"));
  EXPECT_THAT(wrong("\"removed_in_plan\"", "\"burr_distance\"\nstructures = [1]\nwithin = 2"),
              HasSubstr("within is only for force_near"));
  EXPECT_THAT(wrong("plan = ", "[microscope]\ntilt = 80\n#"), HasSubstr("tilt = 80 is outside"));
  test::write_text(folder / "hole.toml",
                   "title = \"Keep away\"\n[[keep_away]]\nstructures = [1]\ndistance = 2\n");
  EXPECT_THAT(wrong("title", "title"), HasSubstr("removes nothing"));
  // a text without a folder does not read files
  EXPECT_THAT(parse_task(kTakeOff, "task.toml").error().message(),
              HasSubstr("task.toml:3: palpate includes no plan \"hole.toml\""));
}

TEST(LoadPlan, KnowsItsOwnByName) {
  EXPECT_GE(embedded_plans().size(), 1u);
  for (const EmbeddedFile& file : embedded_plans()) {
    const auto plan = load_plan(std::string(file.name.substr(0, file.name.size() - 5)));
    ASSERT_TRUE(plan.ok()) << plan.error().message();
    EXPECT_FALSE(plan->regions.empty()) << file.name;
  }
}

TEST(LoadTask, APlanOfWholeStructuresHoldsForEveryPatient) {
  const auto task = load_task("cortical-mastoidectomy");
  ASSERT_TRUE(task.ok()) << task.error().message();
  EXPECT_EQ(drawn_data_set(*task, 7), "temporal-bone:seed=7");
  ASSERT_TRUE(task->microscope);
  EXPECT_EQ(task->microscope->from, Vector<Patient>(1, 0, 0));
  EXPECT_EQ(task->microscope->tilt_deg, 25);
}

TEST(ParseTask, DrawsBySeedWithinTheRange) {
  const auto task = parse_task(kWholeTask, "task.toml");
  ASSERT_TRUE(task.ok());
  EXPECT_EQ(drawn_data_set(*task, 7), drawn_data_set(*task, 7));
  EXPECT_THAT(drawn_data_set(*task, 7), StartsWith("knee-phantom:side=right,seed=7,lesion-depth="));
  std::set<std::string> values, words;
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    const std::string text = drawn_data_set(*task, seed);
    const std::size_t last = text.rfind(",lesion-in=");
    ASSERT_NE(last, std::string::npos);
    words.insert(text.substr(last + 11));
    const std::string number = text.substr(text.rfind('=', last) + 1, last - text.rfind('=', last) - 1);
    values.insert(number);
    EXPECT_GE(std::stod(number), 2);
    EXPECT_LE(std::stod(number), 8);
  }
  EXPECT_THAT(words, ElementsAre("femur", "tibia"));
  EXPECT_GE(values.size(), 58u);  // 61 values are possible
  EXPECT_TRUE(values.contains("2.1"));
}

struct Wrong {
  const char* before;  // substring of kWholeTask
  const char* after;
  const char* reported;
};

TEST(ParseTask, ErrorsNameFaultAndLine) {
  const Wrong wrongs[] = {
      {"title = \"Probe\"\n", "", "no title"},
      {"ordered = true", "orderd = true", "did you mean ordered"},
      {"region = \"pouch\"", "region = \"puoch\"", "did you mean \"pouch\""},
      {"name = \"pouch\"", "name = \"tip\"", "a second region"},
      {"radius = 8\n", "", "without radius"},
      {"plane_normal = [0, -3, 0]\n", "", "half a plane"},
      {"structures = [\"femur\"]\n", "", "a region needs structures"},
      {"kind = \"visit\"", "kind = \"touch\"", "cannot be touched"},
      {"kind = \"cover\"\n", "kind = \"visit\"\n", "a surface cannot be visited"},
      {"force = [2, 3.6]", "force = [3.6, 2]", "not below its end"},
      {"band = [1.6, 3.6]\nlimit = 8.5\n", "", "without band and limit"},
      {"name = \"answer_error\"", "name = \"answer\"", "unknown name \"answer\""},
      {"name = \"answer_error\"", "name = \"time\"\nstructures = [1]", "not of single structures"},
      {"[answer]\nstructures = [\"nodule\"]\nseconds = 2\n", "",
       "answer_error of a task without an [answer]"},
      {"at_most = 8.5\n", "at_least = 9\nat_most = 8.5\n", "at_most below at_least"},
      {"key = \"lesion-depth\"", "key = \"seed\"", "the seed itself cannot be drawn"},
      {"key = \"lesion-depth\"", "key = \"a,b=3\"", "not a key of a data set"},
      {"words = [\"femur\"", "words = [\"femur,seed=3\"", "not a valid word"},
      {"step = 0.1", "words = [\"femur\"]", "both words and numbers"},
      {"data_set = \"knee-phantom:side=right\"\n", "", "but no data_set"},
      {"in_a_row = 2", "in_a_row = 0", "outside 1 ... 100"},
      {"time_limit = 95", "time_limit = nan", "not a finite number"},
      {"[scope]\noptics = 70\nback = 4.5\n", "", "but the task has no [scope]"},
      {"kind = \"visit\"", "kind = \"visit\"\nseen = true", "seen is only for a step"},
      {"optics = 70", "optics = 100", "outside 0 ... 90 degrees"},
  };
  for (const Wrong& wrong : wrongs) {
    std::string text = kWholeTask;
    const std::size_t at = text.find(wrong.before);
    ASSERT_NE(at, std::string::npos) << wrong.before;
    text.replace(at, std::string_view(wrong.before).size(), wrong.after);
    const auto task = parse_task(text, "task.toml");
    ASSERT_FALSE(task.ok()) << wrong.reported;
    EXPECT_THAT(task.error().message(), AllOf(StartsWith("task.toml:"), HasSubstr(wrong.reported)))
        << wrong.after;
  }
  EXPECT_THAT(parse_task("[[tissue]]\nname = \"bone\"\n", "x").error().what, HasSubstr("a scene"));
  EXPECT_FALSE(parse_task("", "x").ok());
  std::string many = kWholeTask;
  for (std::size_t n = 0; n < kMaxTaskParts; ++n) many += "[[metric]]\nname = \"time\"\n";
  EXPECT_THAT(parse_task(many, "x").error().what, HasSubstr("more than 200"));
}

TEST(LoadTask, KnowsItsOwnByName) {
  EXPECT_GE(embedded_tasks().size(), 1u);
  for (const EmbeddedFile& file : embedded_tasks()) {
    const std::string name(file.name.substr(0, file.name.size() - 5));
    const auto task = load_task(name);
    ASSERT_TRUE(task.ok()) << task.error().message();
    EXPECT_FALSE(task->briefing.empty()) << name;
    EXPECT_FALSE(drawn_data_set(*task, 3).empty()) << name;
  }
  EXPECT_THAT(load_task("no-such-task").error().remedy, HasSubstr("palpate task list"));
}

}  // namespace
}  // namespace palpate
