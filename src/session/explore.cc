#include "palpate/explore.h"

#include <algorithm>
#include <chrono>
#include <deque>

#include "session/explore_hand.h"
#include "session/explore_watch.h"
#include "session/run_setup.h"

namespace palpate {
namespace {

using Clock = std::chrono::steady_clock;
constexpr auto kStatusPeriod = std::chrono::milliseconds(100);
// how soon an end is noticed
constexpr auto kPoll = std::chrono::milliseconds(20);

double seconds_since(Clock::time_point then) {
  return std::chrono::duration<double>(Clock::now() - then).count();
}

double norm(const std::array<double, 3>& v) {
  return Eigen::Vector3d(v[0], v[1], v[2]).norm();
}

/// Ticks a second, of the last second.
class RateMeter {
 public:
  double see(std::uint64_t ticks) {
    seen_.push_back({Clock::now(), ticks});
    while (seen_.size() > 2 && seen_.back().time - seen_[1].time >= std::chrono::seconds(1))
      seen_.pop_front();
    const double passed_s = std::chrono::duration<double>(seen_.back().time - seen_.front().time).count();
    return passed_s > 0 ? static_cast<double>(seen_.back().ticks - seen_.front().ticks) / passed_s : 0;
  }

 private:
  struct Sight {
    Clock::time_point time;
    std::uint64_t ticks;
  };
  std::deque<Sight> seen_;
};

/// The parts of a session, all of which live on after its end until its figures are taken.
struct Session {
  const Model& model;
  ServoLoop& loop;
  Recorder& recorder;
  HandThread& hand;
  const ExploreWatch& watch;
};

ExploreStatus status_of(const Session& session, double time_s, RateMeter& rate) {
  const LoopHealth health = session.loop.health();
  const ExploreWatch::LastSecond last = session.watch.last_second();
  const TickRecord tick = session.loop.snapshot();
  const DeviceTick& device = tick.device[0];
  ExploreStatus status;
  status.scheduling = session.loop.scheduling();
  status.time_s = time_s;
  status.rate_hz = rate.see(health.ticks);
  status.lateness_p50_us = last.lateness_p50_us;
  status.lateness_p99_us = last.lateness_p99_us;
  status.lateness_max_us = last.lateness_max_us;
  status.compute_p50_us = last.compute_p50_us;
  status.force_N = norm(device.force_N);
  status.limit_N = device.limit_N;
  status.heat = device.heat;
  if (device.label != 0) status.structure = session.model.name_of(device.label);
  status.flags = device.flags;
  status.method = static_cast<ForceMethod>(tick.method);
  status.skipped = health.skipped;
  status.dropped = health.dropped;
  status.stalls = health.stalls;
  status.progress = session.hand.progress();
  status.recording_failure = session.recorder.failure();
  return status;
}

// the next method that the model is ready for, in a circle
ForceMethod next_method(const Model& model, ForceMethod method) {
  do method = next_of(method);
  while (!model.has(method));
  return method;
}

void grant(ExploreRequest request, const Model& model, ServoLoop& loop) {
  const TickRecord latest = loop.snapshot();
  if (request == ExploreRequest::kEmergencyStop && (latest.switches & kSwitchEmergencyStop))
    loop.rearm();
  else if (request == ExploreRequest::kEmergencyStop)
    loop.emergency_stop();
  else if (request == ExploreRequest::kPause)
    loop.change([](Parameters& parameters) { parameters.paused = !parameters.paused; });
  else if (request == ExploreRequest::kNextMethod)
    loop.change([&](Parameters& parameters) { parameters.method = next_method(model, parameters.method); });
}

// until the script is done, the time is up, the user stops it or the driver gives up
void watch_until_over(const Session& session, const ExploreOptions& options, const Progress& progress,
                      const std::function<void(const ExploreStatus&)>& show, ExploreResult& result) {
  RateMeter rate;
  const Clock::time_point begun = Clock::now();
  Clock::time_point next_status = begun;
  while (!session.hand.done()) {
    result.stopped_by_user = progress.stopped();
    result.device_lost = !session.loop.running();
    if (result.stopped_by_user || result.device_lost) return;
    if (options.request) grant(options.request(), session.model, session.loop);
    if (options.seconds && seconds_since(begun) >= *options.seconds) return;
    if (show && Clock::now() >= next_status) {
      show(status_of(session, seconds_since(begun), rate));
      next_status = std::max(next_status + kStatusPeriod, Clock::now());
    }
    std::this_thread::sleep_for(kPoll);
  }
}

// Whoever explores may choose any method. One that does not suit the volume and that nobody asked for is
// passed over.
Result<void> with_what_can_be_chosen(std::shared_ptr<const Model>& model, const Progress& progress) {
  for (const ForceMethodInfo& info : kForceMethods) {
    auto ready = ready_for(model, {&info.method, 1}, progress);
    if (!ready && ready.error().kind == ErrorKind::kInterrupted) return ready.error();
    if (ready) model = *std::move(ready);
  }
  return {};
}

// ends the threads in the order in which they feed each other, and takes their figures
void finish(const Session& session, ExploreResult& result) {
  session.hand.end();
  session.loop.stop();
  result.health = session.loop.health();
  result.scheduling = session.loop.scheduling();
  const auto& trouble = session.hand.trouble();
  result.trouble.insert(result.trouble.end(), trouble.begin(), trouble.end());

  const auto finished = session.recorder.finish(result.health.dropped, result.health.skipped, result.trouble);
  if (finished) {
    result.summary = *finished;
  } else {
    result.recording_failure = finished.error();
    result.summary = session.recorder.so_far();
    result.summary.dropped = result.health.dropped;
    result.summary.skipped = result.health.skipped;
    result.summary.trouble = result.trouble;
  }
  result.holds = session.watch.holds();
  result.max_force_N = session.watch.max_force_N();
}

}  // namespace

Result<ExploreResult> explore(const LoadedScene& loaded, const Script& script, const ExploreOptions& options,
                              const std::filesystem::path& recording, const Progress& progress,
                              const std::function<void(const ExploreStatus&)>& status) {
  auto setup = set_up_run(loaded, script, options.run, progress);
  if (!setup) return setup.error();
  if (auto ready = with_what_can_be_chosen(setup->model, progress); !ready) return ready.error();
  const Model& model = *setup->model;
  progress.report("finding surfaces", 0);
  auto planned = ScriptedHand::create(model, setup->script);
  progress.report("finding surfaces", 1);
  if (!planned) return planned.error();
  if (progress.stopped()) return Progress::interrupted();

  // the device rests where the hand begins
  SimulatedDevice device(setup->device, setup->hand, setup->script.delay_s);
  device.reset(WorkspaceMapping(device.info(), setup->workspace).to_device(planned->start()));
  SimulatedDriver driver(device);
  LoopSettings settings = options.loop;
  settings.rate_hz = setup->script.rate_hz;
  auto loop = ServoLoop::start(setup->model, driver, setup->parameters, {setup->workspace}, settings);
  if (!loop) return loop.error();

  // the first ticks wait in the ring
  RecordingHeader header = header_of_run(loaded, *setup);
  header.clock = "real";
  header.scheduler = (*loop)->scheduling().scheduler;
  ExploreWatch watch(model, planned->structures());
  auto recorder = Recorder::start((*loop)->ring(), recording, header,
                                  [&watch](const TickRecord& record) { watch.see(record); });
  if (!recorder) return recorder.error();

  HandThread hand(std::move(*planned), setup->workspace, driver, **loop, options.repeat);
  if (auto begun = hand.begin(); !begun) return begun.error();
  const Session session{model, **loop, **recorder, hand, watch};
  ExploreResult result;
  result.limit_N = setup->limit_N;
  result.trouble = setup->trouble;
  watch_until_over(session, options, progress, status, result);
  finish(session, result);
  return result;
}

}  // namespace palpate
