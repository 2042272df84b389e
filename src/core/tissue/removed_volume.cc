#include "palpate/tissue/removed_volume.h"

#include <bit>
#include <utility>

#include "tissue/swept_voxels.h"

namespace palpate {

RemovedVolume::RemovedVolume(const Model& model)
    : labels_(model.labels),
      is_cuttable_(cuttable_labels(model)),
      remaining_{SweptSamples(labels_.get()), {}, 0} {}

void RemovedVolume::add(std::span<const Cut> cuts) {
  for (const Cut& cut : cuts) {
    if (!strokes_.continues(cut.sweep.stroke)) strokes_.begin(cut.sweep.stroke, {remaining_, std::nullopt});
    for (const auto& [i, j, k, samples] : remaining_.swept.add(cut.sweep, *labels_, is_cuttable_)) {
      const auto count = static_cast<std::uint64_t>(std::popcount(samples));
      remaining_.sample_counts[labels_->at(i, j, k)] += count;
      if (cut.device == Cut::kBrokenOff) remaining_.broken_off_samples += count;
    }
  }
}

bool RemovedVolume::undo() {
  Stroke* const stroke = strokes_.undo();
  if (stroke == nullptr) return false;
  if (!stroke->after) stroke->after = std::move(remaining_);
  remaining_ = stroke->before;
  return true;
}

bool RemovedVolume::redo() {
  const Stroke* const stroke = strokes_.redo();
  if (stroke == nullptr) return false;
  remaining_ = *stroke->after;
  return true;
}

std::map<LabelId, double> RemovedVolume::by_label_mm3() const {
  std::map<LabelId, double> volumes;
  for (const auto& [label, samples] : remaining_.sample_counts)
    if (samples > 0) volumes[label] = static_cast<double>(samples) * sample_mm3(geometry());
  return volumes;
}

double RemovedVolume::broken_off_mm3() const {
  return static_cast<double>(remaining_.broken_off_samples) * sample_mm3(geometry());
}

}  // namespace palpate
