#include "explore_status.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "apps/command/text.h"
#include "palpate/base/printable.h"
#include "palpate/device/rendered_stiffness.h"
#include "palpate/device/session_settings.h"

namespace palpate::app {
namespace {

void note_scheduling(const ExploreStatus& status, bool requested, Console& console) {
  const Scheduling& scheduling = status.scheduling;
  console.note("scheduler: " + scheduling.scheduler);
  for (const TickingThread& follower : status.followers)
    console.note("scheduler of " + follower.device + ": " + follower.scheduler);
  console.note("memory: " + scheduling.memory);
  console.note("watchdog: " + scheduling.watchdog);
  console.note("supervisor: " + (status.supervisor.empty() ? "none (--no-supervisor)" : status.supervisor));
  if (requested && !(scheduling.realtime && scheduling.memory_locked))
    console.note("  ticks may come late; docs/guide/explore.md describes how to grant the privileges");
}

// most serious reason why the force differs from that of the tissue
std::string state_of(std::uint32_t flags, bool pointer) {
  struct Word {
    std::uint32_t flag;
    const char* text;
  };
  const Word kWords[] = {{kFlagEmergencyStop, "EMERGENCY STOP"},
                         {kFlagHalted, "HALTED"},
                         {kFlagDeviceFault, "DEVICE FAULT"},
                         {kFlagNotFinite, "NOT FINITE"},
                         {kFlagJump, "JUMP"},
                         {kFlagStale, pointer ? "at rest" : "stale"},
                         {kFlagPaused, "PAUSED"},
                         {kFlagClutched, "clutched"},
                         {kFlagInside, "inside"},
                         {kFlagWedged, "wedged"},
                         {kFlagNoGo, "no-go"},
                         {kFlagThermal, "cooling"},
                         {kFlagClamped, "clamped"},
                         {kFlagPassivity, "damped"},
                         {kFlagRotationLimited, "turn held"},
                         {kFlagRelease, "released"},
                         {kFlagRamp, "fading"}};
  for (const Word& word : kWords)
    if ((flags & word.flag) != 0) return std::string(" ") + word.text;
  return "";
}

// how to recover from a stop
std::string cure_of(const ExploreStatus& status) {
  if (!status.stop) return "";
  if (status.rearmed_in_page) return ": see page";
  return ": r rearms" + (status.arming_code.empty() ? "" : ", page: " + status.arming_code);
}

// expected error of the position of a tracked tip, and residual error at the registration points
std::string tip_error_text(const ViewedNavigation& navigation) {
  char text[80];
  if (navigation.tip)
    std::snprintf(text, sizeof text, " TRE %.1f (95%%: %.1f) FRE %.1f mm%s", navigation.tip->rms_mm,
                  navigation.tip->max_mm, navigation.fre_mm, navigation.tip->is_far ? " FAR" : "");
  else
    std::snprintf(text, sizeof text, " TRE unknown, FRE %.1f mm", navigation.fre_mm);
  return text;
}

// Live line: regular values on the left, then the structure in the remaining space, then irregular states on
// the right, the most serious first. If there is not enough space the times are dropped first, then the less
// serious states, because the operator must be able to read how to recover from a stop.
std::string live_line(const ExploreStatus& status, std::size_t columns) {
  constexpr std::size_t kMaxColumns = 99, kMinForStructure = 8;
  columns = std::min(columns, kMaxColumns);
  char time[30], rate[30], late[60], late_part[90], force[60];
  std::snprintf(time, sizeof time, "%5.1f s ", status.time_s);
  std::snprintf(rate, sizeof rate, "%6.0f Hz  ", status.rate_hz);
  std::snprintf(late, sizeof late, "%.0f/%.0f/%.0f", status.lateness_p50_us, status.lateness_p99_us,
                status.lateness_max_us);
  std::snprintf(late_part, sizeof late_part, "late %11s µs  ", late);
  std::snprintf(force, sizeof force, "%.2f/%.2f N  ", status.force_N, status.limit_N);
  const std::size_t for_structure = status.stop ? 1 : kMinForStructure;
  std::string unusual = state_of(status.flags, status.rearmed_in_page) + cure_of(status);
  // shown permanently, after the reason for a stop
  if (status.navigation) unusual += tip_error_text(*status.navigation);
  const auto add = [&](const std::string& part) {
    const std::size_t beside = display_width(force) + for_structure + display_width(unusual);
    if (beside + display_width(part) <= columns) unusual += part;
  };
  if (status.heat >= 0.005) add(" heat " + std::to_string(std::lround(100 * status.heat)) + "%");
  if (status.method != ForceMethod::kProxy) add(" " + std::string(name_of(status.method)));
  if (!status.task.empty()) add(" task " + std::to_string(std::lround(status.task_s)) + " s");
  if (status.method_awaited) add(" (preparing " + std::string(name_of(*status.method_awaited)) + ")");
  if (status.skipped > 0) add(" skip " + std::to_string(status.skipped));
  if (status.dropped > 0) add(" drop " + std::to_string(status.dropped));
  std::string line;
  std::size_t left = 0;
  for (const std::string& usual :
       {std::string(time) + rate + late_part + force, std::string(time) + rate + force, std::string(force)}) {
    const std::size_t used = display_width(usual) + display_width(unusual);
    left = columns > used ? columns - used : 0;
    line = usual;
    if (left >= for_structure) break;
  }
  return line + pad_or_truncate(status.structure, std::max(for_structure, left)) + unusual;
}

}  // namespace

void note_rendered_stiffness(const LoadedScene& loaded, Console& console) {
  const double factor = RenderedStiffness(loaded.scene.workspace).at_device(1);
  if (factor == 1) return;
  char text[120];
  std::snprintf(text, sizeof text,
                "rendered stiffness = scale x force gain = %g times that of the tissue:", factor);
  console.note(text);
  for (const Tissue& tissue : loaded.model->tissues) {
    if (!tissue.touchable) continue;
    std::snprintf(text, sizeof text, " %.3g N/mm", factor * tissue.stiffness_N_per_mm);
    console.note("  " + pad_or_truncate(tissue.name, 24) + text);
  }
}

std::function<void(const ExploreStatus&)> explore_status_printer(bool realtime_requested,
                                                                 const std::string& address,
                                                                 std::string& printed_warnings,
                                                                 std::optional<ViewedNavigation>& tracked,
                                                                 Console& console) {
  return [&console, &address, &printed_warnings, &tracked, requested = realtime_requested, first = true,
          reported = false, reported_method = std::string(), reported_failure = std::string(), deaths = 0,
          unwatched = false](const ExploreStatus& s) mutable {
    if (first) note_scheduling(s, requested, console);
    tracked = s.navigation;
    if (first)
      for (const std::string& warning : {s.coarser_tissue, s.conservative_bounds}) {
        if (!warning.empty()) console.warn()(warning);
        printed_warnings += warning + "\n";
      }
    const std::string problems = s.device_failure ? s.device_failure->message() : "";
    if (problems != reported_failure)
      console.warn()(problems.empty() ? "the device is ready again" : problems + "\n  no force until then");
    reported_failure = problems;
    if (first && !address.empty()) console.note("to see it, open " + address);
    first = false;
    if (s.recording_failure && !reported) {
      console.warn()(s.recording_failure->message() + "\n  the session continues without it");
      reported = true;
    }
    if (s.supervisor_failure && !unwatched)
      console.warn()("the supervisor died, and the force stays off because no other can be started:\n  " +
                     s.supervisor_failure->message());
    else if (!s.supervisor_failure && unwatched)
      console.warn()("a supervisor is running again");
    else if (!s.supervisor_failure && s.supervisor_deaths > deaths)
      console.warn()("the supervisor died, and the force is off; a new one is running");
    deaths = s.supervisor_deaths;
    unwatched = s.supervisor_failure.has_value();
    for (const FinishedRun& finished : s.finished) {
      console.note("run " + std::to_string(finished.run.number) + " of " + printable_name(finished.run.task) +
                   (finished.run.score.in_band ? ": every counted metric in its band"
                                               : ": not every counted metric in its band") +
                   (finished.history.run_id
                        ? "; in the records as run " + std::to_string(*finished.history.run_id)
                        : ""));
      if (finished.history.not_stored)
        console.warn()("the run is not in the records: " + finished.history.not_stored->message());
    }
    const std::string method = s.method_failure ? s.method_failure->message() : "";
    if (!method.empty() && method != reported_method) console.warn()(method);
    reported_method = method;
    if (s.refusal) console.warn()(s.refusal->message());
    console.show_status(s.question ? "y / n? " + s.question->text : live_line(s, console.columns()));
  };
}

}  // namespace palpate::app
