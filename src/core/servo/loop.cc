#include "servo/loop.h"

#include <sched.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <system_error>

#include "palpate/servo/loop_statistics.h"
#include "palpate/tissue/carving.h"

/// One tick on the real clock, in order: time -> inputs -> tick -> commands -> heartbeat -> published data.
/// update() does not allocate, lock, log or throw; its only system calls read the clock.
namespace palpate {
namespace {

constexpr auto kStopPoll = std::chrono::milliseconds(2);
// longer than the ramp-out; only reached if the servo thread hangs
constexpr auto kStopTimeout = std::chrono::milliseconds(500);

// rate of the device's own clock where it has one and states it, else the loop's
double rate_of(const DeviceDriver& driver, const LoopSettings& settings) {
  const DeviceInfo& info = driver.devices()[driver.clock_owner()];
  const bool device = info.drive != DeviceInfo::Drive::kPulled && info.rate_hz && *info.rate_hz > 0;
  return device ? *info.rate_hz : settings.rate_hz;
}

// release: a reader that observes a counter also observes every earlier increment of the others
void add(std::atomic<std::uint64_t>& counter, std::uint64_t more) {
  counter.store(counter.load(std::memory_order_relaxed) + more, std::memory_order_release);
}

}  // namespace

Loop::Loop(std::shared_ptr<const Model> model, DeviceDriver& driver, const Parameters& parameters,
           const std::vector<WorkspaceSettings>& workspaces, const LoopSettings& settings, TimeSource now)
    : driver_(driver),
      settings_(settings),
      ticks_on_own_thread_(driver.devices()[driver.clock_owner()].drive != DeviceInfo::Drive::kCallback),
      period_ns_(std::llround(1e9 / rate_of(driver, settings))),
      now_(now),
      X_WorldPatient_(model->X_WorldPatient),
      model_(std::move(model)),
      latest_{parameters},
      pacer_(settings.rate_hz, settings.spin_s, stop_),
      ring_(static_cast<std::size_t>(std::ceil(settings.ring_s * rate_of(driver, settings)))),
      watchdog_(driver, settings.heartbeat) {
  const auto devices = driver.devices();
  for (std::size_t d = 0; d < devices.size(); ++d) {
    const WorkspaceSettings& workspace = workspaces[workspaces.size() == 1 ? 0 : d];
    mappings_.emplace_back(devices[d], workspace);
    is_in_patient_[d] = devices[d].in_patient;
    // the caller knows what an operator can hold stable; everything else is a property of the device
    DeviceParameters& device = latest_.parameters.device[d];
    const DeviceParameters requested = device;
    device = device_parameters(devices[d], workspace);
    device.max_stiffness_N_per_mm = std::min(device.max_stiffness_N_per_mm, requested.max_stiffness_N_per_mm);
    // not above 0: unknown
    if (requested.max_damping_N_s_per_mm > 0)
      device.max_damping_N_s_per_mm =
          std::fmin(device.max_damping_N_s_per_mm, requested.max_damping_N_s_per_mm);
    if (std::isfinite(requested.delay_s)) device.delay_s = std::fmax(device.delay_s, requested.delay_s);
  }
  posted_ = latest_;
}

Loop::~Loop() {
  stop();
}

Result<void> Loop::begin() {
  std::promise<void> ready;
  const auto started = ready.get_future();
  try {
    scheduling_.watchdog = watchdog_.begin(settings_.realtime, settings_.cpu);
    thread_ = std::thread([this, &ready] { run(ready); });
    started.wait();
    late_ticks_.begin(settings_.cpu);
  } catch (const std::system_error& error) {
    return Error{ErrorKind::kUnavailable, std::string("cannot start the servo thread: ") + error.what(), "",
                 "close other programs, or raise the process limit (ulimit -u)"};
  }
  return {};
}

void Loop::run(ServoClock& clock) noexcept {
  running_.store(true);
  driver_.run(*this, clock);
}

void Loop::run(std::promise<void>& ready) {
  // with a callback driver the vendor's thread ticks and this one only waits for the end
  RealtimeRequest request;
  request.fifo = settings_.realtime && ticks_on_own_thread_;
  request.lock_memory = settings_.realtime;
  request.cpu = ticks_on_own_thread_ ? settings_.cpu : -1;
  request.priorities_above = 1;
  const RealtimeGrant grant = make_this_thread_realtime(request);
  scheduling_.realtime = grant.fifo;
  scheduling_.memory_locked = grant.memory_locked;
  scheduling_.scheduler = ticks_on_own_thread_ ? grant.scheduler : "set by the vendor's thread";
  scheduling_.memory = grant.memory;
  running_.store(true);
  if (ticks_on_own_thread_) late_ticks_.tick_here();
  ready.set_value();
  driver_.run(*this, *this);
  watchdog_.disarm();
  running_.store(false);
}

// ---- callers

std::uint32_t Loop::change(const std::function<void(Parameters&)>& edit) {
  const std::lock_guard lock(callers_mutex_);
  const auto device = latest_.parameters.device;
  edit(latest_.parameters);
  latest_.parameters.device = device;
  latest_.number += 1;
  parameters_in_.post(latest_);
  return latest_.number;
}

std::uint32_t Loop::emergency_stop() noexcept {
  std::uint64_t now = arming_.load(), next = 0;
  do next = ((now >> 1) + 1) << 1 | 1;
  while (!arming_.compare_exchange_weak(now, next));
  return static_cast<std::uint32_t>(next >> 1);
}

RearmResult Loop::rearm(std::uint32_t stop, std::uint32_t& number) noexcept {
  std::uint64_t now = arming_.load();
  if ((now & 1) == 0) return RearmResult::kNotStopped;
  if (static_cast<std::uint32_t>(now >> 1) != stop) return RearmResult::kStoppedAgain;
  if (free_at_.load() != now)
    return applied_arming_.load() == now ? RearmResult::kTouching : RearmResult::kNotApplied;
  const std::uint64_t next = ((now >> 1) + 1) << 1;
  if (!arming_.compare_exchange_strong(now, next)) return RearmResult::kStoppedAgain;
  number = static_cast<std::uint32_t>(next >> 1);
  return RearmResult::kDone;
}

Arming Loop::arming() const noexcept {
  const std::uint64_t now = arming_.load();
  return {static_cast<std::uint32_t>(now >> 1), (now & 1) != 0};
}

Parameters Loop::parameters() const {
  const std::lock_guard lock(callers_mutex_);
  return latest_.parameters;
}

void Loop::stop() {
  if (!thread_.joinable()) return;
  // fade the force out first
  stopping_.store(true);
  for (auto waited = kStopPoll; waited < kStopTimeout && running() && !silent_.load(); waited += kStopPoll)
    std::this_thread::sleep_for(kStopPoll);
  // Devices with zero force need no watchdog while their driver shuts down; a hung driver still has force and
  // needs it.
  if (silent_.load()) watchdog_.stand_down();
  stop_.store(true);
  thread_.join();
  watchdog_.end();
  late_ticks_.end();
}

LoopHealth Loop::health() const {
  LoopHealth health;
  // loaded before the totals that contain it, because the loop keeps ticking
  const std::uint64_t on_time = counts_.on_time.load();
  health.ticks = counts_.ticks.load();
  health.skipped = counts_.skipped.load();
  health.dropped = counts_.dropped.load();
  health.lateness = percentiles_of(lateness_);
  health.compute = percentiles_of(compute_);
  const std::lock_guard lock(callers_mutex_);
  health.stalls = watchdog_.stalls() - stalls_before_;
  health.late = late_ticks_.counts() - late_before_;

  const double elapsed_s = static_cast<double>(counts_.last_ns.load() - counts_.first_ns.load()) * 1e-9;
  if (health.ticks > 1 && elapsed_s > 0) health.rate_hz = static_cast<double>(health.ticks - 1) / elapsed_s;
  const std::uint64_t due = health.ticks + health.skipped;
  // a reset between the loads can leave on_time above the total
  if (due > 0) health.on_time = static_cast<double>(std::min(on_time, due)) / static_cast<double>(due);
  return health;
}

TickingThread Loop::ticking() const {
  // the scheduler of a vendor's thread is only known from the kernel
  const std::string observed = late_ticks_.scheduler();
  return {driver_.devices()[driver_.clock_owner()].name,
          ticks_on_own_thread_ || observed.empty() ? scheduling_.scheduler : observed, counts_.ticks.load(),
          health().late};
}

void Loop::reset_health() noexcept {
  const std::lock_guard lock(callers_mutex_);
  stalls_before_ = watchdog_.stalls();
  late_before_ = late_ticks_.counts();
  reset_.store(true);
}

// ---- the servo thread

bool Loop::wait() noexcept {
  paced_ = pacer_.wait();
  lateness_ns_ = now_() - pacer_.scheduled_ns();
  return paced_;
}

void Loop::update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept {
  const std::int64_t started_ns = now_();
  late_ticks_.tick_here();
  const std::size_t count = mappings_.size();
  PALPATE_CHECK(samples.size() == count && commands.size() == count);
  const double dt_s = advance_time(started_ns);
  receive_inputs(samples, dt_s, started_ns);

  tick(model_.begin_tick(), parameters_, {states_.data(), count}, dt_s, state_, {wrenches_.data(), count},
       record_);
  model_.end_tick();
  for (std::size_t d = 0; d < count; ++d) commands[d] = mappings_[d].to_device(wrenches_[d]);

  const std::int64_t ended_ns = now_();
  watchdog_.beat(ended_ns);
  record_.lateness_s = static_cast<double>(lateness_ns_) * 1e-9;
  record_.compute_s = static_cast<double>(ended_ns - started_ns) * 1e-9;
  // strokes before sweeps before the record: a reader of the tick in which a motor stopped finds all its
  // sweeps, and a reader of a sweep finds its stroke
  strokes_.store(state_.strokes);
  publish_sweeps(count);
  publish();
  count_tick(started_ns, ended_ns);
}

// Time since the last tick, s, and lateness_ns_. A device with a clock of its own is late by the amount by
// which the interval between ticks exceeds its period.
double Loop::advance_time(std::int64_t now_ns) noexcept {
  const std::int64_t since_ns = last_started_ns_ == 0 ? period_ns_ : now_ns - last_started_ns_;
  if (!paced_) lateness_ns_ = std::max<std::int64_t>(0, since_ns - period_ns_);
  paced_ = false;
  last_started_ns_ = now_ns;
  return static_cast<double>(since_ns) * 1e-9;
}

// Whether this tick is stopped. A stop takes effect in the tick that reads it. A rearm takes effect if the
// last tick's tips were in free space; otherwise it is turned back into the stop.
bool Loop::apply_arming() noexcept {
  std::uint64_t arming = arming_.load();
  const bool requested_to_stop = (arming & 1) != 0;
  if (!requested_to_stop && stopped_ && touched_)
    arming_.compare_exchange_strong(arming, arming | 1);
  else
    stopped_ = requested_to_stop;
  record_.arming_number = static_cast<std::uint32_t>(arming >> 1);
  tick_arming_ = arming;
  return stopped_;
}

void Loop::receive_inputs(std::span<const DeviceSample> samples, double dt_s, std::int64_t now_ns) noexcept {
  parameters_in_.take(posted_);
  parameters_ = posted_.parameters;
  record_.settings_number = posted_.number;
  parameters_.emergency_stop = apply_arming() || posted_.parameters.emergency_stop;
  parameters_.paused = posted_.parameters.paused || stopping_.load(std::memory_order_relaxed);
  // the first tick after a stall sends zero, even if the watchdog was suspended together with the servo
  const bool stalled = dt_s > static_cast<double>(kStall_ns) * 1e-9;
  const std::uint32_t halted = stalled || watchdog_.halted() ? kDeviceHalted : 0u;
  // uses the last tick's rotation, which differs little from this one's
  const Transform<World, Patient> X_WorldPatient =
      rotated_object_pose(X_WorldPatient_, state_.rotation_applied);
  for (std::size_t d = 0; d < samples.size(); ++d) {
    states_[d] = is_in_patient_[d] ? state_in_patient(samples[d], X_WorldPatient, now_ns)
                                   : mappings_[d].to_world(samples[d], now_ns);
    states_[d].status |= halted;
  }
}

// cannot overflow: the ring holds as many sweeps as all burrs can have pending
void Loop::publish_sweeps(std::size_t devices) noexcept {
  for (std::size_t d = 0; d < devices; ++d) {
    std::uint64_t& published = published_sweeps_[d];
    for (const Sweep& sweep : finished_from(state_.device[d].burr, published)) {
      PALPATE_CHECK(sweeps_.push(record_of({static_cast<std::uint32_t>(d), sweep})));
      ++published;
    }
  }
}

// publishes the record through snapshot() and ring(), whose readers never block the loop, and the contact
// state for rearm()
void Loop::publish() noexcept {
  // devices are the record's last member: copy only those in use
  const std::size_t bytes =
      offsetof(TickRecord, device) + sizeof(DeviceTick) * static_cast<std::size_t>(record_.devices);
  snapshot_.store(record_, bytes);
  if (!ring_.push(record_, bytes)) add(counts_.dropped, 1);
  // an invalid pose counts as contact, because free space cannot be established
  constexpr std::uint32_t kContactFlags =
      kFlagContact | kFlagInside | kFlagNotFinite | kFlagNoGo | kFlagRelease;
  bool silent = parameters_.paused, touching = false;
  for (int d = 0; d < record_.devices; ++d) {
    touching = touching || (record_.device[d].flags & kContactFlags) != 0;
    silent = silent && state_.device[d].output.gain == 0 && wrenches_[d].force_N == Vector<World>();
  }
  touched_ = touching;
  free_at_.store(touching ? kNotInFreeSpace : tick_arming_);
  applied_arming_.store(tick_arming_);
  silent_.store(silent, std::memory_order_relaxed);
}

void Loop::count_tick(std::int64_t started_ns, std::int64_t ended_ns) noexcept {
  // plain load first: an exchange waits for all preceding stores
  if (reset_.load(std::memory_order_relaxed) && reset_.exchange(false)) clear_statistics();
  lateness_.add(lateness_ns_);
  compute_.add(ended_ns - started_ns);
  if (counts_.ticks.load(std::memory_order_relaxed) == 0)
    counts_.first_ns.store(started_ns, std::memory_order_relaxed);
  counts_.last_ns.store(started_ns, std::memory_order_relaxed);
  add(counts_.ticks, 1);
  cpu_.store(::sched_getcpu(), std::memory_order_relaxed);

  const std::uint64_t skipped = pacer_.skipped() - skipped_;
  skipped_ += skipped;
  add(counts_.skipped, skipped);
  const bool on_time = lateness_ns_ <= period_ns_ / 2 && lateness_ns_ + (ended_ns - started_ns) <= period_ns_;
  add(counts_.on_time, on_time);
  if (!on_time || skipped > 0) late_ticks_.add(lateness_ns_, skipped + !on_time);
}

void Loop::clear_statistics() noexcept {
  lateness_.clear();
  compute_.clear();
  for (auto* counter : {&counts_.ticks, &counts_.on_time, &counts_.skipped, &counts_.dropped})
    counter->store(0);
}

// ---- start

namespace {

Error usage(const std::string& what, const std::string& remedy) {
  return {ErrorKind::kUsage, what, "", remedy};
}

std::optional<Error> settings_error(const LoopSettings& settings) {
  if (!(settings.rate_hz >= kMinRate_hz && settings.rate_hz <= kMaxRate_hz))
    return usage("the tick rate " + std::to_string(settings.rate_hz) + " Hz is out of range",
                 "choose one from " + std::to_string(static_cast<int>(kMinRate_hz)) + " to " +
                     std::to_string(static_cast<int>(kMaxRate_hz)));
  if (!(settings.spin_s >= 0))
    return usage("the busy-wait time is negative", "set 0 to disable busy-waiting");
  if (!(settings.ring_s > 0 && settings.ring_s <= 60))
    return usage("the recorder ring of " + std::to_string(settings.ring_s) + " s is out of range",
                 "set a length above 0 and up to 60 s");
  return std::nullopt;
}

std::optional<Error> device_error(std::size_t devices, const std::vector<WorkspaceSettings>& workspaces) {
  if (devices < 1 || devices > kMaxDevices)
    return usage("the driver has " + std::to_string(devices) + " devices",
                 "a loop supports 1 to " + std::to_string(kMaxDevices));
  if (workspaces.size() != 1 && workspaces.size() != devices)
    return usage("there are " + std::to_string(workspaces.size()) + " workspaces for " +
                     std::to_string(devices) + " devices",
                 "give one for each device, or one for all");
  const auto is_scale = [](double value) { return value >= kMinScale && value <= kMaxScale; };
  for (const WorkspaceSettings& workspace : workspaces) {
    if (!is_scale(workspace.scale) || !(workspace.force_gain > 0 && std::isfinite(workspace.force_gain)))
      return usage("a workspace has the scale " + std::to_string(workspace.scale) + " and the force gain " +
                       std::to_string(workspace.force_gain),
                   "choose a scale from 0.05 to 20, and a gain above 0");
    if (!std::isfinite(workspace.yaw_deg) || (workspace.home && !workspace.home->all_finite()))
      return usage("the yaw or home of a workspace is not finite", "set finite degrees and millimetres");
  }
  return std::nullopt;
}

Result<std::unique_ptr<Loop>> checked_loop(std::shared_ptr<const Model> model, DeviceDriver& driver,
                                           const Parameters& parameters,
                                           const std::vector<WorkspaceSettings>& workspaces,
                                           const LoopSettings& settings, TimeSource now) {
  if (auto error = settings_error(settings)) return *error;
  if (model == nullptr || !model->has(model->rendered_method(ForceMethod::kProxy)))
    return usage("the model is missing or not prepared for any force method",
                 "prepare the model by prepared_for()");
  if (auto opened = driver.open(settings.may_move); !opened) return opened.error();
  if (auto error = device_error(driver.devices().size(), workspaces)) return *error;
  return std::make_unique<Loop>(std::move(model), driver, parameters, workspaces, settings, now);
}

}  // namespace

Result<std::unique_ptr<ServoLoop>> ServoLoop::start(std::shared_ptr<const Model> model, DeviceDriver& driver,
                                                    const Parameters& parameters,
                                                    const std::vector<WorkspaceSettings>& workspaces,
                                                    const LoopSettings& settings) {
  auto loop = checked_loop(std::move(model), driver, parameters, workspaces, settings, monotonic_ns);
  if (!loop) return loop.error();
  if (auto begun = (*loop)->begin(); !begun) return begun.error();
  return std::unique_ptr<ServoLoop>(*std::move(loop));
}

Result<std::unique_ptr<ServoLoop>> ServoLoop::make_unthreaded(
    std::shared_ptr<const Model> model, DeviceDriver& driver, const Parameters& parameters,
    const std::vector<WorkspaceSettings>& workspaces, const LoopSettings& settings, TimeSource now) {
  auto loop = checked_loop(std::move(model), driver, parameters, workspaces, settings, now);
  if (!loop) return loop.error();
  return std::unique_ptr<ServoLoop>(*std::move(loop));
}

}  // namespace palpate
