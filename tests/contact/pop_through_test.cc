#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <random>
#include <vector>

#include "base/test_files.h"
#include "palpate/contact/proxy_path.h"
#include "palpate/scene/tissue_presets.h"
#include "palpate/surfaces/surfaces.h"
#include "palpate/volume_io/volume_io.h"

/// Random presses on the thin tissues of two real knees, resampled on rotated grids: the proxy's whole path
/// stays outside, checked by an independent oracle. PALPATE_TEST_PRESSES: total number of presses.
namespace palpate {
namespace {

constexpr unsigned kSeed = 5;
const Eigen::Vector3d kVoxel_mm(0.277, 0.277, 1.0);
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
// only the menisci of each knee: preparation takes most of the time, and the other structures run no other
// code
constexpr bool kMenisciAlone = true;
#else
constexpr bool kMenisciAlone = false;
#endif
constexpr int kKnees = 2, kStructures = kMenisciAlone ? 2 : 7;  // per knee: menisci; cartilages and patella
constexpr double kMax_N = 8.5;
constexpr double kMaxStep_mm = 0.5;  // a tick of 1 ms: half a metre a second
constexpr double kWidest_mm = 3;     // the tool's radius
constexpr double kEvery_mm = 0.01;
// one additional press with a shaft for every ten with a sphere; its contact is sampled as a row of spheres
constexpr int kPressesAShaft = 10;
constexpr double kEveryOfShaft_mm = 0.05, kAlongShaft_mm = 0.1, kShaftDip_mm = 0.03;

int press_count() {
  const char* value = std::getenv("PALPATE_TEST_PRESSES");
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  constexpr int kDefault = 80;
#else
  constexpr int kDefault = 3'000;
#endif
  return value != nullptr ? std::atoi(value) : kDefault;
}

// random rotations of each structure, whose labels are resampled for each
int turn_count() {
  constexpr int kFew = 100'000;
  return press_count() < kFew ? 1 : 4;
}

int presses_a_turn() {
  const int turns = kKnees * kStructures * turn_count();
  return (press_count() + turns - 1) / turns;
}

/// Reference evaluation of a signed field: trilinear interpolation in double, the field's outside value
/// beyond the grid.
class Oracle {
 public:
  explicit Oracle(const SignedField& field)
      : voxels_(field.bricks().dense()),
        steps_(field.steps()),
        X_VoxelPatient_(field.geometry().X_PatientVoxel().inverse()) {}

  double distance_mm(const Point<Patient>& x) const {
    const Point<Voxel> p = X_VoxelPatient_ * x;
    const int i = below(p.x()), j = below(p.y()), k = below(p.z());
    double sum = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const int a = corner & 1, b = corner >> 1 & 1, c = corner >> 2;
      const double weight = (a ? p.x() - i : 1 - (p.x() - i)) * (b ? p.y() - j : 1 - (p.y() - j)) *
                            (c ? p.z() - k : 1 - (p.z() - k));
      sum += weight * voxels_.at_or(i + a, j + b, k + c, steps_.outside);
    }
    return steps_.offset + steps_.scale * sum;
  }

 private:
  static int below(double x) { return static_cast<int>(std::floor(x)); }

  Volume<std::int16_t> voxels_;
  SignedSteps steps_;
  Transform<Voxel, Patient> X_VoxelPatient_;
};

class Chance {
 public:
  explicit Chance(unsigned seed) : random_(seed) {}
  double between(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }
  std::size_t below(std::size_t count) {
    return std::uniform_int_distribution<std::size_t>(0, count - 1)(random_);
  }
  Vector<Patient> direction() {
    std::normal_distribution<double> normal;
    return Vector<Patient>(normal(random_), normal(random_), normal(random_)).normalized();
  }
  Eigen::Matrix3d turn() {
    std::normal_distribution<double> normal;
    return Eigen::Quaterniond(normal(random_), normal(random_), normal(random_), normal(random_))
        .normalized()
        .toRotationMatrix();
  }

