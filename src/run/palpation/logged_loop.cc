#include "palpate/palpation/logged_loop.h"

#include "palpate/base/check.h"

#include <exception>
#include <utility>

namespace palpate {
namespace {

RecordingEvent arming(RecordingEvent::Kind kind, RequestedBy by, std::uint32_t number) {
  RecordingEvent event;
  event.kind = kind;
  event.by = by;
  event.number = number;
  return event;
}

}  // namespace

RecordingEvent settings_event(const Parameters& before, const Parameters& after) {
  RecordingEvent event;
  event.kind = RecordingEvent::Kind::kSettings;
  event.changed = changed_settings(before, after);
  record_settings(after, event);
  return event;
}

void change_logged(ServoLoop& loop, EventLog& log, RequestedBy by,
                   const std::function<void(Parameters&)>& edit) {
  log.append([&] {
    RecordingEvent event;
    const std::uint32_t number = loop.change([&](Parameters& parameters) {
      const Parameters before = parameters;
      edit(parameters);
      event = settings_event(before, parameters);
    });
    event.by = by;
    event.number = number;
    return event;
  });
}

void log_pointer_change(ServoLoop& loop, EventLog& log, RequestedBy by) noexcept {
  try {
    log.append([&] {
      RecordingEvent event;
      const std::uint32_t number =
          loop.change([&](Parameters& parameters) { event = settings_event(parameters, parameters); });
      event.changed = kSettingPointer;
      event.by = by;
      event.number = number;
      return event;
    });
  } catch (const std::exception&) {
  }
}

void set_model_logged(ServoLoop& loop, EventLog& log, RequestedBy by, std::shared_ptr<const Model> model,
                      const ModelChange& change) {
  log.append([&] {
    RecordingEvent event;
    event.by = by;
    event.number = change.version;
    event.change = change;
    PALPATE_CHECK(loop.set_model(std::move(model)).ok());
    return event;
  });
}

RecordingEvent sweep_event(const Cut& cut, std::uint32_t version) {
  RecordingEvent event;
  event.kind = RecordingEvent::Kind::kSweep;
  event.number = version;
  event.sweep = record_of(cut);
  return event;
}

void set_cut_model_logged(ServoLoop& loop, EventLog& log, std::span<const Cut> cuts,
                          std::shared_ptr<const Model> model) {
  const std::uint32_t version = model->version;
  for (const Cut& cut : cuts) log.append([&] { return sweep_event(cut, version); });
  set_model_logged(loop, log, {}, std::move(model), {version, ModelChange::kCut});
}

RecordingEvent solution_event(const ComplianceFrame& frame, std::uint64_t input_tick) {
  RecordingEvent event;
  event.kind = RecordingEvent::Kind::kTissueSolution;
  event.number = frame.number;
  event.input_tick = input_tick;
  event.frame_hash = frame.hash();
  return event;
}

void set_solution_logged(ServoLoop& loop, EventLog& log, const ComplianceFrame& frame,
                         std::uint64_t input_tick) {
  log.append([&] {
    loop.change([&](Parameters& parameters) { parameters.compliance = frame; });
    return solution_event(frame, input_tick);
  });
}

void set_unsolved_logged(ServoLoop& loop, EventLog& log, const ComplianceFrame& frame,
                         std::uint64_t input_tick) {
  log.append([&] {
    RecordingEvent event = solution_event(frame, input_tick);
    event.frame_hash = RecordingEvent::kUnsolved;
    loop.change([&](Parameters& parameters) { parameters.compliance = frame; });
    return event;
  });
}

void stop_logged(ServoLoop& loop, EventLog& log, RequestedBy by) noexcept {
  bool stopped = false;
  try {
    log.append([&] {
      const std::uint32_t number = loop.emergency_stop();
      stopped = true;
      return arming(RecordingEvent::Kind::kStop, by, number);
    });
  } catch (const std::exception&) {
    if (!stopped) loop.emergency_stop();
  }
}

RearmResult rearm_logged(ServoLoop& loop, EventLog& log, RequestedBy by, std::uint32_t stop) {
  RearmResult rearmed = RearmResult::kNotStopped;
  log.append([&]() -> std::optional<RecordingEvent> {
    std::uint32_t number = 0;
    rearmed = loop.rearm(stop, number);
    if (rearmed != RearmResult::kDone) return std::nullopt;
    return arming(RecordingEvent::Kind::kRearm, by, number);
  });
  return rearmed;
}

}  // namespace palpate
