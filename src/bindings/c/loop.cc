#include <array>
#include <cmath>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "c/record.h"
#include "c/session.h"
#include "palpate/base/clock.h"
#include "palpate/device/interpolated_pose.h"
#include "palpate/servo/servo_loop.h"

namespace palpate::c {
namespace {

// ticks that nobody takes out of the loop's ring
constexpr double kRing_s = 0.01;

std::optional<double> known(double value) {
  return std::isnan(value) ? std::nullopt : std::optional(value);
}

}  // namespace

/// Device whose poses the host posts. The force is read from the loop's snapshot.
class PostedDriver final : public DeviceDriver {
 public:
  /// The loop takes a device's limits from its driver.
  explicit PostedDriver(const SessionSetup& setup) : pose_(Point<Device>()) {
    info_.name = "host";
    info_.simulated = true;
    info_.in_patient = setup.in_patient;
    const DeviceParameters& device = setup.parameters.device[0];
    info_.peak_torque_Nmm = known(device.limits.peak_torque_Nmm);
    info_.continuous_force_N = known(device.limits.continuous_force_N);
    info_.position_step_mm = known(device.position_step_mm);
  }

  /// @param pose  as is_pose() accepts it
  void post(const plp_pose& pose) noexcept {
    const double* const q = pose.orientation_wxyz;
    pose_.push(Point<Device>(Eigen::Vector3d(pose.tip_mm)), Eigen::Quaterniond(q[0], q[1], q[2], q[3]),
               monotonic_ns());
  }

  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool /*may_move*/) override { return {}; }
  void run(ServoFunction& servo, ServoClock& clock) noexcept override {
    std::array<DeviceSample, 1> samples;
    std::array<DeviceCommand, 1> commands{};
    while (clock.wait()) {
      pose_.fill(samples[0], monotonic_ns());
      servo.update(samples, commands);
    }
  }
  void halt() noexcept override {}
  void resume(std::uint64_t /*newest*/) noexcept override {}

 private:
  DeviceInfo info_;
  InterpolatedPose pose_;
};

}  // namespace palpate::c

struct plp_loop {
  static constexpr palpate::c::Tag kTag = palpate::c::Tag::kLoop;
  explicit plp_loop(const palpate::c::SessionSetup& setup) : driver(setup) {}
  ~plp_loop() { tag = palpate::c::Tag::kNone; }

  palpate::c::Tag tag = kTag;
  std::mutex mutex;  ///< Guards the members that set_model changes
  std::shared_ptr<const int> family;
  std::shared_ptr<const palpate::Model> model;
  palpate::ForceMethod method = palpate::ForceMethod::kProxy;
  palpate::c::PostedDriver driver;
  std::unique_ptr<palpate::ServoLoop> loop;  // last: ends before its driver does
};

namespace palpate::c {
namespace {

plp_loop_health health_of(const plp_loop& loop) {
  const LoopHealth measured = loop.loop->health();
  plp_loop_health health{};
  health.running = loop.loop->running();
  health.ticks = measured.ticks;
  health.skipped = measured.skipped;
  health.rate_hz = measured.rate_hz;
  health.on_time = measured.on_time;
  health.lateness_p99_us = measured.lateness.p99_us;
  health.compute_p99_us = measured.compute.p99_us;
  return health;
}

}  // namespace
}  // namespace palpate::c

using palpate::c::fail;
using palpate::c::guarded;
using palpate::c::is_handle;

plp_status plp_loop_start(const plp_model* model, const plp_loop_options* options, plp_loop** loop) {
  return guarded([&] {
    if (loop == nullptr) return fail(PLP_BAD_INPUT, "loop: the place for the result is null");
    *loop = nullptr;
    plp_loop_options input;
    plp_loop_options_init(&input, sizeof input);
    if (!is_handle(model) || (options != nullptr && !palpate::c::read(options, input))) return PLP_BAD_INPUT;
    const auto setup = palpate::c::setup_of(*model, input.session);
    if (!setup) return fail(setup.error());
    if (setup->devices != 1) return fail(PLP_USAGE, "devices: a loop has one");
    if (setup->solve_soft_tissue) return fail(PLP_USAGE, "solve_soft_tissue: a loop does not");

    auto started = std::make_unique<plp_loop>(*setup);
    started->family = model->family;
    started->model = model->loaded.model;
    started->method = setup->method;
    palpate::LoopSettings settings;
    settings.rate_hz = input.rate_hz;
    settings.realtime = input.realtime != 0;
    settings.ring_s = palpate::c::kRing_s;
    auto running = palpate::ServoLoop::start(model->loaded.model, started->driver, setup->parameters,
                                             {palpate::WorkspaceSettings{}}, settings);
    if (!running) return fail(running.error());
    started->loop = *std::move(running);
    *loop = started.release();
    return PLP_OK;
  });
}

plp_status plp_loop_post(plp_loop* loop, const plp_pose* pose) {
  return guarded([&] {
    plp_pose input;
    if (!is_handle(loop) || !palpate::c::read(pose, input)) return PLP_BAD_INPUT;
    if (!palpate::c::is_pose(input))
      return fail(PLP_BAD_INPUT, "pose: give a finite tip and a unit quaternion");
    loop->driver.post(input);
    return PLP_OK;
  });
}

plp_status plp_loop_snapshot(const plp_loop* loop, plp_record* record) {
  return guarded([&] {
    if (!is_handle(loop)) return PLP_BAD_INPUT;
    return palpate::c::write(palpate::c::record_of(loop->loop->snapshot(), 0), record) ? PLP_OK
                                                                                       : PLP_BAD_INPUT;
  });
}

plp_status plp_loop_set_model(plp_loop* loop, const plp_model* model) {
  return guarded([&] {
    if (!is_handle(loop) || !is_handle(model)) return PLP_BAD_INPUT;
    const std::lock_guard lock(loop->mutex);
    if (auto fine = palpate::c::check_can_switch(*model, loop->family, *loop->model); !fine)
      return fail(fine.error());
    if (!model->current().has(loop->method))
      return fail(PLP_USAGE, "model: this version is not prepared for the loop's method");
    if (auto accepted = loop->loop->set_model(model->loaded.model); !accepted) return fail(accepted.error());
    loop->model = model->loaded.model;
    return PLP_OK;
  });
}

plp_status plp_loop_emergency_stop(plp_loop* loop) {
  return guarded([&] {
    if (!is_handle(loop)) return PLP_BAD_INPUT;
    loop->loop->emergency_stop();
    return PLP_OK;
  });
}

plp_status plp_loop_health_get(const plp_loop* loop, plp_loop_health* health) {
  return guarded([&] {
    return is_handle(loop) && palpate::c::write(palpate::c::health_of(*loop), health) ? PLP_OK
                                                                                      : PLP_BAD_INPUT;
  });
}

plp_status plp_loop_stop(plp_loop* loop) {
  return guarded([&] {
    if (!is_handle(loop)) return PLP_BAD_INPUT;
    const std::lock_guard lock(loop->mutex);
    loop->loop->stop();
    return PLP_OK;
  });
}

void plp_loop_destroy(plp_loop* loop) {
  if (loop != nullptr && is_handle(loop)) delete loop;
}
