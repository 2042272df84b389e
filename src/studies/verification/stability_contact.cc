#include "verification/stability_contact.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "palpate/base/check.h"
#include "palpate/contact/proxy_path.h"
#include "palpate/phantoms/phantoms.h"
#include "palpate/scene/scene.h"
#include "palpate/scene/tissue_presets.h"
#include "palpate/servo/servo.h"
#include "palpate/surfaces/surfaces.h"
#include "verification/accuracy_random.h"
#include "verification/stability_buzz.h"
#include "verification/stability_turning.h"

namespace palpate {
namespace {

constexpr double kFrictionLimit_percent = 2, kDriftLimit_um = 1, kMissedLimit_percent = 10;
constexpr double kDt_s = 1e-3;
constexpr double kLowered_mm = 0.05;  // per tick
// sticking tip: the friction cone has a radius of 1.6 mm at this depth
constexpr double kStickStatic = 0.8, kStickDynamic = 0.7, kStickDepth_mm = 2;
constexpr double kTremor_mm = 0.05, kTremor_hz[] = {9.5, 8};
constexpr int kPlanesPerTremor = 4;
// alternating rotation, commanded to the tick ten times a second; moves the contact by at most 0.5 mm
constexpr double kTurn_rad = 0.03, kTurn_s = 2;
constexpr int kTicksPerTurn = 100;
constexpr double kFace_mm = 16.5;  // position of the plates' outer face
// presses
constexpr double kMax_N = 8.5, kMaxStep_mm = 0.5, kWidest_mm = 3, kEvery_mm = 0.01, kTouch_N = 0.05;

Vector<Patient> random_direction(AccuracyRandom& random) {
  return Vector<Patient>(random.direction());
}

/// A half-space with its boundary through the origin, and a point or a sphere above it.
struct Plane {
  explicit Plane(AccuracyRandom& random)
      : up(random_direction(random)), along(up.cross(random_direction(random)).normalized()) {
    // voxel size of a knee
    static constexpr double kHalf_mm = 9, kReach_mm = 6;
    GridGeometry grid;
    grid.spacing_mm = {0.277, 0.277, 1.0};
    Eigen::Vector3d centre;
    for (int axis = 0; axis < 3; ++axis) {
      centre[axis] = std::ceil(kHalf_mm / grid.spacing_mm[axis]);
      grid.dims[static_cast<std::size_t>(axis)] = 2 * static_cast<int>(centre[axis]) + 1;
    }
    grid.origin = Point<Patient>(-centre.cwiseProduct(grid.spacing_mm));

    Volume<std::int16_t> volume(grid);
    const auto in_steps = [](double distance_mm) {
      return static_cast<std::int16_t>(
          std::lround(std::clamp(distance_mm, -kReach_mm, kReach_mm) / kSurfaceStep_mm));
    };
    const auto X_PatientVoxel = grid.X_PatientVoxel();
    for (int k = 0; k < grid.dims[2]; ++k)
      for (int j = 0; j < grid.dims[1]; ++j)
        for (int i = 0; i < grid.dims[0]; ++i)
          volume.at(i, j, k) = in_steps((X_PatientVoxel * Point<Voxel>(i, j, k) - Point<Patient>()).dot(up));
    const SignedField field(volume, {kSurfaceStep_mm, 0, in_steps(kReach_mm)});
    // rounding increases the slope a little; the volume's boundary is not approached
    const double max_gradient = 1 + kSurfaceStep_mm * grid.spacing_mm.cwiseInverse().norm();
    contact.surface = std::make_shared<const Surface>(field, field, max_gradient);
    // half of all tools are points
    part.radius_mm = std::max(0.0, random.between(-1.5, 1.5));
  }

