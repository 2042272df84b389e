#include "volume_io/labels/label_sink.h"

#include <iterator>
#include <string>

namespace palpate::volume_io {

LabelSink::LabelSink(const VolumeFile& file)
    : file_(file), present_(static_cast<std::size_t>(file.header.layers), std::vector<char>(kLabelValues)) {
  for (int layer = 0; layer < file.header.layers; ++layer)
    layers_.push_back(unfilled<LabelId>(file.header.geometry));
}

Result<void> LabelSink::check_ids() const {
  if (large_ids_.empty()) return {};
  return large_id_error();
}

bool LabelSink::load(const VoxelCacheEntry& cache_entry) {
  auto layers = cache_entry.find_labels(layers_.size());
  if (layers.empty()) return false;
  layers_ = std::move(layers);
  for (std::size_t layer = 0; layer < layers_.size(); ++layer) observe(layers_[layer], present_[layer]);
  return true;
}

std::vector<Volume<LabelId>> LabelSink::take_layers() {
  std::vector<Volume<LabelId>> layers;
  for (auto& voxels : layers_) layers.emplace_back(file_.header.geometry, std::move(voxels));
  return layers;
}

void LabelSink::grow(std::uint64_t values) {
  const std::uint64_t layers = layers_.size(), voxels = file_.header.geometry.voxel_count();
  for (std::uint64_t layer = 0; layer < layers; ++layer) {
    const std::uint64_t before = file_.layers_first ? 0 : layer * voxels;
    const std::uint64_t here =
        file_.layers_first ? (values + layers - 1) / layers : values - std::min(values, before);
    grow_to(layers_[static_cast<std::size_t>(layer)], std::min(here, voxels));
  }
}

void LabelSink::observe(const std::vector<LabelId>& voxels, std::vector<char>& present) {
  LabelId last = 0;
  for (const LabelId label : voxels) {
    if (label == last) continue;
    present[label] = 1;
    last = label;
  }
}

Error LabelSink::large_id_error() const {
  constexpr std::size_t kNamed = 3;
  std::string some;
  for (auto id = large_ids_.begin();
       id != large_ids_.end() && std::distance(large_ids_.begin(), id) < static_cast<std::ptrdiff_t>(kNamed);
       ++id)
    some += (some.empty() ? "" : ", ") + std::to_string(*id);
  const std::size_t count = large_ids_.size();
  const std::string number =
      count > kLabelValues ? "more than " + std::to_string(kLabelValues) : std::to_string(count);
  return bad_input(file_.voxels.file.string(),
                   "has " + number + (count == 1 ? " label" : " labels") + " above 65535 (" + some +
                       (count > kNamed ? ", ..." : "") + "), but labels must be in 0 ... 65535",
                   "renumber the labels and their names with smaller, distinct numbers; if it is a scan, "
                   "give it as the scan (--scan)");
}

Error LabelSink::label_error(std::uint64_t n) const {
  const auto& dims = file_.header.geometry.dims;
  const std::uint64_t voxel =
      file_.layers_first ? n / layers_.size() : n % file_.header.geometry.voxel_count();
  const auto nx = static_cast<std::uint64_t>(dims[0]), ny = static_cast<std::uint64_t>(dims[1]);
  return bad_input(file_.voxels.file.string(),
                   "voxel (" + std::to_string(voxel % nx) + ", " + std::to_string(voxel / nx % ny) + ", " +
                       std::to_string(voxel / nx / ny) +
                       ") holds no label: labels are whole numbers in 0 ... 65535",
                   "is it a scan? give it as the scan, not as the labels");
}

}  // namespace palpate::volume_io
