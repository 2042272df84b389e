#include "session/stop_switch.h"

#include "palpate/palpation/logged_loop.h"
#include "session/originator.h"
#include "session/refusal.h"

namespace palpate {
namespace {

StoppedBy stopped_by(Originator originator) {
  switch (originator) {
    case Originator::kSession:
    case Originator::kScript:
      return StoppedBy::kSession;
    case Originator::kKey:
      return StoppedBy::kKey;
    case Originator::kControlViewer:
    case Originator::kViewingViewer:
    case Originator::kViewerWithConsent:
      return StoppedBy::kViewer;
  }
  return StoppedBy::kSession;
}

}  // namespace

void StopSwitch::begin() {
  const std::lock_guard lock(mutex_);
  if (stopped_early_.load()) stop_logged(*loop_.get(), loop_.log(), requested_by_);
}

void StopSwitch::stop(RequestedBy by) {
  const std::lock_guard lock(mutex_);
  requested_by_ = by;
  if (ServoLoop* loop = loop_.get()) return stop_logged(*loop, loop_.log(), by);
  stopped_early_.store(true);
}

std::optional<std::uint32_t> StopSwitch::current() const {
  const ServoLoop* loop = loop_.get();
  const Arming arming = loop ? loop->arming() : Arming{0, stopped_early_.load()};
  return arming.stopped ? std::optional(arming.number) : std::nullopt;
}

void StopSwitch::describe(ViewedState& state) const {
  const std::lock_guard lock(mutex_);
  state.stop = current();
  state.stopped_by = stopped_by(requested_by_.originator);
  state.stopped_by_viewer = requested_by_.viewer;
  state.armed = physical_ && loop_.get() != nullptr && !state.stop;
}

Result<void> StopSwitch::rearm(const RearmRequest& request) {
  if (physical_ && request.code.empty())
    return refusal("a force-feedback device must be rearmed at the device, not remotely", "",
                   "press r at the terminal of palpate with the tip free, or enter the code shown there");
  if (physical_ && !arming_code_.redeem(request.stop, request.code))
    return refusal("the code differs from the one shown at the terminal of palpate", "code",
                   "each code is valid once, for a minute and for the last stop: enter the current one");
  return rearm(request.stop, requested_by(request.by));
}

Result<void> StopSwitch::rearm(std::uint32_t stop, RequestedBy by) {
  ServoLoop* loop = loop_.get();
  if (!loop) return not_running();
  switch (rearm_logged(*loop, loop_.log(), by, stop)) {
    case RearmResult::kNotStopped:
      return refusal("the force is not stopped", "stop", "");
    case RearmResult::kStoppedAgain:
      return refusal("there was another stop after the one to rearm from", "stop",
                     "check the reason, and rearm again");
    case RearmResult::kNotApplied:
      return refusal("the stop has not taken effect yet", "stop", "try again in a moment");
    case RearmResult::kTouching:
      return refusal("the tip is in contact", "", "move it to free space, then rearm");
    case RearmResult::kDone:
      break;
  }
  return {};
}

std::string StopSwitch::arming_code() {
  const auto stop = current();
  return stop && physical_ ? arming_code_.code_for(*stop) : std::string();
}

}  // namespace palpate
