#include "verification/removal_volumes.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "palpate/tissue/removal.h"
#include "palpate/tissue/removed_volume.h"
#include "palpate/volume/volume.h"
#include "verification/accuracy_random.h"
#include "verification/removal_block.h"

/// Geometric volumes of heads that move through the half-space z < 0. All paths start above it, and no head
/// is wider further down, so that the entry removes nothing more.
namespace palpate {
namespace {

constexpr double kPi = std::numbers::pi;

/// A head, with the parameters of a burr.
struct CutterHead {
  double tip_mm, end_mm, row_mm;  // radii, and distance between the centres of both ends
  Vector<Patient> spindle;
};

/// A path of the tip and the volume removed by it.
struct CutterPath {
  const char* name;
  CutterHead head;
  std::vector<Point<Patient>> corners;
  double expected_mm3;
  double max_error_percent;              // limit of the error of the carved surface
  double max_counted_error_percent = 1;  // limit of the error of RemovedVolume
};

// ball with its centre moving in the surface: half of its swept volume
double half_slot_mm3(double radius_mm, double path_mm) {
  return kPi * radius_mm * radius_mm / 2 * path_mm + 2.0 / 3 * kPi * std::pow(radius_mm, 3);
}

// area of a circular segment beyond a chord at a distance from the centre
double segment_mm2(double radius_mm, double chord_mm) {
  return radius_mm * radius_mm * std::acos(chord_mm / radius_mm) -
         chord_mm * std::sqrt(radius_mm * radius_mm - chord_mm * chord_mm);
}

// Simpson's rule
template <class F>
double integral(double from, double to, const F& f) {
  constexpr int kSteps = 400;
  const double step = (to - from) / kSteps;
  double sum = f(from) + f(to);
  for (int n = 1; n < kSteps; ++n) sum += f(from + step * n) * (n % 2 == 1 ? 4 : 2);
  return sum * step / 3;
}

// parallel passes of a ball with its centre at a height above the surface
double passes_mm3(double radius_mm, double above_mm, double path_mm, int passes, double separation_mm) {
  // cross-section of adjacent passes: their lower envelope
  const double cap_mm3 = kPi * std::pow(radius_mm - above_mm, 2) * (2 * radius_mm + above_mm) / 3;
  const double gap_mm2 = integral(-separation_mm / 2, separation_mm / 2, [&](double y) {
    return std::sqrt(radius_mm * radius_mm - y * y) - above_mm;
  });
  const double gap_mm3 = integral(-separation_mm / 2, separation_mm / 2, [&](double y) {
    return segment_mm2(std::sqrt(radius_mm * radius_mm - y * y), above_mm);
  });
  return path_mm * (segment_mm2(radius_mm, above_mm) + (passes - 1) * gap_mm2) + cap_mm3 +
         (passes - 1) * gap_mm3;
}

// An upright head with the centre of its tip at a depth, then moved sideways: the section at each height is a
// disc or its sweep. Up to the tangent circle of ball and cone it is the ball's, above it the cone's.
double upright_mm3(const CutterHead& head, double deep_mm, double path_mm) {
  const double slope = (head.end_mm - head.tip_mm) / head.row_mm, cosine = std::sqrt(1 - slope * slope);
  const double touches_mm = -slope * head.tip_mm;
  const auto slice_mm2 = [&](double radius_mm) {
    return kPi * radius_mm * radius_mm + 2 * radius_mm * path_mm;
  };
  // integrated over the polar angle, in which the integrand is smooth at the bottom
  const double ball_mm3 = integral(0, std::acos(slope), [&](double angle) {
    return slice_mm2(head.tip_mm * std::sin(angle)) * head.tip_mm * std::sin(angle);
  });
  return ball_mm3 + integral(touches_mm, deep_mm, [&](double height_mm) {
           return slice_mm2(head.tip_mm * cosine + (height_mm - touches_mm) * slope / cosine);
         });
}

std::vector<CutterPath> cutter_paths() {
  const Vector<Patient> up(0, 0, 1), along(1, 0, 0), across(0, 1, 0);
  const CutterHead ball{2, 0, 0, along};
  const CutterHead axial{1.5, 1.5, 5, along}, transverse{1.5, 1.5, 5, across}, standing{1.5, 1.5, 5, up};
  const CutterHead cone{0.9, 1.75, 5, up};
  constexpr double kDistance_mm = 5, kDrilled_mm = 3, kMilled_mm = 2, kAbove_mm = 0.5, kSeparation_mm = 0.5;
  constexpr int kPasses = 5;
  const auto groove = [&](double y_mm, double z_mm) {
    return std::vector<Point<Patient>>{
        {-kDistance_mm / 2, y_mm, 2.2}, {-kDistance_mm / 2, y_mm, z_mm}, {kDistance_mm / 2, y_mm, z_mm}};
  };
  const std::vector<Point<Patient>> hole{{0, 0, 2.2}, {0, 0, -kDrilled_mm}};
  std::vector<Point<Patient>> plane;
  for (int n = 0; n < kPasses; ++n) {
    const auto pass = groove((n - (kPasses - 1) / 2.0) * kSeparation_mm, kAbove_mm);
    plane.insert(plane.end(), pass.begin(), pass.end());
    plane.push_back(pass.back() + up * 2);
  }
  // a head perpendicular to its path, offset from its centre
  const auto beside = [](std::vector<Point<Patient>> corners, const Vector<Patient>& by) {
    for (Point<Patient>& corner : corners) corner += by;
    return corners;
  };
  const double r = axial.tip_mm, row = axial.row_mm;
  return {{"ball/groove", ball, groove(0, 0), half_slot_mm3(ball.tip_mm, kDistance_mm), 2},
          {"ball/plane", ball, plane,
           passes_mm3(ball.tip_mm, kAbove_mm, kDistance_mm, kPasses, kSeparation_mm), 1},
          {"cylinder/across", transverse, beside(groove(0, 0), across * (-row / 2)),
           row * (kPi * r * r / 2 + kDistance_mm * r) + half_slot_mm3(r, kDistance_mm), 2},
          {"cylinder/along", axial, beside(groove(0, 0), along * (-row / 2)),
           half_slot_mm3(r, kDistance_mm + row), 3},
          {"cylinder/drilling", standing, hole, upright_mm3(standing, kDrilled_mm, 0), 4.5},
          {"cylinder/by-its-side", standing, groove(0, -kMilled_mm),
           upright_mm3(standing, kMilled_mm, kDistance_mm), 2.5},
          {"cone/drilling", cone, hole, upright_mm3(cone, kDrilled_mm, 0), 5.5, 2},
          {"cone/by-its-side", cone, groove(0, -kMilled_mm), upright_mm3(cone, kMilled_mm, kDistance_mm), 2}};
}

struct ExactBlock {
  std::shared_ptr<const Surface> surface;
  Model model;  // model with the labels
};

// A block below z = 0 with exact distances. The surface of a labelled block is rounded at its edges, and its
// sides are displaced by up to half a voxel.
ExactBlock exact_block(const BlockGrid& on) {
  constexpr double kHalf_mm = 8, kBlockDeep_mm = 9, kReach_mm = 4, kStep_mm = 1.0 / 2048, kSteepest = 1.05;
  const int half = static_cast<int>(std::ceil(std::hypot(kHalf_mm, kHalf_mm, kBlockDeep_mm) / on.voxel_mm));
  GridGeometry grid;
  grid.dims = {2 * half, 2 * half, 2 * half};
  grid.spacing_mm = Eigen::Vector3d::Constant(on.voxel_mm);
  grid.direction = Eigen::AngleAxisd(on.turned_rad, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  const Eigen::Vector3d first = Eigen::Vector3d::Constant((0.5 - half) * on.voxel_mm);
  grid.origin = Point<Patient>(Eigen::Vector3d(grid.direction * first));
  Volume<std::int16_t> distances(grid);
  Volume<LabelId> labels(grid);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const Eigen::Vector3d p = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen();
        const Eigen::Vector3d off = (p + Eigen::Vector3d(0, 0, kBlockDeep_mm / 2)).cwiseAbs() -
                                    Eigen::Vector3d(kHalf_mm, kHalf_mm, kBlockDeep_mm / 2);
        const double mm = off.cwiseMax(0).norm() + std::min(0.0, off.maxCoeff());
        distances.at(i, j, k) =
            static_cast<std::int16_t>(std::lround(std::clamp(mm, -kReach_mm, kReach_mm) / kStep_mm));
        labels.at(i, j, k) = mm < 0 ? 1 : 0;
      }
  const SignedField field(distances,
                          {kStep_mm, 0, static_cast<std::int16_t>(std::lround(kReach_mm / kStep_mm))});
  ExactBlock block{std::make_shared<const Surface>(field, field, kSteepest), {}};
  block.model.labels = label_bricks(labels);
  block.model.tissues = {Tissue()};
  block.model.tissue_of_label = {-1, 0};
  return block;
}

/// Volume removed by a path.
struct RemovedOfBlock {
  double surface_mm3 = 0;  // by the carved surface
  double counted_mm3 = 0;  // by RemovedVolume
};

/// A burr whose tip follows a prescribed path, in bone with negligible cutting resistance.
class GuidedTip {
 public:
  GuidedTip(const ExactBlock& block, const CutterPath& path, double rate_hz)
      : carved_(block.surface), removed_(block.model), tip_(path.corners.front()) {
    constexpr double kEnergy_mJ_per_mm3 = 2, kStiffness_N_per_mm = 2;
    options_.dt_s = 1 / rate_hz;
    options_.friction = false;
    touchable_.surface = carved_.surface();
    touchable_.stiffness_N_per_mm = kStiffness_N_per_mm;
    touchable_.cutting_energy_mJ_per_mm3 = kEnergy_mJ_per_mm3;
    burr_.radius_mm = path.head.tip_mm;
    burr_.end_radius_mm = path.head.end_mm;
    burr_.length_mm = path.head.row_mm;
    burr_.axis = path.head.spindle;
    burr_.revolutions_per_s = 1000;
  }

