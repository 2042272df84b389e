#include "palpate/rehearsal/comparison.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <numbers>
#include <random>

#include "base/test_seed.h"
#include "contact/test_model.h"

namespace palpate {
namespace {

using std::numbers::pi;
using ::testing::HasSubstr;

constexpr double kDegree = pi / 180;

/// A run in memory with a prescribed tip path.
Recording run_along(const std::function<Point<Patient>(double)>& tip_at, double seconds,
                    double rate_hz = 1000) {
  Recording run;
  run.header.rate_hz = rate_hz;
  const auto count = static_cast<std::uint64_t>(std::llround(seconds * rate_hz));
  for (std::uint64_t n = 0; n <= count; ++n) {
    TickRecord tick;
    tick.tick = n;
    tick.time_s = static_cast<double>(n) / rate_hz;
    tick.dt_s = 1 / rate_hz;
    const Point<Patient> at = tip_at(tick.time_s);
    tick.device[0].tip_patient_mm = tick.device[0].proxy_patient_mm = {at.x(), at.y(), at.z()};
    run.ticks.push_back(tick);
  }
  run.summary.emplace();
  return run;
}

/// Piecewise linear path at constant speed.
struct StraightPath {
  std::vector<Point<Patient>> corners;
  double speed_mm_s = 20;

