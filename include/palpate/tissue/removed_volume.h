#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "palpate/tissue/carving.h"
#include "palpate/tissue/stroke_history.h"

namespace palpate {

/// How much of each structure was swept: of every voxel, which of 4 x 4 x 4 places evenly spread in it, so
/// that what is swept twice counts once, and the same whatever the order. A structure is where its labels
/// were before anything was taken away; what is not felt, or kept, does not count, as it is not taken away. A
/// ball of 4 mm in one structure is within 1 % of its volume on voxels of up to 0.6 mm.
class RemovedVolume {
 public:
  /// @param model  with nothing taken from it yet
  explicit RemovedVolume(const Model& model);

  void add(std::span<const Cut> cuts);
  /// The last stroke counts no more, or again (as Carving::undone); false where there is none.
  bool undo();
  bool redo();
  /// mm3, of what is not 0.
  std::map<LabelId, double> by_label_mm3() const;

  // ---- place by place
  static constexpr int kPlaces = 64;  ///< of a voxel, each a bit of `places` below
  /// Where a voxel's place is. @param n  0 ... kPlaces - 1
  static Point<Voxel> place(int i, int j, int k, int n);
  static double place_mm3(const GridGeometry& grid) { return grid.spacing_mm.prod() / kPlaces; }
  const GridGeometry& geometry() const { return labels_->geometry(); }
  /// Whether a label counts: it is felt and not kept.
  bool counts(LabelId label) const { return is_cut_[label]; }
  /// Calls visit(i, j, k, label, places) for every voxel of which something is swept, in no order.
  template <class Visit>
  void for_each_swept(const Visit& visit) const {
    for (const auto& [index, places] : swept_) {
      if (places == 0) continue;
      const auto [i, j, k] = voxel_at(index);
      visit(i, j, k, labels_->at(i, j, k), places);
    }
  }

 private:
  // what a stroke was the first to sweep: places of a voxel, by its index
  using Stroke = std::vector<std::pair<std::size_t, std::uint64_t>>;
  void add(const Sweep& sweep, Stroke& stroke);
  std::array<int, 3> voxel_at(std::size_t index) const;
  LabelId label_of(std::size_t voxel) const;

  std::shared_ptr<const Bricks<LabelId>> labels_;
  std::vector<bool> is_cut_;                              // by label
  std::unordered_map<std::size_t, std::uint64_t> swept_;  // places of a voxel, by its index
  std::map<LabelId, std::uint64_t> places_;               // that are swept
  StrokeHistory<Stroke> strokes_;
};

}  // namespace palpate
