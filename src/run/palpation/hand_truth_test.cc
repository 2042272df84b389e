// The simulated hand in scenes that do not match the script: whatever happens, every step succeeds or fails
// with its name, and the tip is never deeper than its force explains.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "base/test_files.h"
#include "palpate/loading/loading.h"
#include "palpate/palpation/palpation.h"

namespace palpate {
namespace {

using ::testing::AllOf;
using ::testing::Each;
using ::testing::HasSubstr;

// label at a point of a volume of 48 mm about the origin; labels 1 ... 4 are a, b, c and d
using Shape = std::function<LabelId(const Eigen::Vector3d&)>;

struct MadeScene {
  Shape shape;
  double stiffness_N_per_mm = 1.2;
  double tool_radius_mm = 0;
  std::string names[4] = {"a", "b", "c", "d"};
};

LoadedScene scene_of(const MadeScene& world) {
  GridGeometry grid;
  grid.dims = {48, 48, 48};
  grid.origin = Point<Patient>(-23.5, -23.5, -23.5);
  LabelMap labels;
  labels.layers.emplace_back(grid);
  std::array<bool, 5> there{};
  for (int k = 0; k < 48; ++k)
    for (int j = 0; j < 48; ++j)
      for (int i = 0; i < 48; ++i) {
        const LabelId label = world.shape({i - 23.5, j - 23.5, k - 23.5});
        labels.layers[0].at(i, j, k) = label;
        there[label] = true;
      }
  std::string numbers;
  for (LabelId id = 1; id <= 4; ++id) {
    if (!there[id]) continue;
    labels.segments.push_back({id, world.names[id - 1], {}, 0, id});
    if (world.names[id - 1] != "shown") numbers += (numbers.empty() ? "" : ", ") + std::to_string(id);
  }
  auto scene = parse_scene("[[tissue]]\nname = \"wall\"\nlabels = [" + numbers +
                               "]\nstiffness = " + std::to_string(world.stiffness_N_per_mm) +
                               "\n[tool]\nradius = " + std::to_string(world.tool_radius_mm) + "\n",
                           "test.toml");
  PALPATE_CHECK(scene.ok());
  auto model = build_model(*scene, &labels, nullptr);
  PALPATE_CHECK(model.ok());
  return {*std::move(scene), *std::move(model), ""};
}

Shape ball(double radius_mm) {
  return [=](const Eigen::Vector3d& p) { return p.norm() < radius_mm ? LabelId{1} : LabelId{0}; };
}

std::string touch(const std::string& approach, double press_N = 1, const std::string& more = "") {
  return "[[step]]\n" + approach + "\n[[step]]\npress = " + std::to_string(press_N) +
         "\n[[step]]\nhold = 0.5\n" + more + "[[step]]\nleave = true\n";
}
std::string touch_named(const std::string& name, double press_N = 1, const std::string& more = "") {
  return touch("approach = \"" + name + "\"", press_N, more);
}

class HandTruth : public ::testing::Test {
 protected:
  void run(const LoadedScene& scene, const std::string& script_text, const SimulationOptions& options = {}) {
    auto script = parse_script(script_text, "test script");
    ASSERT_TRUE(script.ok()) << script.error().message();
    auto result = simulate(scene, *script, options, folder_ / "run.h5");
    ASSERT_TRUE(result.ok()) << result.error().message();
    result_ = *std::move(result);
    auto recording = read_recording(folder_ / "run.h5");
    ASSERT_TRUE(recording.ok()) << recording.error().message();
    recording_ = *std::move(recording);
    std::filesystem::remove(folder_ / "run.h5");
  }

  std::string error_of(const LoadedScene& scene, const std::string& script_text) {
    auto script = parse_script(script_text, "test script");
    if (!script.ok()) return "no script";
    const auto result = simulate(scene, *script, {}, "");
    return result.ok() ? "no error" : result.error().message();
  }

  void expect_all_retained(std::size_t structures = 1, std::size_t touches = 1) const {
    EXPECT_EQ(result_.failed_steps, 0u) << (result_.problems.empty() ? "" : result_.problems.back());
    ASSERT_EQ(result_.holds.size(), structures);
    for (const HoldFigure& hold : result_.holds) EXPECT_GE(hold.held_s, 0.5) << hold.structure;
    EXPECT_EQ(result_.touches.size(), touches);
  }

