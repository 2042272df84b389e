#include "session/recorded_edits.h"

#include <algorithm>
#include <span>

#include "palpate/tissue/carving.h"
#include "palpate/tissue/removed_volume.h"

namespace palpate {
namespace {

// an hour of uninterrupted milling; later sweeps are not shown
constexpr std::size_t kMaxShownSweeps = 1'000'000;

}  // namespace

void RecordedEdits::on_event(const RecordingEvent& event) {
  const bool is_sweep = event.kind == RecordingEvent::Kind::kSweep;
  if (!is_sweep && event.kind != RecordingEvent::Kind::kModel) return;
  // versions ascend, whatever an untrusted file contains
  last_version = std::max(last_version, event.number);
  const bool is_shown = cuts.sweeps().size() < kMaxShownSweeps && cuts.changes().size() < kMaxShownSweeps;
  if (is_sweep && is_shown) cuts.add(last_version, event.sweep);
  if (is_sweep) return;
  if (event.change.is_of_tissue()) tissues.push_back(event.change);
  laws.on_event(event.change);
  if (event.change.is_of_stroke() && is_shown)
    cuts.add(last_version,
             event.change.tissue == ModelChange::kUndo ? StrokeAction::kUndo : StrokeAction::kRedo);
}

Result<void> compute_removed_volumes(const Model& model, const Progress& progress, RecordedEdits& edits) {
  RemovedVolume removed(model);
  const std::span<const SweepRecord> sweeps = edits.cuts.sweeps();
  const std::span<const std::uint32_t> versions = edits.cuts.versions();
  const std::span<const CutList::Change> changes = edits.cuts.changes();
  auto change = changes.begin();
  for (std::size_t n = 0;; ++n) {
    for (; change != changes.end() && change->sweeps == n; ++change) {
      change->action == StrokeAction::kUndo ? removed.undo() : removed.redo();
      edits.removed.push_back({change->version, removed.by_label_mm3(), removed.broken_off_mm3()});
    }
    if (n == sweeps.size()) return {};
    const Cut cut = cut_of(sweeps[n]);
    removed.add({&cut, 1});
    if (n + 1 < sweeps.size() && versions[n + 1] == versions[n]) continue;
    if (progress.stopped()) return Progress::interrupted();
    progress.report("computing the removed volume",
                    static_cast<double>(n + 1) / static_cast<double>(sweeps.size()));
    edits.removed.push_back({versions[n], removed.by_label_mm3(), removed.broken_off_mm3()});
  }
}

}  // namespace palpate
