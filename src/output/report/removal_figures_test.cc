#include "report/removal_figures.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "contact/test_model.h"
#include "palpate/recording/recording_source.h"
#include "tissue/test_surfaces.h"

namespace palpate::report {
namespace {

using palpate::testing::kBone;
using palpate::testing::kCartilage;
using std::numbers::pi;

// voxel centres are at multiples of 0.5 mm, so the bone ends on voxel faces
constexpr double kHalf_mm = 12, kTop_mm = -0.25;

/// Bone below kTop_mm with 0.5 mm voxels, in a cube of 24 mm.
Model bone_below() {
  Model model = palpate::testing::ball_model({3, 3, 3});
  Volume<LabelId> labels(palpate::testing::cube_grid(kHalf_mm, {0.5, 0.5, 0.5}));
  const auto X_PatientVoxel = labels.geometry().X_PatientVoxel();
  const auto& dims = labels.geometry().dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i)
        if ((X_PatientVoxel * Point<Voxel>(i, j, k)).z() < kTop_mm) labels.at(i, j, k) = kBone;
  model.labels = label_bricks(labels);
  ContactSurface bone;
  bone.surface = palpate::testing::surface_to_carve(kHalf_mm, {0.5, 0.5, 0.5},
                                                    [](const Eigen::Vector3d& p) { return p.z() - kTop_mm; });
  model.surfaces = {bone};
  model.label_of_surface = {kBone};
  model.tools[0].burr = BurrSettings{};
  return model;
}

RecordingEvent swept(std::uint64_t tick, const Sweep& sweep) {
  RecordingEvent event;
  event.kind = RecordingEvent::Kind::kSweep;
  event.tick = tick;
  event.sweep = record_of({0, sweep});
  return event;
}
RecordingEvent cut_contact(std::uint64_t tick) {
  RecordingEvent event;
  event.tick = tick;
  event.change.tissue = ModelChange::kCut;
  return event;
}

/// 50 ticks of a millisecond, starting at 1 s.
Recording ticks_with(std::vector<RecordingEvent> events) {
  Recording recording;
  recording.events = std::move(events);
  for (std::uint64_t i = 0; i < 50; ++i) {
    TickRecord& tick = recording.ticks.emplace_back();
    tick.tick = i;
    tick.time_s = 1 + 1e-3 * static_cast<double>(i);
  }
  return recording;
}

RemovalFigures figures_of(const Recording& recording, const Model& model) {
  RemovalMeter meter(model);
  TickTimes times(RecordingSource(recording).head());
  const auto observe = [&](const TimedTick& now) { meter.observe(now); };
  meter.on_event(recording.events);
  times.take(recording.ticks, observe);
  times.finish(observe);
  return meter.finish();
}

// volume below a plane of the sweep of a ball at a given depth
double below_plane_mm3(double radius_mm, double depth_mm, double distance_mm) {
  const double r = radius_mm, h = depth_mm, height = r + h;
  const double area = r * r * (pi - std::acos(h / r)) + h * std::sqrt(r * r - h * h);
  return area * distance_mm + pi * height * height * (3 * r - height) / 3;
}

TEST(Removal, EqualsTheAnalyticalVolumeOfABallThroughASlab) {
  const Model model = bone_below();
  for (const double depth_mm : {-1.0, 0.5, 1.2}) {
    const Sweep sweep{{-1.13, 0.27, kTop_mm - depth_mm}, {1.37, 0.27, kTop_mm - depth_mm}, 2};
    const RemovalFigures figures = figures_of(ticks_with({swept(7, sweep), cut_contact(7)}), model);
    ASSERT_EQ(figures.structures.size(), 1u);
    const StructureRemoval& bone = figures.structures[0];
    EXPECT_EQ(bone.label, kBone);
    const double expected_mm3 = below_plane_mm3(2, depth_mm, 2.5);
    EXPECT_NEAR(bone.volume_mm3 / expected_mm3, 1, 0.02) << depth_mm;
    EXPECT_EQ(figures.volume_mm3(), bone.volume_mm3);
    const double all_mm3 = 0.125 * static_cast<double>(label_counts(*model.labels)[kBone]);
    EXPECT_NEAR(bone.fraction, bone.volume_mm3 / all_mm3, 1e-12);
    EXPECT_NEAR(bone.depth_mm, 2 + depth_mm, 1e-3);
  }
}

TEST(Removal, ReportsTheClearanceToProtectedStructures) {
  Model model = bone_below();
  model.tools[0].radius_mm = 2;
  model.protected_structures = {{kBone, model.surfaces[0].surface, true},
                                {7, model.surfaces[0].surface, false}};
  // contact without cutting, 0.4 mm away, in one tick
  Recording recording = ticks_with({});
  for (TickRecord& tick : recording.ticks) tick.device[0].proxy_patient_mm = {0, 0, kTop_mm + 3.5};
  recording.ticks[20].switches = recording.ticks[21].switches = kSwitchMotor;
  recording.ticks[21].device[0].proxy_patient_mm[2] = kTop_mm + 2.4;
  recording.ticks[30].device[0].proxy_patient_mm[2] = kTop_mm + 2;  // with the motor off
  const RemovalFigures figures = figures_of(recording, model);
  ASSERT_EQ(figures.spared.size(), 2u);
  EXPECT_EQ(figures.spared[0].label, kBone);
  EXPECT_TRUE(figures.spared[0].is_protected);
  EXPECT_NEAR(figures.spared[0].nearest_mm, 0.4, 1e-3);
  EXPECT_FALSE(figures.spared[1].is_protected);
  recording.ticks[20].switches = recording.ticks[21].switches = 0;
  EXPECT_TRUE(std::isnan(figures_of(recording, model).spared[0].nearest_mm));
}

RecordingEvent changed(std::uint64_t tick, std::uint32_t action) {
  RecordingEvent event = cut_contact(tick);
  event.change.tissue = action;
  return event;
}

TEST(Removal, UndoneStrokesAreNotCounted) {
  const Model model = bone_below();
  const Sweep first{{-5, 0, kTop_mm}, {-4, 0, kTop_mm}, 2, 1};
  const Sweep second{{5, 0, kTop_mm}, {5, 0, kTop_mm - 1.5}, 1, 2};
  std::vector<RecordingEvent> events{swept(10, first), cut_contact(10), swept(20, second), cut_contact(20),
                                     changed(30, ModelChange::kUndo)};
  const RemovalFigures undone = figures_of(ticks_with(events), model);
  const RemovalFigures alone = figures_of(ticks_with({swept(10, first), cut_contact(10)}), model);
  ASSERT_EQ(undone.structures.size(), 1u);
  EXPECT_EQ(undone.volume_mm3(), alone.volume_mm3());
  EXPECT_EQ(undone.structures[0].fraction, alone.structures[0].fraction);
  EXPECT_EQ(undone.strokes, 2u);
  EXPECT_EQ(undone.undone, 1u);
  // undone, but it had been cut
  EXPECT_NEAR(undone.structures[0].depth_mm, 2.5, 1e-3);
  EXPECT_NEAR(undone.structures[0].last_s, 1.020, 1e-12);
  ASSERT_EQ(undone.steps.size(), 3u);
  const std::vector removed = undone.removed_mm3(0, std::vector{1.015, 1.025, 1.035});
  EXPECT_GT(removed[1], removed[0]);
  EXPECT_EQ(removed[2], removed[0]);

  events.push_back(changed(35, ModelChange::kUndo));
  const RemovalFigures none = figures_of(ticks_with(events), model);
  EXPECT_EQ(none.volume_mm3(), 0);
  EXPECT_EQ(none.undone, 2u);
  events.push_back(changed(40, ModelChange::kRedo));
  events.push_back(changed(41, ModelChange::kRedo));
  const RemovalFigures all = figures_of(ticks_with(events), model);
  EXPECT_EQ(all.volume_mm3(),
            figures_of(ticks_with({events.begin(), events.begin() + 4}), model).volume_mm3());
  EXPECT_EQ(all.undone, 0u);
}

TEST(Removal, LabelsMatchTheRemainingTissueAtATime) {
  const Model model = bone_below();
  const Point<Patient> first(0, 0, -2), second(5, 0, -2);
  const auto ball = [](const Point<Patient>& at, std::uint32_t stroke) { return Sweep{at, at, 1.5, stroke}; };
  const Recording recording =
      ticks_with({swept(9, ball(first, 1)), cut_contact(10), swept(24, ball(second, 2)), cut_contact(25),
                  changed(40, ModelChange::kUndo)});
  const RemovalFigures figures = figures_of(recording, model);
  const auto label_at = [](const Model& observed, const Point<Patient>& at) {
    const Point<Voxel> p = observed.labels->geometry().X_PatientVoxel().inverse() * at;
    return observed.labels->at(static_cast<int>(std::lround(p.x())), static_cast<int>(std::lround(p.y())),
                               static_cast<int>(std::lround(p.z())));
  };
  EXPECT_EQ(model_after_removal(model, figures.changes, 1.009), nullptr);
  struct Observed {
    double time_s;
    LabelId first, second;
  };
  for (const Observed& visited :
       {Observed{1.012, 0, kBone}, Observed{1.030, 0, 0}, Observed{1.045, 0, kBone}}) {
    const auto left = model_after_removal(model, figures.changes, visited.time_s);
    ASSERT_NE(left, nullptr);
    EXPECT_EQ(label_at(*left, first), visited.first) << visited.time_s;
    EXPECT_EQ(label_at(*left, second), visited.second) << visited.time_s;
    EXPECT_EQ(label_at(*left, Point<Patient>(0, 5, -2)), kBone);
  }
  EXPECT_EQ(label_at(model, first), kBone);
}

TEST(Removal, CountsOverlappingSweepsOnce) {
  const Model model = bone_below();
  const Sweep first{{-5, 0, kTop_mm}, {-4.8, 0, kTop_mm}, 2};
  const Sweep second{{5, 0, kTop_mm}, {5, 0, kTop_mm - 1.5}, 1};
  const RemovalFigures figures = figures_of(
      ticks_with({swept(10, first), cut_contact(10), swept(20, first), cut_contact(20), swept(30, second),
                  swept(30, first), cut_contact(30), swept(49, Sweep{{0, 5, 0}, {0, 5, 0}, 2})}),
      model);
  ASSERT_EQ(figures.structures.size(), 1u);
  EXPECT_NEAR(figures.structures[0].first_s, 1.010, 1e-12);
  EXPECT_NEAR(figures.structures[0].last_s, 1.030, 1e-12);
  // the smaller ball cut deeper
  EXPECT_NEAR(figures.structures[0].depth_mm, 2.5, 1e-3);
  ASSERT_EQ(figures.steps.size(), 2u);
  const double all_mm3 = figures.volume_mm3(), first_mm3 = figures.steps[0].volumes_mm3.at(0);
  EXPECT_NEAR(first_mm3 / below_plane_mm3(2, 0, 0.2), 1, 0.03);
  EXPECT_GT(all_mm3, first_mm3 + 3);
  EXPECT_EQ(figures.removed_mm3(0, std::vector{1.0, 1.0095, 1.0101, 1.025, 1.0301, 2.0}),
            (std::vector{0.0, 0.0, first_mm3, first_mm3, all_mm3, all_mm3}));
}

TEST(Removal, MotorRunsBySwitchOrPedal) {
  Model model = bone_below();
  Recording recording = ticks_with({});
  for (std::size_t i = 5; i < 25; ++i) recording.ticks[i].switches = kSwitchMotor;
  for (std::size_t i = 20; i < 30; ++i) recording.ticks[i].device[0].buttons = 1u << 2;
  EXPECT_NEAR(figures_of(recording, model).motor_s, 0.020, 1e-9);
  model.tools[0].burr->pedal = 2;
  EXPECT_NEAR(figures_of(recording, model).motor_s, 0.025, 1e-9);
  model.tools[0].burr->pedal = 3;
  EXPECT_NEAR(figures_of(recording, model).motor_s, 0.020, 1e-9);
  EXPECT_TRUE(figures_of(recording, model).structures.empty());
}

TEST(Removal, StructureWithoutSurfaceUsesTheCommonOne) {
  constexpr double kShell_mm = 2;
  const Model model =
      palpate::testing::as_one_body(palpate::testing::ball_model({0.6, 0.6, 0.6}, 1, kShell_mm), kShell_mm);
  const Sweep sweep{{-15.5, 0, 0}, {-15.5, 0, 0}, 2};
  const RemovalFigures figures = figures_of(ticks_with({swept(3, sweep), cut_contact(3)}), model);
  ASSERT_EQ(figures.structures.size(), 2u);
  for (const StructureRemoval& structure : figures.structures)
    EXPECT_NEAR(structure.depth_mm, structure.label == kBone ? 1.5 : 3.5, 0.02) << structure.label;
}

TEST(Removal, HasNoDepthWithoutSurfaces) {
  Model model = bone_below();
  model.surfaces.clear();
  model.label_of_surface.clear();
  const Recording recording = ticks_with({swept(7, {{0, 0, -1}, {0, 0, -1}, 2}), cut_contact(7)});
  const RemovalFigures figures = figures_of(recording, model);
  ASSERT_EQ(figures.structures.size(), 1u);
  EXPECT_GT(figures.volume_mm3(), 20);
  EXPECT_TRUE(std::isnan(figures.structures[0].depth_mm));
  model.labels.reset();
  EXPECT_TRUE(figures_of(recording, model).structures.empty());
}

TEST(DepthBelow, ExceedsTheRangeOfTheDistanceField) {
  const auto plane = bone_below().surfaces[0].surface;
  for (const double depth_mm : {-3.0, 0.0, 3.5, 4.2, 5.5}) {
    const double found_mm = depth_below_mm(*plane, Point<Patient>(0.3, -0.2, kTop_mm - depth_mm));
    EXPECT_GE(found_mm, depth_mm - 1e-3);
    EXPECT_LE(found_mm, std::max(depth_mm + 1e-3, 1.02 * depth_mm));
  }
  // from the centre of a ball all paths out are equal
  const Model model = palpate::testing::with_exact_surfaces(palpate::testing::ball_model({0.6, 0.6, 0.6}));
  EXPECT_NEAR(depth_below_mm(*model.surfaces[0].surface, Point<Patient>(0, 0, 0)),
              palpate::testing::kBoneRadius_mm, 0.05);
}

}  // namespace
}  // namespace palpate::report
