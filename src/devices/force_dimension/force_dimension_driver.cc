#include "palpate/force_dimension/force_dimension_driver.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <system_error>
#include <thread>

#include "force_dimension/dhd_calls.h"
#include "force_dimension/force_dimension_failures.h"
#include "force_dimension/models.h"
#include "palpate/base/clock.h"
#include "palpate/device/telemetry.h"

namespace palpate {
namespace dhd {

constexpr char kNoDevice = -1;

/// A device of the driver. Its library id belongs to the servo's thread while `state` is kThere, and to the
/// finder's thread while it is kLost; changes of `state` transfer it.
struct Unit {
  enum class State : std::uint8_t { kThere, kLost, kBack };
  Identity identity;
  DeviceModel model;
  DeviceInfo info;
  bool turns = false, gripper = false;
  std::atomic<char> id{kNoDevice};
  std::atomic<int> halts{0};  ///< Number of threads that are disabling its motors at this moment
  std::atomic<State> state{State::kThere};
  std::atomic<Failure> failure{Failure::kNone};

  // ---- the servo's thread
  DeviceSample sample;
  Failure status_failure = Failure::kNone, off_why = Failure::kNone;
  std::int64_t status_ns = 0, failing_since_ns = 0, unheard_since_ns = 0, off_since_ns = 0;
  /// Cause of forces disabled by the operator, until the device reports them enabled; 0: none
  int operator_off_cause = 0;
  bool force_on = false;   ///< Whether palpate has enabled forces
  bool motors_on = true;   ///< Whether the device last reported forces enabled; true if unknown
  bool is_broken = false;  ///< Whether its latest pose is invalid
};

}  // namespace dhd

namespace {

using dhd::DeviceModel;
using dhd::kNoDevice;
using DhdFailure = dhd::Failure;
using DhdUnit = dhd::Unit;

// interval of the search for a lost device, and of polling whether a search is wanted
constexpr auto kFindEvery = std::chrono::milliseconds(100), kFindPoll = std::chrono::milliseconds(5);
constexpr std::int64_t kLastCall_ns = 1'000'000'000;

DhdFailure error_of_cause(int cause) {
  switch (cause) {
    case dhd::kByButton:
      return DhdFailure::kButton;
    case dhd::kByVelocity:
      return DhdFailure::kVelocity;
    case dhd::kByWatchdog:
      return DhdFailure::kWatchdog;
    case dhd::kByUsb:
      return DhdFailure::kUsb;
    case dhd::kByDeadman:
      return DhdFailure::kDeadman;
    default:
      return DhdFailure::kForceOff;
  }
}

// disabled by the operator, or for a reason that only the operator can remove
bool is_by_hand(int cause) {
  return cause == dhd::kByButton || cause == dhd::kByUsb || cause == dhd::kByDeadman;
}

// with an unknown arm position the library's gravity compensation would act in a wrong direction
bool is_unlocated(DhdFailure failure) {
  return failure == DhdFailure::kNoPower || failure == DhdFailure::kNotInitialised ||
         failure == DhdFailure::kNeedsManualInitialisation || failure == DhdFailure::kError ||
         failure == DhdFailure::kBroken;
}

// rotation from a matrix whose rows are the device's axes, only approximately orthonormal. Empty: not a
// rotation
std::optional<Eigen::Quaterniond> turn_of(const double (&frame)[3][3]) {
  Eigen::Matrix3d matrix;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) matrix(r, c) = frame[r][c];
  if (!matrix.allFinite() || !(std::abs(matrix.determinant() - 1) < 0.1)) return std::nullopt;
  return Eigen::Quaterniond(matrix).normalized();
}

}  // namespace

/// Members are grouped by the thread that uses them. The servo's thread is the caller of run().
class ForceDimensionDriver::Core {
 public:
  explicit Core(const ForceDimensionSettings& settings) : settings_(settings) {}
  ~Core() {
    end_.store(true);
    if (finder_.joinable()) finder_.join();
    close_all();
  }

