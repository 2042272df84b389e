#include "palpate/tracker/tracker_driver.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <mutex>

#include "base/test_wait.h"
#include "device/test_wall.h"
#include "palpate/base/clock.h"
#include "palpate/device/interpolated_pose.h"
#include "palpate/openigtlink/encoding.h"
#include "tracker/test_tracker_server.h"

namespace palpate {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::soon;

constexpr const char* kTool = "StylusToTracker";
constexpr const char* kReference = "ReferenceToTracker";

Eigen::Isometry3d turned(double rad, const Eigen::Vector3d& axis, const Eigen::Vector3d& at_mm) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = Eigen::AngleAxisd(rad, axis.normalized()).toRotationMatrix();
  pose.translation() = at_mm;
  return pose;
}
const Eigen::Isometry3d kToolPose = turned(0.7, {1, 2, 3}, {100, -50, 900});

class LastSample final : public ServoFunction {
 public:
  void update(std::span<const DeviceSample> samples,
              std::span<DeviceCommand> /*commands*/) noexcept override {
    const std::lock_guard lock(mutex_);
    last_ = samples[0];
    age_s_ = 1e-9 * static_cast<double>(monotonic_ns() - last_.taken_ns);
  }
  DeviceSample last() const {
    const std::lock_guard lock(mutex_);
    return last_;
  }
  double age_s() const {
    const std::lock_guard lock(mutex_);
    return age_s_;
  }

 private:
  mutable std::mutex mutex_;
  DeviceSample last_;
  double age_s_ = 0;
};

class TrackedTip : public ::testing::Test {
 protected:
  TrackedTip() {
    settings_.stream = {{"127.0.0.1", server_.port()}, kTool, ""};
    settings_.navigation.tip.at = {-17.8, 1.1, -156.9};
    const Eigen::Isometry3d patient = turned(-0.4, {3, 1, 2}, {10, 20, -700});
    settings_.navigation.patient.patient_from_tracker = {patient.linear(), patient.translation()};
    server_.move(kTool, {kToolPose});
  }
  ~TrackedTip() override { end(); }
  void begin() {
    driver_ = std::make_unique<TrackerDriver>(settings_);
    const auto opened = driver_->open(false);
    ASSERT_TRUE(opened.ok()) << opened.error().message();
    thread_ = std::thread([this] { driver_->run(observed_, clock_); });
  }
  void end() {
    clock_.stop = true;
    if (thread_.joinable()) thread_.join();
  }
  // tip in the patient frame for a tool pose in the tracker frame
  Eigen::Vector3d tip_of(const Eigen::Isometry3d& tool) const {
    const auto& X = settings_.navigation.patient.patient_from_tracker;
    return X.linear() * (tool * settings_.navigation.tip.at.eigen()) + X.translation();
  }
  bool comes_to(const Eigen::Vector3d& tip) {
    return soon([&] { return (observed_.last().tip.eigen() - tip).norm() < 0.001; });
  }
  bool says(const char* words) {
    return soon([&] {
      const auto failure = driver_->failure();
      return failure && failure->message().find(words) != std::string::npos && !failure->remedy.empty();
    });
  }
  bool is_well() {
    return soon([&] { return !driver_->failure() && observed_.age_s() < 0.01; });
  }
  std::string refused() {
    TrackerDriver driver(settings_);
    const auto opened = driver.open(false);
    return opened ? "opened" : opened.error().message();
  }

  test::TrackerServer server_;
  TrackedToolSettings settings_;
  std::unique_ptr<TrackerDriver> driver_;
  LastSample observed_;
  testing::UntilStopped clock_;
  std::thread thread_;
};

TEST_F(TrackedTip, IsWhereTheStreamTheTipAndTheRegistrationSay) {
  begin();
  EXPECT_TRUE(driver_->devices()[0].in_patient);
  EXPECT_TRUE(driver_->devices()[0].simulated);
  EXPECT_TRUE(comes_to(tip_of(kToolPose)));
  const Eigen::Isometry3d elsewhere = turned(1.1, {2, -1, 1}, {120, -40, 950});
  server_.move(kTool, {elsewhere});
  EXPECT_TRUE(comes_to(tip_of(elsewhere)));
  // the shaft points from the tip to the markers
  const auto& X = settings_.navigation.patient.patient_from_tracker;
  const Eigen::Vector3d markers = X.linear() * elsewhere.translation() + X.translation();
  EXPECT_TRUE(soon([&] {
    return ((observed_.last().R_DeviceTool * Eigen::Vector3d::UnitZ()) -
            (markers - tip_of(elsewhere)).normalized())
               .norm() < 1e-4;
  }));
  EXPECT_EQ(server_.heard(), test::MessageBytes(igtl::greeting()));
}

