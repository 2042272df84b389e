#include "volume_io/labels/layered_labels.h"

namespace palpate::volume_io {

std::vector<int> assign_layers(std::size_t segments, const SegmentOverlapPairs& overlaps, VolumeFile& file) {
  std::vector<int> layers = layers_of_segments(segments, {overlaps.pairs.begin(), overlaps.pairs.end()});
  file.header.layers = layers.empty() ? 1 : 1 + *std::ranges::max_element(layers);
  if (overlaps.voxels > 0)
    file.notes.push_back(
        "segments overlap in " + std::to_string(overlaps.voxels) +
        " voxels and are kept complete; where one label per voxel is needed, a nested segment takes "
        "precedence, and of crossing segments the one with the stiffest tissue");
  return layers;
}

VolumeFile labels_in_slices(const GridGeometry& grid, const std::filesystem::path& named) {
  VolumeFile file;
  file.header.geometry = grid;
  file.header.meaning = ValueMeaning::kLabels;
  file.layers_first = false;
  file.voxels.file = named;
  file.voxels.encoding = Encoding::kSlices;
  file.voxels.component = Component::kUint16;
  return file;
}

void put_segment(VolumeFile& file, std::size_t n, const std::string& name, int number, int layer,
                 const std::string& colour) {
  const std::string key = "Segment" + std::to_string(n) + "_";
  const auto put = [&](const char* field, const std::string& text) {
    file.segment_fields.emplace_back(key + field, text);
  };
  if (!name.empty()) put("Name", name);
  put("Layer", std::to_string(layer));
  put("LabelValue", std::to_string(number));
  if (!colour.empty()) put("Color", colour);
}

std::string names_in_words(const std::vector<std::string>& names) {
  constexpr std::size_t kNamed = 8;
  std::string text;
  for (std::size_t n = 0; n < std::min(names.size(), kNamed); ++n) text += (n ? ", " : "") + names[n];
  return names.size() > kNamed ? text + " and " + std::to_string(names.size() - kNamed) + " more" : text;
}

}  // namespace palpate::volume_io
