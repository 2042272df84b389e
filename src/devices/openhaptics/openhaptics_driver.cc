#include "palpate/openhaptics/openhaptics_driver.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <mutex>
#include <string_view>
#include <system_error>
#include <thread>

#include "openhaptics/hd_calls.h"
#include "openhaptics/openhaptics_failures.h"
#include "palpate/base/clock.h"
#include "palpate/base/printable.h"
#include "palpate/device/telemetry.h"

namespace palpate {
namespace hd {

/// A device of the driver.
struct Unit {
  std::string config;  ///< Name in the vendor's configuration; empty: the default device
  DeviceInfo info;
  std::string identity;
  std::atomic<Handle> handle{kBadHandle};
  int style = 0;  ///< Calibration style in use; 0: unknown
  /// Peak force of the device, including the part that compensates the attached mass
  std::optional<double> max_N;
  // ---- the thread that runs the frame
  DeviceSample sample;
  Failure failure = Failure::kNone, calibration = Failure::kNone, tripped = Failure::kNone;
  bool update_calibration = false;
  double carried = 0;  ///< Fraction of the attached weight that is compensated at present
  std::int64_t tripped_until_ns = 0, calibration_ns = 0;
};

}  // namespace hd

namespace {

using HdFailure = hd::Failure;
using HdUnit = hd::Unit;

constexpr auto kFindEvery = std::chrono::milliseconds(100), kFindPoll = std::chrono::milliseconds(5);
constexpr auto kOwnPeriod = std::chrono::milliseconds(1);
constexpr std::int64_t kCalibrationEvery_ns = 50'000'000, kLastZero_ns = 100'000'000,
                       kLastCall_ns = 1'000'000'000;
constexpr double kGravity_m_s2 = 9.81, kCarriedIn_s = 0.5;

std::string newtons(double force_N) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.2f N", force_N);
  return text.data();
}

// specifications that the device does not report
void add_known(std::string_view model, DeviceInfo& info) {
  struct Known {
    const char* part;
    double peak_N, continuous_N, step_mm;
  };
  // longer names first, because they contain the shorter ones
  constexpr Known kKnown[] = {{"Touch X", 7.9, 1.75, 0.023},
                              {"Desktop", 7.9, 1.75, 0.023},
                              {"Touch", 3.3, 0.88, 0.055},
                              {"Omni", 3.3, 0.88, 0.055},
                              {"Premium 1.5", 8.5, 1.4, 0.03}};
  for (const Known& known : kKnown)
    if (model.find(known.part) != std::string_view::npos) {
      if (!info.peak_force_N) info.peak_force_N = known.peak_N;
      if (!info.continuous_force_N) info.continuous_force_N = known.continuous_N;
      info.position_step_mm = known.step_mm;
      return;
    }
}

/// Calibration style of a device that needs the least manual action, out of those it supports; 0: none.
int style_of(int styles) {
  for (const int style : {hd::kAuto, hd::kInkwell, hd::kEncoderReset})
    if (styles & style) return style;
  return 0;
}

}  // namespace

class OpenHapticsDriver::Core {
 public:
  explicit Core(const OpenHapticsSettings& settings) : settings_(settings) {}
  /// Ends the use of the library, waiting for a second at most.
  /// @return false: threads had to be abandoned in the library, and may access this object at any time
  bool end() {
    if (!finder_.joinable()) return true;
    end_.store(true);
    if (wait_or_abandon([&] { return is_finder_done_.load(); })) {
      finder_.join();
    } else {
      finder_.detach();
    }
    return !abandoned_.load();
  }

  std::span<const DeviceInfo> devices() const { return infos_; }

