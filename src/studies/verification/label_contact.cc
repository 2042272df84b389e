#include "verification/label_contact.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "palpate/contact/model.h"
#include "palpate/loading/loading.h"
#include "palpate/surfaces/surfaces.h"
#include "verification/accuracy_random.h"
#include "verification/figure_names.h"

namespace palpate {
namespace {

constexpr double kTick_mm = 0.02;  // 20 mm/s at 1 kHz
constexpr double kDeep_mm = 1;     // 1 N at 1 N/mm

struct NamedGrid {
  const char* name;
  Eigen::Vector3d spacing_mm;
};
const NamedGrid kGrids[] = {{"0.36x0.36x0.7", {0.36, 0.36, 0.7}},
                            {"0.28x0.28x1.0", {0.28, 0.28, 1.0}},
                            {"0.625x0.625x0.9", {0.625, 0.625, 0.9}}};
constexpr double kRadii_mm[] = {0, 0.5, 1.5, 3};

// label map by position, in a box around the origin
Volume<LabelId> labelled(const Eigen::Vector3d& size_mm, const Eigen::Vector3d& spacing_mm,
                         const std::function<LabelId(const Eigen::Vector3d&)>& label_at) {
  GridGeometry grid;
  grid.spacing_mm = spacing_mm;
  for (int axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<std::size_t>(axis);
    grid.dims[a] = static_cast<int>(std::ceil(size_mm[axis] / spacing_mm[axis])) | 1;
    grid.origin[axis] = -0.5 * (grid.dims[a] - 1) * spacing_mm[axis];
  }
  Volume<LabelId> labels(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i)
        labels.at(i, j, k) = label_at((X_PatientVoxel * Point<Voxel>(i, j, k)).eigen());
  return labels;
}

// contact surfaces of labels 1, 2, ..., prepared as for a scene
Result<std::vector<ContactSurface>> surfaces_of(const Volume<LabelId>& labels,
                                                const std::vector<double>& stiffness_N_per_mm) {
  auto model = std::make_shared<Model>();
  model->labels = label_bricks(labels);
  model->tissue_of_label.resize(stiffness_N_per_mm.size() + 1, -1);
  for (std::size_t n = 0; n < stiffness_N_per_mm.size(); ++n) {
    Tissue tissue;
    tissue.stiffness_N_per_mm = stiffness_N_per_mm[n];
    tissue.set_friction(0);
    model->tissues.push_back(tissue);
    model->tissue_of_label[n + 1] = static_cast<std::int16_t>(n);
  }
  const std::array methods{ForceMethod::kProxy};
  const auto ready = prepared_with_cache(std::move(model), methods);
  if (!ready) return ready.error();
  return (*ready)->surfaces;
}

/// A tip that is moved along a path without friction.
class FrictionlessTip {
 public:
  FrictionlessTip(const std::vector<ContactSurface>& surfaces, double radius_mm)
      : surfaces_(surfaces), part_{{}, radius_mm} {}

  const ProxyResult& at(const Eigen::Vector3d& tip, double dt_s = 1e-3) {
    result_ =
        advance_proxy(surfaces_, {&part_, 1}, Point<Patient>(tip), state_, {.friction = false, .dt_s = dt_s});
    return result_;
  }
  const ProxyResult& to(const Eigen::Vector3d& from, const Eigen::Vector3d& end) {
    const int ticks = static_cast<int>(std::ceil((end - from).norm() / kTick_mm));
    for (int n = 1; n <= ticks; ++n) at(from + (end - from) * (static_cast<double>(n) / ticks));
    return result_;
  }
  Eigen::Vector3d proxy() const { return state_.position.eigen(); }