  std::span<const DeviceInfo> devices() const { return infos_; }

  Result<void> open(bool may_move) {
    if (finder_.joinable()) return {};
    if (!library_) {
      const auto file =
          find_vendor_library(settings_.library, "Force Dimension's library", dhd::kMissingLibraryRemedy);
      if (!file) return file.error();
      auto loaded = dhd::load(*file);
      if (!loaded) return loaded.error();
      library_ = *loaded;
    }
    if (auto opened = open_all(may_move); !opened) {
      close_all();
      return opened.error();
    }
    infos_.clear();
    for (std::size_t d = 0; d < count_; ++d) infos_.push_back(units_[d].info);
    try {
      finder_ = std::thread([this] { run_finder(); });
    } catch (const std::system_error& error) {
      close_all();
      return Error{ErrorKind::kUnavailable, std::string("cannot start a thread: ") + error.what(),
                   "force-dimension", "close other programs, or raise the process limit (ulimit -u)"};
    }
    return {};
  }

  void run(ServoFunction& servo, ServoClock& clock) {
    const auto units = std::span(units_).first(count_);
    commands_ = {};
    for (DhdUnit& unit : units) {
      unit.force_on = false;
      unit.motors_on = true;
    }
    while (clock.wait()) {
      for (std::size_t d = 0; d < count_; ++d) {
        read(units[d]);
        samples_[d] = units[d].sample;
      }
      servo.update(std::span(samples_).first(count_), std::span(commands_).first(count_));
      for (std::size_t d = 0; d < count_; ++d) write(units[d], commands_[d]);
    }
    for (DhdUnit& unit : units)
      if (unit.state.load() == DhdUnit::State::kThere) {
        set_force(unit, {});
        // braking mode: an arm without compensation descends slowly
        library_->dhdStop(unit.id.load());
        unit.force_on = unit.motors_on = false;
      }
  }

  void halt() {
    halted_.store(true);
    for (DhdUnit& unit : std::span(units_).first(count_)) {
      unit.halts.fetch_add(1);
      if (const char id = unit.id.load(); id != kNoDevice) library_->dhdEnableForce(0, id);
      unit.halts.fetch_sub(1);
    }
  }
  void resume() { halted_.store(false); }

  std::optional<Error> failure() const {
    for (std::size_t d = 0; d < count_; ++d)
      if (const DhdFailure now = units_[d].failure.load(); now != DhdFailure::kNone)
        return dhd::error_for(now, units_[d].info.name);
    return std::nullopt;
  }

 private:
  // ---- the thread that opens
  Result<void> open_all(bool may_move) {
    const int count = library_->dhdGetDeviceCount();
    if (count <= 0)
      return Error{ErrorKind::kUnavailable, "no device is connected", "force-dimension",
                   "plug it in by USB and switch it on; palpate doctor --device force-dimension shows "
                   "whether the system detects one"};
    count_ = 0;
    for (int index = 0; index < std::min(count, kMaxDevices); ++index) {
      DhdUnit& unit = units_[count_];
      const int id = dhd::open_device(*library_, index);
      if (id < 0)
        return dhd::library_error(
            *library_, "device " + std::to_string(index + 1) + " cannot be opened", "force-dimension",
            "close the program that uses it; palpate doctor checks the permissions of this account");
      unit.id.store(static_cast<char>(id));
      ++count_;
      unit.identity = dhd::identity_of(*library_, unit.id);
      unit.model = dhd::model_of(unit.identity.type);
      describe(unit);
      if (auto ready = initialise(unit, may_move); !ready) return ready.error();
      if (auto limited = prepare(unit); !limited) return limited.error();
    }
    return {};
  }

