#include <algorithm>

#include "palpate/model/changed_model.h"
#include "palpate/palpation/palpation.h"
#include "palpate/palpation/recorded_model.h"
#include "palpate/tissue/removed_volume.h"

namespace palpate {
namespace {

LabelMap map_of(const Model& model) {
  LabelMap map;
  map.layers.push_back(model.labels->dense());
  map.segments = model.segments;
  // flattened: a voxel's value is its segment
  for (Segment& segment : map.segments) {
    segment.layer = 0;
    segment.value = segment.id;
  }
  return map;
}

// Removes the cut voxels from all layers, from every segment with contact. Structures by threshold, which are
// in no layer, get a layer of their own.
LabelMap with_layers(const LabelMap& layers, const Model& model, LabelMap left) {
  LabelMap whole = layers;
  const std::vector<LabelId> before = model.labels->dense().voxels();
  const std::vector<LabelId>& after = left.layers.front().voxels();
  for (std::size_t layer = 0; layer < whole.layers.size(); ++layer) {
    std::vector<bool> is_touchable(65536, false);
    for (const Segment& segment : whole.segments)
      if (segment.layer == static_cast<int>(layer))
        is_touchable[segment.value] = model.is_touchable(segment.id);
    std::vector<LabelId>& voxels = whole.layers[layer].voxels();
    for (std::size_t v = 0; v < voxels.size(); ++v)
      if (before[v] != after[v] && is_touchable[voxels[v]]) voxels[v] = 0;
  }
  const auto is_elsewhere = [&](LabelId label) { return layers.find(label) != nullptr; };
  std::erase_if(left.segments, [&](const Segment& segment) { return is_elsewhere(segment.id); });
  if (left.segments.empty()) return whole;
  for (Segment& segment : left.segments) segment.layer = static_cast<int>(whole.layers.size());
  for (LabelId& voxel : left.layers.front().voxels())
    if (is_elsewhere(voxel)) voxel = 0;
  whole.layers.push_back(std::move(left.layers.front()));
  whole.segments.insert(whole.segments.end(), left.segments.begin(), left.segments.end());
  std::ranges::sort(whole.segments, {}, &Segment::id);
  return whole;
}

}  // namespace

Result<RemainingLabels> remaining_labels(const RecordingSource& recording, const Model& model,
                                         const LabelMap* layers, const Progress& progress) {
  const RecordingHead& head = recording.head();
  if (auto same = check_recorded_model(head.header, model); !same) return same.error();
  RemovedVolume removed(model);
  auto carving = std::make_shared<const Carving>(model);
  // cuts of a version that no recorded tick used are not applied
  std::vector<Cut> waiting;
  std::uint64_t ticks = 0;
  const auto read = recording.read(
      [&](const RecordingPart& part) -> Result<void> {
        for (const RecordingEvent& event : part.events) {
          if (event.kind == RecordingEvent::Kind::kSweep) waiting.push_back(cut_of(event.sweep));
          if (event.kind != RecordingEvent::Kind::kModel) continue;
          if (event.change.tissue == ModelChange::kCut) {
            carving = carving->with(waiting);
            removed.add(waiting);
            waiting.clear();
          }
          apply_stroke_change(event.change, removed);
          if (!event.change.is_of_stroke()) continue;
          auto other = carving_after(carving.get(), event.change);
          if (other == nullptr)
            return Error{ErrorKind::kBadInput, "there is no stroke to undo or redo", "", ""};
          carving = std::move(other);
        }
        ticks += part.ticks.size();
        progress.report("cutting", static_cast<double>(ticks) / static_cast<double>(head.ticks));
        return {};
      },
      progress);
  if (!read) return read.error();
  LabelMap left = map_of(*carving->applied_to(model));
  if (layers != nullptr && layers->layers.size() > 1) left = with_layers(*layers, model, std::move(left));
  return RemainingLabels{std::move(left), removed_figures(model, removed)};
}

}  // namespace palpate
