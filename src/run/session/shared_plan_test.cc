#include "palpate/session/shared_plan.h"

#include <gtest/gtest.h>

#include "base/test_folder.h"
#include "contact/test_model.h"
#include "palpate/base/file.h"

namespace palpate {
namespace {

using palpate::test::TemporaryFolder;
using palpate::test::write_text;

constexpr const char* kPlan = R"(title = "a hole"

[[trajectory]]
name = "hole"
entry = [2, -1, 12]
target = [-1, 3, -4]
enters = [5]
entry_within = 2

[[trajectory]]
name = "other"
entry = [0, 0, 10]
target = [0, 0, 0]

[[region]]
name = "to be taken"
shape = "cylinder"
trajectory = "other"
radius = 3

[[keep_away]]
structures = [5]
distance = 2.5
)";

struct OpenPlan {
  TemporaryFolder folder;
  std::filesystem::path file;
  Model model = testing::ball_model({0.7, 0.6, 0.8});
  std::shared_ptr<SharedPlan> plan;

  explicit OpenPlan(const std::string& text, bool may_change = true) {
    file = folder / "plan.toml";
    if (!text.empty()) write_text(file, text);
    auto opened = SharedPlan::open(file, model, may_change);
    PALPATE_CHECK(opened.ok());
    plan = *std::move(opened);
  }
  PlanRequest request(std::optional<std::size_t> trajectory = {}) const {
    PlanRequest request;
    request.version = plan->viewed()->version;
    request.trajectory = trajectory;
    return request;
  }
  PlanRequest add(const std::string& name) const {
    PlanRequest added = request(plan->viewed()->trajectories.size());
    added.name = name;
    added.entry_mm = {0.1, 1, 2};
    added.target_mm = {0.1, 1, 12};
    return added;
  }
  PlanRequest save() const {
    PlanRequest saving = request();
    saving.save = true;
    return saving;
  }
  std::string text() const { return *read_file(file); }
};

TEST(SharedPlan, IsViewedAsInItsFile) {
  const OpenPlan open(kPlan);
  const ViewedPlan viewed = *open.plan->viewed();
  ASSERT_EQ(viewed.trajectories.size(), 2u);
  EXPECT_EQ(viewed.trajectories[0].entry_mm, (std::array<double, 3>{2, -1, 12}));
  EXPECT_EQ(viewed.trajectories[0].entry_within_mm, 2);
  EXPECT_FALSE(viewed.trajectories[0].angle_within_deg.has_value());
  ASSERT_EQ(viewed.keep_away.size(), 1u);
  EXPECT_EQ(viewed.keep_away[0].label, testing::kBone);
  EXPECT_EQ(viewed.keep_away[0].mm, 2.5);
  EXPECT_TRUE(viewed.saved && viewed.can_change);
  EXPECT_EQ(viewed.version, 1u);
}

TEST(SharedPlan, SavedChangesAreInTheFile) {
  const OpenPlan open(kPlan);
  PlanRequest moved = open.request(0);
  moved.target_mm = {-1.0000000000000002, 3, -5};
  ASSERT_TRUE(open.plan->change(moved).ok());
  ASSERT_TRUE(open.plan->change(open.add("third")).ok());
  EXPECT_FALSE(open.plan->viewed()->saved);
  EXPECT_EQ(open.text(), kPlan) << "nothing is written unasked";
  ASSERT_TRUE(open.plan->change(open.save()).ok());
  EXPECT_TRUE(open.plan->viewed()->saved);
  const auto read = load_plan(open.file);
  ASSERT_TRUE(read.ok());
  ASSERT_EQ(read->trajectories.size(), 3u);
  EXPECT_EQ(read->trajectories[0].target.x(), -1.0000000000000002) << "to the last bit";
  EXPECT_EQ(read->trajectories[0].entry_within_mm, 2) << "what is allowed stays";
  EXPECT_EQ(read->trajectories[2].name, "third");
  EXPECT_EQ(read->regions.size(), 1u);
  EXPECT_EQ(read->distances.size(), 1u);
}

TEST(SharedPlan, RejectsStaleChangesAndRestoresAnyVersion) {
  const OpenPlan open(kPlan);
  PlanRequest removed = open.request(0);
  removed.remove = true;
  ASSERT_TRUE(open.plan->change(removed).ok());
  EXPECT_EQ(open.plan->viewed()->trajectories.size(), 1u);
  EXPECT_EQ(open.plan->viewed()->trajectories[0].name, "other");
  // the index of the region's trajectory has changed
  ASSERT_TRUE(open.plan->change(open.save()).ok());
  const auto read = load_plan(open.file);
  ASSERT_TRUE(read.ok());
  EXPECT_EQ(read->regions[0].trajectory, 0u);
  const auto late = open.plan->change(removed);
  ASSERT_FALSE(late.ok());
  EXPECT_EQ(late.error().where, "version");
  PlanRequest back = open.request();
  back.restore_version = 1;
  ASSERT_TRUE(open.plan->change(back).ok());
  EXPECT_EQ(open.plan->viewed()->trajectories.size(), 2u);
  EXPECT_EQ(open.plan->viewed()->trajectories[0].entry_within_mm, 2);
  back = open.request();
  back.restore_version = 77;
  EXPECT_FALSE(open.plan->change(back).ok());
}

TEST(SharedPlan, RejectsInvalidPlansAtomically) {
  const OpenPlan open(kPlan);
  const auto refused = [&](const PlanRequest& request, ErrorKind kind) {
    const auto before = open.plan->viewed();
    const auto done = open.plan->change(request);
    EXPECT_FALSE(done.ok());
    if (!done) {
      EXPECT_EQ(done.error().kind, kind) << done.error().message();
    }
    EXPECT_EQ(open.plan->viewed(), before);
  };
  refused(open.add("hole"), ErrorKind::kBadInput);  // duplicate name
  PlanRequest short_one = open.request(0);
  short_one.target_mm = {2, -1, 12.05};
  refused(short_one, ErrorKind::kBadInput);
  PlanRequest far = open.request(0);
  far.entry_mm = {1e9, 0, 0};
  refused(far, ErrorKind::kBadInput);
  PlanRequest none = open.request(5);
  none.name = "x";
  refused(none, ErrorKind::kUsage);
  PlanRequest half = open.request(2);
  half.name = "half";
  refused(half, ErrorKind::kUsage);
  PlanRequest used = open.request(1);
  used.remove = true;
  refused(used, ErrorKind::kUsage);  // a region depends on it
  // with a recording, every edit is refused
  const OpenPlan found(kPlan, false);
  EXPECT_FALSE(found.plan->change(found.add("third")).ok());
  EXPECT_FALSE(found.plan->viewed()->can_change);
}

TEST(SharedPlan, AFileThatWasChangedMeanwhileIsLeftAsItIs) {
  const OpenPlan open(kPlan);
  ASSERT_TRUE(open.plan->change(open.add("third")).ok());
  const std::string theirs = std::string(kPlan) + "# by somebody else\n";
  write_text(open.file, theirs);
  const auto refused = open.plan->change(open.save());
  ASSERT_FALSE(refused.ok());
  EXPECT_NE(refused.error().message().find("changed since"), std::string::npos);
  EXPECT_EQ(open.text(), theirs);
  std::filesystem::remove(open.file);
  EXPECT_FALSE(open.plan->change(open.save()).ok());
  EXPECT_FALSE(std::filesystem::exists(open.file));
}

TEST(SharedPlan, AFileThatIsNotThereBeginsEmptyAndIsMadeBySaving) {
  const OpenPlan open("");
  EXPECT_TRUE(open.plan->viewed()->trajectories.empty());
  EXPECT_FALSE(open.plan->change(open.save()).ok()) << "it plans nothing";
  ASSERT_TRUE(open.plan->change(open.add("first")).ok());
  ASSERT_TRUE(open.plan->change(open.save()).ok());
  EXPECT_EQ(load_plan(open.file)->trajectories.at(0).name, "first");
  EXPECT_EQ(load_plan(open.file)->title, "plan");
  // with a recording the file has to exist; its folder has to exist in any case
  EXPECT_FALSE(SharedPlan::open(open.folder / "none.toml", open.model, false).ok());
  EXPECT_FALSE(SharedPlan::open(open.folder / "nowhere" / "plan.toml", open.model, true).ok());
  EXPECT_FALSE(SharedPlan::open(write_text(open.folder / "bad.toml", "title = 1\n"), open.model, true).ok());
}

}  // namespace
}  // namespace palpate