  Result<void> initialise(DhdUnit& unit, bool may_move) {
    const char id = unit.id.load();
    if (dhd::is_initialised(*library_, id)) return {};
    // the session waits for manual initialisation and reports it
    if (unit.model.by_hand) return {};
    if (!library_->initialises()) return dhd::error_for(DhdFailure::kNotInitialised, unit.info.name);
    unit.info.moves_by_itself = true;
    if (auto agreed = require_consent(unit.info, may_move); !agreed) return agreed.error();
    if (library_->drdAutoInit(id) < 0) {
      const Error failed = dhd::library_error(*library_, "the arm could not be initialised", unit.info.name,
                                              "make sure that nothing obstructs it, and try again");
      // the library's motion control may still be active
      library_->drdStop(false, id);
      return failed;
    }
    // ends the library's motion control, with forces enabled
    if (library_->drdStop(true, id) < 0)
      return dhd::library_error(*library_, "the library continues to move the arm", unit.info.name,
                                "switch the device off and on again");
    return {};
  }

  /// Settings required after every opening of a device.
  Result<void> prepare(const DhdUnit& unit) {
    const char id = unit.id.load();
    const auto failed = [&](const char* what) {
      return dhd::library_error(*library_, what, unit.info.name, "switch the device off and on again");
    };
    // in addition to the limit of the output stage
    if (unit.info.peak_force_N && library_->dhdSetMaxForce(*unit.info.peak_force_N, id) < 0)
      return failed("it does not accept a force limit");
    if (settings_.held_mass_kg) {
      if (!library_->dhdSetEffectorMass || library_->dhdSetEffectorMass(*settings_.held_mass_kg, id) < 0)
        return failed("it does not accept the mass of the tool");
    }
    if (library_->dhdSetGravityCompensation &&
        library_->dhdSetGravityCompensation(settings_.gravity ? 1 : 0, id) < 0)
      return failed("it does not compensate its own weight");
    return {};
  }

  void describe(DhdUnit& unit) {
    const char id = unit.id.load();
    const DeviceModel& model = unit.model;
    DeviceInfo info;
    info.name = dhd::name_of(unit.identity);
    info.drive = DeviceInfo::Drive::kPulled;
    info.peak_force_N = model.peak_force_N;
    // an existing limit of the device is respected
    if (const double limit_N = library_->dhdGetMaxForce(id); std::isfinite(limit_N) && limit_N > 0)
      info.peak_force_N = std::min(limit_N, info.peak_force_N.value_or(limit_N));
    const bool active_wrist = library_->dhdHasActiveWrist(id);
    const bool active_gripper = library_->dhdHasActiveGripper(id);
    unit.turns = model.turns || active_wrist;
    unit.gripper = model.gripper || active_gripper;
    if (active_wrist) info.peak_torque_Nmm = model.peak_torque_Nmm;
    if (active_gripper) info.peak_gripper_N = model.peak_gripper_N;
    info.position_step_mm = model.position_step_mm;
    if (model.reach_mm) {
      // the largest cube in the ball
      const double half_mm = *model.reach_mm / std::sqrt(3.0);
      info.workspace = {Point<Device>(-half_mm, -half_mm, -half_mm),
                        Point<Device>(half_mm, half_mm, half_mm)};
    }
    info.degrees_of_freedom_in = 3 + (unit.turns ? 3 : 0) + (unit.gripper ? 1 : 0);
    info.degrees_of_freedom_out = 3 + (active_wrist ? 3 : 0) + (active_gripper ? 1 : 0);
    info.buttons = model.buttons;
    info.gripper = unit.gripper;
    info.R_WorldDevice = force_dimension_axes();
    unit.info = info;
  }

  void close_all() {
    for (std::size_t d = 0; d < count_; ++d)
      if (const char id = reclaim_id(units_[d]); id != kNoDevice) {
        library_->dhdStop(id);
        dhd::close_device(*library_, id);
      }
    count_ = 0;
  }