  double seconds() const {
    double mm = 0;
    for (std::size_t n = 1; n < corners.size(); ++n) mm += (corners[n] - corners[n - 1]).norm();
    return mm / speed_mm_s;
  }
  Point<Patient> at(double t) const {
    double left_mm = t * speed_mm_s;
    for (std::size_t n = 1; n < corners.size(); ++n) {
      const double mm = (corners[n] - corners[n - 1]).norm();
      if (left_mm <= mm) return corners[n - 1] + (corners[n] - corners[n - 1]) * (left_mm / mm);
      left_mm -= mm;
    }
    return corners.back();
  }
};

Recording run_along(const StraightPath& path, double rate_hz = 1000) {
  return run_along([&](double t) { return path.at(t); }, path.seconds(), rate_hz);
}

const Model& ball() {
  static const Model model = testing::with_exact_surfaces(testing::ball_model());
  return model;
}
const std::vector<StructureDistance>& ball_distances() {
  static const std::vector<StructureDistance> distances{
      StructureDistance(testing::kBone, ball().surfaces[0].surface)};
  return distances;
}

PlanInScene scene_plan(const std::string& text, const Model& model = ball()) {
  const auto plan = parse_plan("title = \"p\"\n" + text, "plan.toml");
  PALPATE_CHECK(plan.ok());
  auto found = resolve_plan(*plan, model);
  PALPATE_CHECK(found.ok());
  return *std::move(found);
}

// from the top of the ball to 10 mm below it
constexpr const char* kStraightDown = R"([[trajectory]]
name = "down"
entry = [0, 0, 15]
target = [0, 0, 5]
enters = ["ball"]
)";

PlanComparison compared(const PlanInScene& plan, const Recording& run, const Model& model = ball(),
                        const std::vector<StructureDistance>& distances = ball_distances()) {
  const RecordingSource source(run);
  auto made = compare_recording(plan, model, distances, source);
  PALPATE_CHECK(made.ok());
  return *std::move(made);
}

Vector<Patient> perpendicular_to(const Vector<Patient>& v) {
  return v.cross(std::abs(v.x()) < 0.5 ? Vector<Patient>(1, 0, 0) : Vector<Patient>(0, 1, 0)).normalized();
}

TEST(ComparePlan, AStraightWayHasItsOffsetAngleAndDepth) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> part(-1, 1);
  for (int n = 0; n < 12; ++n) {
    // a planned path through the ball's surface, and an actual one, offset and rotated
    const Vector<Patient> out = Vector<Patient>(part(random), part(random), part(random)).normalized();
    const Point<Patient> entry = Point<Patient>() + out * 15, target = entry - out * (8 + 3 * part(random));
    const Vector<Patient> axis = (target - entry).normalized(), side = perpendicular_to(axis);
    const double angle_deg = 12 + 10 * part(random), depth_mm = 9 + 2 * part(random);
    const Vector<Patient> turned =
        axis * std::cos(angle_deg * kDegree) + axis.cross(side) * std::sin(angle_deg * kDegree);
    const Point<Patient> lateral =
        Point<Patient>() + (out * 15 + side * (3 * part(random))).normalized() * 15;
    // a point of the ball that is touched earlier in the run and left again
    const Point<Patient> elsewhere = Point<Patient>() + side * 14, free = Point<Patient>() + side * 30;
    const Point<Patient> above = lateral - turned * 20, deepest = lateral + turned * depth_mm;
    const StraightPath path{{free, elsewhere, free, above, deepest, above}};
    PlanFile file;
    file.title = "p";
    file.trajectories.push_back({"t", entry, target, {"ball"}, 2, 1, 30, {}, 1});
    const auto plan = resolve_plan(file, ball());
    ASSERT_TRUE(plan) << plan.error().message();
    for (const double rate_hz : {1000.0, 4000.0}) {
      const TrajectoryResult done = compared(*plan, run_along(path, rate_hz)).trajectories[0];
      EXPECT_EQ(done.entry_kind, EntryKind::kPassed);
      EXPECT_NEAR(done.entry_error_mm.value, (lateral - entry).norm(), 0.02);
      EXPECT_EQ(done.entry_error_mm.is_within_limit(), done.entry_error_mm.value <= 2);
      // projection of the target onto the path
      const double foot_mm = std::clamp((target - lateral).dot(turned), 0.0, depth_mm);
      const Vector<Patient> off = lateral + turned * foot_mm - target;
      EXPECT_NEAR(done.target_error_mm.value, off.norm(), 0.01);
      EXPECT_NEAR(done.along_mm, off.dot(axis), 0.02);
      EXPECT_NEAR(done.lateral_mm, (off - axis * off.dot(axis)).norm(), 0.02);
      EXPECT_NEAR(done.angle_deg.value, angle_deg, 0.05);
      EXPECT_TRUE(done.angle_deg.is_within_limit());
      EXPECT_LT(done.line_rms_mm, 0.01);
      EXPECT_NEAR(done.depth_mm, depth_mm * std::cos(angle_deg * kDegree), 0.03);
      EXPECT_NEAR(done.depth_error_mm.value, done.depth_mm - (target - entry).norm(), 1e-9);
      EXPECT_TRUE(done.depth_error_mm.is_within_limit());  // the plan has no depth tolerance
      EXPECT_LT((done.deepest.at - deepest).norm(), 0.03);
      EXPECT_TRUE(std::isnan(done.shaft_deg));
    }
  }
}

TEST(ComparePlan, PathNearestToTheTargetIsEvaluated) {
  const PlanInScene plan = scene_plan(kStraightDown);
  // 4 mm off axis, and deeper; then 1 mm off axis, in three strokes that never leave the hole by 10 mm; then
  // off axis again
  const auto in = [](double x, double z) { return Point<Patient>(x, 0, z); };
  const StraightPath path{{in(4, 40), in(4, 0), in(4, 40), in(1, 40), in(1, 12), in(1, 17), in(1, 9),
                           in(1, 18), in(1, 4), in(1, 40), in(-6, 40), in(-6, 9), in(-6, 40)}};
  const TrajectoryResult done = compared(plan, run_along(path)).trajectories[0];
  EXPECT_NEAR(done.target_error_mm.value, 1, 0.01);
  EXPECT_NEAR(done.entry.at.x(), 1, 1e-6);
  EXPECT_NEAR(done.entry.at.z(), std::sqrt(15 * 15 - 1), 0.02);
  EXPECT_NEAR(done.deepest.at.z(), 4, 0.03);
  EXPECT_NEAR(done.depth_mm, std::sqrt(15 * 15 - 1) - 4, 0.04);
  EXPECT_NEAR(done.depth_error_mm.value, done.depth_mm - 10, 1e-9);
  EXPECT_LT(done.angle_deg.value, 0.01);
  // the entry is that of the first stroke
  EXPECT_LT(done.entry.time_s, done.deepest.time_s - 1);
}

