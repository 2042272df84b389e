#include <time.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <thread>

#include "palpate/base/clock.h"
#include "palpate/base/spsc_ring.h"
#include "palpate/direct/direct_methods.h"
#include "palpate/verification/servo_timing.h"
#include "verification/bare_force.h"

namespace palpate {
namespace {

// updates between two drains of the ring, far fewer than its capacity
constexpr std::size_t kBatch = 500;
constexpr double kRate_hz = 4000;
constexpr auto kPoll = std::chrono::milliseconds(5);

// processor time of the calling thread, so that other threads only matter by their effect on the caches
std::int64_t busy_ns() noexcept {
  timespec busy{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &busy);
  return static_cast<std::int64_t>(busy.tv_sec) * 1'000'000'000 + busy.tv_nsec;
}

/// Feeds a path to the servo without waiting. Before it gets the ring, and after all rounds, it keeps the
/// loop's own pace.
class PathDriver final : public DeviceDriver {
 public:
  PathDriver(const PalpationPath& path, int rounds)
      : info_(SimulatedDevice(path.device, path.hand).info()), rounds_(rounds), taken_(kBatch) {
    const WorkspaceMapping mapping(info_, path.workspace);
    for (const DeviceState& state : path.states) {
      samples_.emplace_back();
      samples_.back().tip = mapping.to_device(state.tip);
    }
    round_ns_.reserve(static_cast<std::size_t>(rounds));
  }

  void start(SpscRing<TickRecord>& ring) { ring_.store(&ring); }
  bool done() const { return done_.load(); }
  /// Time per update in each round, ns; valid once done().
  const std::vector<double>& round_ns() const { return round_ns_; }

  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool /*may_move*/) override { return {}; }
  void halt() noexcept override {}
  void resume(std::uint64_t /*newest*/) noexcept override {}

  void run(ServoFunction& servo, ServoClock& clock) noexcept override {
    while (ring_.load() == nullptr && clock.wait()) update(servo, 0);
    for (int round = 0; round < rounds_ && !clock.stopped(); ++round) round_ns_.push_back(play(servo));
    done_.store(true);
    while (clock.wait()) update(servo, 0);
  }

 private:
  void update(ServoFunction& servo, std::size_t index) noexcept {
    DeviceSample& sample = samples_[index];
    sample.taken_ns = monotonic_ns();
    servo.update({&sample, 1}, commands_);
  }

  // plays the whole path once; returns ns per update
  double play(ServoFunction& servo) noexcept {
    std::int64_t timed_ns = 0;
    for (std::size_t begin = 0; begin < samples_.size(); begin += kBatch) {
      const std::size_t end = std::min(begin + kBatch, samples_.size());
      const std::int64_t started_ns = busy_ns();
      for (std::size_t index = begin; index < end; ++index) update(servo, index);
      timed_ns += busy_ns() - started_ns;
      while (ring_.load()->pop(taken_) > 0) {
      }
    }
    return static_cast<double>(timed_ns) / static_cast<double>(samples_.size());
  }

  DeviceInfo info_;
  const int rounds_;
  std::vector<DeviceSample> samples_;
  std::array<DeviceCommand, 1> commands_;
  std::vector<TickRecord> taken_;
  std::vector<double> round_ns_;
  std::atomic<SpscRing<TickRecord>*> ring_{nullptr};
  std::atomic<bool> done_{false};
};

}  // namespace

std::vector<double> time_ticks(const Model& model, const PalpationPath& path, ForceMethod method,
                               int rounds) {
  Parameters parameters = path.parameters;
  parameters.method = method;
  const double dt_s = 1 / path.rate_hz;
  std::vector<double> round_ns;
  for (int round = 0; round < rounds; ++round) {
    SessionState state;
    Wrench wrench;
    TickRecord record;
    const std::int64_t started_ns = busy_ns();
    for (const DeviceState& sensed : path.states)
      tick(model, parameters, {&sensed, 1}, dt_s, state, {&wrench, 1}, record);
    round_ns.push_back(static_cast<double>(busy_ns() - started_ns) / static_cast<double>(path.states.size()));
  }
  return round_ns;
}

