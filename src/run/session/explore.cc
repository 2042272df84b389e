#include "palpate/session/explore.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <thread>
#include <utility>

#include "palpate/base/file.h"
#include "palpate/palpation/plain_vectors.h"
#include "palpate/palpation/run_setup.h"
#include "palpate/recording/recorder.h"
#include "palpate/supervisor/supervisor.h"
#include "session/live_session.h"
#include "session/measured_cells.h"
#include "session/session_statistics.h"
#include "session/tip_source.h"
#include "session/training.h"

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;
constexpr auto kStatusPeriod = std::chrono::milliseconds(100);
// polling period for requests and for the end of the session
constexpr auto kPoll = std::chrono::milliseconds(20);

double seconds_since(Clock::time_point then) {
  return std::chrono::duration<double>(Clock::now() - then).count();
}

/// Parts of a session. All of them outlive its end until the figures have been collected.
struct Session {
  const Model& model;
  ServoLoop& loop;
  Recorder& recorder;
  TipSource& tip;
  const SessionStatistics& statistics;
  LiveSession& live;
  Training* training;      // null: there are no tasks
  Supervisor* supervisor;  // null: the session is not supervised
  const std::string& conservative_bounds;
  bool has_operator;
};

/// Contents of the last displayed status: a key may only answer what the user has been shown.
struct DisplayedStatus {
  std::uint32_t stop = 0;
  std::uint64_t question = 0;
  std::optional<Error> refusal;  // to be displayed next
  std::size_t runs = 0;          // finished runs of tasks already displayed
};

// Stops the force while the supervisor is dead, and restarts the supervisor.
class SupervisorKeeper {
 public:
  explicit SupervisorKeeper(const Session& session) : session_(session) {}
  void restart_if_dead() {
    if (session_.supervisor == nullptr || session_.supervisor->is_running()) return;
    if ((session_.loop.snapshot().switches & kSwitchEmergencyStop) == 0) session_.live.stop_unsupervised();
    if (Clock::now() < next_try_) return;
    if (!failure_) deaths_ += 1;
    const auto again = session_.supervisor->restart();
    failure_ = again ? std::nullopt : std::optional(again.error());
    next_try_ = again ? Clock::time_point() : Clock::now() + std::chrono::seconds(1);
  }
  int deaths() const { return deaths_; }
  /// Reason why the dead supervisor could not be replaced.
  const std::optional<Error>& failure() const { return failure_; }

 private:
  const Session& session_;
  int deaths_ = 0;
  std::optional<Error> failure_;
  Clock::time_point next_try_;
};

ExploreStatus status_of(const Session& session, double time_s, RateMeter& rate, DisplayedStatus& displayed,
                        const SupervisorKeeper& supervisor) {
  const LoopHealth health = session.loop.health();
  const SessionStatistics::LastSecond last = session.statistics.last_second();
  const TickRecord tick = session.loop.snapshot();
  const DeviceTick& device = tick.device[0];
  ExploreStatus status;
  status.scheduling = session.loop.scheduling();
  if (session.supervisor != nullptr) status.supervisor = session.supervisor->scheduler();
  status.supervisor_deaths = supervisor.deaths();
  status.supervisor_failure = supervisor.failure();
  status.time_s = time_s;
  status.rate_hz = rate.observe(health.ticks);
  status.lateness_p50_us = last.lateness_p50_us;
  status.lateness_p99_us = last.lateness_p99_us;
  status.lateness_max_us = last.lateness_max_us;
  status.compute_p50_us = last.compute_p50_us;
  status.force_N = norm(device.force_N);
  status.limit_N = device.limit_N;
  status.heat = device.heat;
  if (device.label != 0)
    status.structure = session.model.name_of(device.label) + session.model.enclosing_suffix(device.label);
  status.flags = device.flags;
  status.method = static_cast<ForceMethod>(tick.method);
  status.skipped = health.skipped;
  status.dropped = health.dropped;
  status.stalls = health.stalls;
  status.progress = session.tip.progress();
  status.recording_failure = session.recorder.failure();
  status.method_awaited = session.live.method_awaited();
  status.method_failure = session.live.method_failure();
  status.coarser_tissue = session.live.coarser_tissue();
  status.conservative_bounds = session.conservative_bounds;
  status.followers = session.tip.followers();
  status.device_failure = session.tip.driver().failure();
  status.stop = session.live.current_stop();
  status.rearmed_in_page = session.live.rearmed_in_page();
  // the code is shown only to a user who sees the device
  if (session.has_operator) status.arming_code = session.live.arming_code();
  status.question = session.live.question();
  status.refusal = std::exchange(displayed.refusal, std::nullopt);
  status.navigation = session.live.navigation();
  if (session.training != nullptr) {
    const ViewedTraining training = session.training->state();
    if (training.phase == ViewedTraining::Phase::kRunning) status.task = training.task;
    status.task_s = training.time_s;
    status.finished = session.training->finished(displayed.runs);
    displayed.runs += status.finished.size();
  }
  displayed.stop = status.stop.value_or(0);
  displayed.question = status.question ? status.question->number : 0;
  return status;
}