  RemovedOfBlock run(const std::vector<Point<Patient>>& corners) {
    constexpr double kSpeed_mm_s = 10, kSettles_s = 0.1;
    for (const Point<Patient>& corner : corners) {
      const Vector<Patient> displacement = corner - tip_;
      const long ticks = std::lround(displacement.norm() / kSpeed_mm_s / options_.dt_s);
      const Point<Patient> from = tip_;
      for (long n = 1; n <= ticks; ++n)
        tick_at(from + displacement * (static_cast<double>(n) / static_cast<double>(ticks)));
      // wait until the proxy has caught up at the corner
      for (long n = 0; n < std::lround(kSettles_s / options_.dt_s); ++n) tick_at(corner);
    }
    carve();
    const auto counted = removed_.by_label_mm3();
    return {removed_of_surface_mm3(), counted.empty() ? 0 : counted.begin()->second};
  }

 private:
  void tick_at(const Point<Patient>& at) {
    tip_ = at;
    if (ticks_++ % std::lround(kCarvedEvery_s / options_.dt_s) == 0) carve();
    (void)advance_burr({&touchable_, 1}, burr_, ToolPose(tip_), proxy_, state_, options_);
  }

  void carve() {
    const std::uint64_t count = finished_sweeps(state_);
    const std::span<const Sweep> finished = finished_from(state_, state_.first_sweep);
    if (finished.empty()) return;
    for (const Sweep& sweep : finished) {
      const SweptShape shape(sweep);
      low_ = low_.min(shape.low() - shape.max_radius_mm());
      high_ = high_.max(shape.high() + shape.max_radius_mm());
    }
    removed_.add(finished_cuts(state_, 0));
    carved_ = carved_.with(finished);
    touchable_.surface = carved_.surface();
    touchable_.original_surface = carved_.original();
    touchable_.clearance_error_mm = carved_.clearance_error_mm();
    rebase_burr({&touchable_, 1}, burr_, ToolPose(tip_), count, proxy_, state_);
    const ToolPart head = burr_.head(state_.inset_mm);
    const SurfaceCorrespondence before{0, false};
    transfer_proxy({&touchable_, 1}, {&head, 1}, ToolPose(tip_), {&before, 1}, proxy_);
  }