TEST(ComparePlan, WithoutStructuresEntryIsTheNearestPathPoint) {
  const PlanInScene plan = scene_plan(R"([[trajectory]]
name = "down"
entry = [0, 0, 15]
target = [0, 0, 5]
entry_within = 1
)");
  // tan of the angle is 0.1: the path is 2 mm off in x at the entry
  const Vector<Patient> turned = Vector<Patient>(0.1, 0, -1).normalized();
  const Point<Patient> beside = Point<Patient>(2, 0, 15);
  const StraightPath path{{{40, 0, 60}, beside - turned * 20, beside + turned * 8, {40, 0, 60}}};
  const TrajectoryResult done = compared(plan, run_along(path)).trajectories[0];
  EXPECT_EQ(done.entry_kind, EntryKind::kNearest);
  EXPECT_NEAR(done.entry_error_mm.value, 2 * std::cos(std::atan(0.1)), 0.001);
  EXPECT_FALSE(done.is_within_limit());
  EXPECT_NEAR(done.angle_deg.value, std::atan(0.1) / kDegree, 0.05);
}

TEST(ComparePlan, UncutTrajectoryHasNoErrors) {
  const PlanInScene plan = scene_plan(kStraightDown);
  const StraightPath path{{{3, 0, 40}, {3, 0, 16}, {3, 0, 40}}};
  Recording run = run_along(path);
  TrajectoryResult done = compared(plan, run).trajectories[0];
  EXPECT_EQ(done.entry_kind, EntryKind::kNone);
  EXPECT_TRUE(std::isnan(done.entry_error_mm.value));
  EXPECT_TRUE(std::isnan(done.angle_deg.value));
  EXPECT_TRUE(std::isnan(done.depth_mm));
  EXPECT_NEAR(done.target_error_mm.value, std::hypot(3, 11), 1e-6);
  EXPECT_NEAR(done.along_mm, -11, 1e-6);
  EXPECT_NEAR(done.lateral_mm, 3, 1e-6);

  for (TickRecord& tick : run.ticks) {
    if (tick.device[0].tip_patient_mm[2] > 16.5) continue;
    tick.device[0].flags |= kFlagContact;
    tick.device[0].label = testing::kBone;
  }
  done = compared(plan, run).trajectories[0];
  EXPECT_EQ(done.entry_kind, EntryKind::kTouched);
  EXPECT_NEAR(done.entry_error_mm.value, std::hypot(3, 1.5), 0.03);
  // half a millimetre of path has no direction
  EXPECT_TRUE(std::isnan(done.angle_deg.value));
}

TEST(ComparePlan, AShaftHasItsAngleWhereTheDeviceTellsOne) {
  Model model = ball();
  model.tools[0].capsules = {{{0, 0, 0}, {0, 0, 100}, 1}};
  const PlanInScene plan = scene_plan(kStraightDown, model);
  Recording run = run_along(StraightPath{{{0, 0, 40}, {0, 0, 6}}});
  const auto shaft_deg = [&] { return compared(plan, run, model).trajectories[0].shaft_deg; };
  EXPECT_TRUE(std::isnan(shaft_deg()));
  // the shaft is rotated to the patient's superior direction, and then by 20 degrees away from it
  const Vector<World> up = (model.X_WorldPatient * Vector<Patient>(0, 0, 1)).normalized();
  const Eigen::Quaterniond upright = shortest_rotation(Eigen::Vector3d(0, 0, 1), up.eigen());
  const Eigen::Vector3d across = up.cross(Vector<World>(1, 0, 0)).normalized().eigen();
  const Eigen::Quaterniond tilted(Eigen::AngleAxisd(20 * kDegree, across) * upright);
  for (std::size_t n = 0; n < run.ticks.size(); ++n) {
    const Eigen::Quaterniond& q = n == 0 ? upright : tilted;
    run.ticks[n].device[0].orientation_wxyz = {q.w(), q.x(), q.y(), q.z()};
  }
  EXPECT_NEAR(shaft_deg(), 20, 1e-6);
}

