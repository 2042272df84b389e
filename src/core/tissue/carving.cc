#include "palpate/tissue/carving.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "palpate/base/check.h"
#include "palpate/base/hash.h"
#include "palpate/tissue/thin_voxels.h"
#include "tissue/swept_voxels.h"

namespace palpate {
namespace {

std::shared_ptr<const Bricks<LabelId>> labels_without_sweep(std::shared_ptr<const Bricks<LabelId>> labels,
                                                            const Sweep& sweep,
                                                            const std::vector<bool>& is_cut) {
  const GridGeometry& grid = labels->geometry();
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  PatchOf<LabelId> patch{voxels_around(sweep, sweep.max_radius_mm(), grid), {}};
  const VoxelBox& box = patch.box;
  if (box.voxel_count() == 0) return labels;
  patch.values.resize(box.voxel_count());
  const SweptShape shape(sweep);
  bool differs = false;
  auto value = patch.values.begin();
  for (int k = box.first[2]; k < box.first[2] + box.size[2]; ++k)
    for (int j = box.first[1]; j < box.first[1] + box.size[1]; ++j) {
      labels->copy_row(box.first[0], j, k, box.size[0], &*value);
      for (int i = box.first[0]; i < box.first[0] + box.size[0]; ++i, ++value) {
        if (!is_cut[*value]) continue;
        if (!(shape.depth_mm(X_PatientVoxel * Point<Voxel>(i, j, k)) > 0)) continue;
        *value = 0;
        differs = true;
      }
    }
  return differs ? std::make_shared<const Bricks<LabelId>>(labels->with(patch)) : labels;
}

// Swept fraction of a voxel: mean over its eight octants, each a linear function of the depth at its centre.
// This is exact for a plane parallel to the octants' faces.
double swept_fraction(const SweptShape& shape, const GridGeometry& grid,
                      const Transform<Patient, Voxel>& X_PatientVoxel, int i, int j, int k) {
  const double half_diagonal_mm = 0.5 * grid.spacing_mm.norm();
  const double depth_mm = shape.depth_mm(X_PatientVoxel * Point<Voxel>(i, j, k));
  if (depth_mm <= -half_diagonal_mm) return 0;
  if (depth_mm >= half_diagonal_mm) return 1;
  const double width_mm = 0.5 * grid.spacing_mm.mean();
  double fraction = 0;
  for (int eighth = 0; eighth < 8; ++eighth) {
    const auto along = [&](int voxel, int axis) {
      return voxel + ((eighth >> axis & 1) != 0 ? 0.25 : -0.25);
    };
    const double mm = shape.depth_mm(X_PatientVoxel * Point<Voxel>(along(i, 0), along(j, 1), along(k, 2)));
    fraction += std::clamp(0.5 + mm / width_mm, 0.0, 1.0) / 8;
  }
  return fraction;
}

}  // namespace

Cut cut_of(const SweepRecord& sweep) {
  const auto point = [](const std::array<double, 3>& p) { return Point<Patient>(p[0], p[1], p[2]); };
  const Vector<Patient> axis_mm(sweep.axis_mm[0], sweep.axis_mm[1], sweep.axis_mm[2]);
  return {sweep.device,
          {point(sweep.from_mm), point(sweep.to_mm), sweep.radius_mm, sweep.stroke, axis_mm,
           sweep.end_radius_mm}};
}

SweepRecord record_of(const Cut& cut) {
  const auto numbers = [](const auto& p) { return std::array{p.x(), p.y(), p.z()}; };
  const Sweep& sweep = cut.sweep;
  return {cut.device,   numbers(sweep.from),    numbers(sweep.to),  sweep.radius_mm,
          sweep.stroke, numbers(sweep.axis_mm), sweep.end_radius_mm};
}

Carving::Carving(const Model& model)
    : original_labels_(model.labels),
      is_cuttable_(cuttable_labels(model)),
      cutting_energy_(model),
      thin_voxels_(model.thin_voxels),
      records_fractions_(is_moving(model.tissue_law)),
      remaining_{{}, model.labels, nullptr, SweptSamples(model.labels.get()), 0} {
  for (const ProtectedStructure& structure : model.protected_structures)
    if (structure.is_protected) protected_surfaces_.push_back(structure.surface);
  for (std::size_t s = 0; s < model.surfaces.size(); ++s) {
    const ContactSurface& contact_surface = model.surfaces[s];
    const std::size_t structure =
        contact_surface.structure >= 0 ? static_cast<std::size_t>(contact_surface.structure) : s;
    original_surfaces_.push_back(model.surfaces[structure].is_protected ? nullptr : contact_surface.surface);
  }
  tracked_surfaces_ = original_surfaces_.size();
  // distances are measured to the remaining material
  for (const TrackedStructure& tracked : model.distance_trees.structures()) {
    const auto& surface = tracked.tree->surface();
    const auto end = original_surfaces_.begin() + static_cast<std::ptrdiff_t>(tracked_surfaces_);
    const auto same = std::find(original_surfaces_.begin(), end, surface);
    if (!is_cuttable_[tracked.label]) {
      original_of_tracked_.push_back(-1);
    } else {
      original_of_tracked_.push_back(
          static_cast<int>(same != end ? same - original_surfaces_.begin() : original_surfaces_.size()));
      if (same == end) original_surfaces_.push_back(surface);
    }
  }
  remaining_.surfaces.resize(original_surfaces_.size());
}

std::shared_ptr<const Carving> Carving::with(std::span<const Cut> cuts) const {
  auto next = std::make_shared<Carving>(*this);
  while (!cuts.empty()) {
    const std::uint32_t stroke = cuts.front().sweep.stroke;
    const auto other = std::ranges::find_if(cuts, [&](const Cut& cut) { return cut.sweep.stroke != stroke; });
    const auto count = static_cast<std::size_t>(other - cuts.begin());
    if (!next->strokes_.continues(stroke))
      next->strokes_.begin(stroke, {std::make_shared<const Remaining>(next->remaining_), nullptr});
    next->apply(cuts.first(count));
    cuts = cuts.subspan(count);
  }
  return next;
}

// applies cuts of one stroke
void Carving::apply(std::span<const Cut> cuts) {
  std::vector<Sweep> sweeps;
  Eigen::Array3d low = Eigen::Array3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
  std::uint64_t hash = remaining_.hash != 0 ? remaining_.hash : kHashSeed;
  for (const Cut& cut : cuts) {
    PALPATE_CHECK(cut.device < kMaxDevices || cut.device == Cut::kBrokenOff);
    const Sweep& sweep = sweeps.emplace_back(cut.sweep);
    account_for(cut);
    hash_word(hash, cut.device);
    for (int axis = 0; axis < 3; ++axis) {
      hash_double(hash, sweep.from[axis]);
      hash_double(hash, sweep.to[axis]);
    }
    hash_double(hash, sweep.radius_mm);
    if (!sweep.is_of_ball()) {
      for (int axis = 0; axis < 3; ++axis) hash_double(hash, sweep.axis_mm[axis]);
      hash_double(hash, sweep.end_radius_mm);
    }
    remaining_.labels = labels_without_sweep(remaining_.labels, sweep, is_cuttable_);
    if (records_fractions_) record_removed_fractions(sweep);
    const SweptShape shape(sweep);
    low = low.min(shape.low() - shape.max_radius_mm());
    high = high.max(shape.high() + shape.max_radius_mm());
  }
  remaining_.hash = hash;
  for (std::size_t s = 0; s < original_surfaces_.size(); ++s) {
    if (original_surfaces_[s] == nullptr || original_surfaces_[s]->is_farther_than(low, high, 0)) continue;
    std::shared_ptr<const CarvedSurface>& carved = remaining_.surfaces[s];
    const CarvedSurface now =
        carved != nullptr ? *carved : CarvedSurface(original_surfaces_[s], protected_surfaces_);
    CarvedSurface next = now.with(sweeps);
    if (carved != nullptr || next.surface() != original_surfaces_[s])
      carved = std::make_shared<const CarvedSurface>(std::move(next));
  }
}

// adds a sweep to its device's account, and a fragment to none
void Carving::account_for(const Cut& cut) {
  CarvedMaterial discarded;
  CarvedMaterial& carved = cut.device == Cut::kBrokenOff ? discarded : carved_[cut.device];
  ++carved.sweeps;
  if (original_labels_ == nullptr) return;
  const double sample_mm3 = original_labels_->geometry().spacing_mm.prod() / SweptSamples::kSamples;
  for (const auto& [i, j, k, samples] :
       remaining_.swept.add(cut.sweep, *original_labels_, cutting_energy_.has_energy())) {
    const double mm3 = std::popcount(samples) * sample_mm3;
    const BoneClass bone = thin_voxels_ != nullptr && thin_voxels_->at(i, j, k) == kThinBone ? kThin : kThick;
    carved.volume_mm3[bone] += mm3;
    carved.energy_mJ[bone] += mm3 * cutting_energy_.mJ_per_mm3(original_labels_->at(i, j, k), i, j, k);
  }
}

void Carving::record_removed_fractions(const Sweep& sweep) {
  const GridGeometry& grid = original_labels_->geometry();
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  PatchOf<std::uint8_t> patch{
      voxels_around(sweep, sweep.max_radius_mm() + 0.5 * grid.spacing_mm.norm(), grid), {}};
  const VoxelBox& box = patch.box;
  if (box.voxel_count() == 0) return;
  patch.values.resize(box.voxel_count());
  const SweptShape shape(sweep);
  bool differs = false;
  auto value = patch.values.begin();
  for (int k = box.first[2]; k < box.first[2] + box.size[2]; ++k)
    for (int j = box.first[1]; j < box.first[1] + box.size[1]; ++j) {
      if (remaining_.removed_fraction != nullptr)
        remaining_.removed_fraction->copy_row(box.first[0], j, k, box.size[0], &*value);
      for (int i = box.first[0]; i < box.first[0] + box.size[0]; ++i, ++value) {
        if (*value == 255 || !is_cuttable_[original_labels_->at(i, j, k)]) continue;
        const double fraction = swept_fraction(shape, grid, X_PatientVoxel, i, j, k);
        const auto removed = static_cast<std::uint8_t>(std::lround(kFullyRemoved * fraction));
        differs = differs || removed > *value;
        *value = std::max(*value, removed);
      }
    }
  if (!differs) return;
  const auto before = remaining_.removed_fraction != nullptr
                          ? remaining_.removed_fraction
                          : std::make_shared<const Bricks<std::uint8_t>>(grid, std::uint8_t{0});
  remaining_.removed_fraction = std::make_shared<const Bricks<std::uint8_t>>(before->with(patch));
}

std::shared_ptr<const Carving> Carving::undone() const {
  auto next = std::make_shared<Carving>(*this);
  Stroke* const stroke = next->strokes_.undo();
  if (stroke == nullptr) return nullptr;
  if (stroke->after == nullptr) stroke->after = std::make_shared<const Remaining>(remaining_);
  next->remaining_ = *stroke->before;
  return next;
}

std::shared_ptr<const Carving> Carving::redone() const {
  auto next = std::make_shared<Carving>(*this);
  const Stroke* const stroke = next->strokes_.redo();
  if (stroke == nullptr) return nullptr;
  next->remaining_ = *stroke->after;
  return next;
}

std::uint64_t Carving::content_hash(std::uint64_t uncut) const {
  if (remaining_.hash == 0) return uncut;
  hash_word(uncut, remaining_.hash);
  return hash_finish(uncut);
}

std::shared_ptr<const Model> Carving::applied_to(const Model& model) const {
  PALPATE_CHECK(model.surfaces.size() == tracked_surfaces_ &&
                model.distance_trees.structures().size() == original_of_tracked_.size());
  auto next = std::make_shared<Model>(model);
  ++next->version;
  ++next->edits;
  for (std::size_t s = 0; s < tracked_surfaces_; ++s) {
    if (original_surfaces_[s] == nullptr) continue;
    ContactSurface& surface = next->surfaces[s];
    const CarvedSurface* const carved = remaining_.surfaces[s].get();
    surface.surface = carved != nullptr ? carved->surface() : original_surfaces_[s];
    surface.original_surface = carved != nullptr ? original_surfaces_[s] : nullptr;
    surface.original_labels = carved != nullptr ? original_labels_ : nullptr;
    surface.clearance_error_mm = carved != nullptr ? carved->clearance_error_mm() : 0;
  }
  for (std::size_t n = 0; n < original_of_tracked_.size(); ++n) {
    if (original_of_tracked_[n] < 0) continue;
    const auto s = static_cast<std::size_t>(original_of_tracked_[n]);
    const CarvedSurface* const carved = remaining_.surfaces[s].get();
    const auto& surface = carved != nullptr ? carved->surface() : original_surfaces_[s];
    if (next->distance_trees.structures()[n].tree->surface() != surface)
      next->distance_trees = next->distance_trees.with(n, surface);
  }
  next->labels = remaining_.labels;
  next->carving = std::make_shared<const Carving>(*this);
  next->content_hash = content_hash(model.hash_before_removal);
  return next;
}

}  // namespace palpate