  // ---- the servo's thread
  void read(DhdUnit& unit) {
    if (unit.state.load() == DhdUnit::State::kBack) come_back(unit);
    DeviceSample& sample = unit.sample;
    if (unit.state.load() != DhdUnit::State::kThere) {
      sample.fault = true;
      return;
    }
    const char id = unit.id.load();
    const std::int64_t requested_ns = monotonic_ns();
    Eigen::Vector3d tip_m = Eigen::Vector3d::Constant(kNoValue), velocity_m_s = tip_m;
    double frame[3][3];
    std::fill_n(&frame[0][0], 9, kNoValue);
    const int received =
        library_->dhdGetPositionAndOrientationFrame(&tip_m[0], &tip_m[1], &tip_m[2], frame, id);
    if (received < 0) return fail(unit, requested_ns);
    unit.failing_since_ns = 0;
    if (requested_ns - unit.status_ns >= to_ns(kStatusEvery_s)) {
      unit.status_ns = requested_ns;
      unit.status_failure = read_status(unit);
      if (unit.status_failure == DhdFailure::kLost) return lose(unit);
    }
    // an old state has arbitrary contents, and says nothing about the current one
    if (received != dhd::kTimeGuard) {
      const auto turn = unit.turns ? turn_of(frame) : Eigen::Quaterniond::Identity();
      unit.is_broken = !tip_m.allFinite() || !turn;
      if (!unit.is_broken) {
        sample.tip = Point<Device>(tip_m * 1000);
        sample.R_DeviceTool = *turn;
        sample.taken_ns = requested_ns;
      }
    }
    DhdFailure failure = unit.status_failure;
    if (unit.is_broken) failure = DhdFailure::kBroken;
    if (failure == DhdFailure::kNone && unit.unheard_since_ns != 0) failure = DhdFailure::kCallFailed;
    sample.velocity_mm_s = Vector<Device>(kNoValue, kNoValue, kNoValue);
    if (library_->dhdGetLinearVelocity(&velocity_m_s[0], &velocity_m_s[1], &velocity_m_s[2], id) >= 0 &&
        velocity_m_s.allFinite())
      sample.velocity_mm_s = Vector<Device>(velocity_m_s * 1000);
    sample.gripper_rad = kNoValue;
    if (double gripper_rad = 0; unit.gripper && library_->dhdGetGripperAngleRad(&gripper_rad, id) >= 0)
      sample.gripper_rad = gripper_rad;
    sample.buttons = library_->dhdGetButtonMask(id);
    sample.fault = failure != DhdFailure::kNone;
    unit.failure.store(failure);
    // the device's own button may have enabled them since the halt
    if (unit.motors_on && (is_unlocated(failure) || halted_.load())) switch_off(unit);
    if (unit.status_failure != DhdFailure::kNone) unit.force_on = false;
  }

  void switch_off(DhdUnit& unit) {
    library_->dhdEnableForce(0, unit.id.load());
    unit.force_on = unit.motors_on = false;
  }

  DhdFailure read_status(DhdUnit& unit) {
    const char id = unit.id.load();
    std::array<int, dhd::kStatusFields> status{};
    if (library_->dhdGetStatus(status.data(), id) < 0) return DhdFailure::kCallFailed;
    if (!status[dhd::kConnected]) return DhdFailure::kLost;
    unit.motors_on = status[dhd::kForce];
    // a cause set by the operator persists until forces are enabled, whatever the device reports meanwhile
    const int cause = status[dhd::kForceOffCause];
    if (unit.motors_on) unit.operator_off_cause = 0;
    if (!unit.motors_on && is_by_hand(cause)) unit.operator_off_cause = cause;
    const bool by_hand = unit.operator_off_cause != 0;
    const int why = by_hand ? unit.operator_off_cause : cause;
    if (!status[dhd::kPower]) return DhdFailure::kNoPower;
    if (status[dhd::kError]) return DhdFailure::kError;
    if (!dhd::is_initialised(*library_, id))
      return unit.model.by_hand ? DhdFailure::kNeedsManualInitialisation : DhdFailure::kNotInitialised;
    if (unit.off_since_ns != 0) {
      // the cause "software" comes from a halt after the device's own reason
      if (!unit.motors_on && why != dhd::kBySoftware) unit.off_why = error_of_cause(why);
      // forces disabled at the device have to be enabled there
      const bool asks = !by_hand && unit.off_why != DhdFailure::kForceOff;
      if (!is_calm(unit) || (!asks && !unit.motors_on)) return unit.off_why;
      unit.off_since_ns = 0;
      return DhdFailure::kNone;
    }
    if (unit.motors_on) return DhdFailure::kNone;
    if (!by_hand && (!unit.force_on || halted_.load())) return DhdFailure::kNone;
    unit.force_on = false;
    // from a halt that has ended
    if (why == dhd::kBySoftware) return DhdFailure::kNone;
    unit.off_since_ns = monotonic_ns();
    unit.off_why = error_of_cause(why);
    return unit.off_why;
  }

