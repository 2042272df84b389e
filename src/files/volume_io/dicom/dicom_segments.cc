#include "volume_io/dicom/dicom_segments.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <set>

namespace palpate::volume_io {

DicomSegmentation join_segmentations(std::vector<DicomSegmentation> files) {
  DicomSegmentation all = std::move(files.front());
  std::map<std::string, int> offset_of_concatenation;
  if (!all.concatenation_uid.empty()) offset_of_concatenation.emplace(all.concatenation_uid, 0);
  const auto highest = [](const std::vector<DicomSegment>& segments) {
    int number = 0;
    for (const DicomSegment& segment : segments) number = std::max(number, segment.number);
    return number;
  };
  for (std::size_t n = 1; n < files.size(); ++n) {
    DicomSegmentation& file = files[n];
    const auto known = offset_of_concatenation.find(file.concatenation_uid);
    const bool continues = known != offset_of_concatenation.end();
    const bool repeats = std::ranges::any_of(file.segments, [&](const DicomSegment& segment) {
      return std::ranges::any_of(all.segments,
                                 [&](const DicomSegment& other) { return other.number == segment.number; });
    });
    const int offset = continues ? known->second : repeats ? highest(all.segments) : 0;
    if (!file.concatenation_uid.empty()) offset_of_concatenation.emplace(file.concatenation_uid, offset);
    for (DicomSegment& segment : file.segments) {
      if (continues) break;
      segment.number += offset;
      all.segments.push_back(std::move(segment));
    }
    for (std::size_t f = 0; f < file.frames.size(); ++f) {
      file.frames[f].file = static_cast<std::uint32_t>(n);
      const bool labels = file.codings.front().kind == SegmentCoding::Kind::kLabels;
      all.segment_of_frame.push_back(labels ? 0 : file.segment_of_frame[f] + offset);
      all.frames.push_back(std::move(file.frames[f]));
    }
    file.codings.front().number_offset = offset;
    all.codings.push_back(file.codings.front());
    if (!all.slice_spacing_mm) all.slice_spacing_mm = file.slice_spacing_mm;
  }
  return all;
}

std::vector<int> layers_of_segments(std::size_t segments, const std::vector<std::pair<int, int>>& overlaps) {
  std::vector<int> layers(segments, -1);
  for (std::size_t n = 0; n < segments; ++n) {
    std::set<int> used;
    for (const auto& [one, other] : overlaps) {
      if (one == static_cast<int>(n)) used.insert(layers[static_cast<std::size_t>(other)]);
      if (other == static_cast<int>(n)) used.insert(layers[static_cast<std::size_t>(one)]);
    }
    int layer = 0;
    while (used.contains(layer)) ++layer;
    layers[n] = layer;
  }
  return layers;
}

}  // namespace palpate::volume_io
