#include "palpate/spacemouse/spacemouse_driver.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/input.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <mutex>

#include "base/test_folder.h"
#include "base/test_wait.h"
#include "device/test_wall.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;
using testing::soon;

class ObservedSample final : public ServoFunction {
 public:
  void update(std::span<const DeviceSample> samples,
              std::span<DeviceCommand> /*commands*/) noexcept override {
    const std::lock_guard lock(mutex_);
    last_ = samples[0];
  }
  DeviceSample last() const {
    const std::lock_guard lock(mutex_);
    return last_;
  }

 private:
  mutable std::mutex mutex_;
  DeviceSample last_;
};

/// A fake machine with a SpaceMouse: events are written by the test through a pipe in place of the device
/// file.
class SpaceMouse : public ::testing::Test {
 protected:
  SpaceMouse() {
    settings_.root = folder_.path();
    plug_in();
  }
  ~SpaceMouse() override {
    end();
    if (events_ >= 0) ::close(events_);
  }
  void write_file(const std::string& file, const std::string& text) {
    std::filesystem::create_directories((folder_.path() / file).parent_path());
    std::ofstream(folder_.path() / file) << text << "\n";
  }
  void plug_in() {
    // an ordinary Logitech mouse precedes it
    write_file("sys/class/input/event3/device/name", "Logitech Optical Mouse");
    write_file("sys/class/input/event3/device/id/vendor", "046d");
    write_file("sys/class/input/event7/device/name", "3Dconnexion SpaceMouse Compact");
    write_file("sys/class/input/event7/device/id/vendor", "256f");
    std::filesystem::create_directories(folder_.path() / "dev/input");
    ASSERT_EQ(::mkfifo(file().c_str(), 0600), 0);
    events_ = ::open(file().c_str(), O_RDWR);
    ASSERT_GE(events_, 0);
  }
  std::filesystem::path file() const { return folder_.path() / "dev/input/event7"; }
  void send(unsigned type, unsigned code, int value) {
    input_event event{};
    event.type = static_cast<__u16>(type);
    event.code = static_cast<__u16>(code);
    event.value = value;
    ASSERT_EQ(::write(events_, &event, sizeof event), static_cast<ssize_t>(sizeof event));
  }
  void begin() {
    driver_ = std::make_unique<SpaceMouseDriver>(settings_);
    const auto opened = driver_->open(false);
    ASSERT_TRUE(opened.ok()) << opened.error().message();
    thread_ = std::thread([this] { driver_->run(observed_, clock_); });
  }
  void end() {
    clock_.stop = true;
    if (thread_.joinable()) thread_.join();
  }

  const test::TemporaryFolder folder_;
  SpaceMouseSettings settings_;
  int events_ = -1;
  std::unique_ptr<SpaceMouseDriver> driver_;
  ObservedSample observed_;
  testing::UntilStopped clock_;
  std::thread thread_;
};

TEST_F(SpaceMouse, IsNoDeviceThatPushes) {
  begin();
  const DeviceInfo& info = driver_->devices()[0];
  EXPECT_EQ(info.name, "3Dconnexion SpaceMouse Compact");
  EXPECT_TRUE(info.simulated);
  EXPECT_EQ(info.degrees_of_freedom_in, 6);
  EXPECT_EQ(info.degrees_of_freedom_out, 0);
}

TEST_F(SpaceMouse, EachAxisMovesInItsDirection) {
  settings_.speed_mm_s = 400;
  settings_.turning_rad_s = 4;
  begin();
  // the kernel's axes: right, towards the user, down
  const double signs[] = {1, -1, -1};
  for (unsigned axis = 0; axis < 3; ++axis) {
    const Point<Device> before = observed_.last().tip;
    send(EV_ABS, axis, 350);
    const int i = static_cast<int>(axis);
    EXPECT_TRUE(soon([&] { return signs[i] * (observed_.last().tip[i] - before[i]) > 5; })) << axis;
    send(EV_ABS, axis, 0);
    const Eigen::Quaterniond upright = observed_.last().R_DeviceTool;
    EXPECT_EQ(upright.vec().norm(), 0) << "no turn by pushing";
    for (int other = i + 1; other < 3; ++other) EXPECT_EQ(observed_.last().tip[other], before[other]) << axis;
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(60));
  const Point<Device> rests = observed_.last().tip;
  for (unsigned axis = 0; axis < 3; ++axis) {
    const Eigen::Quaterniond before = observed_.last().R_DeviceTool;
    send(EV_ABS, 3 + axis, 350);
    const auto turned = [&] {
      const Eigen::AngleAxisd turn(observed_.last().R_DeviceTool * before.conjugate());
      return Eigen::Vector3d(turn.angle() * turn.axis());
    };
    EXPECT_TRUE(soon([&] { return signs[axis] * turned()[axis] > 0.1; })) << axis;
    send(EV_ABS, 3 + axis, 0);
    std::this_thread::sleep_for(std::chrono::milliseconds(60));
  }
  EXPECT_EQ(observed_.last().tip, rests) << "no way by turning";
  EXPECT_FALSE(observed_.last().fault);
}

