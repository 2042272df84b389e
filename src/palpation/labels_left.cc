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
  // flattened: a voxel says which segment it is
  for (Segment& segment : map.segments) {
    segment.layer = 0;
    segment.value = segment.id;
  }
  return map;
}

}  // namespace

Result<LabelsLeft> labels_left(const RecordingSource& recording, const Model& model,
                               const Progress& progress) {
  const RecordingHead& head = recording.head();
  if (auto same = check_recorded_model(head.header, model); !same) return same.error();
  RemovedVolume removed(model);
  auto carving = std::make_shared<const Carving>(model);
  // of a version that no tick is known to have felt nothing is cut yet
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
          follow(event.change, removed);
          if (!event.change.is_of_stroke()) continue;
          auto other = other_stroke(carving.get(), event.change);
          if (other == nullptr)
            return Error{ErrorKind::kBadInput, "there is no stroke that could be undone or done again", "",
                         ""};
          carving = std::move(other);
        }
        ticks += part.ticks.size();
        progress.report("cutting", static_cast<double>(ticks) / static_cast<double>(head.ticks));
        return {};
      },
      progress);
  if (!read) return read.error();
  return LabelsLeft{map_of(*carving->taken_from(model)), removed_figures(model, removed)};
}

}  // namespace palpate
