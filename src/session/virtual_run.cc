#include "session/virtual_run.h"

#include "session/told_loop.h"

namespace palpate {

VirtualRun::VirtualRun(const Model& model, const RunSetup& setup, ScriptedHand hand)
    : model_(model),
      dt_s_(1 / setup.script.rate_hz),
      hand_(std::move(hand)),
      device_(setup.device, setup.hand, setup.script.delay_s),
      mapping_(device_.info(), setup.workspace),
      parameters_(setup.parameters) {
  device_.reset(mapping_.to_device(hand_.start()));
}

const TickRecord& VirtualRun::tick() {
  sensed_ = mapping_.to_world(device_.read(), 0);
  palpate::tick(model_, parameters_, {&sensed_, 1}, dt_s_, state_, {&sent_, 1}, record_);
  return record_;
}

bool VirtualRun::act() {
  HandCommands commands{parameters_.rotation_target, {}};
  const auto intention = hand_.next(record_, dt_s_, commands);
  if (!intention) return false;
  const bool turned = commands.rotation_target.coeffs() != parameters_.rotation_target.coeffs();
  if (turned || commands.method) {
    const Parameters before = parameters_;
    parameters_.rotation_target = commands.rotation_target;
    if (commands.method) parameters_.method = *commands.method;
    RecordingEvent& event = told_.emplace_back(settings_event(before, parameters_));
    event.tick = state_.tick;
    event.by = {Asker::kScript};
    event.number = ++told_number_;
  }
  intended_ = *intention;
  device_.intend(mapping_.to_device(intended_));
  device_.advance(mapping_.to_device(sent_), dt_s_);
  return true;
}

}  // namespace palpate