 private:
  std::mt19937 random_;
};

/// The voxel centres of one label.
std::vector<Point<Patient>> places_of(const Volume<LabelId>& labels, LabelId label) {
  std::vector<Point<Patient>> positions;
  const auto X_PatientVoxel = labels.geometry().X_PatientVoxel();
  const auto& dims = labels.geometry().dims;
  for (int k = 0; k < dims[2]; ++k) {
    for (int j = 0; j < dims[1]; ++j) {
      for (int i = 0; i < dims[0]; ++i)
        if (labels.at(i, j, k) == label) positions.push_back(X_PatientVoxel * Point<Voxel>(i, j, k));
    }
  }
  return positions;
}

/// One structure by its nearest voxels, on a grid whose axes are those of `direction`.
Volume<LabelId> turned(const Volume<LabelId>& labels, LabelId label,
                       const std::vector<Point<Patient>>& positions, const Eigen::Matrix3d& direction) {
  constexpr double kMargin_mm = 3;
  Eigen::Array3d low = Eigen::Array3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (const Point<Patient>& position : positions) {
    const Eigen::Array3d along = (direction.transpose() * position.eigen()).array();
    low = low.min(along - kMargin_mm);
    high = high.max(along + kMargin_mm);
  }
  GridGeometry grid;
  for (int axis = 0; axis < 3; ++axis)
    grid.dims[static_cast<std::size_t>(axis)] =
        static_cast<int>(std::ceil((high[axis] - low[axis]) / kVoxel_mm[axis])) + 1;
  grid.spacing_mm = kVoxel_mm;
  grid.direction = direction;
  grid.origin = Point<Patient>(direction * low.matrix());
  Volume<LabelId> result(grid);
  const auto to_source = labels.geometry().X_PatientVoxel().inverse() * grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Point<Voxel> p = to_source * Point<Voxel>(i, j, k);
        const auto nearest = [](double x) { return static_cast<int>(std::lround(x)); };
        if (labels.at_or(nearest(p.x()), nearest(p.y()), nearest(p.z()), 0) == label)
          result.at(i, j, k) = label;
      }
    }
  }
  return result;
}

struct Counted {
  int presses = 0, touched = 0;
  long ticks = 0;
  double deepest_mm = -std::numeric_limits<double>::infinity();
  void add(const Counted& other) {
    presses += other.presses;
    touched += other.touched;
    ticks += other.ticks;
    deepest_mm = std::max(deepest_mm, other.deepest_mm);
  }
};

/// A press with a sphere or a shaft on one structure; the oracle checks the proxy's path.
class Press {
 public:
  Press(const ContactSurface& surface, const Oracle& oracle, const ToolPart& tool)
      : touchable_(surface), oracle_(oracle), tool_(tool) {}

  /// Presses towards `target` along a random direction with a random tilt up to a random force; about half of
  /// the presses then slide. Returns whether contact force was rendered.
  bool run(const Point<Patient>& target, Chance& chance) {
    const Vector<Patient> inward = chance.direction();
    tip_ = first_touch(target, inward) - inward * chance.between(0.5, 2);
    follow();
    max_mm_ = chance.between(0.5, kMax_N) / touchable_.stiffness_N_per_mm;
    const double speed_mm = chance.between(0.1, kMaxStep_mm);
    const Vector<Patient> lateral = inward.cross(chance.direction()).normalized();
    const Vector<Patient> push = (inward + lateral * chance.between(0, 0.6)).normalized() * speed_mm;
    double path_mm = 0;
    while (path_mm < max_mm_ + 6 && penetration_mm() < max_mm_ - 1e-6) {
      lead(push);
      path_mm += speed_mm;
    }
    if (chance.between(0, 1) < 0.5) {
      const Vector<Patient> along = inward.cross(chance.direction()).normalized() * speed_mm;
      for (double slid_mm = 0; slid_mm < 10; slid_mm += speed_mm) lead(along);
    }
    return touched_;
  }