// ---- distances

TEST(ComparePlan, ClosestApproachesAreThoseOfEveryTick) {
  // bone up to 15 mm, surrounded by fat, which is not touchable
  Model model = testing::with_exact_surfaces(testing::ball_model({1, 1, 1}));
  model.tools[0].radius_mm = 1.5;
  const auto distances = structure_distances(model);
  ASSERT_TRUE(distances);
  const PlanInScene plan = scene_plan("[[keep_away]]\nstructures = [\"ball\"]\ndistance = 3\n", model);
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> part(-1, 1);
  StraightPath path;
  path.speed_mm_s = 120;
  // every fourth corner is inside the ball
  for (int n = 0; n < 25; ++n)
    path.corners.push_back(Point<Patient>() +
                           Vector<Patient>(part(random), part(random), part(random)) * (n % 4 == 1 ? 5 : 50));
  const Recording run = run_along(path);
  const PlanComparison made = compared(plan, run, model, *distances);
  ASSERT_EQ(made.approaches.size(), 2u);
  ASSERT_EQ(made.times_s.size(), kMaxPlanTimes);
  for (std::size_t s = 0; s < 2; ++s) {
    // reference: evaluates every tick
    std::vector<double> least(kMaxPlanTimes, std::numeric_limits<double>::infinity());
    double nearest = std::numeric_limits<double>::infinity(), below_s = 0;
    std::uint64_t nearest_tick = 0, entered = 0;
    bool was_below = false;
    for (std::size_t n = 0; n < run.ticks.size(); ++n) {
      const auto& at = run.ticks[n].device[0].tip_patient_mm;
      const double gap = (*distances)[s].distance_mm({at[0], at[1], at[2]}) - 1.5;
      double& in_part = least[n * kMaxPlanTimes / run.ticks.size()];
      in_part = std::min(in_part, gap);
      if (gap < nearest) nearest = gap, nearest_tick = n;
      const bool below = s == 0 && gap < 3;
      if (below && was_below) below_s += 0.001;
      entered += below && !was_below;
      was_below = below;
    }
    const StructureClearance& approach = made.approaches[s];
    EXPECT_EQ(approach.label, s == 0 ? testing::kBone : testing::kFat);
    EXPECT_NEAR(approach.nearest_mm, nearest, 1e-9);
    EXPECT_EQ(approach.nearest.tick, nearest_tick);
    for (std::size_t n = 0; n < kMaxPlanTimes; ++n) {
      EXPECT_GE(approach.over_time_mm[n], least[n] - 1e-4);
      EXPECT_LE(approach.over_time_mm[n], least[n] + 0.051);
    }
    if (s == 1) continue;
    EXPECT_NEAR(approach.below_s, below_s, 1e-9);
    EXPECT_EQ(made.violations.size(), entered);
    EXPECT_GE(entered, 1u);
  }
  EXPECT_FALSE(made.is_within_limit());
}

