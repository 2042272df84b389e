#include "palpate/tissue/chain_mail.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "base/test_seed.h"
#include "palpate/tissue/carved_cells.h"
#include "palpate/tissue/displaced_tissue.h"
#include "tissue/each_cell.h"
#include "tissue/test_soft_block.h"

namespace palpate {
namespace {

using testing::soft_block;

constexpr double kEdge_mm = 1;
constexpr int kMailCells = 16;

// z up; soft below the surface z = kMailCells - 4, rigid below `bone_mm`
ElasticGrid tissue_on_bone(double bone_mm) {
  ElasticBox box;
  box.cell_mm = kEdge_mm;
  box.cells = {kMailCells, kMailCells, kMailCells};
  return {box,
          [=](const Point<Patient>& at) {
            if (at.z() > kMailCells - 4) return ElasticMaterial{};
            return ElasticMaterial{at.z() < bone_mm ? Matter::kRigid : Matter::kSoft, 10, 0.45};
          },
          1};
}
constexpr double kSurface_mm = kMailCells - 4;

Dent dent_of(double depth_mm, double radius_mm = 3, double x = 8, double y = 8) {
  return {{x, y, kSurface_mm}, {0, 0, 1}, depth_mm, radius_mm};
}

Eigen::Vector3d displacement_mm(const ChainMail& mail, int i, int j, int k) {
  Eigen::Vector3d moved;
  for (int c = 0; c < 3; ++c) moved[c] = mail.displacement_mm().values[mail.layout().node(i, j, k, c)];
  return moved;
}

// Largest violation of a link's bounds, over links between existing nodes at least one of which was moved.
double max_beyond_mm(const ChainMail& mail, const ElasticGrid& grid) {
  double largest = 0;
  const auto is_there = [&](int i, int j, int k) {
    return (grid.constraint(i, j, k) & ElasticGrid::kNoNode) == 0;
  };
  for_each_node({{0, 0, 0}, {kMailCells, kMailCells, kMailCells}}, [&](int i, int j, int k) {
    for (int axis = 0; axis < 3; ++axis) {
      const int to[3] = {i + (axis == 0), j + (axis == 1), k + (axis == 2)};
      if (*std::max_element(to, to + 3) > kMailCells || !is_there(i, j, k) || !is_there(to[0], to[1], to[2]))
        continue;
      const Eigen::Vector3d further =
          displacement_mm(mail, to[0], to[1], to[2]) - displacement_mm(mail, i, j, k);
      for (int c = 0; c < 3; ++c)
        largest =
            std::max(largest, c == axis ? std::max(further[c] - (ChainMail::kMaxStretch - 1) * kEdge_mm,
                                                   -further[c] - (1 - ChainMail::kMinStretch) * kEdge_mm)
                                        : std::abs(further[c]) - ChainMail::kShear * kEdge_mm);
    }
  });
  return largest;
}

TEST(ChainMail, LinksBelowADentCompressWithinTheirBounds) {
  const ElasticGrid grid = tissue_on_bone(1);
  ChainMail mail(grid);
  mail.press(dent_of(1.8));
  // directly below the tool's tip each link contributes half its length
  for (int below = 0; below < 6; ++below)
    EXPECT_NEAR(displacement_mm(mail, 8, 8, kMailCells - 4 - below).z(), -std::max(0.0, 1.8 - 0.5 * below),
                1e-6)
        << below;
  // the tool's sphere and, where that is steeper than links can shear, half a length per link
  const double first_mm = 1.8 - (3 - std::sqrt(8.0));
  for (int lateral = 1; lateral < 5; ++lateral)
    EXPECT_NEAR(-displacement_mm(mail, 8 + lateral, 8, kMailCells - 4).z(),
                std::max(0.0, first_mm - 0.5 * (lateral - 1)), 1e-6)
        << lateral;
  EXPECT_EQ(displacement_mm(mail, 2, 2, kMailCells - 4), Eigen::Vector3d::Zero()) << "far away";
}

TEST(ChainMail, LinksStayWithinTheirBoundsForAnyPress) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> depth(0.05, 2.5), place(6, 10);
  const ElasticGrid grid = tissue_on_bone(1);
  ChainMail mail(grid);
  for (int n = 0; n < 20; ++n) {
    const double x = place(random), y = place(random), deep_mm = depth(random);
    mail.press(dent_of(deep_mm, 3, x, y));
    mail.relax(4);
    EXPECT_LT(max_beyond_mm(mail, grid), 1e-4) << n;
  }
}

TEST(ChainMail, ReleasedTissueReturnsToRest) {
  const ElasticGrid grid = tissue_on_bone(1);
  ChainMail mail(grid);
  mail.press(dent_of(2));
  mail.relax(4);
  mail.release();
  double before = mail.max_displacement_mm();
  EXPECT_GT(before, 1.5);
  for (int n = 0; n < 60; ++n) {
    mail.relax(8);
    EXPECT_LE(mail.max_displacement_mm(), before);
    before = mail.max_displacement_mm();
  }
  EXPECT_LT(before, 0.02);
}

TEST(ChainMail, HeldDentSpreadsSymmetrically) {
  const ElasticGrid grid = tissue_on_bone(1);
  ChainMail mail(grid);
  mail.press(dent_of(1.5));
  mail.relax(300);
  const int top = kMailCells - 4;
  for (const int lateral : {1, 3, 5}) {
    const double right = displacement_mm(mail, 8 + lateral, 8, top).z();
    EXPECT_NEAR(displacement_mm(mail, 8 - lateral, 8, top).z(), right, 1e-3);
    EXPECT_NEAR(displacement_mm(mail, 8, 8 + lateral, top).z(), right, 1e-3);
    EXPECT_LT(right, -0.05);
  }
  // where no bound is active, the mean of its neighbours
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (int axis = 0; axis < 3; ++axis)
    for (const int direction : {-1, 1})
      mean += displacement_mm(mail, 8 + direction * (axis == 0), 4 + direction * (axis == 1),
                              7 + direction * (axis == 2)) /
              6;
  EXPECT_LT((mean - displacement_mm(mail, 8, 4, 7)).norm(), 1e-4);
}

TEST(ChainMail, BoneDoesNotMoveUnderThinTissue) {
  // 2 mm of tissue, compressed by 1.8 mm
  const ElasticGrid grid = tissue_on_bone(kSurface_mm - 2);
  ChainMail mail(grid);
  mail.press(dent_of(1.8));
  mail.relax(20);
  for (int i = 0; i <= kMailCells; ++i)
    EXPECT_EQ(displacement_mm(mail, i, 8, kMailCells - 6), Eigen::Vector3d::Zero()) << i;
  EXPECT_NEAR(displacement_mm(mail, 8, 8, kMailCells - 4).z(), -1.8, 1e-6);
  for (const float moved : mail.displacement_mm().values) ASSERT_TRUE(std::isfinite(moved));
}

TickRecord dented_at(double x, double y, double depth_mm) {
  TickRecord record = testing::pressed_at(x, y);
  record.device[0].depth_mm = depth_mm;
  return record;
}

TEST(ChainMailTissue, FollowsTheToolThroughBoxesAndComesToRest) {
  const auto model = soft_block(true, 1, TissueLaw::kChainMail);
  ChainMailTissue tissue;
  EXPECT_EQ(tissue.of(0), nullptr);
  double x = -20;
  Point<Patient> corner;
  int boxes = 0;
  for (; x < 20; x += 0.8) {
    tissue.advance(*model, dented_at(x, 0, 2));
    const ChainMail* mail = tissue.of(0);
    ASSERT_NE(mail, nullptr);
    boxes += mail->box().corner != corner;
    corner = mail->box().corner;
    // nodes moved by the tool are as deep as the tool
    EXPECT_NEAR(mail->max_displacement_mm(), 2, 0.35) << x;
  }
  EXPECT_GT(boxes, 3);
  TickRecord away = testing::tool_at({x, 0, 10});
  int frames = 0;
  while (tissue.of(0) != nullptr && ++frames < 1000) tissue.advance(*model, away);
  EXPECT_LT(frames, 1000);
}

TEST(ChainMailTissue, DisplaysADentExceptInRigidTissue) {
  const auto model = soft_block(false, 1, TissueLaw::kChainMail);
  const DisplacedTissue deformed(*model, dented_at(0, 0, 2));
  ASSERT_FALSE(deformed.is_at_rest());
  EXPECT_NEAR(deformed.displacement_mm({0, 0, 0}).z(), -2, 0.3);
  EXPECT_GT(deformed.displacement_mm({9, 0, 0}).z(), -1);
  EXPECT_EQ(deformed.displacement_mm({0, 0, -25}).norm(), 0) << "bone";
  EXPECT_GT(deformed.strain({0, 0, -2}), 0.05);
  TickRecord on_bone = dented_at(0, 0, 2);
  on_bone.device[0].contact_label[0] = 3;
  EXPECT_TRUE(DisplacedTissue(*model, on_bone).is_at_rest());
  ChainMailTissue tissue;
  tissue.advance(*model, on_bone);
  EXPECT_EQ(tissue.of(0), nullptr);
}

}  // namespace
}  // namespace palpate
