#include <gtest/gtest.h>

#include <array>
#include <cinttypes>
#include <cstdio>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/hash.h"
#include "palpate/model/changed_model.h"
#include "palpate/model/make_model.h"
#include "palpate/recording/recording.h"
#include "palpate/servo/servo.h"
#include "sampling/test_targets.h"

/// Runs with a pinned hash, which detect unintended changes of the rendering, from labels to wrench:
/// preparation, contact, friction, penetration of a layer, a burr and its cuts. Labels and tip trajectory are
/// integers and sums of integers; neither hand nor device is in the loop.

namespace palpate {
namespace {

constexpr LabelId kGoldenBone = 3, kGoldenSkin = 8;
constexpr double kGoldenVoxel_mm = 0.5;

// a ball of bone with a radius of 7 mm in a skin of 1.5 mm, which ruptures at 0.9 N
ModelParts golden_parts() {
  GridGeometry grid;
  grid.dims = {49, 49, 49};
  grid.spacing_mm = Eigen::Vector3d::Constant(kGoldenVoxel_mm);
  grid.origin = Point<Patient>(-12, -12, -12);
  Volume<LabelId> labels(grid);
  for (int k = 0; k < 49; ++k)
    for (int j = 0; j < 49; ++j)
      for (int i = 0; i < 49; ++i) {
        const int squared = (i - 24) * (i - 24) + (j - 24) * (j - 24) + (k - 24) * (k - 24);
        labels.at(i, j, k) = squared <= 14 * 14 ? kGoldenBone : squared <= 17 * 17 ? kGoldenSkin : LabelId{0};
      }

  ModelParts parts;
  parts.labels = label_bricks(labels);
  parts.segments = {{kGoldenBone, "bone", {}, 0, kGoldenBone}, {kGoldenSkin, "skin", {}, 0, kGoldenSkin}};
  Tissue bone;
  bone.name = "bone";
  bone.stiffness_N_per_mm = 1.5;
  bone.friction = 0.2;
  bone.static_friction = 0.3;
  Tissue skin;
  skin.name = "skin";
  skin.stiffness_N_per_mm = 0.75;
  skin.friction = skin.static_friction = 0.25;
  skin.puncture_N = 0.9;
  skin.rests_on = {0};
  parts.tissues = {bone, skin};
  parts.tissue_of_label.assign(kGoldenSkin + 1, -1);
  parts.tissue_of_label[kGoldenBone] = 0;
  parts.tissue_of_label[kGoldenSkin] = 1;
  return parts;
}

std::shared_ptr<const Model> golden_model(ModelParts parts, ForceMethod method) {
  auto made = make_model(std::move(parts));
  PALPATE_CHECK(made.ok());
  auto ready = prepared_for(*made, {&method, 1});
  PALPATE_CHECK(ready.ok());
  return *std::move(ready);
}

// target of a straight motion and its number of ticks
struct Leg {
  std::array<double, 3> to_mm;
  int ticks;
};

// from the air onto the skin, along it, through it onto the bone, along the bone and out again
constexpr std::array<Leg, 6> kThroughTheSkin{{{{1, 2, 11}, 600},
                                              {{1, 2, 8}, 100},
                                              {{4, 2, 7}, 200},
                                              {{4, 2, 4.5}, 200},
                                              {{1, 4, 5}, 200},
                                              {{1, 4, 12}, 100}}};

struct GoldenRun {
  RecordingSummary summary;
  std::uint64_t force_hash = kHashSeed;  ///< Hash of the forces alone
  bool skin_contact = false, bone_contact = false;
  double removed_mm3 = 0;
};

// the tip is driven at 1 kHz; swept volume is removed every 20 ms
GoldenRun run_golden(std::shared_ptr<const Model> model, ForceMethod method, std::span<const Leg> legs) {
  constexpr double kTick_s = 1e-3;
  constexpr std::uint64_t kCutEvery = 20;
  Parameters parameters;
  parameters.method = method;
  parameters.motor = model->tools[0].burr.has_value();
  SessionState state;
  DeviceState device;
  Wrench wrench;
  TickRecord record;
  GoldenRun run;
  Eigen::Vector3d from(1, 2, 12);
  for (const Leg& leg : legs) {
    const Eigen::Vector3d to(leg.to_mm[0], leg.to_mm[1], leg.to_mm[2]);
    for (int n = 1; n <= leg.ticks; ++n) {
      const Eigen::Vector3d tip = from + (to - from) * (static_cast<double>(n) / leg.ticks);
      device.tip = model->X_WorldPatient * Point<Patient>(tip);
      if (state.tick % kCutEvery == 0)
        if (const auto cuts = finished_cuts(state.device[0].burr, 0); !cuts.empty())
          model = carved_by(*model, cuts)->applied_to(*model);
      tick(*model, parameters, {&device, 1}, kTick_s, state, {&wrench, 1}, record);
      run.summary.observe(record);
      const DeviceTick& device_tick = record.device[0];
      for (const double newtons : device_tick.force_N) hash_double(run.force_hash, newtons);
      if ((device_tick.flags & kFlagContact) == 0) continue;
      run.skin_contact |= device_tick.label == kGoldenSkin;
      run.bone_contact |= device_tick.label == kGoldenBone;
    }
    from = to;
  }
  run.removed_mm3 = state.device[0].burr.removed_mm3;
  return run;
}

// failure message with instructions
std::string golden_help(std::uint64_t hash) {
  char text[400];
  std::snprintf(text, sizeof text,
                "the hash is now 0x%016" PRIx64
                ". If that is meant, write this value here. If the forces alone differ, say in CHANGELOG.md "
                "under Unreleased what is felt otherwise",
                hash);
  return text;
}

TEST(GoldenRun, ByTheProxyOverAndThroughALayer) {
  const GoldenRun run =
      run_golden(golden_model(golden_parts(), ForceMethod::kProxy), ForceMethod::kProxy, kThroughTheSkin);
  EXPECT_TRUE(run.skin_contact && run.bone_contact);
  EXPECT_GT(run.summary.ruptured, 0u);
  EXPECT_EQ(run.summary.run_hash, 0x1692542baf48072du) << golden_help(run.summary.run_hash);
  EXPECT_EQ(run.force_hash, 0xf5137b817e7b93cdu) << golden_help(run.force_hash);
}

TEST(GoldenRun, IsTheSameOnAnotherSimdTarget) {
  constexpr std::array<Leg, 2> kOntoTheSkin{{{{1, 2, 11}, 500}, {{1, 2, 8}, 50}}};
  const std::vector<std::int64_t> targets = hwy::SupportedAndGeneratedTargets();
  std::uint64_t first = 0;
  for (const std::int64_t target : {targets.front(), targets.back()}) {
    const test::OnlyTargets only(target);
    const GoldenRun run =
        run_golden(golden_model(golden_parts(), ForceMethod::kProxy), ForceMethod::kProxy, kOntoTheSkin);
    EXPECT_TRUE(run.skin_contact);
    if (first == 0) first = run.summary.run_hash;
    EXPECT_EQ(run.summary.run_hash, first) << test::target_name(target);
  }
}

TEST(GoldenRun, ByTheTrilinearMethod) {
  const GoldenRun run = run_golden(golden_model(golden_parts(), ForceMethod::kTrilinear),
                                   ForceMethod::kTrilinear, kThroughTheSkin);
  EXPECT_TRUE(run.skin_contact && run.bone_contact);
  EXPECT_EQ(run.summary.run_hash, 0x02bc39fc6389910cu) << golden_help(run.summary.run_hash);
  EXPECT_EQ(run.force_hash, 0x2e2c0793a101470cu) << golden_help(run.force_hash);
}

TEST(GoldenRun, OfABurrThatCuts) {
  ModelParts parts = golden_parts();
  parts.tools[0].radius_mm = 1.5;
  parts.tools[0].burr = BurrSettings{};
  constexpr std::array<Leg, 4> kGroove{
      {{{1, 2, 10.5}, 600}, {{1, 2, 7.5}, 100}, {{4, 2, 6.5}, 200}, {{4, 2, 12}, 50}}};
  const GoldenRun run =
      run_golden(golden_model(std::move(parts), ForceMethod::kProxy), ForceMethod::kProxy, kGroove);
  EXPECT_TRUE(run.skin_contact);
  EXPECT_GT(run.removed_mm3, 1);
  EXPECT_EQ(run.summary.run_hash, 0x1ec2669de3923a1au) << golden_help(run.summary.run_hash);
  EXPECT_EQ(run.force_hash, 0x8b35013ad6897bd5u) << golden_help(run.force_hash);
}

}  // namespace
}  // namespace palpate
