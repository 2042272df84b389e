#include "palpate/voxel_methods.h"

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
  PALPATE_CHECK(
      std::visit([](const auto& volume) { return volume != nullptr && !volume->empty(); }, storage_));
  X_VoxelPatient_ = geometry().X_PatientVoxel().inverse();
}

LabelVoxels::LabelVoxels(std::shared_ptr<const Volume<LabelId>> labels, const LabelSet& set)
    : LabelVoxels(set.ranges(), std::variant<Labels, Mask>(std::move(labels))) {}

LabelVoxels LabelVoxels::mask(const Volume<LabelId>& labels, const LabelSet& set) {
  auto mask = std::make_shared<Volume<std::uint8_t>>(labels.geometry());
  for (std::size_t n = 0; n < labels.voxels().size(); ++n) {
    mask->voxels()[n] = set.contains(labels.voxels()[n]) ? 1 : 0;
  }
  return {std::vector<LabelRange>{{1, 1}}, Mask(std::move(mask))};
}

const GridGeometry& LabelVoxels::geometry() const {
  return std::visit([](const auto& volume) -> const GridGeometry& { return volume->geometry(); }, storage_);
}

bool LabelVoxels::contains(int i, int j, int k) const {
  const unsigned label =
      std::visit([&](const auto& volume) -> unsigned { return volume->at_or(i, j, k, 0); }, storage_);
  for (const LabelRange& range : ranges_) {
    if (label >= range.first && label <= range.last) return true;
  }
  return false;
}

}  // namespace palpate