  Result<void> open() {
    if (finder_.joinable()) return {};
    if (!library_) {
      const auto file = find_vendor_library(settings_.library, "OpenHaptics", hd::kMissingLibraryRemedy);
      if (!file) return file.error();
      auto loaded = hd::load(*file);
      if (!loaded) return loaded.error();
      library_ = *loaded;
    }
    count_ = std::clamp<std::size_t>(settings_.names.size(), 1, kMaxDevices);
    infos_.clear();
    for (std::size_t d = 0; d < count_; ++d) {
      units_[d].config = settings_.names.empty() ? "" : settings_.names[d];
      unsigned error = hd::kNoError;
      units_[d].handle = hd::init(*library_, units_[d].config, error);
      if (units_[d].handle == hd::kBadHandle) {
        disable_all();
        return hd::init_error(*library_, error, units_[d].config.empty() ? "touch" : units_[d].config);
      }
      describe(units_[d]);
      auto ready = subtract_attached_weight(units_[d]);
      if (ready) ready = prepare(units_[d]);
      if (!ready) {
        disable_all();
        return ready.error();
      }
      infos_.push_back(units_[d].info);
    }
    try {
      finder_ = std::thread([this] {
        run_finder();
        is_finder_done_.store(true);
      });
    } catch (const std::system_error& error) {
      disable_all();
      return Error{ErrorKind::kUnavailable, std::string("cannot start a thread: ") + error.what(), "touch",
                   "close other programs, or raise the process limit (ulimit -u)"};
    }
    return {};
  }

  void run(ServoFunction& servo, ServoClock& clock) {
    if (abandoned_.load()) return;
    servo_ = &servo;
    commands_ = {};
    stopping_.store(false);
    zero_frames_.store(0);
    if (link_.load() == Link::kConnected) start(Owner::kVendor);
    while (!clock.stopped()) {
      std::this_thread::sleep_for(kOwnPeriod);
      if (link_.load() == Link::kConnected) watch_scheduler();
      if (link_.load() == Link::kFound) {
        start(Owner::kOwn);
        link_.store(Link::kAwaitingFrame);
      }
      if (link_.load() == Link::kAwaitingFrame) await_frame();
      if (link_.load() == Link::kConnected) continue;
      // without frames nobody else ticks, and other devices may depend on these ticks
      for (std::size_t d = 0; d < count_; ++d) samples_[d].fault = true;
      servo.update(std::span(samples_).first(count_), std::span(commands_).first(count_));
    }
    stop();
    servo_ = nullptr;
  }

  void halt() {
    halted_.store(true);
    switch_off();
  }
  void resume() { halted_.store(false); }

  std::optional<Error> failure() const {
    const HdFailure now = failure_.load();
    if (now == HdFailure::kNone) return std::nullopt;
    return hd::error_for(
        now, infos_.empty() ? "touch" : infos_[std::min(failing_device_.load(), infos_.size() - 1)].name);
  }

 private:
  /// Thread that calls the servo. run() takes over in kVendor or kReading only; a frame in which the device
  /// is lost hands over to it at its end.
  enum class Owner : std::uint8_t {
    kVendor,   ///< The vendor's thread, between frames
    kReading,  ///< The vendor's thread, while it reads the devices in a frame
    kInFrame,  ///< The vendor's thread, from then to the end of the frame
    kOwn,      ///< run()
  };
  /// State of the connection to the library, which determines the threads that may use it.
  enum class Link : std::uint8_t {
    kConnected,      ///< The vendor's thread and run()
    kLost,           ///< The finder, which initialises the devices again
    kFound,          ///< run(), which starts the scheduler
    kAwaitingFrame,  ///< As kConnected, but run() ticks, and the vendor's frames carry zeros, until one has
                     ///< ended
  };

