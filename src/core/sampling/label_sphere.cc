#include "palpate/sampling/label_voxels.h"
#include "palpate/sampling/sphere_filters.h"

#include <limits>

namespace palpate {

LabelSet LabelSet::all() {
  LabelSet set;
  set.words_.fill(~std::uint64_t{0});
  set.erase(0);
  return set;
}

void LabelSet::insert(LabelId id) {
  PALPATE_CHECK(id != 0);
  words_[id / 64] |= std::uint64_t{1} << (id % 64);
}

std::vector<LabelRange> LabelSet::ranges() const {
  std::vector<LabelRange> ranges;
  for (unsigned id = 1; id < 0x10000; ++id) {
    const auto label = static_cast<LabelId>(id);
    if (!contains(label)) continue;
    if (!ranges.empty() && ranges.back().last + 1u == id) {
      ranges.back().last = label;
    } else {
      ranges.push_back({label, label});
    }
  }
  return ranges;
}

LabelVoxels::LabelVoxels(std::vector<LabelRange> ranges, std::variant<Labels, Mask> storage)
    : storage_(std::move(storage)), ranges_(std::move(ranges)) {
  PALPATE_CHECK(std::visit(
      [](const auto& bricks) {
        return bricks != nullptr && bricks->geometry().voxel_count() > 0 && bricks->outside() == 0;
      },
      storage_));
  X_VoxelPatient_ = geometry().X_PatientVoxel().inverse();
}

LabelVoxels::LabelVoxels(std::shared_ptr<const Bricks<LabelId>> labels, const LabelSet& set)
    : LabelVoxels(set.ranges(), std::variant<Labels, Mask>(std::move(labels))) {}

LabelVoxels LabelVoxels::mask(const Bricks<LabelId>& labels, const LabelSet& set) {
  std::vector<std::uint8_t> is_member(std::size_t{std::numeric_limits<LabelId>::max()} + 1);
  for (std::size_t id = 0; id < is_member.size(); ++id)
    is_member[id] = set.contains(static_cast<LabelId>(id)) ? 1 : 0;
  return {{{1, 1}},
          std::make_shared<const Bricks<std::uint8_t>>(Bricks<std::uint8_t>::of_labels(labels, is_member))};
}

const GridGeometry& LabelVoxels::geometry() const {
  return std::visit([](const auto& bricks) -> const GridGeometry& { return bricks->geometry(); }, storage_);
}

bool LabelVoxels::contains(int i, int j, int k) const {
  const unsigned label =
      std::visit([&](const auto& bricks) -> unsigned { return bricks->anywhere(i, j, k); }, storage_);
  for (const LabelRange& range : ranges_) {
    if (label >= range.first && label <= range.last) return true;
  }
  return false;
}

}  // namespace palpate
