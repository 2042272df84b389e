#pragma once

#include <functional>
#include <memory>
#include <span>

#include "palpate/device/model_change.h"
#include "palpate/recording/event_log.h"
#include "palpate/recording/recording.h"
#include "palpate/servo/servo_loop.h"
#include "palpate/tissue/carving.h"

/// Commands to a loop that are logged for the recording together with their originator. All external commands
/// of a session reach its loop by these functions. Thread-safe.
namespace palpate {

/// Event of a change of settings, without originator and number.
RecordingEvent settings_event(const Parameters& before, const Parameters& after);

/// ServoLoop::change(), logged.
void change_logged(ServoLoop& loop, EventLog& log, RequestedBy by,
                   const std::function<void(Parameters&)>& edit);
/// Logs that a viewer took or released the pointer. The loop's settings do not change; without memory no
/// event is logged.
void log_pointer_change(ServoLoop& loop, EventLog& log, RequestedBy by) noexcept;
/// ServoLoop::set_model(), logged.
/// @param change  change that leads to the model from the previous version
void set_model_logged(ServoLoop& loop, EventLog& log, RequestedBy by, std::shared_ptr<const Model> model,
                      const ModelChange& change);
/// Event of a sweep that is removed in a version.
RecordingEvent sweep_event(const Cut& cut, std::uint32_t version);
/// Sets and logs a version that differs from the previous one by cuts.
void set_cut_model_logged(ServoLoop& loop, EventLog& log, std::span<const Cut> cuts,
                          std::shared_ptr<const Model> model);
/// Event of a tissue solution.
/// @param input_tick  TickRecord::tick from which it was solved
RecordingEvent solution_event(const ComplianceFrame& frame, std::uint64_t input_tick);
/// Passes a tissue solution to the loop, logged.
void set_solution_logged(ServoLoop& loop, EventLog& log, const ComplianceFrame& frame,
                         std::uint64_t input_tick);
/// Passes a frame without any known local compliance to the loop, in place of one that could not be solved;
/// logged.
void set_unsolved_logged(ServoLoop& loop, EventLog& log, const ComplianceFrame& frame,
                         std::uint64_t input_tick);
/// ServoLoop::emergency_stop(), logged. The stop is carried out even if there is no memory for the event.
void stop_logged(ServoLoop& loop, EventLog& log, RequestedBy by) noexcept;
/// ServoLoop::rearm(), logged unless refused.
RearmResult rearm_logged(ServoLoop& loop, EventLog& log, RequestedBy by, std::uint32_t stop);

}  // namespace palpate
