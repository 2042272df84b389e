#include <limits>

#include "base/hash.h"
#include "palpate/carving.h"
#include "palpate/check.h"
#include "tissue/swept_voxels.h"

namespace palpate {
namespace {

std::shared_ptr<const Bricks<LabelId>> without(std::shared_ptr<const Bricks<LabelId>> labels,
                                               const Sweep& sweep, const std::vector<bool>& is_cut) {
  const GridGeometry& grid = labels->geometry();
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  PatchOf<LabelId> patch{voxels_around(sweep, sweep.radius_mm, grid), {}};
  const VoxelBox& box = patch.box;
  if (box.voxel_count() == 0) return labels;
  patch.values.resize(box.voxel_count());
  bool differs = false;
  auto value = patch.values.begin();
  for (int k = box.first[2]; k < box.first[2] + box.size[2]; ++k)
    for (int j = box.first[1]; j < box.first[1] + box.size[1]; ++j) {
      labels->copy_row(box.first[0], j, k, box.size[0], &*value);
      for (int i = box.first[0]; i < box.first[0] + box.size[0]; ++i, ++value) {
        if (!is_cut[*value]) continue;
        if (distance_to_axis_mm(sweep, X_PatientVoxel * Point<Voxel>(i, j, k)) >= sweep.radius_mm) continue;
        *value = 0;
        differs = true;
      }
    }
  return differs ? std::make_shared<const Bricks<LabelId>>(labels->with(patch)) : labels;
}

}  // namespace

Cut cut_of(const SweepRecord& sweep) {
  const auto point = [](const std::array<double, 3>& p) { return Point<Patient>(p[0], p[1], p[2]); };
  return {sweep.device, {point(sweep.from_mm), point(sweep.to_mm), sweep.radius_mm}};
}

SweepRecord plain(const Cut& cut) {
  const auto numbers = [](const Point<Patient>& p) { return std::array{p.x(), p.y(), p.z()}; };
  return {cut.device, numbers(cut.sweep.from), numbers(cut.sweep.to), cut.sweep.radius_mm};
}

Carving::Carving(const Model& model)
    : carved_(model.surfaces.size()),
      made_labels_(model.labels),
      labels_(model.labels),
      is_cut_(labels_that_are_cut(model)),
      hash_(kHashSeed) {
  for (const ProtectedStructure& structure : model.protected_structures)
    if (structure.kept) kept_.push_back(structure.surface);
  for (std::size_t s = 0; s < model.surfaces.size(); ++s) {
    const FeltSurface& felt = model.surfaces[s];
    const std::size_t structure = felt.structure >= 0 ? static_cast<std::size_t>(felt.structure) : s;
    made_.push_back(model.surfaces[structure].kept ? nullptr : felt.surface);
  }
}

std::shared_ptr<const Carving> Carving::with(std::span<const Cut> cuts) const {
  auto next = std::make_shared<Carving>(*this);
  std::vector<Sweep> sweeps;
  for (const Cut& cut : cuts) {
    PALPATE_CHECK(cut.device < kMaxDevices);
    sweeps.push_back(cut.sweep);
    ++next->sweeps_[cut.device];
    hash_word(next->hash_, cut.device);
    for (int axis = 0; axis < 3; ++axis) {
      hash_double(next->hash_, cut.sweep.from[axis]);
      hash_double(next->hash_, cut.sweep.to[axis]);
    }
    hash_double(next->hash_, cut.sweep.radius_mm);
    next->labels_ = without(next->labels_, cut.sweep, is_cut_);
  }
  if (sweeps.empty()) return next;
  Eigen::Array3d low = Eigen::Array3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (const Sweep& sweep : sweeps) {
    const Eigen::Array3d from = sweep.from.eigen().array(), to = sweep.to.eigen().array();
    low = low.min(from.min(to) - sweep.radius_mm);
    high = high.max(from.max(to) + sweep.radius_mm);
  }
  for (std::size_t s = 0; s < made_.size(); ++s) {
    if (made_[s] == nullptr || made_[s]->is_beyond(low, high, 0)) continue;
    const CarvedSurface now = carved_[s] != nullptr ? *carved_[s] : CarvedSurface(made_[s], kept_);
    CarvedSurface then = now.with(sweeps);
    if (carved_[s] != nullptr || then.surface() != made_[s])
      next->carved_[s] = std::make_shared<const CarvedSurface>(std::move(then));
  }
  return next;
}

std::shared_ptr<const Model> Carving::taken_from(const Model& felt) const {
  PALPATE_CHECK(felt.surfaces.size() == made_.size());
  auto next = std::make_shared<Model>(felt);
  ++next->version;
  ++next->edits;
  for (std::size_t s = 0; s < made_.size(); ++s) {
    if (carved_[s] == nullptr) continue;
    FeltSurface& surface = next->surfaces[s];
    surface.surface = carved_[s]->surface();
    surface.made = made_[s];
    surface.made_labels = made_labels_;
    surface.short_mm = carved_[s]->short_mm();
  }
  next->labels = labels_;
  next->carving = std::make_shared<const Carving>(*this);
  std::uint64_t hash = felt.content_hash;
  hash_word(hash, hash_);
  next->content_hash = hash_finish(hash);
  return next;
}

}  // namespace palpate