  /// @param force_N  largest requested force; 0: no contact
  void expect_never_deeper(double force_N, double stiffness_N_per_mm) const {
    for (const TickRecord& t : recording_.ticks) {
      const DeviceTick& d = t.device[0];
      const double rendered = std::min(stiffness_N_per_mm, d.max_stiffness_N_per_mm);
      if (std::isnan(d.depth_mm)) continue;
      ASSERT_LE(d.depth_mm, force_N / rendered + 1) << t.time_s << " s";
    }
  }

  test::TemporaryFolder folder_;
  SimulationResult result_;
  Recording recording_;
};

TEST_F(HandTruth, EnclosedStructureFailsByNameAndTheRunContinues) {
  const LoadedScene scene = scene_of({[](const Eigen::Vector3d& p) {
    return p.norm() < 6 ? LabelId{2} : p.norm() < 12 ? LabelId{1} : LabelId{0};
  }});
  run(scene, touch_named("b") + touch_named("a"));
  EXPECT_EQ(result_.failed_steps, 1u);
  ASSERT_EQ(result_.problems.size(), 1u);
  EXPECT_THAT(result_.problems[0], AllOf(HasSubstr("script line 1: approach to b failed: it is covered by a"),
                                         HasSubstr("lines 3, 5, 7 are skipped")));
  EXPECT_EQ(recording_.summary->problems, result_.problems);
  ASSERT_EQ(result_.touches.size(), 1u);
  EXPECT_EQ(result_.touches[0].structure, "a");
  EXPECT_EQ(result_.holds[0].held_s, 0) << "b";
  EXPECT_GE(result_.holds[1].held_s, 0.5) << "a";
  expect_never_deeper(1, 1.2);
}

TEST_F(HandTruth, ThroughAShellThereIsNoWayAndNoneIsMade) {
  // a ball inside a closed shell: the straight path would penetrate the shell
  const LoadedScene scene = scene_of({[](const Eigen::Vector3d& p) {
    const double r = p.norm();
    return r < 5 ? LabelId{2} : r > 14 && r < 17 ? LabelId{1} : LabelId{0};
  }});
  run(scene, touch_named("b"));
  EXPECT_EQ(result_.failed_steps, 1u);
  EXPECT_THAT(result_.problems, Each(HasSubstr("approach to b failed: there is no free path to it")));
  for (const TickRecord& t : recording_.ticks) ASSERT_EQ(t.device[0].label, 0) << "nothing is touched";
  EXPECT_TRUE(result_.touches.empty());
}

TEST_F(HandTruth, AThinWallIsHeldFromOutside) {
  const LoadedScene scene = scene_of({[](const Eigen::Vector3d& p) {
    const double r = p.norm();
    return r > 14 && r < 16 ? LabelId{1} : LabelId{0};
  }});
  run(scene, touch_named("a"));
  expect_all_retained();
  EXPECT_NEAR(result_.touches[0].point.eigen().norm(), 16, 0.8);
  expect_never_deeper(1, 1.2);
}

TEST_F(HandTruth, ThroughAHoleThereIsAWay) {
  const LoadedScene scene = scene_of({[](const Eigen::Vector3d& p) {
    const double r = p.norm();
    const bool hole = p.z() > 0 && std::hypot(p.x(), p.y()) < 6;
    return r < 5 ? LabelId{2} : r > 14 && r < 17 && !hole ? LabelId{1} : LabelId{0};
  }});
  run(scene, touch_named("b") + touch("approach = \"b\"\nfrom = \"superior\""));
  expect_all_retained(1, 2);
  expect_never_deeper(1, 1.2);
}

TEST_F(HandTruth, ADirectionThatIsBlockedFailsByName) {
  const LoadedScene scene = scene_of({[](const Eigen::Vector3d& p) {
    if (p.norm() < 8) return LabelId{1};
    return p.y() > 12 && p.y() < 16 ? LabelId{2} : LabelId{0};
  }});
  run(scene, touch("approach = \"a\"\nfrom = \"posterior\"\nclearance = 30") +
                 touch("approach = \"a\"\nfrom = \"anterior\""));
  // there is room between ball and wall
  EXPECT_EQ(result_.failed_steps, 0u) << result_.problems.back();
  EXPECT_GT(result_.touches[0].point.y(), 3);
  EXPECT_LT(result_.touches[1].point.y(), -3);

  const LoadedScene closed = scene_of({[](const Eigen::Vector3d& p) {
    if (p.norm() < 8) return LabelId{1};
    return p.y() > 1.5 && p.y() < 16 ? LabelId{2} : LabelId{0};
  }});
  run(closed, touch("approach = \"a\"\nfrom = \"posterior\"") + touch_named("a"));
  EXPECT_EQ(result_.failed_steps, 1u);
  EXPECT_THAT(result_.problems, Each(HasSubstr("no free path to it from that direction")));
  expect_never_deeper(1, 1.2);
}

TEST_F(HandTruth, TouchesPointsLandmarksAndNearestSurfaces) {
  // a ball, and another one to its left
  const Eigen::Vector3d other(17, 0, 0);
  const LoadedScene scene = scene_of({[&](const Eigen::Vector3d& p) {
    return p.norm() < 10 ? LabelId{1} : (p - other).norm() < 4 ? LabelId{2} : LabelId{0};
  }});
  const Eigen::Vector3d askew = Eigen::Vector3d(-1, -1, 1).normalized() * 10;
  std::string script =
      touch("approach = [-5.8, -5.8, 5.8]") + touch("approach = \"a\"\nlandmark = \"superior\"") +
      touch("approach = \"a\"\nlandmark = \"posterior\"") + touch("approach = \"a\"\nnearest = \"b\"") +
      touch("approach = \"a\"\nnearest = [0, -30, 0]");
  run(scene, script);
  EXPECT_EQ(result_.failed_steps, 0u) << result_.problems.back();
  ASSERT_EQ(result_.touches.size(), 5u);
  const Eigen::Vector3d expected[] = {askew, {0, 0, 10}, {0, 10, 0}, {10, 0, 0}, {0, -10, 0}};
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_LT((result_.touches[i].point.eigen() - expected[i]).norm(), 5.5) << i;
    EXPECT_EQ(result_.touches[i].structure, "a");
    EXPECT_EQ(result_.touches[i].line, static_cast<int>(i) * 8 + 1 + (i > 1 ? static_cast<int>(i) - 1 : 0));
    EXPECT_NEAR(result_.touches[i].point.eigen().norm(), 10, 0.6) << "on the surface";
  }
  expect_never_deeper(1, 1.2);
}

TEST_F(HandTruth, AbsentUntouchableOrAmbiguousStructuresAreErrorsWithLines) {
  MadeScene world{[](const Eigen::Vector3d& p) {
    if (p.norm() > 10) return LabelId{0};
    return p.x() > 5 ? LabelId{3} : p.x() > 0 ? LabelId{1} : LabelId{2};
  }};
  world.names[1] = "a";
  world.names[2] = "shown";
  const LoadedScene scene = scene_of(world);
  EXPECT_THAT(error_of(scene, "\n" + touch_named("a")),
              AllOf(HasSubstr("test script:2"), HasSubstr("2 structures"), HasSubstr("\"#1\", \"#2\"")));
  EXPECT_THAT(error_of(scene, touch_named("shown")), HasSubstr("not touchable"));
  EXPECT_THAT(error_of(scene, touch("approach = \"#1\"\nnearest = \"e\"")), HasSubstr("no structure 'e'"));
  EXPECT_THAT(error_of(scene, touch("approach = [40, 0, 0]")),
              HasSubstr("no touchable structure within 5 mm"));
  run(scene, touch_named("#1") + touch_named("#2"));
  expect_all_retained(2, 2);
}

TEST_F(HandTruth, MoreThanTheLimitFailsByNameAndDoesNotGoIn) {
  const LoadedScene scene = scene_of({ball(12)});
  SimulationOptions options;
  options.max_force_N = 3;
  run(scene, touch_named("a", 40) + touch_named("a", 1), options);
  EXPECT_EQ(result_.failed_steps, 1u);
  ASSERT_EQ(result_.problems.size(), 2u) << "known before, and met";
  EXPECT_THAT(result_.problems[1],
              AllOf(HasSubstr("script line 3: press of 40.00 N on a failed: the limit is "),
                    HasSubstr("lines 5, 7 are skipped")));
  EXPECT_GE(result_.holds[0].held_s, 0.5) << "the second press";
  expect_never_deeper(3, 1.2);
}

TEST_F(HandTruth, SlideOntoAnotherStructureFailsByName) {
  const LoadedScene scene = scene_of({[](const Eigen::Vector3d& p) {
    if (p.y() < 0 || p.y() > 12 || std::abs(p.x()) > 18 || std::abs(p.z()) > 18) return LabelId{0};
    return p.x() < 0 ? LabelId{1} : LabelId{2};
  }});
  const std::string slide = "[[step]]\nslide = 30\ndirection = \"left\"\n[[step]]\nhold = 0.5\n";
  run(scene, touch("approach = [-8, 0, 0]", 1, slide) + touch_named("b"));
  EXPECT_EQ(result_.failed_steps, 1u);
  EXPECT_THAT(result_.problems, Each(AllOf(HasSubstr("slide of 30.0 mm on a failed: it touched b instead"),
                                           HasSubstr("lines 10, 12 are skipped"))));
  expect_never_deeper(1, 1.2);
  // succeeds on the extent of the structure
  run(scene, touch("approach = [-12, 0, 0]", 1,
                   "[[step]]\nslide = 6\ndirection = \"left\"\nspeed = 200\n[[step]]\nhold = 0.5\n"));
  EXPECT_EQ(result_.failed_steps, 0u) << result_.problems.back();
  expect_never_deeper(1, 1.2);
}

TEST_F(HandTruth, AHoldThatSlipsOffFails) {
  // the object keeps rotating: a narrow bar moves away under the tip
  const LoadedScene scene = scene_of({[](const Eigen::Vector3d& p) {
    return p.y() > -4 && p.y() < 4 && std::abs(p.z()) < 5 && std::abs(p.x()) < 20 ? LabelId{1} : LabelId{0};
  }});
  run(scene,
      touch("approach = [14, -4, 0]", 1, "[[step]]\nrotate = 80\nseconds = 0.3\n[[step]]\nhold = 0.5\n"));
  EXPECT_EQ(result_.failed_steps, 1u);
  EXPECT_THAT(result_.problems, Each(AllOf(HasSubstr("turn by 80 degrees failed"), HasSubstr("skipped"))));
  expect_never_deeper(1, 1.2);
}

TEST_F(HandTruth, AHoldThatTrembleBreaksIsNoHold) {
  run(scene_of({ball(12)}), "tremor = 1.0\n" + touch_named("a"));
  EXPECT_EQ(result_.failed_steps, 1u);
  EXPECT_THAT(result_.problems, Each(AllOf(HasSubstr("script line"), HasSubstr("on a failed"))));
}

TEST_F(HandTruth, AnObjectThatTurnsDoesNotHitTheHand) {
  // a long bar that sweeps through the hand's rest position
  const LoadedScene scene = scene_of({[](const Eigen::Vector3d& p) {
    return std::abs(p.y()) < 4 && std::abs(p.z()) < 23 && std::abs(p.x()) < 4 ? LabelId{1} : LabelId{0};
  }});
  const std::string turn = "[[step]]\nrotate = 90\naxis = \"right\"\nseconds = 0.3\n";
  run(scene, turn + touch_named("a") + turn + touch_named("a"));
  expect_all_retained(1, 2);
}

TEST_F(HandTruth, TouchingAndTinyStructuresAreHeldOrFailByName) {
  const LoadedScene scene = scene_of({[](const Eigen::Vector3d& p) {
    if ((p - Eigen::Vector3d(-10, 0, 0)).norm() < 10) return LabelId{1};
    if ((p - Eigen::Vector3d(10, 0, 0)).norm() < 10) return LabelId{2};
    if ((p - Eigen::Vector3d(0, 0, 18)).norm() < 2) return LabelId{3};
    return (p - Eigen::Vector3d(0.5, 0.5, -18.5)).norm() < 0.6 ? LabelId{4} : LabelId{0};
  }});
  run(scene, touch_named("a") + touch_named("b") + touch_named("c") + touch_named("d"));
  ASSERT_EQ(result_.holds.size(), 4u);
  for (std::size_t s = 0; s < 4; ++s) {
    const std::string name(1, static_cast<char>('a' + static_cast<int>(s)));
    const bool failed = std::any_of(result_.problems.begin(), result_.problems.end(), [&](const auto& t) {
      return t.find(" " + name + " failed") != std::string::npos;
    });
    EXPECT_NE(result_.holds[s].held_s >= 0.5, failed) << name;
    EXPECT_FALSE(failed && s < 2) << name;
  }
  expect_never_deeper(1, 1.2);
}

struct Trajectory {
  const char* hand;
  double tool_radius_mm, stiffness_N_per_mm, press_N;
};
class HandTruthWith : public HandTruth, public ::testing::WithParamInterface<Trajectory> {};

TEST_P(HandTruthWith, ABallIsHeldNoDeeperThanTheForceExplains) {
  const Trajectory& section = GetParam();
  MadeScene world{ball(14)};
  world.stiffness_N_per_mm = section.stiffness_N_per_mm;
  world.tool_radius_mm = section.tool_radius_mm;
  run(scene_of(world), std::string("hand = \"") + section.hand + "\"\n" + touch_named("a", section.press_N));
  // at the largest stiffness that a hand holds stably, force may vary by more than a fifth
  if (section.stiffness_N_per_mm < 5) expect_all_retained();
  EXPECT_EQ(result_.failed_steps == 0, result_.holds[0].held_s >= 0.5 - 1e-9);
  expect_never_deeper(section.press_N, section.stiffness_N_per_mm);
  // before the press there is only contact
  EXPECT_NEAR(result_.touches[0].point.eigen().norm(), 14, 0.7);
}

INSTANTIATE_TEST_SUITE_P(
    Grips, HandTruthWith,
    ::testing::Values(Trajectory{"light-grip", 0, 1.2, 1}, Trajectory{"whole-arm", 0, 1.2, 1},
                      Trajectory{"firm-grip", 3, 1.2, 1}, Trajectory{"light-grip", 3, 1.2, 0.5},
                      Trajectory{"firm-grip", 0, 0.05, 0.3}, Trajectory{"whole-arm", 0, 0.1, 0.5},
                      Trajectory{"firm-grip", 0, 5, 1.2}),
    [](const auto& path) { return "Way" + std::to_string(path.index); });

class HandTruthBy : public HandTruth, public ::testing::WithParamInterface<ForceMethod> {};

TEST_P(HandTruthBy, EveryMethodHoldsOrFailsByName) {
  SimulationOptions options;
  options.method = GetParam();
  const LoadedScene scene = scene_of({ball(14)});
  run(scene, touch_named("a"), options);
  EXPECT_NE(result_.failed_steps == 0, result_.holds[0].held_s < 0.5 - 1e-9);
  // a force that jumps between voxels is not held within a fifth
  const bool even = GetParam() != ForceMethod::kStoredNormals;
  EXPECT_EQ(result_.failed_steps, even ? 0u : 1u);
  expect_never_deeper(1, 1.2);

  // the method changes in the middle of a contact
  for (const ForceMethod other : {ForceMethod::kProxy, ForceMethod::kTrilinear}) {
    run(scene,
        touch_named("a", 1,
                    "[[step]]\nmethod = \"" + std::string(name_of(other)) + "\"\n[[step]]\nhold = 0.5\n"),
        options);
    EXPECT_EQ(result_.failed_steps, even ? 0u : 1u);
    expect_never_deeper(1, 1.2);
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, HandTruthBy,
                         ::testing::Values(ForceMethod::kTrilinear, ForceMethod::kSpline,
                                           ForceMethod::kGaussianSphere, ForceMethod::kSmoothSphere,
                                           ForceMethod::kStoredNormals, ForceMethod::kProxy),
                         [](const auto& method) {
                           std::string name(name_of(method.param));
                           std::erase(name, '-');
                           return name;
                         });

}  // namespace
}  // namespace palpate
