#include "palpate/palpation/virtual_run.h"

#include <utility>

#include "palpate/loading/loading.h"
#include "palpate/model/changed_model.h"
#include "palpate/palpation/logged_loop.h"

namespace palpate {

namespace {

// period at which a session's cutter thread would remove the swept volume
constexpr double kCutEvery_s = 0.02;

}  // namespace

VirtualRun::VirtualRun(std::shared_ptr<const Model> model, const RunSetup& setup, ScriptedHand hand,
                       Progress progress)
    : model_(std::move(model)),
      dt_s_(1 / setup.script.rate_hz),
      hand_(std::move(hand)),
      device_(setup.device, setup.hand, setup.script.delay_s),
      mapping_(device_.info(), setup.workspace),
      parameters_(setup.parameters),
      solver_(setup.script.rate_hz),
      progress_(std::move(progress)) {
  device_.reset(mapping_.to_device(hand_.start()));
  if (has_scope(setup.script)) scope_.emplace(*model_, hand_.start());
}

const TickRecord& VirtualRun::tick() {
  const std::size_t devices = scope_ ? 2 : 1;
  sensed_[0] = mapping_.to_world(device_.read(), 0);
  if (scope_) sensed_[1] = scope_->state();
  const TickRecord* const before = state_.tick > 0 ? &record_ : nullptr;
  // solved with the model of the previous tick, as in a replay
  const bool is_deformable =
      before != nullptr && is_elastic(last_model_->tissue_law) && last_model_->has(ForceMethod::kProxy);
  if (is_deformable ? solver_.advance(*last_model_, before) : solver_.publish_pending()) {
    parameters_.compliance = solver_.frame();
    events_.push_back(solution_event(solver_.frame(), solver_.input_tick()));
    events_.back().tick = state_.tick;
  }
  cut();
  palpate::tick(*model_, parameters_, {sensed_.data(), devices}, dt_s_, state_, {sent_.data(), devices},
                record_);
  last_model_ = model_;
  return record_;
}

// removes the swept volume from this tick on, then carries out a stroke request of the script
void VirtualRun::cut() {
  if (state_.time_s - cut_s_ < kCutEvery_s) return;
  cut_s_ = state_.time_s;
  remove_swept_volume();
  if (const auto action = std::exchange(stroke_, std::nullopt)) change_stroke(*action);
}

void VirtualRun::remove_swept_volume() {
  std::vector<Cut> cuts = finished_cuts(state_.device[0].burr, 0);
  if (scope_)
    for (const Cut& cut : finished_cuts(state_.device[1].burr, 1)) cuts.push_back(cut);
  if (cuts.empty()) return;
  model_ = carved_with_fragments(*model_, cuts)->applied_to(*model_);
  for (const Cut& cut : cuts) events_.push_back(sweep_event(cut, model_->version));
  RecordingEvent& event = events_.emplace_back();
  event.number = model_->version;
  event.change = {model_->version, ModelChange::kCut};
  for (std::size_t row = events_.size() - cuts.size() - 1; row < events_.size(); ++row)
    events_[row].tick = state_.tick;
}

void VirtualRun::change_stroke(StrokeAction action) {
  const ModelChange change = change_of_stroke(*model_, action);
  const auto carving = carving_after(model_->carving.get(), change);
  stroke_version_ = carving != nullptr ? change.version : 0;
  if (carving == nullptr) return;
  model_ = carving->applied_to(*model_);
  RecordingEvent& event = events_.emplace_back();
  event.tick = state_.tick;
  event.by = {Originator::kScript};
  event.number = change.version;
  event.change = change;
}

// the law was checked when the script was read; only building its surfaces can fail
void VirtualRun::change_law(TissueLaw law) {
  law_version_ = model_->version;
  if (law == model_->tissue_law) return;
  const ModelChange change = change_of_law(*model_, law);
  auto next = next_version({model_, model_}, change, {}, progress_, *cached_preparation());
  law_version_ = next ? change.version : 0;
  if (!next) return;
  model_ = std::move(next->current);
  RecordingEvent& event = events_.emplace_back();
  event.tick = state_.tick;
  event.by = {Originator::kScript};
  event.number = change.version;
  event.change = change;
}

bool VirtualRun::act() {
  HandCommands commands{parameters_.rotation_target, {}, {}, {}, {}, stroke_version_, law_version_};
  commands.scope_is_there = scope_ && scope_->is_there();
  const auto intention = hand_.next(record_, dt_s_, commands);
  if (!intention) return false;
  if (commands.scope) scope_->aim(*commands.scope);
  if (scope_) scope_->advance(record_, dt_s_);
  if (commands.stroke) {
    stroke_ = commands.stroke;
    stroke_version_.reset();
  }
  if (commands.law) change_law(*commands.law);
  const bool turned = commands.rotation_target.coeffs() != parameters_.rotation_target.coeffs();
  if (turned || commands.method || commands.motor) {
    const Parameters before = parameters_;
    parameters_.rotation_target = commands.rotation_target;
    if (commands.method) parameters_.method = *commands.method;
    if (commands.motor) parameters_.motor = *commands.motor;
    RecordingEvent& event = events_.emplace_back(settings_event(before, parameters_));
    event.tick = state_.tick;
    event.by = {Originator::kScript};
    event.number = ++reported_number_;
  }
  intended_ = *intention;
  device_.intend(mapping_.to_device(intended_));
  device_.advance(mapping_.to_device(sent_[0]), dt_s_);
  return true;
}

}  // namespace palpate