  /// Moves the tool; a negative height is below the surface.
  void lead(double height_mm, double along_mm, double across_mm = 0) {
    const Point<Patient> tip =
        Point<Patient>() + up * (part.radius_mm + height_mm) + along * along_mm + up.cross(along) * across_mm;
    force_N = advance_proxy({&contact, 1}, {&part, 1}, tip, state).force_N;
  }
  void press(double depth_mm) {
    for (double height_mm = 1; height_mm > -depth_mm; height_mm -= kLowered_mm) lead(height_mm, 0);
    lead(-depth_mm, 0);
  }
  /// Ratio of the tangential to the normal force.
  double ratio() const {
    const double normal_N = force_N.dot(up);
    return (force_N - up * normal_N).norm() / normal_N;
  }

  Vector<Patient> up, along;
  ContactSurface contact;
  ToolPart part;
  ProxyState state;
  Vector<Patient> force_N;
};

double deviation_percent(double value, double requested) {
  return 100 * std::abs(value / requested - 1);
}

Result<std::vector<Figure>> friction_figures(int planes, const Progress& progress) {
  constexpr int kStepsToSlip = 1000, kSlidden = 300;
  constexpr double kSlide_mm = 0.003;
  AccuracyRandom random(kContactSeed);
  double static_percent = 0, dynamic_percent = 0;
  for (int n = 0; n < planes; ++n) {
    if (progress.stopped()) return Progress::interrupted();
    progress.report("friction", static_cast<double>(n) / planes);
    Plane plane(random);
    const double mu_static = random.between(0.05, 1.05), mu_dynamic = mu_static * random.between(0.3, 1);
    plane.contact.static_friction = mu_static;
    plane.contact.friction = mu_dynamic;
    const double depth_mm = random.between(0.5, 2.5);
    plane.press(depth_mm);

    // pull sideways until it slips, or should have slipped long before
    const double step_mm = mu_static * depth_mm / kStepsToSlip;
    double path_mm = 0, most = 0;
    for (int step = 0; plane.state.sticking && step < 2 * kStepsToSlip; ++step) {
      most = std::max(most, plane.ratio());
      plane.lead(-depth_mm, path_mm += step_mm);
    }
    static_percent = std::max(static_percent, deviation_percent(most, mu_static));
    for (int step = 0; step < kSlidden; ++step) {
      plane.lead(-depth_mm, path_mm += kSlide_mm);
      dynamic_percent = std::max(dynamic_percent, deviation_percent(plane.ratio(), mu_dynamic));
    }
  }
  const auto n = static_cast<std::uint64_t>(planes);
  return std::vector<Figure>{
      {"stability/friction/static/worst", static_percent, "percent", n, kFrictionLimit_percent},
      {"stability/friction/dynamic/worst", dynamic_percent, "percent", n * kSlidden, kFrictionLimit_percent}};
}

// tremor: displacement of the tip along two axes; zero at time 0
std::array<double, 2> tremor_mm(double time_s) {
  return {kTremor_mm * std::sin(2 * std::numbers::pi * kTremor_hz[0] * time_s),
          kTremor_mm * std::sin(2 * std::numbers::pi * kTremor_hz[1] * time_s)};
}

/// Displacement of a proxy that should stick.
struct Drift {
  double farthest_mm = 0;
  std::uint64_t loose = 0;  ///< Ticks in which it did not stick, so that its displacement is not drift
  void add(const ProxyState& proxy, const Point<Patient>& begun) {
    farthest_mm = std::max(farthest_mm, (proxy.position - begun).norm());
    loose += !proxy.coupled || proxy.contact_count == 0 || !proxy.sticking;
  }
};

// sticking contact on a plane at rest, with a trembling tip
void tremble(AccuracyRandom& random, long ticks, Drift& drift) {
  Plane plane(random);
  plane.contact.static_friction = kStickStatic;
  plane.contact.friction = kStickDynamic;
  plane.press(kStickDepth_mm);
  const Point<Patient> begun = plane.state.position;
  for (long n = 0; n < ticks; ++n) {
    const auto [along_mm, across_mm] = tremor_mm(static_cast<double>(n) * kDt_s);
    plane.lead(-kStickDepth_mm, along_mm, across_mm);
    drift.add(plane.state, begun);
  }
}

// sticking contact on an object that rotates about an axis, with a tip that trembles in world coordinates
void turn(const Model& plates, AccuracyRandom& random, long ticks, Drift& drift) {
  Parameters parameters;
  parameters.method = ForceMethod::kProxy;
  const Eigen::Vector3d axis = random.direction();
  const Point<World> aim = plates.X_WorldPatient * Point<Patient>(kFace_mm - kStickDepth_mm, 3, 2);
  const Vector<World> outward = plates.X_WorldPatient * Vector<Patient>(1, 0, 0);
  const Vector<World> along = plates.X_WorldPatient * Vector<Patient>(0, 1, 0);
  SessionState state;
  Wrench sent;
  TickRecord record;
  const auto advance = [&](const Point<World>& tip) {
    DeviceState sensed;
    sensed.tip = tip;
    tick(plates, parameters, {&sensed, 1}, kDt_s, state, {&sent, 1}, record);
  };

  for (double above_mm = kStickDepth_mm + 1; above_mm > 0; above_mm -= kLowered_mm)
    advance(aim + outward * above_mm);
  advance(aim);
  const Point<Patient> begun = state.device[0].proxy.position;
  for (long n = 0; n < ticks; ++n) {
    const double time_s = static_cast<double>(n) * kDt_s;
    if (n % kTicksPerTurn == 0)
      parameters.rotation_target =
          Eigen::AngleAxisd(kTurn_rad * std::sin(2 * std::numbers::pi * time_s / kTurn_s), axis);
    const auto [along_mm, across_mm] = tremor_mm(time_s);
    advance(aim + along * along_mm + outward.cross(along) * across_mm);
    drift.add(state.device[0].proxy, begun);
  }
}

Result<std::vector<Figure>> drift_figures(const ContactEffort& effort, const Progress& progress) {
  const auto plates = two_plates(1, PreparationMethod::kUnionGaussian, progress);
  if (!plates) return plates.error();
  Model sticky = **plates;
  for (ContactSurface& surface : sticky.surfaces) {
    surface.static_friction = kStickStatic;
    surface.friction = kStickDynamic;
  }

  AccuracyRandom random(kContactSeed);
  const long ticks = std::lround(effort.sticking_s / kDt_s);
  std::vector<Figure> lengths, counts;
  const auto add = [&](const char* what, int times, auto&& stick) -> Result<void> {
    Drift drift;
    for (int n = 0; n < times; ++n) {
      if (progress.stopped()) return Progress::interrupted();
      progress.report(std::string("sticking: ") + what, static_cast<double>(n) / times);
      stick(drift);
    }
    const std::string path = std::string("stability/drift/") + what;
    const auto n = static_cast<std::uint64_t>(times) * static_cast<std::uint64_t>(ticks);
    lengths.push_back({path + "/farthest", 1e3 * drift.farthest_mm, "um", n, kDriftLimit_um});
    counts.push_back({path + "/loose", static_cast<double>(drift.loose), "ticks", n, 0});
    return {};
  };
  const int planes = (effort.planes + kPlanesPerTremor - 1) / kPlanesPerTremor;
  const auto trembling = add("trembling", planes, [&](Drift& drift) { tremble(random, ticks, drift); });
  if (!trembling) return trembling.error();
  const auto turning =
      add("turning", effort.turns, [&](Drift& drift) { turn(sticky, random, ticks, drift); });
  if (!turning) return turning.error();
  lengths.insert(lengths.end(), counts.begin(), counts.end());
  return lengths;
}

/// Independent interpolation of the distance field, in double.
class DistanceOracle {
 public:
  explicit DistanceOracle(const SignedField& field)
      : voxels_(field.bricks().dense()),
        steps_(field.steps()),
        X_VoxelPatient_(field.geometry().X_PatientVoxel().inverse()) {}