  double removed_of_surface_mm3() const {
    constexpr double kPosition_mm = 0.1;
    const Eigen::Array3d to = high_.min(Eigen::Array3d(high_[0], high_[1], 0.3));
    const Eigen::Array3i cells = ((to - low_) / kPosition_mm).ceil().max(0).cast<int>();
    const Eigen::Array3d size_mm = (to - low_) / cells.cast<double>();
    AccuracyRandom random(23);
    long removed = 0;
    for (int k = 0; k < cells[2]; ++k)
      for (int j = 0; j < cells[1]; ++j)
        for (int i = 0; i < cells[0]; ++i) {
          // stratified random points, so that no plane of the block coincides with a plane of points
          const double x = i + random.between(0, 1), y = j + random.between(0, 1),
                       z = k + random.between(0, 1);
          const Point<Patient> position(Eigen::Vector3d(low_ + Eigen::Array3d(x, y, z) * size_mm));
          removed +=
              carved_.original()->distance_mm(position) < 0 && carved_.surface()->distance_mm(position) > 0;
        }
    return size_mm.prod() * static_cast<double>(removed);
  }

  CarvedSurface carved_;
  RemovedVolume removed_;
  ContactSurface touchable_;
  Burr burr_;
  BurrState state_;
  ProxyState proxy_;
  ProxyOptions options_;
  Point<Patient> tip_;
  long ticks_ = 0;
  Eigen::Array3d low_ = Eigen::Array3d::Constant(1e9), high_ = -low_;
};

}  // namespace

Result<std::vector<Figure>> path_volume_figures(const PathVolumeOptions& options, const Progress& progress) {
  std::vector<ExactBlock> blocks;
  for (const BlockGrid& grid : kBlockGrids) {
    blocks.push_back(exact_block(grid));
    if (!options.all) break;
  }
  std::vector<Figure> figures;
  for (const CutterPath& path : cutter_paths()) {
    const std::string name = path.name;
    if (!options.all && name != "cylinder/across" && name != "cone/drilling") continue;
    RelativeRange rates, grids;
    double error_percent = 0, counted_error_percent = 0;
    const auto off = [&](double mm3) { return 100 * std::abs(mm3 / path.expected_mm3 - 1); };
    const auto take = [&](std::size_t block, double rate_hz, RelativeRange& range) {
      const RemovedOfBlock removed = GuidedTip(blocks[block], path, rate_hz).run(path.corners);
      error_percent = std::max(error_percent, off(removed.surface_mm3));
      counted_error_percent = std::max(counted_error_percent, off(removed.counted_mm3));
      range.add(removed.surface_mm3);
    };
    for (const double rate_hz : kTickRates_Hz) {
      if (progress.stopped()) return Progress::interrupted();
      if (options.all || rate_hz == 1000 || rate_hz == 4000) take(0, rate_hz, rates);
    }
    for (std::size_t block = 0; block < blocks.size(); ++block) {
      if (progress.stopped()) return Progress::interrupted();
      if (options.all) take(block, 1000, grids);
    }
    const std::string prefix = "removal/" + name;
    figures.push_back({prefix + "/off-geometry", error_percent, "percent", rates.count() + grids.count(),
                       path.max_error_percent});
    figures.push_back({prefix + "/counted-off-geometry", counted_error_percent, "percent",
                       rates.count() + grids.count(), path.max_counted_error_percent});
    figures.push_back({prefix + "/between-rates", rates.percent(), "percent", rates.count(), 2});
    if (options.all)
      figures.push_back({prefix + "/between-grids", grids.percent(), "percent", grids.count(), 4});
  }
  return figures;
}

}  // namespace palpate