TEST(ComparePlan, ViolatedClearanceListsItsTicks) {
  // oscillates towards the ball and away: |p| = 20 + 4 cos, so the clearance is 5 + 4 cos
  const PlanInScene plan = scene_plan("[[keep_away]]\nstructures = [\"ball\"]\ndistance = 3\n");
  const Recording run =
      run_along([](double t) { return Point<Patient>(20 + 4 * std::cos(2 * pi * t), 0, 0); }, 3);
  const PlanComparison made = compared(plan, run);
  ASSERT_EQ(made.violations.size(), 3u);
  for (std::size_t n = 0; n < 3; ++n) {
    const ClearanceViolation& violation = made.violations[n];
    const double turn = static_cast<double>(n);
    // 5 + 4 cos < 3 from one third to two thirds of each period
    EXPECT_NEAR(violation.begin.time_s, turn + 1.0 / 3, 0.002);
    EXPECT_NEAR(violation.end_s, turn + 2.0 / 3, 0.002);
    EXPECT_NEAR(violation.nearest.time_s, turn + 0.5, 0.03);
    EXPECT_EQ(violation.begin.tick, static_cast<std::uint64_t>(std::llround(violation.begin.time_s * 1000)));
    EXPECT_NEAR(violation.nearest_mm, 1, 0.01);
    EXPECT_EQ(violation.requested_mm, 3);
    EXPECT_LT((violation.nearest.at - Point<Patient>(16, 0, 0)).norm(), 0.1);
  }
  EXPECT_NEAR(made.approaches[0].nearest_mm, 1, 0.01);
  EXPECT_NEAR(made.approaches[0].below_s, 1, 0.01);
  EXPECT_FALSE(made.approaches[0].is_within_limit());

  const PlanComparison comparison =
      compared(scene_plan("[[keep_away]]\nstructures = [\"ball\"]\ndistance = 0.9\n"), run);
  EXPECT_TRUE(comparison.violations.empty());
  EXPECT_TRUE(comparison.is_within_limit());
}

TEST(ComparePlan, ABurrsHeadIsAllOfItsRowWhereItIsHeld) {
  Model model = ball();
  model.tools[0].radius_mm = 1;
  model.tools[0].burr = BurrSettings{.length_mm = 8, .end_radius_mm = 2};
  const Vector<World> right = (model.X_WorldPatient * Vector<Patient>(-1, 0, 0)).normalized();
  const Eigen::Quaterniond turned = shortest_rotation(Eigen::Vector3d(0, 0, 1), right.eigen());
  // the head extends along -x: its far end is 8 mm nearer to the ball than the tip, and wider
  Recording run = run_along([](double t) { return Point<Patient>(40 - 5 * t, 0, 0); }, 1);
  for (TickRecord& tick : run.ticks) {
    tick.device[0].orientation_wxyz = {turned.w(), turned.x(), turned.y(), turned.z()};
    tick.device[0].tip_patient_mm = {0, 0, 0};  // the operator's tip is elsewhere
  }
  const PlanComparison made =
      compared(scene_plan("[[keep_away]]\nstructures = [\"ball\"]\ndistance = 1\n", model), run, model);
  EXPECT_NEAR(made.approaches[0].nearest_mm, 35 - 8 - 2 - 15, 0.06);
  // far away the tolerance is 0.05 mm, which is ten ticks
  EXPECT_GE(made.approaches[0].nearest.tick, 990u);
  EXPECT_LT((made.approaches[0].nearest.at - Point<Patient>(35, 0, 0)).norm(), 0.051);
}

// ---- volumes

/// Volume of the intersection of two balls with centres d apart.
double lens_mm3(double a, double b, double d) {
  return pi * std::pow(a + b - d, 2) * (d * d + 2 * d * (a + b) - 3 * (a - b) * (a - b)) / (12 * d);
}
double ball_mm3(double r) {
  return 4.0 / 3 * pi * r * r * r;
}

