#include "palpate/tasks/burr_meters.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

namespace palpate {
namespace {

double nearest_distance_mm(const std::vector<StructureDistance>& structures, const Point<Patient>& at) {
  double min_mm = std::numeric_limits<double>::infinity();
  for (const StructureDistance& structure : structures) min_mm = std::min(min_mm, structure.distance_mm(at));
  return min_mm;
}

}  // namespace

double bone_left_mm(const std::vector<StructureDistance>& structures, const RemovedVolume& removed) {
  const auto X = removed.geometry().X_PatientVoxel();
  const double half_diagonal_mm = 0.5 * removed.geometry().spacing_mm.norm();
  double min_mm = std::numeric_limits<double>::infinity();
  removed.for_each_swept([&](int i, int j, int k, LabelId, std::uint64_t samples) {
    // skip voxels that cannot contain a new minimum
    if (nearest_distance_mm(structures, X * Point<Voxel>(i, j, k)) - half_diagonal_mm >= min_mm) return;
    for (int index = 0; index < RemovedVolume::kSamples; ++index)
      if ((samples >> index & 1) != 0)
        min_mm = std::min(min_mm,
                          nearest_distance_mm(structures, X * RemovedVolume::sample_point(i, j, k, index)));
  });
  return std::isfinite(min_mm) ? min_mm : kNoValue;
}

void BurrNearStructures::observe(const ToolHead& head, double force_N) {
  const bool is_stronger = force_N > peak_N_;
  if (head_) {
    const double at_least_mm = gap_mm_ - head.moved_mm(*head_);
    if (at_least_mm >= nearest_mm_ && (!is_stronger || at_least_mm > within_mm_)) return;
  }
  gap_mm_ = std::numeric_limits<double>::infinity();
  for (const StructureDistance& structure : *structures_)
    gap_mm_ = std::min(gap_mm_, palpate::gap_mm(structure, head));
  head_ = head;
  if (!(gap_mm_ >= nearest_mm_)) nearest_mm_ = gap_mm_;
  if (is_stronger && gap_mm_ <= within_mm_) peak_N_ = force_N;
}

MicroscopeView::MicroscopeView(const TaskMicroscope& microscope, const Model& model)
    : labels_(model.labels),
      X_VoxelPatient_(model.labels->geometry().X_PatientVoxel().inverse()),
      step_mm_(0.5 * model.labels->geometry().spacing_mm.minCoeff()),
      uncarved_mm_(model.labels->geometry().spacing_mm.maxCoeff()) {
  for (std::size_t label = 0; label < model.tissue_of_label.size(); ++label)
    is_touchable_.push_back(model.is_touchable(static_cast<LabelId>(label)));
  const Eigen::Vector3d axis = microscope.from.eigen().normalized();
  const Eigen::Vector3d across = axis.unitOrthogonal();
  directions_.push_back(Vector<Patient>(axis));
  for (const double part : {0.5, 1.0}) {
    const double tilt = part * microscope.tilt_deg * std::numbers::pi / 180;
    for (int n = 0; n < 8; ++n) {
      const Eigen::Vector3d side = Eigen::AngleAxisd(n * std::numbers::pi / 4, axis) * across;
      directions_.push_back(Vector<Patient>(std::cos(tilt) * axis + std::sin(tilt) * side));
    }
  }
}

bool MicroscopeView::is_visible(const ToolHead& head, const RemovedVolume& removed) const {
  const double begins_mm = head.radius_mm + uncarved_mm_;
  return std::ranges::any_of(directions_, [&](const Vector<Patient>& direction) {
    return is_free(head.from, direction, begins_mm, removed);
  });
}

bool MicroscopeView::is_free(const Point<Patient>& from, const Vector<Patient>& direction, double begins_mm,
                             const RemovedVolume& removed) const {
  const auto& dims = labels_->geometry().dims;
  // a line from inside the volume leaves it after at most its diagonal
  const double diagonal_mm =
      labels_->geometry().spacing_mm.cwiseProduct(Eigen::Vector3d(dims[0], dims[1], dims[2])).norm();
  for (double at_mm = begins_mm; at_mm < diagonal_mm; at_mm += step_mm_) {
    const Point<Voxel> p = X_VoxelPatient_ * (from + direction * at_mm);
    const int i = static_cast<int>(std::lround(p[0])), j = static_cast<int>(std::lround(p[1])),
              k = static_cast<int>(std::lround(p[2]));
    const LabelId label = labels_->anywhere(i, j, k);
    if (label >= is_touchable_.size() || !is_touchable_[label]) continue;
    // a voxel blocks the view while most of it is left
    if (std::popcount(removed.swept_samples(i, j, k)) < RemovedVolume::kSamples / 2) return false;
  }
  return true;
}

}  // namespace palpate
