#include "session/deformed_labels.h"

#include <gtest/gtest.h>

#include <cmath>

#include "server/test_host.h"

namespace palpate {
namespace {

constexpr int kSide = 60;
constexpr LabelId kFat = 3;

/// Host with fat below the plane k = 40, in voxels of 0.5 mm, and its deformation.
class DeformingHost : public testing::FakeHost {
 public:
  DeformingHost() : FakeHost({kSide, kSide, kSide}) {
    GridGeometry grid;
    grid.dims = {kSide, kSide, kSide};
    grid.spacing_mm = Eigen::Vector3d::Constant(0.5);
    Volume<LabelId> fat(grid);
    for (int k = 0; k < 40; ++k)
      for (int j = 0; j < kSide; ++j)
        for (int i = 0; i < kSide; ++i) fat.at(i, j, k) = kFat;
    scene_.labels = label_bricks(fat);
  }
  const ViewedScene& scene() const override { return scene_.labels ? scene_ : FakeHost::scene(); }
  std::shared_ptr<const ViewedDeformation> deformation(std::size_t device) const override {
    return deformations[device];
  }
  std::array<std::shared_ptr<const ViewedDeformation>, kMaxDevices> deformations;

 private:
  ViewedScene scene_;
};

/// Deformation field with nodes of 1 mm around a tool pressed into the fat at (x, 15) mm, to a depth of
/// `depth_mm`.
std::shared_ptr<const ViewedDeformation> dent(double x_mm, double depth_mm) {
  auto deformation = std::make_shared<ViewedDeformation>();
  deformation->nodes = {17, 17, 17};
  deformation->first_patient_mm = {x_mm - 8, 7, 8};
  deformation->spacing_mm = 1;
  for (int k = 0; k < 17; ++k)
    for (int j = 0; j < 17; ++j)
      for (int i = 0; i < 17; ++i) {
        const double z = 8 + k, off = std::hypot(i - 8, j - 8), below = 20 - z;
        const bool is_fat = z <= 19.5;
        const double by = is_fat ? depth_mm * std::exp(-(off * off + below * below) / 18) : 0;
        for (const double c : {0.0, 0.0, -by}) deformation->moved_mm.push_back(static_cast<float>(c));
      }
  return deformation;
}

/// Index of the first slice above the fat in a column.
int top(const Bricks<LabelId>& labels, int i, int j) {
  int k = kSide;
  while (k > 0 && labels.at(i, j, k - 1) == 0) --k;
  return k;
}

TEST(DeformedLabels, ADentIsADent) {
  DeformingHost host;
  DeformedLabels observed;
  EXPECT_EQ(observed.of(host), host.labels()) << "nothing has yielded";

  host.deformations[0] = dent(15, 3);
  const auto dented = observed.of(host);
  // 3 mm are 6 voxels; nodes half a voxel below the surface displace what is above them
  EXPECT_NEAR(top(*dented, 30, 30), 40 - 6, 1);
  // the deformation 3 mm from the centre, according to the field
  EXPECT_NEAR(top(*dented, 36, 30), 40 - 6 * std::exp(-0.5), 1);
  // no deformation far away
  EXPECT_EQ(top(*dented, 2, 2), 40);
  EXPECT_EQ(observed.of(host), dented) << "nothing is made anew while all stays";

  host.deformations[0] = nullptr;
  EXPECT_EQ(observed.of(host), host.labels());
}

TEST(DeformedLabels, SumsDeformationsOfTwoTools) {
  DeformingHost host;
  DeformedLabels observed;
  host.deformations[0] = dent(15, 1.5);
  host.deformations[1] = dent(15, 1.5);
  const auto both = observed.of(host);
  host.deformations = {dent(15, 3)};
  const auto one = observed.of(host);
  for (int i = 0; i < kSide; i += 3) EXPECT_EQ(top(*both, i, 30), top(*one, i, 30)) << i;
  // two dents that do not overlap are independent
  host.deformations = {dent(10, 3), dent(22, 3)};
  const auto apart = observed.of(host);
  EXPECT_NEAR(top(*apart, 20, 30), 34, 1);
  EXPECT_NEAR(top(*apart, 44, 30), 34, 1);
}

}  // namespace
}  // namespace palpate