  double deepest_mm() const { return deepest_mm_; }
  long ticks() const { return ticks_; }

 private:
  // where a straight way to the target first meets the structure
  Point<Patient> first_touch(const Point<Patient>& target, const Vector<Patient>& inward) const {
    const double far_mm = 150;
    double to_go_mm = far_mm, clearance_mm = 0;
    while ((clearance_mm = tool_clearance_mm(target - inward * to_go_mm)) > 0.01)
      to_go_mm -= std::max(0.01, clearance_mm / touchable_.surface->max_gradient());
    return target - inward * to_go_mm;
  }

  // distance of the outline of the tool from the structure, along the whole shaft
  double tool_clearance_mm(const Point<Patient>& at) const {
    const int count = static_cast<int>(tool_.axis_mm.norm() / kAlongShaft_mm);
    double min_mm = std::numeric_limits<double>::infinity();
    for (int n = 0; n <= count; ++n) {
      const double part = static_cast<double>(n) / std::max(1, count);
      min_mm = std::min(min_mm, oracle_.distance_mm(at + tool_.axis_mm * part));
    }
    return min_mm - tool_.radius_mm;
  }
  double penetration_mm() const { return (state_.position - tip_).norm(); }

  // moves the tip, limited to max_mm_ of penetration and kMaxStep_mm per tick
  void lead(const Vector<Patient>& displacement) {
    Vector<Patient> pressed = tip_ + displacement - state_.position;
    if (pressed.norm() > max_mm_) pressed = pressed * (max_mm_ / pressed.norm());
    Vector<Patient> step = state_.position + pressed - tip_;
    if (step.norm() > kMaxStep_mm) step = step * (kMaxStep_mm / step.norm());
    tip_ += step;
    follow();
  }

  void follow() {
    ProxyPath path;
    const ProxyResult result = advance_proxy({&touchable_, 1}, {&tool_, 1}, tip_, state_, {}, &path);
    ++ticks_;
    ASSERT_TRUE(state_.coupled);
    ASSERT_LT(path.count, path.vertices.size()) << "no corner is lost";
    ASSERT_EQ(path.vertices[path.count - 1], state_.position);
    touched_ = touched_ || result.force_N.norm() > 0.05;
    for (std::size_t n = 1; n < path.count; ++n) scan_along(path.vertices[n - 1], path.vertices[n]);
  }

  void scan_along(const Point<Patient>& a, const Point<Patient>& b) {
    const double every_mm = tool_.axis_mm == Vector<Patient>() ? kEvery_mm : kEveryOfShaft_mm;
    const int pieces = static_cast<int>((b - a).norm() / every_mm) + 1;
    for (int n = 0; n <= pieces; ++n)
      deepest_mm_ =
          std::max(deepest_mm_, -tool_clearance_mm(a + (b - a) * (static_cast<double>(n) / pieces)));
  }

  const ContactSurface& touchable_;
  const Oracle& oracle_;
  const ToolPart tool_;
  ProxyState state_;
  Point<Patient> tip_;
  double max_mm_ = 0;
  bool touched_ = false;
  double deepest_mm_ = -std::numeric_limits<double>::infinity();
  long ticks_ = 0;
};

struct CountedTools {
  Counted parts, shafts;
};

