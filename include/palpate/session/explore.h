#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/device/registry.h"
#include "palpate/loading/loading.h"
#include "palpate/navigation/navigated_tip.h"
#include "palpate/palpation/palpation.h"
#include "palpate/server/viewer_host.h"
#include "palpate/servo/servo_loop.h"
#include "palpate/session/shared_plan.h"
#include "palpate/session/training.h"

/// Real-time session: a script's simulated hand, or an operator with a device, explores a scene through the
/// same servo loop.
///
///    hand, 500 Hz ── intended position ──► driver ◄─► servo ── every tick ──► recorder ─► file
///        ▲                                            │
///        └────────── latest tick ─────────────────────┼─► status, 10 Hz (the calling thread)
///                                                     └─► viewers, which also send requests
namespace palpate {

/// Request of the user while a session runs. kRearm, kAgree and kDecline answer what the last ExploreStatus
/// reported.
enum class ExploreRequest : std::uint8_t {
  kNone,
  kEmergencyStop,  ///< Sets all forces to zero immediately; nothing else changes
  kRearm,          ///< Ramps the forces up again after the stop that was reported, provided the tip is free
  kAgree,          ///< Consents to the question that was reported
  kDecline,
  kPause,       ///< Toggles the pause: forces fade out, or in again
  kNextMethod,  ///< Selects the next force method, cyclically
  kMotor,       ///< Toggles the burrs' motors
  kUndoStroke,  ///< Restores what the last stroke removed
  kRedoStroke,  ///< Removes again what was last restored
  kTask,        ///< Begins a run of a task; ends it if one is under way
};

/// Consent question: a viewer requests a change while a physical device can apply force. Example: "viewer 3
/// wants to turn the object by 20 degrees".
struct ConsentQuestion {
  std::uint64_t number = 0;  ///< From 1; unique within a session
  std::string text;
};

// devices without a driver of their own
inline constexpr const char* kSimulatedHand = "simulated";  ///< Simulated device that follows a script
/// Tip moved by a viewer; its force is displayed but not rendered
inline constexpr const char* kPointer = "pointer";
/// Tip moved by a node of ROS 2, the only device of its session; its force is published but not rendered
inline constexpr const char* kRos2Hand = "ros2";

/// Valid device names of a session: the three above and those of `known`.
std::vector<std::string> device_names(const DeviceRegistry& known);
/// Checks whether a session can use these devices. Errors: kUsage for an unknown name (the message lists the
/// known ones), a duplicate, more than kMaxDevices, a simulated hand that is not the first, a ROS 2 hand
/// combined with another device, or an empty list.
Result<void> check_devices(const std::vector<std::string>& names, const DeviceRegistry& known);

/// Options of explore().
struct ExploreOptions {
  SimulationOptions run;
  /// Names of the devices, in the order of the tick's devices; see device_names().
  std::vector<std::string> devices = {kSimulatedHand};
  /// Driver factories of the devices that need one.
  DeviceRegistry known;
  LoopSettings loop;              ///< Loop settings; the rate is ignored in favour of the run's own
  std::optional<double> seconds;  ///< Duration after which the session ends; empty: when the script ends
  bool repeat = false;            ///< Whether the script restarts when it has ended, until stopped
  /// Program and arguments of the supervisor process, which calls supervise() (supervisor.h). If it dies the
  /// force is switched off and another one is started. Empty: the session is not supervised.
  std::vector<std::string> supervisor;
  /// File to which the supervisor appends its record (SupervisorSettings::event_log_fd). Empty: none.
  std::filesystem::path supervisor_log;
  /// Polled fifty times a second by the calling thread; must not block. Empty: no requests.
  std::function<ExploreRequest()> request;
  /// Whether the requests come from an operator who sees and answers ExploreStatus::question. If false,
  /// viewers cannot change anything while a physical device can apply force.
  bool has_operator = false;
  /// Tasks offered in the session; none: nothing is evaluated.
  TrainingOptions training;
  /// Plan shown to viewers, who may edit it if it allows that; null: none.
  std::shared_ptr<SharedPlan> plan = {};
  /// Registration of the device whose samples are in the patient frame (DeviceInfo::in_patient); null: none.
  std::shared_ptr<const Navigation> navigation = {};
  /// Starts the viewer server: called once, before the loop runs and anything is recorded. The returned
  /// object is destroyed when the session ends, before the host. Its error is returned by explore(). Empty:
  /// no viewers.
  std::function<Result<std::shared_ptr<void>>(LiveHost&)> viewers;
};

/// Status of a running session. Timing figures cover the last second that reached the recorder.
struct ExploreStatus {
  Scheduling scheduling;
  /// Scheduling that the supervisor's process obtained, as in Scheduling::scheduler; empty: no supervisor
  std::string supervisor;
  /// Supervisor processes that died since the session began; each death stopped the force
  int supervisor_deaths = 0;
  /// Reason why the supervisor could not be restarted. Retried every second; the force stays stopped until
  /// then.
  std::optional<Error> supervisor_failure;
  double time_s = 0;   ///< Time since the session began; s
  double rate_hz = 0;  ///< Tick rate over the last second; Hz
  double lateness_p50_us = 0, lateness_p99_us = 0, lateness_max_us = 0;
  double compute_p50_us = 0;
  /// Reason why soft tissue is solved in coarser cells than the scene requests; empty if it is not.
  std::string coarser_tissue;
  /// Reasons why a device's stiffness is limited to a conservative bound, one per line. Empty if every vendor
  /// specifies its stiffness.
  std::string conservative_bounds;
  /// Threads other than the loop's own that exchange states and commands with a device.
  std::vector<TickingThread> followers;
  /// Reason why a device currently delivers no force or no pose.
  std::optional<Error> device_failure;
  // values of the latest tick
  double force_N = 0, limit_N = 0, heat = 0;
  std::string structure;  ///< Name of the structure in contact; empty: none
  ForceMethod method = ForceMethod::kProxy;
  std::uint32_t flags = 0;  ///< TickFlag bits
  // totals since the session began
  std::uint64_t skipped = 0, dropped = 0, stalls = 0;
  double progress = 0;  ///< Progress of the script in steps, 0 ... 1
  /// Reason why recording ended early; the session continues.
  std::optional<Error> recording_failure;
  std::optional<ForceMethod> method_awaited;  ///< Method that becomes active once it is prepared
  /// Reason why the method requested last is not active.
  std::optional<Error> method_failure;
  std::optional<std::uint32_t> stop;  ///< Number of the stop in effect; empty: none
  /// One-time code that re-arms a physical device from the page after that stop; empty: none.
  std::string arming_code;
  /// Whether the force is re-armed in the page instead of by kRearm: a viewer's pointer moves the tip and no
  /// device applies force
  bool rearmed_in_page = false;
  std::optional<ConsentQuestion> question;     ///< Question to be answered by kAgree or kDecline
  std::optional<Error> refusal;                ///< Refusal of a request since the last status
  std::optional<ViewedNavigation> navigation;  ///< State of a tracked tool; empty: none
  std::string task;                            ///< Name of the task being run; empty: none
  double task_s = 0;                           ///< Duration of that run so far; s
  std::vector<FinishedRun> finished;           ///< Runs finished since the last status
};

/// Result of explore().
struct ExploreResult {
  RecordingSummary summary;
  LoopHealth health;
  Scheduling scheduling;
  std::vector<TickingThread> threads;  ///< Threads that exchanged states and commands with devices
  std::vector<TouchFigure> touches;
  std::vector<HoldFigure> holds;
  std::size_t failed_steps = 0;       ///< Failed steps of the script
  double max_force_N = 0;             ///< Largest commanded force
  double limit_N = 0;                 ///< Highest force limit in effect
  std::vector<std::string> problems;  ///< Limits known to be unreachable, and failed steps, in words
  std::optional<Error> recording_failure;
  std::vector<FinishedRun> runs;  ///< Runs of tasks
  bool stopped_by_user = false;   ///< Stopped by progress.stopped(), or by a teacher in the page
  bool device_lost = false;       ///< The driver failed permanently, which ended the session
};

/// Runs a scene in real time with a scripted hand, the pointer of a viewer or physical devices, until the
/// script ends, the time is over, or progress.stopped(). The force then fades out and the recording is
/// finished, so that it can be replayed. Error kInterrupted if stopped before the first tick. A full disk
/// does not end the session; the result reports it.
/// @param script     script of the simulated hand, if that is the first device; none: the default script
/// @param recording  output file; empty: none
/// @param status     called on this thread when the loop starts, and then ten times a second; may be empty
/// Errors: those of set-up (device, hand or structures of a script, structures of a task, settings of the
/// loop), of creating the recording, of opening the log of the supervisor, of starting the viewer server and
/// the supervisor.
Result<ExploreResult> explore(const LoadedScene& loaded, const std::optional<Script>& script,
                              const ExploreOptions& options, const std::filesystem::path& recording,
                              const Progress& progress = {},
                              const std::function<void(const ExploreStatus&)>& status = {});

}  // namespace palpate