/// A run in which balls were removed, each by a separate stroke, visible to the tool one tick later.
Recording cutting_run(const std::vector<std::pair<Point<Patient>, double>>& balls) {
  Recording run = run_along(StraightPath{{{0, 0, 40}, {0, 0, 39}}});
  std::uint32_t version = 1;
  for (const auto& [at, radius_mm] : balls) {
    RecordingEvent sweep;
    sweep.kind = RecordingEvent::Kind::kSweep;
    sweep.tick = 10 * version;
    sweep.number = ++version;
    sweep.sweep.from_mm = sweep.sweep.to_mm = {at.x(), at.y(), at.z()};
    sweep.sweep.radius_mm = radius_mm;
    sweep.sweep.stroke = version;
    RecordingEvent cut;
    cut.tick = sweep.tick;
    cut.number = cut.change.version = version;
    cut.change.tissue = ModelChange::kCut;
    run.events.insert(run.events.end(), {sweep, cut});
  }
  return run;
}

constexpr const char* kSphereToTakeOff = R"([[trajectory]]
name = "down"
entry = [0, 0, 15]
target = [0, 0, 3]
[[region]]
name = "sphere"
shape = "sphere"
trajectory = "down"
radius = 5
)";

TEST(ComparePlan, VolumesInAndOutsideThePlanAreExact) {
  const PlanInScene plan = scene_plan(kSphereToTakeOff);
  // a ball of radius 4 mm, entirely in bone, 6 mm from the centre of the planned one
  Recording run = cutting_run({{Point<Patient>(6, 0, 3), 4}});
  PlanComparison made = compared(plan, run);
  const double in_mm3 = lens_mm3(5, 4, 6);
  ASSERT_EQ(made.volumes.size(), 1u);
  EXPECT_EQ(made.volumes[0].label, testing::kBone);
  EXPECT_NEAR(made.volumes[0].in_plan.planned_mm3 / ball_mm3(5), 1, 0.01);
  EXPECT_NEAR(made.volumes[0].in_plan.removed_mm3 / in_mm3, 1, 0.02);
  EXPECT_NEAR(made.volumes[0].outside_mm3 / (ball_mm3(4) - in_mm3), 1, 0.02);
  EXPECT_NEAR(made.volumes[0].in_plan.remaining_mm3() / (ball_mm3(5) - in_mm3), 1, 0.02);
  ASSERT_EQ(made.regions.size(), 1u);
  EXPECT_EQ(made.regions[0].removed_mm3, made.volumes[0].in_plan.removed_mm3);
  EXPECT_EQ(made.regions[0].planned_mm3, made.volumes[0].in_plan.planned_mm3);

  // undo restores the tissue, redo removes it
  RecordingEvent stroke;
  stroke.tick = 40;
  stroke.number = stroke.change.version = 3;
  stroke.change.tissue = ModelChange::kUndo;
  run.events.push_back(stroke);
  EXPECT_EQ(compared(plan, run).volumes[0].in_plan.removed_mm3, 0);
  EXPECT_EQ(compared(plan, run).volumes[0].outside_mm3, 0);
  stroke.number = stroke.change.version = 4;
  stroke.change.tissue = ModelChange::kRedo;
  run.events.push_back(stroke);
  EXPECT_EQ(compared(plan, run).volumes[0].outside_mm3, made.volumes[0].outside_mm3);

  // overlapping sweeps count once; sweeps without a cut model version do not count
  Recording twice = cutting_run({{Point<Patient>(6, 0, 3), 4}, {Point<Patient>(6, 0, 3), 4}});
  twice.events.push_back(run.events[0]);
  twice.events.back().sweep.from_mm = twice.events.back().sweep.to_mm = {0, 0, -8};
  EXPECT_EQ(compared(plan, twice).volumes[0].in_plan.removed_mm3, made.volumes[0].in_plan.removed_mm3);
  EXPECT_EQ(compared(plan, twice).volumes[0].outside_mm3, made.volumes[0].outside_mm3);
}