  // ---- the thread that opens, and the finder
  void describe(HdUnit& unit) {
    const hd::Library& library = *library_;
    library.hdMakeCurrentDevice(unit.handle);
    const std::string model = hd::text_of(library, hd::kModelType),
                      serial = hd::text_of(library, hd::kSerialNumber);
    DeviceInfo info;
    info.name = (model.empty() ? "OpenHaptics device" : model) + (serial.empty() ? "" : " no. " + serial);
    info.drive = DeviceInfo::Drive::kCallback;
    info.peak_force_N = hd::number_of(library, hd::kMaxForce, 1000);
    info.continuous_force_N = hd::number_of(library, hd::kMaxContinuousForce, 1000);
    info.stiffness_N_per_mm = hd::number_of(library, hd::kMaxStiffness, 100);
    int rate_hz = 0;
    library.hdGetIntegerv(hd::kUpdateRate, &rate_hz);
    if (rate_hz > 0 && rate_hz <= 100'000) info.rate_hz = rate_hz;
    std::array<double, 6> box{};
    library.hdGetDoublev(hd::kUsableWorkspace, box.data());
    const Point<Device> low(box[0], box[1], box[2]), high(box[3], box[4], box[5]);
    if (low.all_finite() && high.all_finite() && low.x() < high.x() && low.y() < high.y() &&
        low.z() < high.z())
      info.workspace = {low, high};
    add_known(model, info);
    info.degrees_of_freedom_in = 6;
    info.degrees_of_freedom_out = 3;
    info.buttons = 2;
    info.R_WorldDevice = openhaptics_axes();
    int styles = 0;
    library.hdGetIntegerv(hd::kCalibrationStyle, &styles);
    unit.style = style_of(styles);
    unit.info = info;
    unit.identity = identity_of(unit);
    hd::drain(library);
  }
  /// Reduces the force limits by the weight of the attached mass.
  Result<void> subtract_attached_weight(HdUnit& unit) const {
    DeviceInfo& info = unit.info;
    unit.max_N = info.peak_force_N;
    if (!settings_.held_mass_kg) return {};
    const double weight_N = *settings_.held_mass_kg * kGravity_m_s2;
    for (std::optional<double>* limit_N : {&info.peak_force_N, &info.continuous_force_N}) {
      if (!*limit_N) continue;
      if (weight_N >= **limit_N)
        return Error{ErrorKind::kUsage,
                     "the tool weighs " + newtons(weight_N) + ", and the device can carry " +
                         newtons(**limit_N) +
                         (limit_N == &info.continuous_force_N ? " without overheating" : ""),
                     info.name, "give a mass that it can carry, or none: --held-mass touch=KG"};
      **limit_N -= weight_N;
    }
    return {};
  }

  std::string identity_of(const HdUnit& unit) {
    library_->hdMakeCurrentDevice(unit.handle);
    return hd::text_of(*library_, hd::kModelType) + "\n" + hd::text_of(*library_, hd::kSerialNumber);
  }

  /// Called after initialisation and before the scheduler starts.
  Result<void> prepare(HdUnit& unit) {
    library_->hdMakeCurrentDevice(unit.handle);
    hd::drain(*library_);
    library_->hdEnable(hd::kMaxForceClamping);
    library_->hdEnable(hd::kForceRamping);
    if (!halted_.load()) library_->hdEnable(hd::kForceOutput);
    if (const unsigned error = hd::drain(*library_); error != hd::kNoError && !hd::is_warning(error)) {
      const char* message = library_->hdGetErrorString(error);
      return Error{ErrorKind::kUnavailable,
                   "the force limits of the library cannot be enabled" +
                       (message && *message ? " (" + printable_name(message) + ")" : std::string()),
                   unit.info.name, "switch the device off and on again; install the newest OpenHaptics"};
    }
    unit.calibration = HdFailure::kNone;
    unit.calibration_ns = unit.tripped_until_ns = 0;
    unit.update_calibration = false;
    if (unit.style == hd::kEncoderReset && library_->hdCheckCalibration() != hd::kCalibrated)
      library_->hdUpdateCalibration(hd::kEncoderReset);
    hd::drain(*library_);
    return {};
  }

  void disable_all() {
    for (std::size_t d = 0; d < count_; ++d)
      if (units_[d].handle != hd::kBadHandle) {
        library_->hdDisableDevice(units_[d].handle);
        units_[d].handle = hd::kBadHandle;
      }
    if (library_) hd::drain(*library_);
  }

  // ---- run()'s thread
  void start(Owner ticks) {
    for (HdUnit& unit : units_) unit.carried = 0;
    // a halt or a stop may have disabled forces: the first frame enables them
    force_on_.store(false);
    last_frame_ns_.store(monotonic_ns());
    has_framed_.store(false);
    failed_.store(false);
    owner_.store(ticks);
    scheduled_ = library_->hdScheduleAsynchronous(
        [](void* core) -> unsigned {
          Core& self = *static_cast<Core*>(core);
          self.inside_.store(true);
          self.frame();
          self.inside_.store(false);
          return hd::kCallbackContinue;
        },
        this, hd::kDefaultPriority);
    running_.store(true);
    library_->hdStartScheduler();
  }

  void watch_scheduler() {
    const std::int64_t since_ns = monotonic_ns() - last_frame_ns_.load();
    if (!failed_.load() && since_ns < to_ns(kLate_s)) return;
    // the device keeps the last commanded force
    if (force_on_.load()) switch_off();
    has_framed_.store(false);
    Owner was = Owner::kVendor;
    // a thread within the servo has to return first; one that has not entered it will find the ownership
    // taken
    if (!owner_.compare_exchange_strong(was, Owner::kOwn) &&
        (was != Owner::kReading || !owner_.compare_exchange_strong(was, Owner::kOwn)) && was != Owner::kOwn)
      return;
    // a frame may have failed in the meantime
    link_.store(failed_.exchange(false) ? Link::kLost : Link::kAwaitingFrame);
  }

  // ticks return to the vendor's thread as soon as it completes a frame
  void await_frame() {
    if (failed_.exchange(false)) {
      note(HdFailure::kLost, 0);
      link_.store(Link::kLost);
    } else if (has_framed_.load()) {
      link_.store(Link::kConnected);
      owner_.store(Owner::kVendor);
    } else if (monotonic_ns() - last_frame_ns_.load() >= to_ns(kAbandoned_s)) {
      note(HdFailure::kStalled, 0);
      link_.store(Link::kLost);
    }
  }

  // sends zero in a frame, then stops the library
  void stop() {
    stopping_.store(true);
    if (link_.load() == Link::kConnected || link_.load() == Link::kAwaitingFrame) {
      link_.store(Link::kConnected);
      const std::int64_t until_ns = monotonic_ns() + kLastZero_ns;
      while (zero_frames_.load() < 2 && monotonic_ns() < until_ns) std::this_thread::sleep_for(kOwnPeriod);
      scheduler_stop_requested_.store(true);
      wait_or_abandon([&] { return !running_.load(); });
    }
    // later frames bypass the servo; one that is in it is waited for without a timeout
    while (in_servo_.load()) std::this_thread::sleep_for(kOwnPeriod);
  }

  /// Waits for a condition that depends on the library. After a timeout its threads are abandoned.
  template <class Condition>
  bool wait_or_abandon(Condition&& condition) {
    const std::int64_t until_ns = monotonic_ns() + kLastCall_ns;
    while (!condition() && !abandoned_.load()) {
      if (monotonic_ns() > until_ns) abandoned_.store(true);
      std::this_thread::sleep_for(kOwnPeriod);
    }
    return !abandoned_.load();
  }

  // ---- any thread
  void switch_off() {
    for (std::size_t d = 0; d < count_; ++d) {
      // a single device is always current
      if (count_ > 1) library_->hdMakeCurrentDevice(units_[d].handle);
      library_->hdDisable(hd::kForceOutput);
    }
    // last, so that a frame that enables forces concurrently is followed by one that does so again
    force_on_.store(false);
  }
  void note(HdFailure failure, std::size_t device) {
    failing_device_.store(device);
    failure_.store(failure);
  }

  // ---- the vendor's thread
  void frame() {
    Owner own = Owner::kVendor;
    if (!owner_.compare_exchange_strong(own, Owner::kReading)) return zero_frame();
    const std::int64_t now_ns = monotonic_ns();
    const bool was_off = !force_on_.load();
    for (HdUnit& unit : std::span(units_).first(count_)) read(unit, now_ns);
    own = Owner::kReading;
    if (!owner_.compare_exchange_strong(own, Owner::kInFrame)) {
      if (std::ranges::any_of(std::span(units_).first(count_),
                              [](const HdUnit& unit) { return unit.failure == HdFailure::kLost; }))
        failed_.store(true);
      return end_with_zeros();
    }
    for (std::size_t d = 0; d < count_; ++d) {
      samples_[d] = units_[d].sample;
      // marked as a fault so that the returning force is ramped
      samples_[d].fault = samples_[d].fault || was_off;
    }
    in_servo_.store(true);
    const bool stopping = stopping_.load() || abandoned_.load();
    if (!stopping) servo_->update(std::span(samples_).first(count_), std::span(commands_).first(count_));
    in_servo_.store(false);
    for (std::size_t d = 0; d < count_; ++d)
      end_frame(units_[d], stopping || samples_[d].fault ? nullptr : &commands_[d]);
    const unsigned error = hd::drain(*library_);
    std::size_t worst = 0;
    for (std::size_t d = 0; d < count_; ++d) {
      if (error != hd::kNoError) receive_error(units_[d], error, now_ns);
      if (units_[d].update_calibration) {
        units_[d].update_calibration = false;
        library_->hdMakeCurrentDevice(units_[d].handle);
        library_->hdUpdateCalibration(static_cast<unsigned>(units_[d].style));
        hd::drain(*library_);
      }
      if (units_[worst].failure == HdFailure::kNone ||
          (units_[d].failure != HdFailure::kNone && units_[d].failure < units_[worst].failure))
        worst = d;
    }
    note(units_[worst].failure, worst);
    if (was_off && !halted_.load() && !stopping) switch_on();
    if (stopping) zero_frames_.fetch_add(1);
    last_frame_ns_.store(monotonic_ns());
    if (units_[worst].failure == HdFailure::kLost) failed_.store(true);
    owner_.store(units_[worst].failure == HdFailure::kLost ? Owner::kOwn : Owner::kVendor);
  }

  // a frame while another thread ticks, or none
  void zero_frame() {
    if (owner_.load() != Owner::kOwn) return;
    for (std::size_t d = 0; d < count_; ++d) {
      library_->hdMakeCurrentDevice(units_[d].handle);
      library_->hdBeginFrame(units_[d].handle);
    }
    end_with_zeros();
  }
  void end_with_zeros() {
    for (std::size_t d = 0; d < count_; ++d) end_frame(units_[d], nullptr);
    if (const unsigned error = hd::drain(*library_); error != hd::kNoError && !hd::is_warning(error))
      failed_.store(true);
    if (stopping_.load()) zero_frames_.fetch_add(1);
    last_frame_ns_.store(monotonic_ns());
    has_framed_.store(true);
  }

  void read(HdUnit& unit, std::int64_t now_ns) {
    const hd::Library& library = *library_;
    library.hdMakeCurrentDevice(unit.handle);
    library.hdBeginFrame(unit.handle);
    // a failed call leaves the values unchanged
    Eigen::Vector3d tip_mm = Eigen::Vector3d::Constant(kNoValue), velocity_mm_s = tip_mm,
                    turning_rad_s = tip_mm;
    Eigen::Matrix4d transform = Eigen::Matrix4d::Constant(kNoValue);
    int buttons = 0;
    library.hdGetDoublev(hd::kPosition, tip_mm.data());
    library.hdGetDoublev(hd::kVelocity, velocity_mm_s.data());
    library.hdGetDoublev(hd::kAngularVelocity, turning_rad_s.data());
    // column-major, as in Eigen
    library.hdGetDoublev(hd::kTransform, transform.data());
    library.hdGetIntegerv(hd::kButtons, &buttons);
    if (now_ns - unit.calibration_ns > kCalibrationEvery_ns) {
      unit.calibration_ns = now_ns;
      check_calibration(unit);
    }
    unit.failure = unit.calibration;
    if (now_ns < unit.tripped_until_ns && unit.failure == HdFailure::kNone) unit.failure = unit.tripped;
    if (const unsigned error = hd::drain(library); error != hd::kNoError) receive_error(unit, error, now_ns);
    const Eigen::Matrix3d turn = transform.topLeftCorner<3, 3>();
    const bool is_pose = tip_mm.allFinite() && turn.allFinite() && std::abs(turn.determinant() - 1) < 0.1;
    if (!is_pose && unit.failure != HdFailure::kLost) unit.failure = HdFailure::kBroken;
    DeviceSample& sample = unit.sample;
    sample.fault = unit.failure != HdFailure::kNone;
    if (!is_pose || unit.failure == HdFailure::kLost) return;
    sample.tip = Point<Device>(tip_mm);
    sample.R_DeviceTool = Eigen::Quaterniond(turn).normalized();
    const Vector<Device> none(kNoValue, kNoValue, kNoValue);
    sample.velocity_mm_s = velocity_mm_s.allFinite() ? Vector<Device>(velocity_mm_s) : none;
    sample.angular_velocity_rad_s = turning_rad_s.allFinite() ? Vector<Device>(turning_rad_s) : none;
    sample.buttons = static_cast<std::uint32_t>(buttons);
    sample.taken_ns = now_ns;
  }

  void check_calibration(HdUnit& unit) {
    const unsigned state = library_->hdCheckCalibration();
    unit.calibration = HdFailure::kNone;
    if (state == hd::kCalibrated) return;
    unit.calibration = unit.style == hd::kInkwell ? HdFailure::kInkwell : HdFailure::kReset;
    // resetting the encoders requires an arm that nobody holds
    unit.update_calibration =
        state == hd::kNeedsUpdate && (unit.style == hd::kAuto || unit.style == hd::kInkwell);
  }

  void receive_error(HdUnit& unit, unsigned code, std::int64_t now_ns) {
    HdFailure failure = HdFailure::kLost;
    if (code == hd::kWarmMotors) failure = HdFailure::kWarm;
    if (code == hd::kExceededForce || code == hd::kExceededImpulse || code == hd::kForceError)
      failure = HdFailure::kForce;
    if (code == hd::kExceededVelocity) failure = HdFailure::kVelocityTrip;
    if (failure != HdFailure::kLost) {
      unit.tripped = failure;
      unit.tripped_until_ns = now_ns + to_ns(kCalm_s);
    }
    if (unit.failure == HdFailure::kNone || failure < unit.failure) unit.failure = failure;
    unit.sample.fault = true;
  }

  /// @param command  nullptr: zero
  void end_frame(HdUnit& unit, const DeviceCommand* command) {
    const bool gives = command && !halted_.load();
    Eigen::Vector3d force_N = gives ? command->force_N.eigen() : Eigen::Vector3d::Zero();
    // compensates the weight of the attached mass (y is up), ramped like a force
    const double step = unit.info.rate_hz ? 1 / (*unit.info.rate_hz * kCarriedIn_s) : 1e-3;
    unit.carried = gives ? std::min(1.0, unit.carried + step) : 0;
    if (settings_.held_mass_kg) force_N.y() += unit.carried * *settings_.held_mass_kg * kGravity_m_s2;
    const double max_N = unit.max_N.value_or(force_N.norm());
    if (force_N.norm() > max_N) force_N *= max_N / force_N.norm();
    library_->hdMakeCurrentDevice(unit.handle);
    library_->hdSetDoublev(hd::kForce, force_N.data());
    library_->hdEndFrame(unit.handle);
  }

  void switch_on() {
    force_on_.store(true);
    for (std::size_t d = 0; d < count_; ++d) {
      library_->hdMakeCurrentDevice(units_[d].handle);
      library_->hdEnable(hd::kForceOutput);
    }
    // a halt arrived meanwhile
    if (halted_.load()) switch_off();
  }

  // ---- the finder's thread
  void run_finder() {
    auto next = std::chrono::steady_clock::now();
    while (!end_.load() && !abandoned_.load()) {
      std::this_thread::sleep_for(kFindPoll);
      if (scheduler_stop_requested_.exchange(false)) {
        if (zero_frames_.load() < 2) switch_off();
        stop_scheduler();
      }
      if (link_.load() != Link::kLost || std::chrono::steady_clock::now() < next) continue;
      next = std::chrono::steady_clock::now() + kFindEvery;
      if (!stop_scheduler()) continue;
      disable_all();
      bool all = true;
      for (std::size_t d = 0; d < count_ && all; ++d) {
        HdUnit& unit = units_[d];
        unsigned error = hd::kNoError;
        unit.handle = hd::init(*library_, unit.config, error);
        all = unit.handle != hd::kBadHandle && identity_of(unit) == unit.identity;
        if (unit.handle == hd::kBadHandle)
          note(HdFailure::kLost, d);
        else if (!all)
          note(HdFailure::kOtherDevice, d);
        if (all && !prepare(unit)) {
          all = false;
          note(HdFailure::kLost, d);
        }
      }
      if (all) link_.store(Link::kFound);
    }
    // an abandoned scheduler that returns is left alone, because the program may be exiting
    if (!abandoned_.load() && stop_scheduler()) disable_all();
  }

  /// @return false: it was abandoned meanwhile
  bool stop_scheduler() {
    if (running_.load()) {
      library_->hdStopScheduler();
      library_->hdUnschedule(scheduled_);
      // calls that had already started
      while (inside_.load() && !abandoned_.load()) std::this_thread::sleep_for(kOwnPeriod);
      running_.store(false);
    }
    return !abandoned_.load();
  }

  const OpenHapticsSettings settings_;
  std::optional<hd::Library> library_;
  std::array<HdUnit, kMaxDevices> units_{};
  std::size_t count_ = 0;
  std::vector<DeviceInfo> infos_;
  ServoFunction* servo_ = nullptr;
  unsigned long scheduled_ = 0;
  // thread that runs the frame
  std::array<DeviceSample, kMaxDevices> samples_{};
  std::array<DeviceCommand, kMaxDevices> commands_{};

  std::atomic<Owner> owner_{Owner::kOwn};
  std::atomic<Link> link_{Link::kConnected};
  std::atomic<bool> halted_{false}, stopping_{false}, force_on_{false}, failed_{false}, running_{false},
      has_framed_{false}, inside_{false}, in_servo_{false}, abandoned_{false},
      scheduler_stop_requested_{false}, end_{false}, is_finder_done_{false};
  std::atomic<int> zero_frames_{0};
  std::atomic<std::int64_t> last_frame_ns_{0};
  std::atomic<HdFailure> failure_{HdFailure::kNone};
  std::atomic<std::size_t> failing_device_{0};
  std::thread finder_;
};

OpenHapticsDriver::OpenHapticsDriver(const OpenHapticsSettings& settings)
    : core_(std::make_unique<Core>(settings)) {}
OpenHapticsDriver::~OpenHapticsDriver() {
  if (core_->end()) return;
  // Threads abandoned in the library may return to it at any time, so that these objects live until the
  // process ends, beyond the end of main()
  static std::mutex mutex;
  static auto* const left = new std::vector<std::unique_ptr<Core>>;
  const std::lock_guard lock(mutex);
  left->push_back(std::move(core_));
}

std::span<const DeviceInfo> OpenHapticsDriver::devices() const {
  return core_->devices();
}

Result<void> OpenHapticsDriver::open(bool /*may_move*/) {
  return core_->open();
}

void OpenHapticsDriver::run(ServoFunction& servo, ServoClock& clock) noexcept {
  core_->run(servo, clock);
}

void OpenHapticsDriver::halt() noexcept {
  core_->halt();
}

void OpenHapticsDriver::resume(std::uint64_t /*newest*/) noexcept {
  core_->resume();
}

std::optional<Error> OpenHapticsDriver::failure() const {
  return core_->failure();
}

}  // namespace palpate