void carry_out(ExploreRequest request, const Session& session, DisplayedStatus& displayed) {
  const auto report_result = [&](const Result<void>& done) {
    if (!done) displayed.refusal = done.error();
  };
  switch (request) {
    case ExploreRequest::kEmergencyStop:
      return session.live.stop_by_key();
    case ExploreRequest::kRearm:
      return report_result(session.live.rearm_by_key(displayed.stop));
    case ExploreRequest::kAgree:
    case ExploreRequest::kDecline:
      return session.live.answer_by_key(displayed.question, request == ExploreRequest::kAgree);
    case ExploreRequest::kPause:
      return session.live.pause_by_key();
    case ExploreRequest::kNextMethod:
      return session.live.next_method();
    case ExploreRequest::kMotor:
      return report_result(session.live.toggle_motor_by_key());
    case ExploreRequest::kUndoStroke:
      return report_result(session.live.change_stroke_by_key(StrokeAction::kUndo));
    case ExploreRequest::kRedoStroke:
      return report_result(session.live.change_stroke_by_key(StrokeAction::kRedo));
    case ExploreRequest::kTask:
      return report_result(session.live.begin_or_end_task_by_key());
    case ExploreRequest::kNone:
      return;
  }
}

// runs until the script is done, the time is up, the user stops the session or the driver gives up
void watch_until_over(const Session& session, const ExploreOptions& options, const Progress& progress,
                      const std::function<void(const ExploreStatus&)>& show, ExploreResult& result) {
  RateMeter rate;
  DisplayedStatus displayed;
  SupervisorKeeper supervisor(session);
  const Clock::time_point begun = Clock::now();
  Clock::time_point next_status = begun;
  while (!session.tip.done()) {
    result.stopped_by_user = progress.stopped() || session.live.is_over();
    result.device_lost = !session.loop.running();
    if (result.stopped_by_user || result.device_lost) return;
    supervisor.restart_if_dead();
    if (options.request) carry_out(options.request(), session, displayed);
    session.live.follow_script();
    if (options.seconds && seconds_since(begun) >= *options.seconds) return;
    if (show && Clock::now() >= next_status) {
      show(status_of(session, seconds_since(begun), rate, displayed, supervisor));
      next_status = std::max(next_status + kStatusPeriod, Clock::now());
    }
    std::this_thread::sleep_for(kPoll);
  }
}

// Prepares the proxy. The user may choose any method later; direct methods are prepared on demand. Surfaces
// are inherited by every model version, so they have to exist before the first. If they cannot be built for
// the scene the proxy is not available; if it was requested, the set-up has already failed.
Result<void> with_surfaces(std::shared_ptr<const Model>& model, const Progress& progress) {
  constexpr ForceMethod kProxyAlone[] = {ForceMethod::kProxy};
  auto ready = prepared_with_cache(model, kProxyAlone, progress);
  if (!ready && ready.error().kind == ErrorKind::kInterrupted) return ready.error();
  if (ready) model = *std::move(ready);
  return {};
}

// ends the threads in the order of the data flow, and collects their figures
void finish(const Session& session, ExploreResult& result) {
  session.tip.end();
  result.threads = session.tip.followers();
  result.threads.insert(result.threads.begin(), session.loop.ticking());
  session.loop.stop();
  result.health = session.loop.health();
  result.scheduling = session.loop.scheduling();
  const auto problems = session.tip.problems();
  result.failed_steps = problems.size();
  result.touches = session.tip.touches();
  result.problems.insert(result.problems.end(), problems.begin(), problems.end());
  const auto warnings = session.live.later_tissue_warnings();
  result.problems.insert(result.problems.end(), warnings.begin(), warnings.end());

  const auto finished =
      session.recorder.finish(result.health.dropped, result.health.skipped, result.problems);
  if (finished) {
    result.summary = *finished;
  } else {
    result.recording_failure = finished.error();
    result.summary = session.recorder.so_far();
    result.summary.dropped = result.health.dropped;
    result.summary.skipped = result.health.skipped;
    result.summary.problems = result.problems;
  }
  // the recorder has processed the last tick
  if (session.training != nullptr) {
    session.training->end();
    result.runs = session.training->finished();
  }
  result.holds = session.statistics.holds();
  // a pointer session has no list of structures to be touched: report only those that were
  if (session.tip.pointer())
    std::erase_if(result.holds, [](const HoldFigure& hold) { return hold.peak_force_N == 0; });
  result.max_force_N = session.statistics.max_force_N();
  result.limit_N = std::min(session.live.highest_force_limit_N(), session.model.scene_max_force_N);
}