TEST(ComparePlan, VolumesOfEachStructure) {
  // a shell of 4 mm around the bone; the plan is to remove all bone and nothing of the shell
  Model model = testing::with_exact_surfaces(testing::ball_model({0.6, 0.6, 0.6}, 1, 4), 4);
  const std::vector<StructureDistance> distances{
      StructureDistance(testing::kBone, model.surfaces[0].surface)};
  const PlanInScene plan = scene_plan("[[region]]\nname = \"bone\"\nstructures = [\"ball\"]\n", model);
  // where the voxel faces are oblique to the surface
  const Recording run = cutting_run({{Point<Patient>() + Vector<Patient>(1, 2, 3).normalized() * 14, 3}});
  const PlanComparison made = compared(plan, run, model, distances);
  const double in_mm3 = lens_mm3(15, 3, 14);
  ASSERT_EQ(made.volumes.size(), 2u);
  EXPECT_EQ(made.volumes[0].label, testing::kBone);
  EXPECT_NEAR(made.volumes[0].in_plan.planned_mm3 / ball_mm3(15), 1, 0.01);
  EXPECT_NEAR(made.volumes[0].in_plan.removed_mm3 / in_mm3, 1, 0.04);
  EXPECT_EQ(made.volumes[0].outside_mm3, 0);
  EXPECT_EQ(made.volumes[1].label, testing::kCartilage);
  EXPECT_EQ(made.volumes[1].in_plan.planned_mm3, 0);
  EXPECT_NEAR(made.volumes[1].outside_mm3 / (ball_mm3(3) - in_mm3), 1, 0.04);
}

// ---- truncated recordings

TEST(ComparePlan, UnobservedRequirementsFail) {
  const PlanInScene plan = scene_plan(kStraightDown);
  Recording run = run_along(StraightPath{{{0, 0, 40}, {0, 0, 5}}});
  EXPECT_TRUE(compared(plan, run).is_within_limit());
  Recording cut = run;
  cut.summary.reset();
  EXPECT_TRUE(compared(plan, cut).cut_short);
  EXPECT_FALSE(compared(plan, cut).is_within_limit());
  Recording gap = run;
  gap.ticks.erase(gap.ticks.begin() + 500, gap.ticks.begin() + 600);
  EXPECT_NEAR(compared(plan, gap).missing_s, 0.101, 1e-9);
  EXPECT_FALSE(compared(plan, gap).is_within_limit());
  Recording blind = run;
  for (std::size_t n = 100; n < 200; ++n) blind.ticks[n].device[0].tip_patient_mm[1] = kNoValue;
  EXPECT_EQ(compared(plan, blind).invalid_ticks, 100u);
  EXPECT_NEAR(compared(plan, blind).trajectories[0].target_error_mm.value, 0, 1e-9);

  const auto refused = [&](const Recording& bad, std::size_t device = 0) {
    const auto made = compare_recording(plan, ball(), ball_distances(), RecordingSource(bad), device);
    return made ? "accepted" : made.error().message();
  };
  EXPECT_THAT(refused(Recording()), HasSubstr("it has no tick"));
  EXPECT_THAT(refused(run, 1), HasSubstr("it has no device 2"));
  Recording back = run;
  back.ticks[7].time_s = 0;
  EXPECT_THAT(refused(back), HasSubstr("the clock does not advance at tick 7"));
}

TEST(ComparePlan, TheWayIsThinnedOut) {
  const Recording run = run_along(StraightPath{{{0, 0, 40}, {0, 0, -40}}, 5});
  const PlanComparison made = compared(scene_plan(kStraightDown), run);
  EXPECT_EQ(made.ticks, 16'001u);
  EXPECT_LE(made.path.size(), kMaxPathPoints);
  EXPECT_GT(made.path.size(), kMaxPathPoints / 4);
  EXPECT_EQ(made.path.front(), Point<Patient>(0, 0, 40));
  EXPECT_LT((made.path.back() - Point<Patient>(0, 0, -40)).norm(), 1e-9);
}

}  // namespace
}  // namespace palpate
