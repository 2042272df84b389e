#include "palpate/contact/tool_contact.h"

#include <gtest/gtest.h>

#include <utility>
#include <vector>

#include "contact/test_model.h"

namespace palpate {
namespace {

using testing::cube_grid;
using testing::kBone;
using testing::kBoneRadius_mm;
using testing::kCartilage;
using testing::sampled_distance;
using testing::steepest_of;

constexpr LabelId kWall = 3, kFloor = 4;
constexpr double kNotchStiffness_N_per_mm = 0.8;

/// A wall where x < 0 and a floor where z < 0, meeting along y, with equal contact properties.
Model notch() {
  const GridGeometry grid = cube_grid(10, {0.5, 0.5, 0.5});
  Model model;
  Volume<LabelId> labels(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Eigen::Vector3d p = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen();
        labels.at(i, j, k) = p.x() < 0 ? kWall : p.z() < 0 ? kFloor : LabelId{0};
      }
  model.labels = label_bricks(labels);
  model.tissues.resize(1);
  model.tissues[0].stiffness_N_per_mm = kNotchStiffness_N_per_mm;
  model.tissue_of_label = {-1, -1, -1, 0, 0};
  model.level_of_label = {0, 0, 0, 1, 1};
  for (const auto& [label, axis] : {std::pair{kWall, 0}, std::pair{kFloor, 2}}) {
    const SignedField field = sampled_distance(
        grid, [axis = axis](const Eigen::Vector3d& p) { return p[axis]; }, 6);
    model.surfaces.push_back(
        {{kNotchStiffness_N_per_mm}, std::make_shared<const Surface>(field, field, steepest_of(field))});
    model.label_of_surface.push_back(label);
  }
  return model;
}

/// A tool moved by the proxy without friction, at 10 mm/s.
class ToolRun {
 public:
  explicit ToolRun(const Model& model) : model_(model) { device_.scale = 1; }

  ToolContact lead(const Point<Patient>& from, const Point<Patient>& to) {
    ToolContact contact;
    constexpr int kTicks = 500;
    for (int n = 0; n <= kTicks; ++n) {
      const TickContext tick{model_, ForceMethod::kProxy, false, false, 1e-3, {}, {}};
      const DeviceContext hand{
          model_.tools[0], device_, Eigen::Matrix3d::Identity(), from + (to - from) * n / kTicks, {}};
      const PosedTool posed_tool(tick, hand);
      const ProxyResult result = advance_proxy(model_.surfaces, posed_tool.parts(), posed_tool.pose(), proxy_,
                                               proxy_options(tick, hand));
      contact = touch_by_proxy(tick, hand, posed_tool, proxy_, result, coupling_);
    }
    return contact;
  }

 private:
  const Model& model_;
  DeviceParameters device_;
  ProxyState proxy_;
  CouplingState coupling_;
};

int count(const ToolContact& contact) {
  int n = 0;
  while (n < kMaxContactsReported && contact.contacts[static_cast<std::size_t>(n)].label != 0) ++n;
  return n;
}

TEST(ToolContact, NotchGivesTwoContactsStrongestFirst) {
  const Model model = notch();
  ToolRun run(model);
  const ToolContact contact = run.lead({3, 1, 3}, {-0.5, 1, -1});
  ASSERT_EQ(count(contact), 2);
  const auto& [floor, wall] = std::pair(contact.contacts[0], contact.contacts[1]);
  EXPECT_EQ(floor.label, kFloor);
  EXPECT_EQ(wall.label, kWall);
  EXPECT_NEAR(floor.force_N, kNotchStiffness_N_per_mm * 1, 0.01);
  EXPECT_NEAR(wall.force_N, kNotchStiffness_N_per_mm * 0.5, 0.01);
  EXPECT_LT((floor.position - Point<Patient>(0, 1, 0)).norm(), 0.02);
  EXPECT_LT((wall.position - Point<Patient>(0, 1, 0)).norm(), 0.02);
  // their sum is the force
  EXPECT_NEAR(contact.requested.force_N.x(), wall.force_N, 0.01);
  EXPECT_NEAR(contact.requested.force_N.z(), floor.force_N, 0.01);
  EXPECT_EQ(contact.strongest.site.label, floor.label);
}

TEST(ToolContact, EachToolPartReportsItsContact) {
  Model model = notch();
  model.tools[0].points_mm = {{0, 0, 0}, {4, 2, 0}};
  model.tools[0].radius_mm = 0.5;
  ToolRun run(model);
  // the first sphere touches the wall, both touch the floor
  const ToolContact contact = run.lead({3, 0, 3}, {0.2, 0, 0.1});
  ASSERT_EQ(count(contact), 3);
  double floor_N = 0, wall_N = 0;
  bool observed[2] = {false, false};
  for (int n = 0; n < 3; ++n) {
    const ContactPoint& one = contact.contacts[static_cast<std::size_t>(n)];
    if (n > 0) {
      EXPECT_LE(one.force_N, contact.contacts[static_cast<std::size_t>(n - 1)].force_N);
    }
    if (one.label == kWall) {
      EXPECT_EQ(one.part, 0);
      EXPECT_LT((one.position - Point<Patient>(0, 0, 0.5)).norm(), 0.02);
      wall_N += one.force_N;
      continue;
    }
    EXPECT_EQ(one.label, kFloor);
    ASSERT_LT(one.part, 2);
    observed[one.part] = true;
    EXPECT_LT((one.position - (one.part == 0 ? Point<Patient>(0.5, 0, 0) : Point<Patient>(4.5, 2, 0))).norm(),
              0.02);
    floor_N += one.force_N;
  }
  EXPECT_TRUE(observed[0] && observed[1]);
  EXPECT_NEAR(wall_N, kNotchStiffness_N_per_mm * 0.3, 0.01);
  EXPECT_NEAR(floor_N, kNotchStiffness_N_per_mm * 0.4, 0.01);
}

TEST(ToolContact, InnerLayersFollowTheOutermostStructure) {
  constexpr double kShell_mm = 2, kDeep_mm = 3;
  const Model model = testing::as_one_body(testing::ball_model({0.6, 0.6, 0.6}, 1.0, kShell_mm), kShell_mm);
  ToolRun run(model);
  const double top_mm = kBoneRadius_mm + kShell_mm;
  // where x < 0 the shell lies on the bone
  const Vector<Patient> out(-0.8, 0, 0.6);
  const ToolContact contact =
      run.lead(Point<Patient>() + out * (top_mm + 3), Point<Patient>() + out * (top_mm - kDeep_mm));
  ASSERT_EQ(count(contact), 2);
  EXPECT_EQ(contact.contacts[0].label, kCartilage);
  EXPECT_EQ(contact.contacts[1].label, kBone);
  const double shell = model.tissues[1].stiffness_N_per_mm, bone = model.tissues[0].stiffness_N_per_mm;
  EXPECT_NEAR(contact.contacts[0].force_N, shell * kDeep_mm, 0.1);
  EXPECT_NEAR(contact.contacts[1].force_N, (bone - shell) * (kDeep_mm - kShell_mm), 0.1);
  EXPECT_NEAR(contact.requested.force_N.norm(), contact.contacts[0].force_N + contact.contacts[1].force_N,
              0.05);
  EXPECT_LT((contact.contacts[1].position - (Point<Patient>() + out * kBoneRadius_mm)).norm(), 0.1);
}

TEST(ToolContact, NoContactInFreeSpace) {
  const Model model = notch();
  ToolRun run(model);
  EXPECT_EQ(count(run.lead({3, 0, 3}, {1, 0, 1})), 0);
}

}  // namespace
}  // namespace palpate