  // delay before forces that the device disabled by itself are enabled again
  static bool is_calm(DhdUnit& unit) {
    const std::int64_t now_ns = monotonic_ns();
    // an unknown velocity does not count as calm
    if (!(unit.sample.velocity_mm_s.norm() <= kCalm_mm_s)) unit.off_since_ns = now_ns;
    return now_ns - unit.off_since_ns >= to_ns(kCalm_s);
  }

  void fail(DhdUnit& unit, std::int64_t now_ns) {
    unit.sample.fault = true;
    unit.failure.store(DhdFailure::kCallFailed);
    if (unit.failing_since_ns == 0) unit.failing_since_ns = now_ns;
    if (now_ns - unit.failing_since_ns > to_ns(kAbandoned_s)) lose(unit);
  }

  void lose(DhdUnit& unit) {
    // a device that does not report may still accept commands
    set_force(unit, {});
    unit.sample.fault = true;
    unit.force_on = false;
    unit.failure.store(DhdFailure::kLost);
    unit.state.store(DhdUnit::State::kLost);
  }

  void come_back(DhdUnit& unit) {
    unit.failing_since_ns = unit.unheard_since_ns = unit.status_ns = unit.off_since_ns = 0;
    unit.status_failure = DhdFailure::kNone;
    unit.operator_off_cause = 0;
    unit.force_on = unit.is_broken = false;
    unit.motors_on = true;
    unit.state.store(DhdUnit::State::kThere);
  }

  void write(DhdUnit& unit, const DeviceCommand& command) {
    if (unit.state.load() != DhdUnit::State::kThere) return;
    const bool halted = halted_.load();
    if (halted) unit.force_on = false;
    const bool fine = !halted && !unit.sample.fault && unit.sample.taken_ns != 0;
    // a zero command precedes enabling the motors
    const bool enables = fine && !unit.force_on;
    if (!set_force(unit, fine && !enables ? command : DeviceCommand{})) return on_rejected_command(unit);
    unit.unheard_since_ns = 0;
    if (enables) switch_on(unit);
  }

  void switch_on(DhdUnit& unit) {
    // the operator may have used the device's own switch since the last query
    unit.status_failure = read_status(unit);
    if (unit.status_failure == DhdFailure::kLost) return lose(unit);
    if (unit.status_failure != DhdFailure::kNone) return;
    unit.force_on = library_->dhdEnableForce(1, unit.id.load()) >= 0;
    unit.motors_on = true;
    // a halt arrived meanwhile
    if (halted_.load()) switch_off(unit);
  }

  // a device that rejects commands keeps the last force, so its motors are disabled
  void on_rejected_command(DhdUnit& unit) {
    // only once: if the operator enables them, that has to be observed first
    if (unit.motors_on) switch_off(unit);
    unit.force_on = false;
    const std::int64_t now_ns = monotonic_ns();
    if (unit.unheard_since_ns == 0) unit.unheard_since_ns = now_ns;
    if (now_ns - unit.unheard_since_ns > to_ns(kAbandoned_s)) lose(unit);
  }

  bool set_force(const DhdUnit& unit, const DeviceCommand& command) {
    const Eigen::Vector3d &f = command.force_N.eigen(), t = command.torque_Nmm.eigen() * 1e-3;
    return library_->dhdSetForceAndTorqueAndGripperForce(f[0], f[1], f[2], t[0], t[1], t[2],
                                                         command.gripper_N, unit.id.load()) >= 0;
  }