  double distance_mm(const Point<Patient>& x) const {
    const Eigen::Vector3d p = (X_VoxelPatient_ * x).eigen();
    const Eigen::Vector3d low = p.array().floor(), part = p - low;
    const Eigen::Vector3i first = low.cast<int>();
    const auto row = [&](int j, int k) {
      const auto voxel = [&](int i) {
        return static_cast<double>(
            voxels_.at_or(first.x() + i, first.y() + j, first.z() + k, steps_.outside));
      };
      return std::lerp(voxel(0), voxel(1), part.x());
    };
    const auto slice = [&](int k) { return std::lerp(row(0, k), row(1, k), part.y()); };
    return steps_.offset + steps_.scale * std::lerp(slice(0), slice(1), part.z());
  }

 private:
  Volume<std::int16_t> voxels_;
  SignedSteps steps_;
  Transform<Voxel, Patient> X_VoxelPatient_;
};

struct Pressed {
  bool touched = false;
  /// Maximum over its whole path; negative: above the surface
  double deepest_mm = -std::numeric_limits<double>::infinity();
};

/// Presses from the free point nearest to `target`, which is inside the structure, along a random line:
/// oblique to the surface and then sideways, limited to a random force and to kMaxStep_mm per tick.
Pressed press(const ContactSurface& surface, const DistanceOracle& oracle, const Point<Patient>& target,
              AccuracyRandom& random) {
  constexpr double kBefore_mm = 0.5, kMaxMisaligned = 0.6, kFurther_mm = 6;
  const ToolPart tool{{}, std::max(0.0, random.between(-1, kWidest_mm))};
  const auto clearance_mm = [&](const Point<Patient>& at) { return oracle.distance_mm(at) - tool.radius_mm; };
  const Vector<Patient> inward = random_direction(random);
  const Vector<Patient> lateral = inward.cross(random_direction(random)).normalized();
  const double max_mm = random.between(0.5, kMax_N) / surface.stiffness_N_per_mm;
  const double speed_mm = random.between(0.1, kMaxStep_mm);
  const Vector<Patient> askew = (inward + lateral * random.between(0, kMaxMisaligned)).normalized();
  Point<Patient> tip = target;
  while (clearance_mm(tip) < kBefore_mm) tip = tip - inward * kBefore_mm;

  Pressed pressed;
  ProxyState state;
  const auto follow = [&] {
    ProxyPath path;
    const ProxyResult result = advance_proxy({&surface, 1}, {&tool, 1}, tip, state, {}, &path);
    PALPATE_CHECK(path.count < path.vertices.size());
    pressed.touched = pressed.touched || result.force_N.norm() > kTouch_N;
    for (std::size_t corner = 1; corner < path.count; ++corner) {
      const Vector<Patient> leg = path.vertices[corner] - path.vertices[corner - 1];
      const int pieces = static_cast<int>(leg.norm() / kEvery_mm) + 1;
      for (int n = 0; n <= pieces; ++n)
        pressed.deepest_mm =
            std::max(pressed.deepest_mm,
                     -clearance_mm(path.vertices[corner - 1] + leg * (static_cast<double>(n) / pieces)));
    }
  };
  const auto lead = [&](const Vector<Patient>& direction, double path_mm) {
    for (double advanced_mm = 0; advanced_mm < path_mm; advanced_mm += speed_mm) {
      const Vector<Patient> pull = tip + direction * speed_mm - state.position;
      tip = state.position + pull * std::min(1.0, max_mm / pull.norm());
      follow();
    }
  };
  follow();
  lead(askew, max_mm + kFurther_mm);
  lead(lateral, kFurther_mm);
  return pressed;
}

// "medial meniscus" has to be one part of a figure's name
std::string part_of_name(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == ' ' || c == '_' || c == '/'; }, '-');
  return text;
}

