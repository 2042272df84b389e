#include <gtest/gtest.h>

#include "session/test_session.h"

namespace palpate {
namespace {

using testing::kBone;
using testing::kBoneRadius_mm;
using testing::kCartilage;
using testing::loaded_ball;

TEST(ReadyFor, EveryFeltStructureGetsItsSurface) {
  const auto model = loaded_ball(3).model;
  const std::array methods{ForceMethod::kProxy, ForceMethod::kSpline};
  const auto ready = ready_for(model, methods);
  ASSERT_TRUE(ready.ok()) << ready.error().message();
  EXPECT_TRUE((*ready)->has(ForceMethod::kProxy));
  EXPECT_TRUE((*ready)->has(ForceMethod::kSpline));
  EXPECT_FALSE(model->has(ForceMethod::kProxy));
  EXPECT_EQ((*ready)->content_hash, model->content_hash);
  EXPECT_EQ((*ready)->label_of_surface, (std::vector<LabelId>{kBone, kCartilage})) << "fat is not felt";
  // zero lies on the ball, and on the shell's outside, within half a voxel of 0.9 mm
  for (const Vector<Patient>& outward : {Vector<Patient>(1, 0, 0), Vector<Patient>(0, 0.6, 0.8)}) {
    const auto distance_mm = [&](std::size_t surface, double radius_mm) {
      return (*ready)->surfaces[surface].surface->distance_mm(Point<Patient>() + outward * radius_mm);
    };
    EXPECT_NEAR(distance_mm(0, kBoneRadius_mm), 0, 0.45);
    EXPECT_NEAR(distance_mm(0, kBoneRadius_mm + 2), 2, 0.7);
    EXPECT_NEAR(distance_mm(1, kBoneRadius_mm + 3), 0, 0.45);
  }
  EXPECT_EQ((*ready)->surfaces[1].stiffness_N_per_mm, model->tissues[1].stiffness_N_per_mm);
  EXPECT_EQ(*ready_for(*ready, methods), *ready) << "nothing to add";
}

TEST(ReadyFor, ASimulatedHandIsHeldByTheProxyAndItReplays) {
  const LoadedScene loaded = loaded_ball(3);
  test::TemporaryFolder folder;
  SimulationOptions options;
  options.method = ForceMethod::kProxy;
  const auto result = simulate(loaded, testing::press_script("shell"), options, folder / "proxy.h5");
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->trouble.empty()) << result->trouble.front();
  ASSERT_EQ(result->holds.size(), 1u);
  EXPECT_GT(result->holds[0].held_s, 0.5);
  EXPECT_EQ(result->summary.inside, 0u);
  const auto recording = read_recording(folder / "proxy.h5");
  ASSERT_TRUE(recording.ok());
  const auto again = replay(*recording, loaded.model);
  ASSERT_TRUE(again.ok()) << again.error().message();
  EXPECT_TRUE(again->identical) << again->difference;
}

}  // namespace
}  // namespace palpate
