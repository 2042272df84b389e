#include "palpate/rehearsal/plan_in_scene.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "palpate/scene/structures.h"
#include "rehearsal/labels_with_voxels.h"

namespace palpate {
namespace {

constexpr std::uint64_t kAllSamples = ~std::uint64_t{0};

/// Number of sample points of voxels, by label.
struct SampleCounts {
  std::map<LabelId, std::uint64_t> by_label;

  void add(LabelId label, std::uint64_t samples) {
    if (samples != 0) by_label[label] += static_cast<std::uint64_t>(std::popcount(samples));
  }
  VolumesByLabel mm3(const GridGeometry& grid) const {
    VolumesByLabel volumes;
    for (const auto& [label, count] : by_label)
      volumes[label] = static_cast<double>(count) * RemovedVolume::sample_mm3(grid);
    return volumes;
  }
};
struct PlanCounts {
  explicit PlanCounts(const PlanInScene& plan) : of_regions(plan.regions.size()) {}

  std::vector<SampleCounts> of_regions;
  SampleCounts of_plan;

  PlannedVolumes mm3(const GridGeometry& grid) const {
    PlannedVolumes volumes;
    for (const SampleCounts& region : of_regions) volumes.of_regions.push_back(region.mm3(grid));
    volumes.of_plan = of_plan.mm3(grid);
    return volumes;
  }
};

/// Adds the sample points of a voxel that are in regions. Returns their bit set.
std::uint64_t count_voxel(const PlanInScene& plan, const GridGeometry& grid, int i, int j, int k,
                          LabelId label, std::uint64_t samples, PlanCounts& counts) {
  std::uint64_t planned = 0;
  for (std::size_t n = 0; n < plan.regions.size(); ++n) {
    const std::uint64_t in = samples & plan.regions[n].samples_in(grid, i, j, k, label);
    counts.of_regions[n].add(label, in);
    planned |= in;
  }
  counts.of_plan.add(label, planned);
  return planned;
}

}  // namespace

RegionInPlan::RegionInPlan(const PlanFile& plan, const PlanRegion& region, std::vector<bool> has_label)
    : shape_(region.shape), has_label_(std::move(has_label)), radius_mm_(region.radius_mm) {
  if (shape_ == PlanShape::kStructures) return;
  const PlanTrajectory& trajectory = plan.trajectories[region.trajectory];
  axis_ = trajectory.axis();
  across_ = region.across;
  third_ = axis_.cross(across_);
  const bool is_long = shape_ != PlanShape::kSphere;
  middle_ = trajectory.entry + axis_ * (is_long ? 0.5 * (region.from_mm + region.depth_mm) : region.depth_mm);
  half_mm_ = 0.5 * Eigen::Vector3d(region.depth_mm - region.from_mm, region.width_mm, region.height_mm);
}

double RegionInPlan::depth_mm(const Point<Patient>& at) const {
  const Vector<Patient> from_middle = at - middle_;
  // distance beyond the faces, in two or three perpendicular directions
  Eigen::Vector3d beyond = Eigen::Vector3d::Constant(-std::numeric_limits<double>::infinity());
  switch (shape_) {
    case PlanShape::kStructures:
      return std::numeric_limits<double>::infinity();
    case PlanShape::kSphere:
      return radius_mm_ - from_middle.norm();
    case PlanShape::kCylinder: {
      const double along = from_middle.dot(axis_);
      beyond[0] = std::abs(along) - half_mm_[0];
      beyond[1] = (from_middle - axis_ * along).norm() - radius_mm_;
      break;
    }
    case PlanShape::kBox:
      beyond = Eigen::Vector3d(std::abs(from_middle.dot(axis_)), std::abs(from_middle.dot(across_)),
                               std::abs(from_middle.dot(third_))) -
               half_mm_;
      break;
  }
  return -(beyond.cwiseMax(0).norm() + std::min(0.0, beyond.maxCoeff()));
}

std::uint64_t RegionInPlan::samples_in(const GridGeometry& grid, int i, int j, int k, LabelId label) const {
  if (!has(label)) return 0;
  if (shape_ == PlanShape::kStructures) return kAllSamples;
  const auto X = grid.X_PatientVoxel();
  const double half_diagonal_mm = 0.5 * grid.spacing_mm.norm();
  const double depth = depth_mm(X * Point<Voxel>(i, j, k));
  if (depth >= half_diagonal_mm) return kAllSamples;
  if (depth <= -half_diagonal_mm) return 0;
  std::uint64_t in = 0;
  for (int index = 0; index < RemovedVolume::kSamples; ++index)
    if (depth_mm(X * RemovedVolume::sample_point(i, j, k, index)) > 0) in |= std::uint64_t{1} << index;
  return in;
}

Result<PlanInScene> resolve_plan(const PlanFile& plan, const Model& model) {
  if (model.labels == nullptr)
    return Error{ErrorKind::kBadInput, "the scene has no label map, but a plan needs structures", plan.source,
                 "give the scene labels = \"...\" in [data]"};
  const std::vector<bool> has_voxel = labels_with_voxels(model);
  const auto labels_of = [&](const std::vector<LabelReference>& references,
                             int line) -> Result<std::vector<bool>> {
    auto labels = labels_in_model(model, references, plan.where(line));
    if (!labels) return labels;
    for (std::size_t label = 0; label < labels->size(); ++label)
      if ((*labels)[label] && !has_voxel[label])
        return Error{ErrorKind::kBadInput,
                     "the structure \"" + model.name_of(static_cast<LabelId>(label)) + "\" has no voxel",
                     plan.where(line), "give another one, or leave it out"};
    return labels;
  };
  PlanInScene found{plan, {}, {}, {}};
  for (const PlanTrajectory& trajectory : plan.trajectories) {
    auto labels = labels_of(trajectory.enters, trajectory.line);
    if (!labels) return labels.error();
    found.enters.push_back(*std::move(labels));
  }
  for (const PlanRegion& region : plan.regions) {
    auto labels = labels_of(region.structures, region.line);
    if (!labels) return labels.error();
    found.regions.emplace_back(plan, region, *std::move(labels));
  }
  for (const PlanDistance& distance : plan.distances) {
    const auto labels = labels_of(distance.structures, distance.line);
    if (!labels) return labels.error();
    for (std::size_t label = 0; label < labels->size(); ++label) {
      if (!(*labels)[label]) continue;
      double& requested_mm = found.distances_mm[static_cast<LabelId>(label)];
      requested_mm = std::max(requested_mm, distance.distance_mm);
    }
  }
  return found;
}

Result<PlannedVolumes> planned_volumes(const PlanInScene& plan, const Model& model,
                                       const Progress& progress) {
  const RemovedVolume nothing(model);
  const GridGeometry& grid = model.labels->geometry();
  PlanCounts counts(plan);
  bool stopped = false;
  model.labels->for_each_piece([&](const RowPiece<LabelId>& piece) {
    if (stopped || plan.regions.empty() || (piece.uniform && !nothing.counts(piece.voxels[0]))) return;
    if (piece.i == 0) stopped = progress.stopped();
    for (int n = 0; n < piece.count; ++n)
      if (const LabelId label = piece.voxels[n]; nothing.counts(label))
        count_voxel(plan, grid, piece.i + n, piece.j, piece.k, label, kAllSamples, counts);
  });
  if (stopped) return Progress::interrupted();
  return counts.mm3(grid);
}

RemovedVolumes removed_volumes(const PlanInScene& plan, const RemovedVolume& removed) {
  const GridGeometry& grid = removed.geometry();
  PlanCounts counts(plan);
  SampleCounts outside;
  removed.for_each_swept([&](int i, int j, int k, LabelId label, std::uint64_t samples) {
    const std::uint64_t planned = count_voxel(plan, grid, i, j, k, label, samples, counts);
    outside.add(label, samples & ~planned);
  });
  return {counts.mm3(grid), outside.mm3(grid)};
}

double depth_past_plan_mm(const PlanInScene& plan, const RemovedVolume& removed) {
  const auto X = removed.geometry().X_PatientVoxel();
  const double half_diagonal_mm = 0.5 * removed.geometry().spacing_mm.norm();
  const auto past_mm = [&](const Point<Patient>& at) {
    double min_mm = std::numeric_limits<double>::infinity();
    for (const RegionInPlan& region : plan.regions) min_mm = std::min(min_mm, -region.depth_mm(at));
    return min_mm;
  };
  double max_mm = 0;
  removed.for_each_swept([&](int i, int j, int k, LabelId, std::uint64_t samples) {
    // skip voxels that cannot exceed the current maximum
    if (past_mm(X * Point<Voxel>(i, j, k)) + half_diagonal_mm <= max_mm) return;
    for (int index = 0; index < RemovedVolume::kSamples; ++index)
      if ((samples >> index & 1) != 0)
        max_mm = std::max(max_mm, past_mm(X * RemovedVolume::sample_point(i, j, k, index)));
  });
  return max_mm;
}

}  // namespace palpate
