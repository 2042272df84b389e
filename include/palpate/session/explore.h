#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/device/registry.h"
#include "palpate/link/viewer_server.h"
#include "palpate/loading/loading.h"
#include "palpate/navigation/navigated_tip.h"
#include "palpate/palpation/palpation.h"
#include "palpate/servo/servo_loop.h"
#include "palpate/session/shared_plan.h"
#include "palpate/session/training.h"

/// A script on the real clock: the simulated hand feels a scene through the same loop as a person with a
/// device would.
///
///    hand, 500 Hz ── where it wants to be ──► driver ◄─► servo ── every tick ──► recorder ─► file
///        ▲                                                │
///        └─────────── the latest tick ────────────────────┼─► status, 10 Hz (the calling thread)
///                                                         └─► viewers, who also ask for changes
namespace palpate {

/// What the user asks for while a session runs. A rearm and an answer are to what ExploreStatus has shown
/// last.
enum class ExploreRequest : std::uint8_t {
  kNone,
  kEmergencyStop,  ///< forces off at once, and no more than that
  kRearm,          ///< forces on again by the ramp, after the stop that was shown, where the tip is free
  kAgree,          ///< to the question that was shown
  kDecline,
  kPause,       ///< forces fade out; asked for again: in
  kNextMethod,  ///< feel by the next force method, in a circle
  kMotor,       ///< of the burrs: on; asked for again: off
  kUndoStroke,  ///< what was cut last is put back
  kRedoStroke,  ///< what was put back last is taken away again
  kTask,        ///< a run of a task begins; asked for again: it ends
};

/// A viewer wants to change something while a physical device may push: "viewer 3 wants to turn the object by
/// 20 degrees".
struct ConsentQuestion {
  std::uint64_t number = 0;  ///< from 1; another one, another number
  std::string text;
};

// the devices that need no driver
inline constexpr const char* kSimulatedHand = "simulated";  ///< follows a script, with a simulated device
inline constexpr const char* kPointer = "pointer";  ///< a viewer's; its force is shown and felt by nobody

/// The names that a session's devices may have: these two, and what is known besides.
std::vector<std::string> device_names(const DeviceRegistry& known);
/// Whether a session may have these devices. Errors: kUsage for a name that is not known, with those that
/// are; one that comes twice, more than kMaxDevices, a simulated hand that is not the first, none at all.
Result<void> check_devices(const std::vector<std::string>& names, const DeviceRegistry& known);

struct ExploreOptions {
  SimulationOptions run;
  /// What is felt with, in the order of the tick's devices: device_names().
  std::vector<std::string> devices = {kSimulatedHand};
  /// Makers of the drivers of those that need one.
  DeviceRegistry known;
  LoopSettings loop;              ///< its rate is ignored: the run's own holds
  std::optional<double> seconds;  ///< end after that long; empty: when the script ends
  bool repeat = false;            ///< begin the script again when it has ended, until stopped
  /// Program and arguments that call supervise() (supervisor.h): a process that watches this one is made of
  /// them. Dies it, the force goes off, and another one is started. Empty: nobody watches.
  std::vector<std::string> supervisor;
  /// Gets the supervisor's record (SupervisorSettings::record_file), at its end where it is there already.
  /// Empty: no file does.
  std::filesystem::path supervisor_log;
  /// Asked fifty times a second by the calling thread; must not wait. Empty: nobody asks for anything.
  std::function<ExploreRequest()> request;
  /// Whoever makes these requests sees ExploreStatus::question and answers it. Without, viewers change
  /// nothing while a physical device may push.
  bool asks_here = false;
  /// Tasks that are done in it; none: nothing is evaluated.
  TrainingOptions training;
  /// A plan that viewers see, and may change; null: none is rehearsed.
  std::shared_ptr<SharedPlan> plan = {};
  /// Of the device whose samples are places in the patient (DeviceInfo::in_patient); null: there is none.
  std::shared_ptr<const Navigation> navigation = {};
  /// Shows the session to viewers and takes their requests: called once, before the loop runs and anything is
  /// recorded. What it returns is destroyed when the session ends, before the host. Its error is explore()'s.
  /// Empty: nobody looks on.
  std::function<Result<std::shared_ptr<void>>(ViewerHost&)> viewers;
};

/// Where a session stands. Figures of time are of the last second that reached the recorder.
struct ExploreStatus {
  Scheduling scheduling;
  std::string supervisor;     ///< what its process got, as Scheduling::scheduler; empty: there is none
  int supervisor_deaths = 0;  ///< since the session began; each has stopped it
  /// Why nobody watches since the last of these deaths; tried again every second, and stopped until then.
  std::optional<Error> supervisor_failure;
  double time_s = 0;   ///< since the session began
  double rate_hz = 0;  ///< ticks a second, of the last second
  double lateness_p50_us = 0, lateness_p99_us = 0, lateness_max_us = 0;
  double compute_p50_us = 0;
  /// Why soft tissue is solved in coarser cells than the scene asks for; empty: it is not.
  std::string coarser_tissue;
  /// Where a device is made no stiffer than is careful, why; a line each. Empty: every maker says how stiff.
  std::string careful_bounds;
  /// Whoever exchanges states and commands with a device beside the loop's own thread.
  std::vector<TickingThread> followers;
  /// Why a device gives no force or no pose at present.
  std::optional<Error> device_trouble;
  // of the latest tick
  double force_N = 0, limit_N = 0, heat = 0;
  std::string structure;  ///< that is touched; empty: none
  ForceMethod method = ForceMethod::kProxy;
  std::uint32_t flags = 0;  ///< TickFlag bits
  // since the session began
  std::uint64_t skipped = 0, dropped = 0, stalls = 0;
  double progress = 0;  ///< of the script, 0 ... 1, by steps
  /// Why the recording ended before the session, which goes on.
  std::optional<Error> recording_failure;
  std::optional<ForceMethod> method_awaited;  ///< felt as soon as it is made ready
  /// Why the force method that was asked for last is not felt.
  std::optional<Error> method_failure;
  std::optional<std::uint32_t> stop;  ///< which one holds; empty: none
  /// That arms a physical device from a page after that stop, once; empty: there is none.
  std::string arming_code;
  bool rearmed_in_page = false;  ///< and not by kRearm: a viewer's pointer moves the tip, and nothing pushes
  std::optional<ConsentQuestion> question;     ///< to be answered by kAgree or kDecline
  std::optional<Error> refusal;                ///< of a request since the last status
  std::optional<ViewedNavigation> navigation;  ///< of a tracked tool; empty: there is none
  std::string task;                   ///< name of the task of which a run is under way; empty: none is
  double task_s = 0;                  ///< for how long
  std::vector<FinishedRun> finished;  ///< runs that are over since the last status
};

struct ExploreResult {
  RecordingSummary summary;
  LoopHealth health;
  Scheduling scheduling;
  std::vector<TickingThread> threads;  ///< that exchanged states and commands with devices
  std::vector<TouchFigure> touches;
  std::vector<HoldFigure> holds;
  std::size_t failed_steps = 0;      ///< of the script
  double max_force_N = 0;            ///< largest force sent
  double limit_N = 0;                ///< the highest that held
  std::vector<std::string> trouble;  ///< what is known not to be reached, and steps that failed, in words
  std::optional<Error> recording_failure;
  std::vector<FinishedRun> runs;  ///< of tasks
  bool stopped_by_user = false;   ///< by progress.stopped(), or by a teacher in the page
  bool device_lost = false;       ///< the driver gave up, which ended the session
};

/// Lets a scripted hand, a viewer's pointer or whoever holds a device feel a scene in real time, until the
/// script is done, the time is up, or progress.stopped(): then the force fades out and the recording is
/// finished, so that it replays. Stopped before the first tick: Error kInterrupted. A disk that fills is no
/// error of the session: it goes on, and the result tells.
/// @param script     of the simulated hand; without one there is none
/// @param recording  a file to write; empty: none
/// @param status     called on this thread when the loop runs, and then ten times a second; may be empty
/// Errors: those of set-up (a script's device, hand or structures, a task's structures, settings of the
/// loop), of creating the recording, of opening the supervisor's log; the viewers', the supervisor's.
Result<ExploreResult> explore(const LoadedScene& loaded, const Script& script, const ExploreOptions& options,
                              const std::filesystem::path& recording, const Progress& progress = {},
                              const std::function<void(const ExploreStatus&)>& status = {});

}  // namespace palpate
