#include "palpate/tissue/removed_volume.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "tissue/swept_voxels.h"

namespace palpate {
namespace {

constexpr int kAlong = 4;  // sample points along each axis
constexpr std::uint64_t kAll = ~std::uint64_t{0};

}  // namespace

RemovedVolume::RemovedVolume(const Model& model)
    : labels_(model.labels), is_cut_(labels_that_are_cut(model)) {}

void RemovedVolume::add(std::span<const Cut> cuts) {
  for (const Cut& cut : cuts) {
    if (!strokes_.continues(cut.sweep.stroke)) strokes_.begin(cut.sweep.stroke, {});
    add(cut.sweep, strokes_.last());
  }
}

bool RemovedVolume::undo() {
  Stroke* const stroke = strokes_.undo();
  if (stroke == nullptr) return false;
  for (const auto& [voxel, samples] : *stroke) {
    swept_[voxel] &= ~samples;
    sample_counts_[label_of(voxel)] -= static_cast<std::uint64_t>(std::popcount(samples));
  }
  return true;
}

bool RemovedVolume::redo() {
  const Stroke* const stroke = strokes_.redo();
  if (stroke == nullptr) return false;
  for (const auto& [voxel, samples] : *stroke) {
    swept_[voxel] |= samples;
    sample_counts_[label_of(voxel)] += static_cast<std::uint64_t>(std::popcount(samples));
  }
  return true;
}

Point<Voxel> RemovedVolume::sample_point(int i, int j, int k, int n) {
  const auto along = [](int voxel, int index) { return voxel + (index + 0.5) / kAlong - 0.5; };
  return {along(i, n % kAlong), along(j, n / kAlong % kAlong), along(k, n / (kAlong * kAlong))};
}

std::array<int, 3> RemovedVolume::voxel_at(std::size_t index) const {
  const auto& [ni, nj, nk] = labels_->geometry().dims;
  const auto row = index / static_cast<std::size_t>(ni), rows = static_cast<std::size_t>(nj);
  return {static_cast<int>(index % static_cast<std::size_t>(ni)), static_cast<int>(row % rows),
          static_cast<int>(row / rows)};
}

LabelId RemovedVolume::label_of(std::size_t voxel) const {
  const auto [i, j, k] = voxel_at(voxel);
  return labels_->at(i, j, k);
}

void RemovedVolume::add(const Sweep& sweep, Stroke& stroke) {
  const GridGeometry& grid = labels_->geometry();
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  const auto index = [&](int i, int j, int k) {
    return static_cast<std::size_t>(i) +
           static_cast<std::size_t>(grid.dims[0]) *
               (static_cast<std::size_t>(j) +
                static_cast<std::size_t>(grid.dims[1]) * static_cast<std::size_t>(k));
  };
  const double half_diagonal_mm = 0.5 * grid.spacing_mm.norm();
  const VoxelBox box = voxels_around(sweep, sweep.widest_mm() + half_diagonal_mm, grid);
  const SweptShape shape(sweep);
  for (int k = box.first[2]; k < box.first[2] + box.size[2]; ++k)
    for (int j = box.first[1]; j < box.first[1] + box.size[1]; ++j)
      for (int i = box.first[0]; i < box.first[0] + box.size[0]; ++i) {
        const LabelId label = labels_->at(i, j, k);
        if (!is_cut_[label]) continue;
        const double depth_mm = shape.depth_mm(X_PatientVoxel * Point<Voxel>(i, j, k));
        if (depth_mm <= -half_diagonal_mm) continue;
        std::uint64_t& swept = swept_[index(i, j, k)];
        if (swept == kAll) continue;
        std::uint64_t now = kAll;
        if (depth_mm < half_diagonal_mm) {
          now = 0;
          for (int n = 0; n < kSamples; ++n)
            if (shape.depth_mm(X_PatientVoxel * sample_point(i, j, k, n)) > 0) now |= std::uint64_t{1} << n;
        }
        now &= ~swept;
        if (now == 0) continue;
        stroke.emplace_back(index(i, j, k), now);
        sample_counts_[label] += static_cast<std::uint64_t>(std::popcount(now));
        swept |= now;
      }
}

std::map<LabelId, double> RemovedVolume::by_label_mm3() const {
  std::map<LabelId, double> volumes;
  for (const auto& [label, samples] : sample_counts_)
    if (samples > 0) volumes[label] = static_cast<double>(samples) * sample_mm3(geometry());
  return volumes;
}

}  // namespace palpate