  // ---- the finder's thread
  void run_finder() {
    auto next = std::chrono::steady_clock::now();
    while (!end_.load()) {
      std::this_thread::sleep_for(kFindPoll);
      if (std::chrono::steady_clock::now() < next) continue;
      next = std::chrono::steady_clock::now() + kFindEvery;
      for (std::size_t d = 0; d < count_; ++d)
        if (units_[d].state.load() == DhdUnit::State::kLost) reopen(units_[d]);
    }
  }

  // Takes the id, after which no thread makes calls for the device, and waits for calls in progress: a halt
  // may come from any thread and must not wait. If such a call hangs in the library, the device stays open.
  static char reclaim_id(DhdUnit& unit) {
    const char id = unit.id.exchange(kNoDevice);
    const std::int64_t until_ns = monotonic_ns() + kLastCall_ns;
    while (unit.halts.load() > 0) {
      if (monotonic_ns() > until_ns) return kNoDevice;
      std::this_thread::sleep_for(kFindPoll);
    }
    return id;
  }

  void reopen(DhdUnit& unit) {
    if (const char id = reclaim_id(unit); id != kNoDevice) {
      library_->dhdStop(id);
      dhd::close_device(*library_, id);
    }
    const auto units = std::span(units_).first(count_);
    const auto open =
        std::ranges::count_if(units, [](const DhdUnit& each) { return each.id.load() != kNoDevice; });
    DhdFailure why = DhdFailure::kLost;
    const bool any = library_->dhdGetDeviceCount() > open;
    for (int index = 0; any && index < kMaxDevices; ++index) {
      if (std::ranges::any_of(
              units, [&](const DhdUnit& each) { return each.id.load() == static_cast<char>(index); }))
        continue;
      const int opened = dhd::open_device(*library_, index);
      if (opened < 0) {
        if (why == DhdFailure::kLost) why = DhdFailure::kInUse;
        continue;
      }
      const auto id = static_cast<char>(opened);
      if (dhd::identity_of(*library_, id) != unit.identity) {
        why = DhdFailure::kOtherDevice;
      } else if (!unit.model.by_hand && !dhd::is_initialised(*library_, id)) {
        // closed again meanwhile, so that the vendor's program can initialise it
        why = DhdFailure::kNotInitialised;
      } else {
        unit.id.store(id);
        if (prepare(unit)) {
          unit.state.store(DhdUnit::State::kBack);
          return;
        }
        if (reclaim_id(unit) == kNoDevice) continue;
      }
      dhd::close_device(*library_, id);
    }
    unit.failure.store(why);
  }

  const ForceDimensionSettings settings_;
  std::optional<dhd::Library> library_;
  std::array<DhdUnit, kMaxDevices> units_{};
  std::size_t count_ = 0;
  std::vector<DeviceInfo> infos_;
  std::array<DeviceSample, kMaxDevices> samples_{};
  std::array<DeviceCommand, kMaxDevices> commands_{};
  std::atomic<bool> halted_{false}, end_{false};
  std::thread finder_;
};

ForceDimensionDriver::ForceDimensionDriver(const ForceDimensionSettings& settings)
    : core_(std::make_unique<Core>(settings)) {}
ForceDimensionDriver::~ForceDimensionDriver() = default;

std::span<const DeviceInfo> ForceDimensionDriver::devices() const {
  return core_->devices();
}

Result<void> ForceDimensionDriver::open(bool may_move) {
  return core_->open(may_move);
}

void ForceDimensionDriver::run(ServoFunction& servo, ServoClock& clock) noexcept {
  core_->run(servo, clock);
}

void ForceDimensionDriver::halt() noexcept {
  core_->halt();
}

void ForceDimensionDriver::resume(std::uint64_t /*newest*/) noexcept {
  core_->resume();
}

std::optional<Error> ForceDimensionDriver::failure() const {
  return core_->failure();
}

}  // namespace palpate