TEST_F(SpaceMouse, ALightTouchDoesNothingAndTheTipStaysWithinReach) {
  settings_.speed_mm_s = 2000;
  begin();
  send(EV_ABS, ABS_X, 40);
  std::this_thread::sleep_for(std::chrono::milliseconds(60));
  EXPECT_EQ(observed_.last().tip, Point<Device>());
  // beyond the range
  send(EV_ABS, ABS_X, 2'000'000'000);
  EXPECT_TRUE(soon([&] { return observed_.last().tip.x() == SpaceMouseDriver::kHalfReach_mm; }));
  send(EV_ABS, ABS_X, -2'000'000'000);
  EXPECT_TRUE(soon([&] { return observed_.last().tip.x() == -SpaceMouseDriver::kHalfReach_mm; }));
}

TEST_F(SpaceMouse, TipRestsWhenARelativeDeviceIsSilent) {
  begin();
  send(EV_REL, REL_X, 350);
  EXPECT_TRUE(soon([&] { return observed_.last().tip.x() > 0.5; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(250));
  const double x = observed_.last().tip.x();
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(observed_.last().tip.x(), x);
}

TEST_F(SpaceMouse, ButtonsAreBits) {
  begin();
  send(EV_KEY, BTN_0, 1);
  send(EV_KEY, BTN_1, 1);
  EXPECT_TRUE(soon([&] { return observed_.last().buttons == 3; }));
  send(EV_KEY, BTN_0, 0);
  EXPECT_TRUE(soon([&] { return observed_.last().buttons == 2; }));
}

// the kernel's buffer overflowed and the cap's release was lost
TEST_F(SpaceMouse, EventsThatWereDroppedLetItRest) {
  begin();
  send(EV_KEY, BTN_0, 1);
  send(EV_ABS, ABS_X, 350);
  EXPECT_TRUE(soon([&] { return observed_.last().tip.x() > 0.5 && observed_.last().buttons == 1; }));
  send(EV_SYN, SYN_DROPPED, 0);
  send(EV_ABS, ABS_Y, 350);
  EXPECT_TRUE(soon([&] { return observed_.last().buttons == 0; }));
  std::this_thread::sleep_for(std::chrono::milliseconds(60));
  const Point<Device> rests = observed_.last().tip;
  EXPECT_EQ(rests.y(), 0) << "of what is left of a lost report nothing is taken";
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(observed_.last().tip, rests);
  send(EV_SYN, SYN_REPORT, 0);
  send(EV_ABS, ABS_Y, -350);
  EXPECT_TRUE(soon([&] { return observed_.last().tip.y() > 0.5; }));
}

TEST_F(SpaceMouse, LostItIsAFaultUntilItIsBack) {
  begin();
  send(EV_ABS, ABS_X, 350);
  EXPECT_TRUE(soon([&] { return observed_.last().tip.x() > 0.1; }));
  // a partial event is invalid
  const char half[5] = {};
  ASSERT_EQ(::write(events_, half, sizeof half), 5);
  EXPECT_TRUE(soon([&] { return observed_.last().fault && driver_->failure(); }));
  EXPECT_THAT(driver_->failure()->what, HasSubstr("was disconnected"));
  EXPECT_FALSE(driver_->failure()->remedy.empty());
  EXPECT_TRUE(soon([&] { return !driver_->failure() && !observed_.last().fault; }));
  const double x = observed_.last().tip.x();
  std::this_thread::sleep_for(std::chrono::milliseconds(30));
  EXPECT_EQ(observed_.last().tip.x(), x) << "the cap is where it was let go";
}

TEST_F(SpaceMouse, ReportsMissingPermissions) {
  EXPECT_EQ(spacemouse_vendor(settings_).detect().connected[0].state, "ready");
  std::filesystem::remove_all(folder_.path() / "sys");
  const DeviceReport report = spacemouse_vendor(settings_).detect();
  EXPECT_FALSE(report.checks[0].passed);
  EXPECT_FALSE(report.checks[0].remedy.empty());
  SpaceMouseDriver none(settings_);
  ASSERT_FALSE(none.open(false).ok());
  settings_.file = "/no/such/event";
  SpaceMouseDriver removed(settings_);
  const auto opened = removed.open(false);
  ASSERT_FALSE(opened.ok());
  EXPECT_THAT(opened.error().message(), HasSubstr("/no/such/event"));
}

}  // namespace
}  // namespace palpate
