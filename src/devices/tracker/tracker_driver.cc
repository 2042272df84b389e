#include "palpate/tracker/tracker_driver.h"

#include <atomic>

#include "palpate/base/clock.h"
#include "palpate/device/interpolated_pose.h"

namespace palpate {
namespace {

constexpr const char* kSayWhere = "give its address: --tracker HOST:PORT (port 18944 for PLUS)";
// time limit of look()
constexpr double kCheckInterval_s = 1;

// smallest rotation that takes z to the direction from the tip to the markers' origin
Rotation<TrackedTool, Device> shaft_of(const Point<TrackedTool>& tip) {
  const Eigen::Vector3d along = -tip.eigen();
  if (along.norm() < 1e-6) return {};
  return Rotation<TrackedTool, Device>(shortest_rotation(Eigen::Vector3d::UnitZ(), along));
}

}  // namespace

class TrackerDriver::Core {
 public:
  explicit Core(const TrackedToolSettings& settings)
      : is_known_(!settings.stream.address.host.empty() && !settings.stream.transform.empty()),
        patient_(settings.navigation.patient.patient_from_tracker),
        registered_(settings.navigation.patient.error
                        ? std::optional(settings.navigation.patient.error->about)
                        : std::nullopt),
        tip_(settings.navigation.tip.at),
        shaft_(shaft_of(tip_)),
        stream_(settings.stream, [this](const MarkersPose& pose) { update_pose(pose); }) {
    info_.name = kTracker;
    info_.simulated = true;
    info_.degrees_of_freedom_in = 6;
    info_.degrees_of_freedom_out = 0;
    info_.in_patient = true;
  }

  std::span<const DeviceInfo> devices() const { return {&info_, 1}; }
  Result<void> open() {
    if (is_known_) return stream_.open();
    return Error{
        ErrorKind::kUsage, "no tracked tool is given", kTracker,
        "give --tracker HOST:PORT, --transform, --tip and --registration (docs/guide/navigation.md)"};
  }
  std::optional<Error> failure() const {
    if (const auto of_the_stream = stream_.failure()) return of_the_stream;
    if (!is_far_) return std::nullopt;
    return Error{ErrorKind::kUnavailable,
                 "the tip of the tool is more than a metre from the registration points of the patient",
                 kTracker, "move it to the patient, or register the patient again"};
  }

  void run(ServoFunction& servo, ServoClock& clock) {
    DeviceSample sample;
    DeviceCommand none;
    while (clock.wait()) {
      reported_.fill(sample, monotonic_ns());
      servo.update({&sample, 1}, {&none, 1});
    }
  }

 private:
  void update_pose(const MarkersPose& pose) {
    const Transform<Patient, TrackedTool> in_patient = patient_ * pose.tracker_from_tool;
    const Point<Patient> tip = in_patient * tip_;
    // written such that NaN counts as far
    is_far_ = registered_ && !((tip - *registered_).norm() <= TrackerDriver::kMaxFromPatient_mm);
    if (is_far_) return;
    const Eigen::Quaterniond turn(in_patient.linear());
    reported_.push(Point<Device>(tip.eigen()), (turn * shaft_.quaternion()).normalized(), pose.at_ns);
  }

  const bool is_known_;
  const Transform<Patient, Tracker> patient_;
  const std::optional<Point<Patient>> registered_;  // centre of the registration's points; empty if unknown
  const Point<TrackedTool> tip_;
  const Rotation<TrackedTool, Device> shaft_;  // orientation of the displayed tool in the markers' frame
  DeviceInfo info_;
  std::atomic<bool> is_far_{false};
  InterpolatedPose reported_{Point<Device>()};
  TrackerStream stream_;  // last, because its thread calls tell()
};

TrackerDriver::TrackerDriver(const TrackedToolSettings& settings) : core_(std::make_unique<Core>(settings)) {}
TrackerDriver::~TrackerDriver() = default;

std::span<const DeviceInfo> TrackerDriver::devices() const {
  return core_->devices();
}

Result<void> TrackerDriver::open(bool /*may_move*/) {
  return core_->open();
}

void TrackerDriver::run(ServoFunction& servo, ServoClock& clock) noexcept {
  core_->run(servo, clock);
}

std::optional<Error> TrackerDriver::failure() const {
  return core_->failure();
}

DeviceVendor tracker_vendor(const TrackedToolSettings& settings) {
  const auto detect = [address = settings.stream.address] {
    DeviceReport report;
    if (address.host.empty()) {
      report.checks.push_back({"a tracking server", false, "no address is given", kSayWhere});
      return report;
    }
    const std::string what = "server at " + address.text();
    TrackerStream stream({address, "", ""}, [](const MarkersPose&) {});
    if (const auto opened = stream.open(kCheckInterval_s); !opened) {
      report.checks.push_back({what, false, opened.error().what, opened.error().remedy});
      return report;
    }
    report.checks.push_back({what, true, "sends transforms", ""});
    for (const std::string& name : stream.received_transforms()) report.connected.push_back({name, "ready"});
    return report;
  };
  return {kTracker, "a tracked tool in a registered patient, from a tracker's stream (OpenIGTLink): no force",
          [settings] { return std::make_unique<TrackerDriver>(settings); }, detect};
}

}  // namespace palpate
