#include "palpate/volume/overlaps.h"

#include <algorithm>
#include <map>
#include <set>
#include <tuple>

namespace palpate {
namespace {

constexpr std::size_t kNoSegment = SIZE_MAX;

/// Calls `visit(voxel, places)` for each voxel of at least one segment, with the segments' places in
/// LabelMap::segments.
template <class Visit>
void for_each_labelled_voxel(const LabelMap& labels, const Visit& visit) {
  std::vector<std::vector<std::size_t>> segments_of_value(labels.layers.size());
  for (std::size_t index = 0; index < labels.segments.size(); ++index) {
    const Segment& segment = labels.segments[index];
    std::vector<std::size_t>& of_layer = segments_of_value[static_cast<std::size_t>(segment.layer)];
    if (of_layer.size() <= segment.value) of_layer.resize(segment.value + 1u, kNoSegment);
    of_layer[segment.value] = index;
  }
  std::vector<std::size_t> indices;
  for (std::size_t voxel = 0; voxel < labels.geometry().voxel_count(); ++voxel) {
    indices.clear();
    for (std::size_t layer = 0; layer < labels.layers.size(); ++layer) {
      const LabelId value = labels.layers[layer].voxels()[voxel];
      const std::vector<std::size_t>& of_layer = segments_of_value[layer];
      if (value != 0 && value < of_layer.size() && of_layer[value] != kNoSegment)
        indices.push_back(of_layer[value]);
    }
    if (!indices.empty()) visit(voxel, std::span<const std::size_t>(indices));
  }
}

std::vector<std::size_t> voxel_counts(const LabelMap& labels) {
  std::vector<std::size_t> counts(labels.segments.size());
  for_each_labelled_voxel(labels, [&](std::size_t, std::span<const std::size_t> segments) {
    for (const std::size_t index : segments) ++counts[index];
  });
  return counts;
}

/// Order of segments by size, the same for any order of layers.
class SmallerSegment {
 public:
  explicit SmallerSegment(const LabelMap& labels) : labels_(labels), counts_(voxel_counts(labels)) {}
  bool operator()(std::size_t one, std::size_t other) const { return key(one) < key(other); }
  std::size_t voxels(std::size_t index) const { return counts_[index]; }

 private:
  std::tuple<std::size_t, const std::string&, LabelId> key(std::size_t index) const {
    const Segment& segment = labels_.segments[index];
    return {counts_[index], segment.name, segment.id};
  }
  const LabelMap& labels_;
  const std::vector<std::size_t> counts_;
};

}  // namespace

std::vector<SegmentOverlap> segment_overlaps(const LabelMap& labels) {
  if (labels.layers.size() < 2) return {};
  const SmallerSegment is_smaller(labels);
  std::map<std::pair<std::size_t, std::size_t>, std::size_t> shared;
  for_each_labelled_voxel(labels, [&](std::size_t, std::span<const std::size_t> segments) {
    for (std::size_t a = 0; a < segments.size(); ++a)
      for (std::size_t b = a + 1; b < segments.size(); ++b)
        ++shared[std::minmax(segments[a], segments[b], is_smaller)];
  });
  std::vector<SegmentOverlap> overlaps;
  for (const auto& [pair, voxels] : shared)
    overlaps.push_back({labels.segments[pair.first].id, labels.segments[pair.second].id, voxels,
                        static_cast<double>(voxels) / static_cast<double>(is_smaller.voxels(pair.first))});
  std::ranges::sort(overlaps, {}, [](const SegmentOverlap& o) { return std::pair(o.smaller, o.larger); });
  return overlaps;
}

std::vector<std::vector<LabelId>> enclosing_segments(std::span<const SegmentOverlap> overlaps) {
  std::vector<std::vector<LabelId>> enclosing;
  std::set<std::pair<LabelId, LabelId>> ordered;
  for (const SegmentOverlap& overlap : overlaps) {
    ordered.emplace(overlap.smaller, overlap.larger);
    if (!overlap.is_nested()) continue;
    if (overlap.smaller >= enclosing.size()) enclosing.resize(overlap.smaller + 1u);
    enclosing[overlap.smaller].push_back(overlap.larger);
  }
  // two segments that hold 0.9 of a third one each share voxels, so that every pair of them has an overlap
  static_assert(kNestedFraction > 0.5);
  for (std::vector<LabelId>& larger : enclosing)
    std::ranges::sort(larger, [&](LabelId a, LabelId b) { return ordered.contains({a, b}); });
  return enclosing;
}

Volume<LabelId> flatten(const LabelMap& labels, std::span<const SegmentOverlap> overlaps,
                        std::span<const std::uint16_t> preference) {
  const std::vector<Segment>& segments = labels.segments;
  const auto index_of = [&](LabelId id) {
    return static_cast<std::size_t>(labels.find(id) - segments.data());
  };
  std::vector<std::vector<bool>> is_nested_in(segments.size(), std::vector<bool>(segments.size()));
  for (const SegmentOverlap& overlap : overlaps)
    if (overlap.is_nested() && preference[overlap.smaller] > 0)
      is_nested_in[index_of(overlap.smaller)][index_of(overlap.larger)] = true;
  const SmallerSegment is_smaller(labels);
  const auto goes_before = [&](std::size_t one, std::size_t other) {
    const auto preferred = preference[segments[one].id], others = preference[segments[other].id];
    return preferred != others ? preferred > others : is_smaller(one, other);
  };

  Volume<LabelId> flat(labels.geometry());
  for_each_labelled_voxel(labels, [&](std::size_t voxel, std::span<const std::size_t> indices) {
    std::size_t best = kNoSegment;
    for (const std::size_t index : indices) {
      const bool has_nested =
          std::ranges::any_of(indices, [&](std::size_t other) { return is_nested_in[other][index]; });
      if (!has_nested && (best == kNoSegment || goes_before(index, best))) best = index;
    }
    flat.voxels()[voxel] = segments[best].id;
  });
  return flat;
}

}  // namespace palpate
