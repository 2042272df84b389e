#pragma once

#include <functional>
#include <memory>
#include <span>

#include "palpate/recording/recording.h"
#include "palpate/servo/servo_loop.h"
#include "palpate/tissue/carving.h"

/// Requests to a loop, each with its row for the recording: who asked for what. All that a session is told
/// while it runs comes to its loop this way. Any thread.
namespace palpate {

/// The row of a change of settings, without who asked and its number.
RecordingEvent settings_event(const Parameters& before, const Parameters& after);

/// As ServoLoop::change().
void change_told(ServoLoop& loop, EventLog& told, AskedBy by, const std::function<void(Parameters&)>& edit);
/// A viewer took the tip, or left it: nothing of the loop's own changes, and where there is no memory there
/// is no row.
void pointer_told(ServoLoop& loop, EventLog& told, AskedBy by) noexcept;
/// As ServoLoop::set_model(). @param change  leads to it from the version before it
void set_model_told(ServoLoop& loop, EventLog& told, AskedBy by, std::shared_ptr<const Model> model,
                    const ModelChange& change);
/// A row for a sweep of those that a version is cut by.
RecordingEvent sweep_event(const Cut& cut, std::uint32_t version);
/// A version that follows by cuts from the one before it.
void set_cut_model_told(ServoLoop& loop, EventLog& told, std::span<const Cut> cuts,
                        std::shared_ptr<const Model> model);
/// The row of a solution of tissue that yields. @param input_tick  TickRecord::tick that it was solved from
RecordingEvent yield_event(const YieldFrame& frame, std::uint64_t input_tick);
/// Tells the ticks of a solution.
void set_yield_told(ServoLoop& loop, EventLog& told, const YieldFrame& frame, std::uint64_t input_tick);
/// As ServoLoop::emergency_stop(), which is done also where there is no memory for the row.
void stop_told(ServoLoop& loop, EventLog& told, AskedBy by) noexcept;
/// As ServoLoop::rearm(); one that is not done has no row.
Rearmed rearm_told(ServoLoop& loop, EventLog& told, AskedBy by, std::uint32_t stop);

}  // namespace palpate
