#include <gtest/gtest.h>

#include "session/test_session.h"

namespace palpate {
namespace {

using testing::kBone;
using testing::kBoneRadius_mm;
using testing::kCartilage;
using testing::loaded_ball;

constexpr double kShell_mm = 3;

double distance_mm(const Model& model, std::size_t surface, double radius_mm) {
  return model.surfaces[surface].surface->distance_mm(Point<Patient>() +
                                                      Vector<Patient>(0, 0.6, 0.8) * radius_mm);
}

TEST(ReadyFor, StructuresThatTouchGetAnOuterSurface) {
  const auto model = loaded_ball(kShell_mm).model;
  const std::array methods{ForceMethod::kProxy, ForceMethod::kSpline};
  const auto ready = ready_for(model, methods);
  ASSERT_TRUE(ready.ok()) << ready.error().message();
  EXPECT_TRUE((*ready)->has(ForceMethod::kProxy));
  EXPECT_TRUE((*ready)->has(ForceMethod::kSpline));
  EXPECT_FALSE(model->has(ForceMethod::kProxy));
  EXPECT_EQ((*ready)->content_hash, model->content_hash);
  EXPECT_EQ((*ready)->label_of_surface, (std::vector<LabelId>{kBone, kCartilage})) << "fat is not felt";
  ASSERT_EQ((*ready)->surfaces.size(), 3u) << "those two, and what they have in common";
  for (const std::size_t structure : {0u, 1u}) {
    EXPECT_EQ((*ready)->surfaces[structure].surface, nullptr) << "never gone through, never met by itself";
    EXPECT_EQ((*ready)->surfaces[structure].beneath, 2);
    EXPECT_EQ((*ready)->surfaces[structure].stiffness_N_per_mm, model->tissues[structure].stiffness_N_per_mm);
  }
  EXPECT_EQ((*ready)->surfaces[2].beneath, -1);
  // zero lies on the shell's outside, within half a voxel of 0.9 mm
  EXPECT_NEAR(distance_mm(**ready, 2, kBoneRadius_mm + kShell_mm), 0, 0.45);
  EXPECT_NEAR(distance_mm(**ready, 2, kBoneRadius_mm + kShell_mm + 2), 2, 0.7);
  ASSERT_NE((*ready)->surfaces[2].owners, nullptr);
  const OwnerShares outside =
      (*ready)->surfaces[2].owners->at(Point<Patient>(0, 0, kBoneRadius_mm + kShell_mm));
  ASSERT_EQ(outside.all().size(), 1u) << "the bone lies beneath";
  EXPECT_EQ(outside.largest(), 1);
  EXPECT_EQ(*ready_for(*ready, methods), *ready) << "nothing to add";
}

TEST(ReadyFor, WhatCanBeGoneThroughAndWhatLiesBeneathHaveSurfacesOfTheirOwn) {
  Model model = *loaded_ball(kShell_mm).model;
  model.tissues[1].puncture_N = 2;
  const std::array methods{ForceMethod::kProxy};
  const auto ready = ready_for(std::make_shared<const Model>(model), methods);
  ASSERT_TRUE(ready.ok()) << ready.error().message();
  ASSERT_EQ((*ready)->surfaces.size(), 3u);
  EXPECT_EQ((*ready)->surfaces[1].puncture_N, 2);
  EXPECT_NEAR(distance_mm(**ready, 0, kBoneRadius_mm), 0, 0.45);
  EXPECT_NEAR(distance_mm(**ready, 0, kBoneRadius_mm + 2), 2, 0.7);
  EXPECT_NEAR(distance_mm(**ready, 1, kBoneRadius_mm + kShell_mm), 0, 0.45);
  EXPECT_EQ((*ready)->surfaces[0].beneath, 2);
  EXPECT_EQ((*ready)->surfaces[1].beneath, 2);
}

TEST(ReadyFor, WhatTouchesNobodyStaysAsItIs) {
  Model model = *loaded_ball(kShell_mm).model;
  model.tissues[1].felt = false;
  const std::array methods{ForceMethod::kProxy};
  const auto ready = ready_for(std::make_shared<const Model>(model), methods);
  ASSERT_TRUE(ready.ok()) << ready.error().message();
  ASSERT_EQ((*ready)->surfaces.size(), 1u);
  EXPECT_EQ((*ready)->surfaces[0].owners, nullptr);
  EXPECT_EQ((*ready)->surfaces[0].beneath, -1);
  EXPECT_NEAR(distance_mm(**ready, 0, kBoneRadius_mm), 0, 0.45);
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
