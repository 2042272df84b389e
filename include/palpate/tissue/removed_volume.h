#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/tissue/carving.h"
#include "palpate/tissue/stroke_history.h"
#include "palpate/tissue/swept_samples.h"

namespace palpate {

/// Measures the volume swept from each structure by sampling every voxel at 4 x 4 x 4 evenly spaced points,
/// so that repeated sweeps count once and the order does not matter. Structures are those of the labels
/// before any removal; structures that are not touchable, or are protected, cannot be removed and do not
/// count. A ball of 4 mm in one structure is within 1 % of its volume for voxels of up to 0.6 mm.
class RemovedVolume {
 public:
  /// @param model  with nothing removed yet
  explicit RemovedVolume(const Model& model);

  void add(std::span<const Cut> cuts);
  /// Excludes the last stroke, or includes it again (as Carving::undone). Returns false if there is none.
  bool undo();
  bool redo();
  /// Volumes above 0, mm3.
  std::map<LabelId, double> by_label_mm3() const;
  /// Volume of fragments that were cut loose (palpate/tissue/fragments.h), part of the above; mm3.
  double broken_off_mm3() const;

  // ---- sample points
  static constexpr int kSamples = SweptSamples::kSamples;
  static Point<Voxel> sample_point(int i, int j, int k, int n) {
    return SweptSamples::sample_point(i, j, k, n);
  }
  static double sample_mm3(const GridGeometry& grid) { return grid.spacing_mm.prod() / kSamples; }
  const GridGeometry& geometry() const { return labels_->geometry(); }
  /// Whether a label counts: it is touchable and not protected.
  bool counts(LabelId label) const { return is_cuttable_[label]; }
  /// Swept points of a voxel; 0 outside the volume.
  std::uint64_t swept_samples(int i, int j, int k) const { return remaining_.swept.at(i, j, k); }
  /// Calls visit(i, j, k, label, samples) for every voxel with swept points, in no particular order;
  /// `samples` has a bit per swept point.
  template <class Visit>
  void for_each_swept(const Visit& visit) const {
    remaining_.swept.for_each(
        [&](int i, int j, int k, std::uint64_t samples) { visit(i, j, k, labels_->at(i, j, k), samples); });
  }

 private:
  struct Remaining {
    SweptSamples swept;
    std::map<LabelId, std::uint64_t> sample_counts;  // number of swept points
    std::uint64_t broken_off_samples = 0;            // in fragments
  };
  struct Stroke {
    Remaining before;
    std::optional<Remaining> after;  // set by the first undo
  };

  std::shared_ptr<const Bricks<LabelId>> labels_;
  std::vector<bool> is_cuttable_;  // by label
  Remaining remaining_;
  StrokeHistory<Stroke> strokes_;
};

}  // namespace palpate