 private:
  const std::vector<ContactSurface>& surfaces_;
  const ToolPart part_;
  ProxyState state_;
  ProxyResult result_;
};

double peak_to_peak(const std::vector<double>& values) {
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  return *high - *low;
}

double p99_of(std::vector<double> values) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// ---- terraces

struct Terrace {
  double ripple_percent = 0, direction_deg = 0, sinking_mm = 0, drag_percent = 0;
  void add(const Terrace& other) {
    ripple_percent = std::max(ripple_percent, other.ripple_percent);
    direction_deg = std::max(direction_deg, other.direction_deg);
    sinking_mm = std::max(sinking_mm, other.sinking_mm);
    drag_percent = std::max(drag_percent, other.drag_percent);
  }
};

/// A half-space with a surface oblique to the slices.
struct TiltedPlane {
  std::vector<ContactSurface> surfaces;
  Eigen::Vector3d up, along, middle;  ///< `along`: direction of steepest ascent
};

Result<TiltedPlane> tilted_plane(const Eigen::Vector3d& spacing_mm, double tilt_deg, AccuracyRandom& random) {
  const double tilt = tilt_deg * std::numbers::pi / 180, heading = random.between(0, 2 * std::numbers::pi);
  const Eigen::Vector3d level(std::cos(heading), std::sin(heading), 0);
  TiltedPlane plane;
  plane.up = std::sin(tilt) * level + std::cos(tilt) * Eigen::Vector3d::UnitZ();
  plane.along = (level - level.dot(plane.up) * plane.up).normalized();
  for (int axis = 0; axis < 3; ++axis) plane.middle[axis] = random.between(-0.5, 0.5) * spacing_mm[axis];
  const Eigen::Vector3d size_mm(34, 34, 14 + 22 * std::min(2.0, std::tan(tilt)));
  auto surfaces = surfaces_of(labelled(size_mm, spacing_mm,
                                       [&](const Eigen::Vector3d& p) {
                                         return static_cast<LabelId>((p - plane.middle).dot(plane.up) < 0);
                                       }),
                              {1});
  if (!surfaces) return surfaces.error();
  plane.surfaces = *std::move(surfaces);
  return plane;
}

// 16 mm in the direction of steepest ascent, at a depth of 1 mm
Terrace terrace(const TiltedPlane& plane, double radius_mm) {
  FrictionlessTip tool(plane.surfaces, radius_mm);
  constexpr double kHalfPath_mm = 8, kBefore_mm = 1;
  const Eigen::Vector3d begin =
      plane.middle + plane.up * (radius_mm - kDeep_mm) - plane.along * (kHalfPath_mm + kBefore_mm);
  tool.at(begin + plane.up * 3);
  tool.to(begin + plane.up * 3, begin);
  tool.to(begin, begin + plane.along * kBefore_mm);
  std::vector<double> force_N, angle_deg;
  double away_mm = 0, drag_N = 0;
  for (double distance_mm = kBefore_mm; distance_mm < kBefore_mm + 2 * kHalfPath_mm;
       distance_mm += kTick_mm) {
    const Eigen::Vector3d force = tool.at(begin + plane.along * distance_mm).force_N.eigen();
    force_N.push_back(force.norm());
    angle_deg.push_back(std::atan2(force.cross(plane.up).norm(), force.dot(plane.up)) * 180 /
                        std::numbers::pi);
    away_mm += (tool.proxy() - plane.middle).dot(plane.up) - radius_mm;
    drag_N -= force.dot(plane.along);
  }
  const auto n = static_cast<double>(force_N.size());
  return {100 * peak_to_peak(force_N) / kDeep_mm, p99_of(angle_deg), std::abs(away_mm / n),
          100 * std::abs(drag_N / n) / kDeep_mm};
}

struct TerraceLimits {
  double ripple_percent = 8, direction_deg = 2;
  std::optional<double> drag_percent = 1;
};

// required limits; at 2 degrees a step between two slices is 20 to 30 mm long
TerraceLimits limits_of(double tilt_deg, const NamedGrid& grid) {
  const bool coarse = grid.spacing_mm.x() > 0.6;
  if (tilt_deg < 5) return {35, 2.5, std::nullopt};
  if (coarse && tilt_deg >= 20 && tilt_deg <= 35) return {15};
  return {};
}

Result<void> add_terraces(const LabelContactEffort& effort, const Progress& progress,
                          std::vector<Figure>& figures) {
  AccuracyRandom random(kLabelContactSeed);
  constexpr double kTilts_deg[] = {2, 5, 10, 20, 35, 60};
  const auto n = static_cast<std::uint64_t>(effort.offsets) * std::size(kRadii_mm);
  // by quantity
  std::array<std::vector<Figure>, 4> found;
  double done = 0;
  for (const NamedGrid& grid : kGrids)
    for (const double tilt_deg : kTilts_deg) {
      progress.report("contact: planes tilted to the slices",
                      done++ / static_cast<double>(std::size(kGrids) * std::size(kTilts_deg)));
      Terrace worst;
      for (int offset = 0; offset < effort.offsets; ++offset) {
        if (progress.stopped()) return Progress::interrupted();
        const auto plane = tilted_plane(grid.spacing_mm, tilt_deg, random);
        if (!plane) return plane.error();
        for (const double radius_mm : kRadii_mm) worst.add(terrace(*plane, radius_mm));
      }
      const std::string suffix = "/" + std::string(grid.name) + "/" + short_number(tilt_deg) + "deg";
      const TerraceLimits limits = limits_of(tilt_deg, grid);
      const std::string path = "contact/terraces/";
      found[0].push_back(
          {path + "ripple" + suffix, worst.ripple_percent, "percent", n, limits.ripple_percent});
      found[1].push_back({path + "direction" + suffix, worst.direction_deg, "deg", n, limits.direction_deg});
      found[2].push_back({path + "sink" + suffix, worst.sinking_mm, "mm", n, 0.1});
      found[3].push_back({path + "drag" + suffix, worst.drag_percent, "percent", n, limits.drag_percent});
    }
  for (const std::vector<Figure>& quantity : found)
    figures.insert(figures.end(), quantity.begin(), quantity.end());
  return {};
}

// ---- seams

// slides at a depth of 1 mm across the seam of two labels with a common flat top, and along it
Result<void> add_seams(const Progress& progress, std::vector<Figure>& figures) {
  // by quantity
  std::array<std::vector<Figure>, 3> found;
  for (const NamedGrid& grid : kGrids) {
    double drag_N = 0, jump_N = 0, rise_mm = 0;
    std::uint64_t n = 0;
    for (const double turned_deg : {0.0, 25.0, 60.0}) {
      if (progress.stopped()) return Progress::interrupted();
      const double turned = turned_deg * std::numbers::pi / 180;
      const auto surfaces =
          surfaces_of(labelled({26, 26, 20}, grid.spacing_mm,
                               [&](const Eigen::Vector3d& p) {
                                 if (p.z() > 0) return LabelId{0};
                                 return static_cast<LabelId>(
                                     p.x() * std::cos(turned) + p.y() * std::sin(turned) < 0 ? 1 : 2);
                               }),
                      {1, 1});
      if (!surfaces) return surfaces.error();
      // the voxel boundary is midway between the last centre below 0 and the first above
      const double top_mm = 0.5 * grid.spacing_mm.z();
      for (const double radius_mm : kRadii_mm)
        for (const double heading : {0.0, 0.7, 1.4}) {
          FrictionlessTip tool(*surfaces, radius_mm);
          const Eigen::Vector3d along(std::cos(heading), std::sin(heading), 0);
          const Eigen::Vector3d begin = -4 * along + Eigen::Vector3d(0, 0, top_mm + radius_mm - kDeep_mm);
          tool.at(begin + Eigen::Vector3d(0, 0, 3));
          Vector<Patient> before_N = tool.to(begin + Eigen::Vector3d(0, 0, 3), begin).force_N;
          std::vector<double> height_mm;
          for (double distance_mm = 0; distance_mm < 8; distance_mm += kTick_mm, ++n) {
            const Vector<Patient> force_N = tool.at(begin + along * distance_mm).force_N;
            drag_N = std::max(drag_N, std::hypot(force_N.x(), force_N.y()));
            jump_N = std::max(jump_N, (force_N - before_N).norm() - kTick_mm);
            height_mm.push_back(tool.proxy().z());
            before_N = force_N;
          }
          rise_mm = std::max(rise_mm, peak_to_peak(height_mm));
        }
    }
    const std::string path = "contact/seams/", suffix = "/" + std::string(grid.name);
    found[0].push_back({path + "drag" + suffix, drag_N, "N", n, 0.05});
    found[1].push_back({path + "jump" + suffix, jump_N, "N", n, 0.02});
    found[2].push_back({path + "rise" + suffix, rise_mm, "mm", n, 0.1});
  }
  for (const std::vector<Figure>& quantity : found)
    figures.insert(figures.end(), quantity.begin(), quantity.end());
  return {};
}

// ---- layers beneath

struct SoftLayer {
  const char* name;
  double soft_N_per_mm, thick_mm;
};

// presses into soft tissue on bone of 1.5 N/mm, from above, 5 mm into the bone
Result<void> add_layers(const Progress& progress, std::vector<Figure>& figures) {
  constexpr double kBone_N_per_mm = 1.5, kIntoBone_mm = 5;
  for (const SoftLayer& soft : {SoftLayer{"fat-10mm", 0.036, 10}, SoftLayer{"meniscus-4mm", 0.25, 4},
                                SoftLayer{"cartilage-2mm", 0.9, 2}}) {
    if (progress.stopped()) return Progress::interrupted();
    double error_percent = 0, share_error_percent = 0;
    std::uint64_t n = 0;
    // grid on which both interfaces are midway between slice centres
    const Eigen::Vector3d spacing_mm(0.36, 0.36, 0.5);
    const auto surfaces = surfaces_of(labelled({26, 26, 2 * (soft.thick_mm + 12)}, spacing_mm,
                                               [&](const Eigen::Vector3d& p) {
                                                 const double deep_mm = -(p.z() - 0.25);
                                                 if (deep_mm < 0) return LabelId{0};
                                                 return static_cast<LabelId>(deep_mm < soft.thick_mm ? 1 : 2);
                                               }),
                                      {soft.soft_N_per_mm, kBone_N_per_mm});
    if (!surfaces) return surfaces.error();
    for (const double radius_mm : {0.0, 1.5}) {
      FrictionlessTip tool(*surfaces, radius_mm);
      tool.at({0, 0, 5});
      for (double deep_mm = -3; deep_mm < soft.thick_mm + kIntoBone_mm; deep_mm += 0.05) {
        const ProxyResult& result = tool.at({0, 0, 0.25 + radius_mm - deep_mm});
        // near an interface its error of 0.05 mm times the stiffness is a large fraction of a small force
        if (deep_mm < 1 || std::abs(deep_mm - soft.thick_mm) < 0.5) continue;
        const double in_soft_mm = std::min(deep_mm, soft.thick_mm), in_bone_mm = deep_mm - in_soft_mm;
        const double soft_N = soft.soft_N_per_mm * in_soft_mm, bone_N = kBone_N_per_mm * in_bone_mm;
        error_percent =
            std::max(error_percent, 100 * std::abs(result.force_N.norm() / (soft_N + bone_N) - 1));
        // surface 0 is label 1
        double reported = 0;
        for (int part = 0; part < result.path_segments; ++part)
          if (result.path[static_cast<std::size_t>(part)].structure == 0)
            reported = result.path[static_cast<std::size_t>(part)].fraction;
        share_error_percent =
            std::max(share_error_percent, 100 * std::abs(reported - soft_N / (soft_N + bone_N)));
        ++n;
      }
    }
    const std::string path = "contact/layers/" + std::string(soft.name);
    figures.push_back({path + "/force-off", error_percent, "percent", n, 10});
    figures.push_back({path + "/share-off", share_error_percent, "percent", n, 10});
  }
  return {};
}

// ---- sheets

Result<void> add_sheets(const LabelContactEffort& effort, const Progress& progress,
                        std::vector<Figure>& figures) {
  for (const int voxels : {1, 2}) {
    AccuracyRandom random(kLabelContactSeed);
    label_contact::SheetPresses all;
    for (int n = 0; n < effort.sheets; ++n) {
      if (progress.stopped()) return Progress::interrupted();
      progress.report("contact: thin sheets", static_cast<double>(n) / effort.sheets);
      const auto one = label_contact::press_sheet(
          label_contact::sheet(kGrids[static_cast<std::size_t>(n) % std::size(kGrids)].spacing_mm,
                               random.direction(), voxels, label_contact::Joined::kByFaces),
          effort.presses, kLabelContactSeed + static_cast<std::uint64_t>(n));
      if (!one) return one.error();
      all.presses += one->presses;
      all.detected += one->detected;
      all.through += one->through;
    }
    const std::string path = "contact/sheets/" + short_number(voxels) + "-voxel/";
    const auto n = static_cast<std::uint64_t>(all.presses);
    figures.push_back({path + "through", static_cast<double>(all.through), "presses", n, 0});
    figures.push_back({path + "not-felt", static_cast<double>(all.presses - all.detected), "presses", n, 0});
  }
  return {};
}

}  // namespace

namespace label_contact {

Sheet sheet(const Eigen::Vector3d& spacing_mm, const Eigen::Vector3d& up, int voxels, Joined joined) {
  constexpr double kWide_mm = 20;
  const Eigen::Vector3d steps_mm = up.cwiseAbs().cwiseProduct(spacing_mm);
  const double thick_mm = (joined == Joined::kByFaces ? steps_mm.sum() : steps_mm.maxCoeff()) +
                          (voxels - 1) * steps_mm.maxCoeff();
  return {labelled({kWide_mm, kWide_mm, kWide_mm}, spacing_mm,
                   [&](const Eigen::Vector3d& p) {
                     const double above_mm = up.dot(p);
                     return static_cast<LabelId>(above_mm >= 0 && above_mm < thick_mm);
                   }),
          up, thick_mm};
}

Result<SheetPresses> press_sheet(const Sheet& sheet, int presses, std::uint64_t seed) {
  const auto surfaces = surfaces_of(sheet.labels, {1});
  if (!surfaces) return surfaces.error();
  AccuracyRandom random(seed);
  const Eigen::Vector3d right = sheet.up.unitOrthogonal(), ahead = sheet.up.cross(right);
  SheetPresses counted;
  for (int n = 0; n < presses; ++n) {
    const Eigen::Vector3d askew =
        right * random.between(-0.35, 0.35) + ahead * random.between(-0.35, 0.35) - sheet.up;
    const Eigen::Vector3d velocity_mm_per_ms = askew.normalized() * random.between(0.1, 0.5);
    const int timing = static_cast<int>(random.between(0, 3));
    Eigen::Vector3d tip =
        right * random.between(-2, 2) + ahead * random.between(-2, 2) + sheet.up * (sheet.thick_mm + 1.5);
    FrictionlessTip tool(*surfaces, 0);
    bool detected = false, through = false;
    while (!through && sheet.up.dot(tip) > -4) {
      const double dt_ms = timing == 0 ? 1 : timing == 1 ? 4 : random.between(0.5, 1.5);
      detected = tool.at(tip, 1e-3 * dt_ms).force_N.norm() > 0.05 || detected;
      through = sheet.up.dot(tool.proxy()) < -1;
      tip += velocity_mm_per_ms * dt_ms;
    }
    ++counted.presses;
    counted.detected += detected;
    counted.through += through;
  }
  return counted;
}

}  // namespace label_contact

Result<std::vector<Figure>> label_contact_figures(const Progress& progress,
                                                  const LabelContactEffort& effort) {
  std::vector<Figure> figures;
  if (auto done = add_terraces(effort, progress, figures); !done) return done.error();
  if (auto done = add_seams(progress, figures); !done) return done.error();
  if (auto done = add_layers(progress, figures); !done) return done.error();
  if (auto done = add_sheets(effort, progress, figures); !done) return done.error();
  return figures;
}

Result<SuiteReport> run_label_contact(const Progress& progress) {
  auto figures = label_contact_figures(progress);
  if (!figures) return figures.error();
  SuiteReport report;
  report.figures = *std::move(figures);
  report.notes = {
      {"contact",
       "proxy without friction, on surfaces prepared from labels as for a scene, at 20 mm/s; 1 N at "
       "1 N/mm on planes and seams"},
      {"random", "seed " + std::to_string(kLabelContactSeed)}};
  return report;
}

}  // namespace palpate
