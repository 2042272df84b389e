#include "session/cutter.h"

#include <array>
#include <chrono>
#include <exception>
#include <string>
#include <utility>

#include "palpate/base/spsc_ring.h"
#include "session/refusal.h"

namespace palpate {
namespace {

// longest time that swept volume waits before it is removed from the surfaces
constexpr auto kCutPoll = std::chrono::milliseconds(10);

}  // namespace

Cutter::Cutter(LiveModel& model, SessionLoop& loop)
    : model_(model),
      loop_(loop),
      first_(model.versions(model.lock()).current),
      removed_(*first_),
      nearest_(*first_) {}

void Cutter::begin(bool threads) {
  if (threads && first_->has_burr()) thread_ = std::thread([this] { run(); });
}

void Cutter::end() {
  ending_.store(true);
  if (thread_.joinable()) thread_.join();
}

void Cutter::run() {
  while (!ending_.load()) {
    std::this_thread::sleep_for(kCutPoll);
    cut_and_change();
  }
}

void Cutter::run_step(Clock::time_point now) {
  if (thread_.joinable() || ending_ || !first_->has_burr() || now < due_) return;
  due_ = now + kCutPoll;
  cut_and_change();
}

void Cutter::cut_and_change() noexcept try {
  ServoLoop& loop = *loop_.get();
  std::array<SweepRecord, 64> swept;
  // sampled before the sweeps are popped, so that the sweeps of a stroke that had ended by then are complete
  const bool stroke_is_over = !motor_was_on(*first_, loop.snapshot());
  for (std::size_t count = loop.sweeps().pop(swept); count > 0; count = loop.sweeps().pop(swept))
    for (const SweepRecord& sweep : std::span(swept).first(count)) taken_.push_back(cut_of(sweep));
  if (!taken_.empty()) cut(std::exchange(taken_, {}));
  if (stroke_is_over) change_strokes();
} catch (const std::exception&) {
  // Out of memory: the burr waits for its sweeps to be removed and cuts nothing meanwhile. No stroke is
  // undone.
}

void Cutter::cut(std::vector<Cut> cuts) {
  const std::shared_ptr<const Model> before = model_.versions(model_.lock()).current;
  auto carving = carved_with_fragments(*before, cuts);
  const LiveModel::Lock lock = model_.lock();
  const Model& model = model_.current(lock);
  // the law may have changed meanwhile and brought new surfaces, from which these cuts are still missing
  if (has_other_surfaces(*before, model.tissue_law)) carving = carved_by(model, cuts);
  // operations that may throw come first; repeating them is harmless
  cuts_.reserve(cuts.size());
  for (const Cut& cut : cuts)
    if (cut.device != Cut::kBrokenOff) nearest_.observe(cut.sweep);
  removed_.add(cuts);
  auto next = carving->applied_to(model);
  const std::uint32_t version = next->version;
  model_.apply_cuts(lock, cuts, std::move(next));
  for (const Cut& cut : cuts) cuts_.add(version, record_of(cut));
}

void Cutter::change_strokes() {
  const LiveModel::Lock lock = model_.lock();
  while (!queued_.empty()) {
    const QueuedChange queued = queued_.front();
    queued_.pop_front();
    const bool by_script = queued.by.originator == Originator::kScript;
    if (by_script) script_version_ = 0;
    // a stroke has begun since the request, so the request does not refer to the last one
    if (queued.change.strokes != loop_.get()->strokes()) continue;
    const ModelChange change = change_of_stroke(model_.current(lock), queued.change.action);
    cuts_.reserve(0);
    auto next = next_version(model_.versions(lock), change);
    if (!next) continue;
    model_.apply(lock, *std::move(next), change, queued.by);
    if (by_script) script_version_ = change.version;
    cuts_.add(change.version, queued.change.action);
    apply_stroke_change(change, removed_);
  }
}

// strokes that can still be undone or redone once the queued requests have been carried out
std::ptrdiff_t Cutter::available_strokes(const LiveModel::Lock& lock, StrokeAction action) const {
  const Carving* const carving = model_.current(lock).carving.get();
  if (carving == nullptr) return 0;
  auto remaining = static_cast<std::ptrdiff_t>(action == StrokeAction::kUndo ? carving->strokes_to_undo()
                                                                             : carving->strokes_to_redo());
  for (const QueuedChange& queued : queued_) remaining += queued.change.action == action ? -1 : 1;
  return remaining;
}

Result<void> Cutter::check(const LiveModel::Lock& lock, const StrokeChange& change,
                           const Parameters& now) const {
  const ServoLoop& loop = *loop_.get();
  if (now.motor || motor_was_on(*first_, loop.snapshot()))
    return refusal("the motor is running, and the stroke is not finished", "motor",
                   "switch off the motor, or release its pedal, first");
  if (loop.strokes() != change.strokes)
    return refusal("another stroke was started after the request", "", "repeat the request for that stroke");
  if (available_strokes(lock, change.action) > 0) return {};
  return change.action == StrokeAction::kUndo
             ? refusal("there is no stroke to undo", "",
                       "a stroke is everything cut between start and stop of the motor; the last " +
                           std::to_string(kMaxUndoneStrokes) + " are kept")
             : refusal("there is no stroke to redo", "", "cutting after an undo discards the undone strokes");
}

void Cutter::request(const LiveModel::Lock& /*held*/, const StrokeChange& change, RequestedBy by) {
  queued_.push_back({change, by});
}

void Cutter::request_by_script(StrokeAction action) {
  const ServoLoop* const loop = loop_.get();
  const LiveModel::Lock lock = model_.lock();
  script_version_ = 0;
  if (!loop || !first_->has_burr()) return;
  request(lock, {action, loop->strokes()}, {Originator::kScript});
  script_version_.reset();
}

std::optional<std::uint32_t> Cutter::script_version() const {
  const LiveModel::Lock lock = model_.lock();
  return script_version_;
}

std::vector<SweepRecord> Cutter::sweeps(std::uint32_t version, std::uint64_t first,
                                        std::size_t max_count) const {
  const LiveModel::Lock lock = model_.lock();
  return cuts_.sweeps_at(version, static_cast<std::size_t>(first), max_count);
}

void Cutter::describe(const LiveModel::Lock& lock, const std::map<LabelId, double>& nearest_mm,
                      ViewedState& state) const {
  const Model& model = model_.current(lock);
  state.sweeps = cuts_.count_at(model.version);
  state.undone_to = cuts_.undone_to(model.version);
  if (const Carving* const carving = model.carving.get()) {
    state.strokes_to_undo = carving->strokes_to_undo();
    state.strokes_to_redo = carving->strokes_to_redo();
  }
  state.removed_mm3 = removed_.by_label_mm3();
  state.broken_off_mm3 = removed_.broken_off_mm3();
  ProtectedDistanceMeter nearest = nearest_;
  nearest.observe(nearest_mm);
  state.nearest_mm = nearest.nearest_mm();
}

}  // namespace palpate