TickCost time_ticks_beside_bare(const Model& model, const PalpationPath& path, ForceMethod method,
                                int rounds) {
  // slice lengths are chosen so that both take about the same time
  constexpr std::size_t kSlice = 250;
  constexpr int kRepeats = 4;
  Parameters parameters = path.parameters;
  parameters.method = method;
  const double dt_s = 1 / path.rate_hz, full_force_N = model.force_field(method).full_force_N();
  const Transform<Patient, World> X_PatientWorld = model.X_WorldPatient.inverse();
  std::vector<double> ticks_ns, bares_ns, ratios;
  Vector<Patient> sum_N;
  for (int round = 0; round < rounds; ++round) {
    SessionState state;
    Wrench wrench;
    TickRecord record;
    for (std::size_t begin = 0; begin < path.states.size(); begin += kSlice) {
      const auto slice = std::span(path.states).subspan(begin, std::min(kSlice, path.states.size() - begin));
      const std::int64_t started_ns = busy_ns();
      for (const DeviceState& sensed : slice)
        tick(model, parameters, {&sensed, 1}, dt_s, state, {&wrench, 1}, record);
      const std::int64_t between_ns = busy_ns();
      for (int repeat = 0; repeat < kRepeats; ++repeat)
        for (const DeviceState& sensed : slice)
          sum_N += bare_force_N(*model.field, full_force_N, X_PatientWorld * sensed.tip);
      const std::int64_t ended_ns = busy_ns();
      const auto count = static_cast<double>(slice.size());
      ticks_ns.push_back(static_cast<double>(between_ns - started_ns) / count);
      bares_ns.push_back(static_cast<double>(ended_ns - between_ns) / (kRepeats * count));
      ratios.push_back(ticks_ns.back() / bares_ns.back());
    }
  }
  // prevents the computation from being optimised away
  PALPATE_CHECK(sum_N.all_finite());
  return {median(ticks_ns), median(bares_ns), median(ratios)};
}

Percentiles time_ticks_in_contact(const Model& model, const PalpationPath& path, ForceMethod method) {
  Parameters parameters = path.parameters;
  parameters.method = method;
  const double dt_s = 1 / path.rate_hz;
  SessionState state;
  Wrench wrench;
  TickRecord record;
  std::vector<double> contact_us;
  contact_us.reserve(path.states.size());
  for (const DeviceState& sensed : path.states) {
    const std::int64_t started_ns = monotonic_ns();
    tick(model, parameters, {&sensed, 1}, dt_s, state, {&wrench, 1}, record);
    const std::int64_t ended_ns = monotonic_ns();
    if (record.device[0].label != 0) contact_us.push_back(static_cast<double>(ended_ns - started_ns) * 1e-3);
  }
  if (contact_us.empty()) return {};
  std::sort(contact_us.begin(), contact_us.end());
  const auto at = [&](double part) {
    return contact_us[static_cast<std::size_t>(part * static_cast<double>(contact_us.size() - 1))];
  };
  return {at(0.5), at(0.99), at(0.999), contact_us.back()};
}

Result<std::vector<double>> time_updates(std::shared_ptr<const Model> model, const PalpationPath& path,
                                         ForceMethod method, int rounds, const Progress& progress) {
  Parameters parameters = path.parameters;
  parameters.method = method;
  PathDriver driver(path, rounds);
  LoopSettings settings;
  settings.rate_hz = kRate_hz;
  // the kernel throttles a real-time thread that never sleeps
  settings.realtime = false;
  auto loop = ServoLoop::start(std::move(model), driver, parameters, {path.workspace}, settings);
  if (!loop) return loop.error();
  driver.start((*loop)->ring());
  while (!driver.done()) {
    if (progress.stopped()) return Progress::interrupted();
    std::this_thread::sleep_for(kPoll);
  }
  (*loop)->stop();
  return driver.round_ns();
}

double median(std::vector<double> values) {
  PALPATE_CHECK(!values.empty());
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace palpate