LiveSessionParts session_parts(const RunSetup& setup, const Scene& scene, TipSource& tip,
                               const ExploreOptions& options, bool recording, Training* training,
                               const std::string& coarser_tissue) {
  const auto devices = tip.driver().devices();
  LiveSessionParts parts{setup.model,     {devices.begin(), devices.end()},
                         setup.workspace, setup.parameters,
                         tip.name(),      setup.script.rate_hz,
                         tip.pointer(),   recording,
                         scene.modality,  options.has_operator,
                         training};
  parts.coarser_tissue = coarser_tissue;
  parts.plan = options.plan;
  parts.navigation = options.navigation;
  return parts;
}

/// Descriptor of the supervisor's record file; closed by the destructor.
class SupervisorLog {
 public:
  static Result<SupervisorLog> open(const std::filesystem::path& file) {
    if (file.empty()) return SupervisorLog(-1);
    const int number = ::open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    if (number < 0) return output_error(file, errno);
    return SupervisorLog(number);
  }
  SupervisorLog(SupervisorLog&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  SupervisorLog& operator=(SupervisorLog&&) = delete;
  ~SupervisorLog() {
    if (number_ >= 0) ::close(number_);
  }
  int number() const { return number_; }

 private:
  explicit SupervisorLog(int number) : number_(number) {}
  int number_;
};

/// Starts the supervisor; nullptr if the session has none.
Result<std::unique_ptr<Supervisor>> supervisor_of(const ExploreOptions& options, const SupervisorLog& log,
                                                  const DeviceDriver& driver) {
  if (options.supervisor.empty()) return std::unique_ptr<Supervisor>();
  SupervisorSettings settings;
  settings.command = options.supervisor;
  settings.event_log_fd = log.number();
  settings.realtime = options.loop.realtime;
  if (driver.halt_fd() >= 0) settings.halt_fds.push_back(driver.halt_fd());
  const auto devices = driver.devices();
  settings.kill_frozen = settings.halt_fds.empty() && !std::ranges::all_of(devices, &DeviceInfo::simulated);
  return Supervisor::start(settings);
}

// Rejects scope steps: on the real clock, the simulated device is a tip led by a hand model; only a physical
// device can turn a scope here.
Result<void> check_script(const Script& script) {
  for (std::size_t n = 0; n < script.steps.size(); ++n)
    if (std::holds_alternative<ScopeStep>(script.steps[n]))
      return Error{ErrorKind::kUsage,
                   "explore cannot move a scope by script: on the real clock a script moves a single tip",
                   script.source + ":" + std::to_string(script.lines[n]),
                   "run the script with palpate simulate, or remove the step and hold the scope with a "
                   "second device: --device simulated --device NAME"};
  return {};
}

/// Warning if a step asks for more force than is ever sent; empty: none does.
std::string out_of_reach(const TaskFile& task, double limit_N) {
  for (const TaskStep& step : task.steps) {
    if (step.kind != StepKind::kTouch || step.force_N[0] <= limit_N) continue;
    char text[160];
    std::snprintf(text, sizeof text,
                  "asks for %.2f N, but the force limit is %.2f N: raise it with --max-force",
                  step.force_N[0], limit_N);
    return "the task's step \"" + step.name + "\" " + text;
  }
  return "";
}

/// Settings and model of a session, with the surfaces that its method needs.
Result<RunSetup> prepare_run(const LoadedScene& loaded, const std::optional<Script>& script,
                             const ExploreOptions& options, const Progress& progress) {
  // a simulated hand needs touchable tissue; a viewer may look around and move the tip without
  const bool is_touchable = has_touchable_tissue(*loaded.model),
             scripted = options.devices[0] == kSimulatedHand;
  if (!is_touchable && scripted)
    if (auto touchable = require_touchable_tissue(loaded); !touchable) return touchable.error();
  SimulationOptions run = options.run;
  if (!is_touchable) run.method = ForceMethod::kTrilinear;
  auto setup =
      scripted ? set_up_run(loaded, script, run, progress) : set_up_guided_run(loaded, run, progress);
  if (!setup) return setup.error();
  if (auto ready = with_surfaces(setup->model, progress); !ready) return ready.error();
  return setup;
}

/// Starts the training of a session; null without tasks. Adds warnings to `setup`.
Result<std::unique_ptr<Training>> start_training(const TrainingOptions& options, std::size_t devices,
                                                 const Progress& progress, RunSetup& setup) {
  if (options.tasks.empty()) return std::unique_ptr<Training>();
  auto training = Training::start(options, *setup.model, devices, progress);
  if (!training) return training.error();
  if (options.requires_all_tasks)
    for (const OfferedTask& task : options.tasks)
      if (std::string out = out_of_reach(task.file, setup.limit_N); !out.empty())
        setup.problems.push_back(std::move(out));
  return training;
}

}  // namespace