// the tip stays at the same place in the patient when both are moved together
TEST_F(TrackedTip, FollowsThePatientsMarkers) {
  settings_.stream.reference = kReference;
  const Eigen::Isometry3d reference = turned(0.3, {0, 1, 0}, {-200, 30, 1000});
  server_.move(kReference, {reference});
  server_.move(kTool, {kToolPose});
  begin();
  const Eigen::Vector3d tip = tip_of(reference.inverse() * kToolPose);
  EXPECT_TRUE(comes_to(tip));
  const Eigen::Isometry3d moved = turned(0.2, {1, 1, 0}, {5, 40, -20});
  server_.move(kReference, {moved * reference});
  EXPECT_TRUE(soon([&] { return (observed_.last().tip.eigen() - tip).norm() > 5; }));
  server_.move(kTool, {moved * kToolPose});
  EXPECT_TRUE(comes_to(tip));
  server_.move(kReference, {moved * reference, false});
  EXPECT_TRUE(says("ReferenceToTracker is not visible"));
}

TEST_F(TrackedTip, AgesWhileInvisibleAndRecovers) {
  begin();
  ASSERT_TRUE(comes_to(tip_of(kToolPose)));
  server_.move(kTool, {kToolPose, false});
  EXPECT_TRUE(soon([&] { return observed_.age_s() > 0.05; }));
  EXPECT_TRUE(says("StylusToTracker is not visible"));
  EXPECT_LT((observed_.last().tip.eigen() - tip_of(kToolPose)).norm(), 0.001) << "where it was seen last";
  server_.move(kTool, {kToolPose});
  EXPECT_TRUE(is_well());
}

TEST_F(TrackedTip, CountsAsInvisibleFarFromThePatient) {
  Eigen::Isometry3d far = kToolPose, near = kToolPose;
  settings_.navigation.patient.error.emplace().about = Point<Patient>(tip_of(kToolPose));
  near.translation() += Eigen::Vector3d(0, 0, TrackerDriver::kMaxFromPatient_mm - 1);
  far.translation() += Eigen::Vector3d(0, 0, TrackerDriver::kMaxFromPatient_mm + 1);
  server_.move(kTool, {near});
  begin();
  ASSERT_TRUE(comes_to(tip_of(near)));
  EXPECT_TRUE(is_well());
  server_.move(kTool, {far});
  EXPECT_TRUE(says("more than a metre"));
  EXPECT_TRUE(soon([&] { return observed_.age_s() > InterpolatedPose::kValidity_s; }));
  EXPECT_LT((observed_.last().tip.eigen() - tip_of(near)).norm(), 0.001) << "where it was seen last";
  server_.move(kTool, {kToolPose});
  EXPECT_TRUE(is_well());
}

TEST_F(TrackedTip, AConnectionThatIsLostComesBack) {
  begin();
  server_.drop();
  EXPECT_TRUE(soon([&] { return server_.connections() == 2; }));
  EXPECT_TRUE(is_well());
  // data that are not OpenIGTLink, and damaged messages
  server_.send_instead(test::MessageBytes(500, 'x'));
  EXPECT_TRUE(says("does not send OpenIGTLink"));
  test::MessageBytes damaged = test::transform_message(kTool, kToolPose);
  damaged.back() ^= 1;
  server_.send_instead(damaged);
  EXPECT_TRUE(says("checksums are wrong"));
  server_.send_instead({});
  EXPECT_TRUE(is_well());
}

TEST_F(TrackedTip, ReportsMissingToolsAtTheStart) {
  settings_.stream.transform = "ProbeToTracker";
  EXPECT_THAT(refused(), HasSubstr("sends no ProbeToTracker\n  it sends: StylusToTracker"));
  settings_.stream.transform.clear();
  EXPECT_THAT(refused(), HasSubstr("no tracked tool is given"));
  settings_.stream.transform = kTool;
  settings_.stream.address.host.clear();
  EXPECT_THAT(refused(), HasSubstr("no tracked tool is given"));
  const auto lost = tracker_vendor().detect();
  EXPECT_FALSE(lost.checks[0].passed);

  TrackedToolSettings there;
  there.stream.address = {"127.0.0.1", server_.port()};
  const DeviceReport report = tracker_vendor(there).detect();
  EXPECT_TRUE(report.checks[0].passed);
  ASSERT_EQ(report.connected.size(), 1u);
  EXPECT_EQ(report.connected[0].id, kTool);
}

TEST(TrackerAddress, IsHostAndPort) {
  const auto address = [](const char* text) {
    const auto parsed = parse_tracker_address(text);
    return parsed ? parsed->host + " " + std::to_string(parsed->port) + " " + parsed->text() : "none";
  };
  EXPECT_EQ(address("localhost:18944"), "localhost 18944 localhost:18944");
  EXPECT_EQ(address("[::1]:7"), "::1 7 [::1]:7");
  for (const char* text :
       {"localhost", ":18944", "a:", "a:0", "a:65536", "a:1x", "a:123456", "a:b:1", "C:/poses.csv:1", ""})
    EXPECT_EQ(address(text), "none") << text;
}

}  // namespace
}  // namespace palpate