CountedTools press_on(const Volume<LabelId>& labels, const Segment& structure, Chance& chance,
                      Chance& shaft_chance) {
  CountedTools counted;
  const auto points = places_of(labels, structure.value);
  const TissuePreset* preset = match_preset(structure.name).preset;
  for (int turn = 0; turn < turn_count(); ++turn) {
    const auto grid = turned(labels, structure.value, points, chance.turn());
    const auto prepared = prepare_surfaces(*label_bricks(grid), {structure.value}, {});
    EXPECT_TRUE(prepared.ok());
    if (!prepared.ok() || preset == nullptr) return counted;
    ContactSurface surface;
    surface.surface = std::make_shared<const Surface>(prepared->front().surface);
    surface.stiffness_N_per_mm = preset->values.stiffness_N_per_mm;
    surface.static_friction = surface.friction = preset->values.friction;
    const Oracle oracle(surface.surface->distance_field());
    // centres of voxels lie inside
    const auto targets = places_of(grid, structure.value);
    for (int n = 0; n < presses_a_turn(); ++n) {
      Press press(surface, oracle, {{}, n % 4 == 0 ? 0 : chance.between(0, kWidest_mm)});
      const bool touched = press.run(targets[chance.below(targets.size())], chance);
      counted.parts.add({1, touched, press.ticks(), press.deepest_mm()});
    }
    for (int n = 0; n < presses_a_turn(); n += kPressesAShaft) {
      const Vector<Patient> along_mm = shaft_chance.direction() * shaft_chance.between(3, 60);
      Press press(surface, oracle, {{}, shaft_chance.between(0.3, kWidest_mm), along_mm});
      const bool touched = press.run(targets[shaft_chance.below(targets.size())], shaft_chance);
      counted.shafts.add({1, touched, press.ticks(), press.deepest_mm()});
    }
  }
  return counted;
}

void expect_no_pop_through(const std::string& name) {
  SCOPED_TRACE("seed " + std::to_string(kSeed));
  PALPATE_SHARED_FILE(file, name);
  const auto read = read_labels(file);
  ASSERT_TRUE(read.ok());
  Chance chance(kSeed), shaft_chance(kSeed + 1);
  Counted all, shafts;
  int structures = 0;
  for (const Segment& segment : read->labels.segments) {
    const auto named = [&](const char* part) { return segment.name.find(part) != std::string::npos; };
    const bool other = !kMenisciAlone && (named("cartilage") || segment.name == "patella");
    if (!named("meniscus") && !other) continue;
    SCOPED_TRACE(segment.name);
    ++structures;
    const CountedTools tools = press_on(read->labels.layers.front(), segment, chance, shaft_chance);
    const Counted& counted = tools.parts;
    std::printf("%-26s %6d presses, %6.2f %% touched, %8ld ticks, deepest %.4f mm\n", segment.name.c_str(),
                counted.presses, 100.0 * counted.touched / counted.presses, counted.ticks,
                counted.deepest_mm);
    std::fflush(stdout);
    EXPECT_LE(counted.deepest_mm, kProxySettings.max_penetration_mm);
    // with the few presses under a sanitizer a single one is several percent, so only their sum is checked
    // there
    EXPECT_TRUE(counted.touched >= 0.9 * counted.presses || counted.presses < 1000);
    all.add(counted);
    EXPECT_LE(tools.shafts.deepest_mm, kProxySettings.max_penetration_mm + kShaftDip_mm);
    shafts.add(tools.shafts);
  }
  EXPECT_EQ(structures, kStructures);
  EXPECT_GE(all.touched, 0.9 * all.presses);
  std::printf("all: %d presses, %.2f %% touched, %ld ticks, deepest %.4f mm, seed %u\n", all.presses,
              100.0 * all.touched / all.presses, all.ticks, all.deepest_mm, kSeed);
  EXPECT_GE(shafts.touched, 0.9 * shafts.presses);
  std::printf("shafts: %d presses, %.2f %% touched, %ld ticks, deepest %.4f mm\n", shafts.presses,
              100.0 * shafts.touched / shafts.presses, shafts.ticks, shafts.deepest_mm);
}

TEST(PopThrough, NoPressPassesTheHandSegmentedKnee) {
  expect_no_pop_through("knee_spl/seg.nrrd");
}

TEST(PopThrough, NoPressPassesTheObliqueKnee) {
  expect_no_pop_through("knee_dess/SAG_3D_DESS_RIGHT_bones_cart_men_fib-label.nrrd");
}

}  // namespace
}  // namespace palpate