Result<ExploreResult> explore(const LoadedScene& loaded, const std::optional<Script>& script,
                              const ExploreOptions& options, const std::filesystem::path& recording,
                              const Progress& progress,
                              const std::function<void(const ExploreStatus&)>& status) {
  if (auto possible = check_devices(options.devices, options.known); !possible) return possible.error();
  if (script)
    if (auto possible = check_script(*script); !possible) return possible.error();
  auto setup = prepare_run(loaded, script, options, progress);
  if (!setup) return setup.error();
  std::string conservative_bounds;
  auto tip = tip_source_for(*setup, options, progress, conservative_bounds);
  if (!tip) return tip.error();
  MeasuredCells with_cells = with_measured_cells(setup->model, (*tip)->driver().devices().size());
  setup->model = std::move(with_cells.model);
  if (!with_cells.warning.empty()) setup->problems.push_back(with_cells.warning);
  if (progress.stopped()) return Progress::interrupted();

  auto started = start_training(options.training, (*tip)->driver().devices().size(), progress, *setup);
  if (!started) return started.error();
  const std::unique_ptr<Training> training = *std::move(started);
  // the viewer server may fail to start, so it comes before any force is rendered
  LiveSession live(session_parts(*setup, loaded.scene, **tip, options, !recording.empty(), training.get(),
                                 with_cells.warning));
  std::shared_ptr<void> viewers;
  if (options.viewers) {
    auto served = options.viewers(live);
    if (!served) return served.error();
    viewers = *std::move(served);
  }
  LoopSettings settings = options.loop;
  settings.rate_hz = setup->script.rate_hz;
  const Model& model = *setup->model;
  const auto log = SupervisorLog::open(options.supervisor_log);
  if (!log) return log.error();
  auto supervisor = supervisor_of(options, *log, (*tip)->driver());
  if (!supervisor) return supervisor.error();
  if (*supervisor) settings.heartbeat = &(*supervisor)->heartbeat();
  auto loop =
      ServoLoop::start(setup->model, (*tip)->driver(), setup->parameters, {setup->workspace}, settings);
  if (!loop) return loop.error();

  // the first ticks wait in the ring
  RecordingHeader header = header_of_run(loaded, *setup);
  header.clock = "real";
  header.device = (*tip)->devices();
  header.devices = static_cast<int>((*loop)->devices().size());
  header.scheduler = (*loop)->scheduling().scheduler;
  SessionStatistics statistics(model, (*tip)->hold_requests());
  if (training) training->begin_session(header);
  const auto on_tick = [&statistics, &live, &training](const TickRecord& record,
                                                       std::span<const RecordingEvent> events) {
    statistics.observe(record);
    live.observe(record);
    if (training) training->observe(record, events);
  };
  auto recorder = Recorder::start((*loop)->ring(), recording, header, on_tick, &live.log());
  if (!recorder) return recorder.error();

  // However the session ends, viewers are disconnected before the loop and the statistics are destroyed. They
  // stay connected while finish() scores a run in progress, and receive its results.
  struct EndOfViewing {
    std::shared_ptr<void>& viewers;
    LiveSession& live;
    TipSource& tip;
    ~EndOfViewing() {
      viewers.reset();
      live.end();
      tip.end();
    }
  } const end_of_viewing{viewers, live, **tip};
  live.begin(**loop, statistics);
  const ScriptEdits edits{[&live](StrokeAction action) { live.change_stroke_by_script(action); },
                          [&live] { return live.script_stroke_version(); },
                          [&live](TissueLaw law) { live.change_law_by_script(law); },
                          [&live] { return live.script_law_version(); }};
  if (auto begun = (*tip)->begin(**loop, live.log(), edits); !begun) return begun.error();
  const Session session{model,
                        **loop,
                        **recorder,
                        **tip,
                        statistics,
                        live,
                        training.get(),
                        supervisor->get(),
                        conservative_bounds,
                        options.has_operator};
  ExploreResult result;
  result.problems = setup->problems;
  watch_until_over(session, options, progress, status, result);
  live.close();
  finish(session, result);
  return result;
}

}  // namespace palpate
