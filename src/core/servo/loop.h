#pragma once

#include <array>
#include <atomic>
#include <future>
#include <mutex>
#include <thread>
#include <tuple>

#include "palpate/base/clock.h"
#include "palpate/base/latency_histogram.h"
#include "palpate/base/mailbox.h"
#include "palpate/base/snapshot.h"
#include "palpate/base/spsc_ring.h"
#include "palpate/device/sweep_record.h"
#include "palpate/servo/realtime.h"
#include "palpate/servo/servo_loop.h"
#include "servo/late_ticks.h"
#include "servo/model_slot.h"
#include "servo/pacer.h"
#include "servo/watchdog.h"

namespace palpate {

/// Implementation of ServoLoop. Drivers call update() once per tick; wait() is the clock of drivers without
/// one. Members are grouped by the threads that write them.
class Loop final : public ServoLoop, public ServoFunction, public ServoClock {
 public:
  /// @param now  the monotonic clock; tests inject their own
  Loop(std::shared_ptr<const Model> model, DeviceDriver& driver, const Parameters& parameters,
       const std::vector<WorkspaceSettings>& workspaces, const LoopSettings& settings,
       TimeSource now = monotonic_ns);
  ~Loop() override;
  /// Starts the threads; returns once the servo thread has recorded its scheduling. Error kUnavailable if no
  /// thread could be created.
  Result<void> begin();
  void run(ServoClock& clock) noexcept override;

  std::uint32_t change(const std::function<void(Parameters&)>& edit) override;
  Parameters parameters() const override;
  Result<void> set_model(std::shared_ptr<const Model> model) override { return model_.set(std::move(model)); }
  std::size_t collect() override { return model_.collect(); }
  std::uint32_t emergency_stop() noexcept override;
  RearmResult rearm(std::uint32_t stop, std::uint32_t& number) noexcept override;
  Arming arming() const noexcept override;
  void stop() override;
  bool running() const noexcept override { return running_.load(); }
  TickRecord snapshot() const override { return snapshot_.load(); }
  SpscRing<TickRecord>& ring() noexcept override { return ring_; }
  SpscRing<SweepRecord>& sweeps() noexcept override { return sweeps_; }
  std::uint32_t strokes() const noexcept override { return strokes_.load(); }
  LoopHealth health() const override;
  void reset_health() noexcept override;
  const Scheduling& scheduling() const noexcept override { return scheduling_; }
  TickingThread ticking() const override;
  int cpu() const noexcept override { return cpu_.load(std::memory_order_relaxed); }
  std::span<const DeviceInfo> devices() const override { return driver_.devices(); }

  // ---- the servo thread
  bool wait() noexcept override;
  bool stopped() const noexcept override { return stop_.load(std::memory_order_relaxed); }
  void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override;

 private:
  // parameters with the number of the change that produced them
  struct Posted {
    Parameters parameters;
    std::uint32_t number = 0;
  };

  static constexpr std::uint64_t kNotInFreeSpace = ~std::uint64_t{0};

  void run(std::promise<void>& ready);
  bool apply_arming() noexcept;
  double advance_time(std::int64_t now_ns) noexcept;
  void receive_inputs(std::span<const DeviceSample> samples, double dt_s, std::int64_t now_ns) noexcept;
  void publish() noexcept;
  void publish_sweeps(std::size_t devices) noexcept;
  void count_tick(std::int64_t started_ns, std::int64_t ended_ns) noexcept;
  void clear_statistics() noexcept;

  DeviceDriver& driver_;
  const LoopSettings settings_;
  const bool ticks_on_own_thread_;  // false: callback driver, ticks run in its vendor's thread
  const std::int64_t period_ns_;
  const TimeSource now_;
  const Transform<World, Patient> X_WorldPatient_;  // same in every version of the model

  // written by callers
  ModelSlot model_;
  mutable std::mutex callers_mutex_;  // serialises change(), parameters() and the baselines of health()
  Posted latest_;
  Mailbox<Posted> parameters_in_;
  std::atomic<bool> stop_{false}, stopping_{false}, reset_{false};
  // Twice the number of the last stop or rearm, plus 1 if it is a stop. A single word, so that a tick reads
  // number and state together, and a rearm's compare-exchange fails if a later stop intervened.
  std::atomic<std::uint64_t> arming_{0};

  // owned by the servo thread
  Pacer pacer_;
  Posted posted_;          // last taken from parameters_in_
  Parameters parameters_;  // input of the current tick
  std::vector<WorkspaceMapping> mappings_;
  std::array<bool, kMaxDevices> is_in_patient_{};  // DeviceInfo::in_patient
  SessionState state_;
  std::array<DeviceState, kMaxDevices> states_;
  std::array<Wrench, kMaxDevices> wrenches_;
  TickRecord record_;
  std::int64_t last_started_ns_ = 0;
  std::int64_t lateness_ns_ = 0;
  bool stopped_ = false;  // state that the last tick took from arming_
  std::uint64_t tick_arming_ = 0;
  // whether a tip was in contact in the last tick; true before the first tick, when contact is unknown
  bool touched_ = true;
  bool paced_ = false;  // the current tick was started by pacer_
  std::uint64_t skipped_ = 0;
  std::array<std::uint64_t, kMaxDevices> published_sweeps_{};

  // written by the servo thread, read by others
  Snapshot<TickRecord> snapshot_;
  SpscRing<TickRecord> ring_;
  SpscRing<SweepRecord> sweeps_{kMaxDevices * std::tuple_size_v<decltype(BurrState::sweep)>};
  std::atomic<std::uint32_t> strokes_{0};
  LatencyHistogram lateness_, compute_;
  struct Counts {
    std::atomic<std::uint64_t> ticks{0}, on_time{0}, skipped{0}, dropped{0};
    std::atomic<std::int64_t> first_ns{0}, last_ns{0};
  } counts_;
  std::atomic<bool> silent_{false}, running_{false};
  std::atomic<int> cpu_{-1};
  // arming_ as of the last tick, and the same value if all tips of that tick were in free space, else
  // kNotInFreeSpace
  std::atomic<std::uint64_t> applied_arming_{0}, free_at_{kNotInFreeSpace};

  // baselines of health() since the last reset
  LateCounts late_before_;
  std::uint64_t stalls_before_ = 0;

  Scheduling scheduling_;
  Watchdog watchdog_;
  LateTicks late_ticks_;
  std::thread thread_;
};

}  // namespace palpate