bool is_pressed_on(const Segment& segment) {
  const auto named = [&](const char* part) { return segment.name.find(part) != std::string::npos; };
  return named("cartilage") || named("meniscus") || segment.name == "patella";
}

std::vector<Point<Patient>> centres_of(const Volume<LabelId>& labels, LabelId label) {
  std::vector<Point<Patient>> centres;
  const auto& dims = labels.geometry().dims;
  const auto X_PatientVoxel = labels.geometry().X_PatientVoxel();
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i)
        if (labels.at(i, j, k) == label) centres.push_back(X_PatientVoxel * Point<Voxel>(i, j, k));
  return centres;
}

Result<std::vector<Figure>> pop_through_figures(const ContactEffort& effort, const Progress& progress) {
  const auto knee = make_knee_phantom(effort.voxel_mm, 1, progress);
  if (!knee) return knee.error();
  const Volume<LabelId>& labels = knee->labels.layers.front();
  std::vector<LabelId> structures;
  std::vector<std::string> names;
  for (const Segment& segment : knee->labels.segments) {
    if (!is_pressed_on(segment)) continue;
    structures.push_back(segment.value);
    names.push_back(segment.name);
  }
  const auto prepared = prepare_surfaces(*label_bricks(labels), structures, {}, progress);
  if (!prepared) return prepared.error();

  // grouped by unit, as required by the table
  std::vector<Figure> depths, parts;
  const int count = static_cast<int>(structures.size()), presses = (effort.presses + count - 1) / count;
  AccuracyRandom random(kContactSeed);
  for (std::size_t s = 0; s < structures.size(); ++s) {
    progress.report("pressing on the " + names[s], static_cast<double>(s) / count);
    const TissuePreset* preset = match_preset(names[s]).preset;
    PALPATE_CHECK(preset != nullptr);
    ContactSurface surface;
    surface.surface = std::make_shared<const Surface>((*prepared)[s].surface);
    surface.stiffness_N_per_mm = preset->values.stiffness_N_per_mm;
    surface.set_friction(preset->values.friction);
    const DistanceOracle oracle(surface.surface->distance_field());
    const auto targets = centres_of(labels, structures[s]);
    Pressed all;
    int missed = 0;
    for (int n = 0; n < presses; ++n) {
      if (progress.stopped()) return Progress::interrupted();
      const auto at = static_cast<std::size_t>(random.between(0, static_cast<double>(targets.size())));
      const Pressed pressed = press(surface, oracle, targets[at], random);
      missed += !pressed.touched;
      all.deepest_mm = std::max(all.deepest_mm, pressed.deepest_mm);
    }
    const std::string path = "stability/pop-through/" + part_of_name(names[s]);
    const auto n = static_cast<std::uint64_t>(presses);
    depths.push_back({path + "/deepest", all.deepest_mm, "mm", n, kProxySettings.max_penetration_mm});
    parts.push_back({path + "/missed", 100.0 * missed / presses, "percent", n, kMissedLimit_percent});
  }
  depths.insert(depths.end(), parts.begin(), parts.end());
  return depths;
}

}  // namespace

Result<std::vector<Figure>> contact_figures(const Progress& progress, const ContactEffort& effort) {
  auto figures = friction_figures(effort.planes, progress);
  if (!figures) return figures;
  const auto drift = drift_figures(effort, progress);
  if (!drift) return drift;
  figures->insert(figures->end(), drift->begin(), drift->end());
  const auto pop_through = pop_through_figures(effort, progress);
  if (!pop_through) return pop_through;
  figures->insert(figures->end(), pop_through->begin(), pop_through->end());
  const auto turning = turning_figures(effort.levers, progress);
  if (!turning) return turning;
  figures->insert(figures->end(), turning->begin(), turning->end());
  return figures;
}

}  // namespace palpate
