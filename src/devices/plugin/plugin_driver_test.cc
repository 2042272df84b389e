#include "palpate/plugin/plugin_driver.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <string>
#include <thread>

#include "base/test_folder.h"
#include "base/test_wait.h"

namespace palpate {
namespace {

using namespace std::chrono_literals;
using test::TemporaryFolder;
using ::testing::HasSubstr;

/// Servo that answers -2 mm and beyond by 0.5 N, and stores what it is told.
class Wall final : public ServoFunction {
 public:
  void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override {
    tip_x = samples[0].tip.x();
    fault = samples[0].fault;
    buttons = samples[0].buttons;
    commands[0].force_N =
        samples[0].fault || samples[0].tip.x() > -2 ? Vector<Device>() : Vector<Device>(0.5, 0, 0);
    ticks.fetch_add(1);
  }
  std::atomic<double> tip_x{0};
  std::atomic<bool> fault{false};
  std::atomic<std::uint32_t> buttons{0};
  std::atomic<int> ticks{0};
};

class Clock final : public ServoClock {
 public:
  bool wait() noexcept override {
    std::this_thread::sleep_for(1ms);
    return !stop;
  }
  bool stopped() const noexcept override { return stop; }
  std::atomic<bool> stop{false};
};

/// Environment of the plug-in's process, in which the test plug-in reads its fault.
class Plugin : public ::testing::Test {
 protected:
  Plugin() {
    const std::string file = (folder_.path() / "force").string();
    const int opened = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    EXPECT_EQ(::ftruncate(opened, sizeof(double)), 0);
    force_N =
        static_cast<volatile double*>(::mmap(nullptr, sizeof(double), PROT_READ, MAP_SHARED, opened, 0));
    ::close(opened);
    ::setenv("PALPATE_TEST_PLUGIN_FORCE", file.c_str(), 1);
    use("");
  }
  ~Plugin() override {
    ::munmap(const_cast<double*>(force_N), sizeof(double));
    ::unsetenv("PALPATE_TEST_PLUGIN_FORCE");
    ::unsetenv("PALPATE_TEST_PLUGIN");
  }
  static void use(const char* fault) { ::setenv("PALPATE_TEST_PLUGIN", fault, 1); }
  static PluginSettings settings(const char* file = PALPATE_TEST_PLUGIN) {
    return {file, {PALPATE_TEST_PLUGIN_HOST}};
  }
  static std::string refusal(const char* fault, const char* file = PALPATE_TEST_PLUGIN) {
    use(fault);
    PluginDriver driver(settings(file));
    const auto opened = driver.open(false);
    return opened ? "" : opened.error().message();
  }
  template <class Condition>
  static bool soon(const Condition& condition) {
    for (int n = 0; n < 5000 && !condition(); ++n) std::this_thread::sleep_for(1ms);
    return condition();
  }

  const TemporaryFolder folder_;
  volatile double* force_N = nullptr;
  Wall wall;
  Clock clock;
};

TEST_F(Plugin, PushesAndEndsAtZero) {
  PluginDriver driver(settings());
  ASSERT_TRUE(driver.open(false).ok());
  EXPECT_EQ(driver.devices().front().name, "Test arm no. 7");
  EXPECT_EQ(driver.devices().front().peak_force_N, 3);
  EXPECT_FALSE(driver.devices().front().continuous_force_N) << "the plug-in leaves it unknown";
  std::thread servo([&] { driver.run(wall, clock); });
  EXPECT_TRUE(soon([&] { return *force_N == 0.5 && wall.tip_x == -2.5 && wall.buttons == 1; }));
  EXPECT_FALSE(driver.failure());
  // the watchdog's halt reaches the device whatever the servo commands, until it is ended
  driver.halt();
  EXPECT_TRUE(soon([&] { return *force_N == 0; }));
  std::this_thread::sleep_for(30ms);
  EXPECT_EQ(*force_N, 0);
  driver.resume(0);
  EXPECT_TRUE(soon([&] { return *force_N == 0.5; }));
  clock.stop = true;
  servo.join();
  EXPECT_TRUE(soon([&] { return *force_N == 0; }));
}

// another servo, the same session: as a driver is run again
TEST_F(Plugin, IsRunAgain) {
  PluginDriver driver(settings());
  ASSERT_TRUE(driver.open(false).ok());
  for (int n = 0; n < 2; ++n) {
    clock.stop = false;
    ASSERT_TRUE(driver.open(false).ok());
    std::thread servo([&] { driver.run(wall, clock); });
    EXPECT_TRUE(soon([&] { return *force_N == 0.5; }));
    clock.stop = true;
    servo.join();
  }
}

TEST_F(Plugin, EveryFaultEndsInZeroForceAndAReason) {
  const struct {
    const char *fault, *reason;
  } kFaults[] = {{"crash", "has ended by signal 11"},
                 {"exit", "has ended with exit code 3"},
                 {"hang", "did not answer for 0.1 s"},
                 {"nan", "a pose that is not finite"},
                 {"size", "a sample of another size"}};
  for (const auto& [fault, reason] : kFaults) {
    SCOPED_TRACE(fault);
    use(fault);
    clock.stop = false;
    wall.fault = false;
    PluginDriver driver(settings());
    ASSERT_TRUE(driver.open(false).ok());
    std::thread servo([&] { driver.run(wall, clock); });
    EXPECT_TRUE(soon([&] { return *force_N == 0.5; }));
    EXPECT_TRUE(soon([&] { return wall.fault && driver.failure(); }));
    // a process that crashes leaves its device to the vendor's watchdog
    if (std::string(fault) != "crash" && std::string(fault) != "exit") {
      EXPECT_TRUE(soon([&] { return *force_N == 0; }));
    }
    // a process that crashes while the processor is busy is silent first
    const auto what = [&] {
      const auto failure = driver.failure();
      return failure ? failure->what : "nothing";
    };
    soon([&] { return what().find(reason) != std::string::npos; });
    EXPECT_THAT(what(), HasSubstr(reason));
    // the servo ticks on
    const int ticks = wall.ticks;
    EXPECT_TRUE(soon([&] { return wall.ticks > ticks + 50; }));
    EXPECT_TRUE(wall.fault);
    clock.stop = true;
    servo.join();
  }
}

TEST_F(Plugin, ADeviceThatIsNotReadForAWhileComesBack) {
  use("read");
  PluginDriver driver(settings());
  ASSERT_TRUE(driver.open(false).ok());
  std::thread servo([&] { driver.run(wall, clock); });
  EXPECT_TRUE(soon([&] { return wall.fault.load(); }));
  EXPECT_TRUE(soon([&] { return driver.failure().has_value(); }));
  EXPECT_TRUE(soon([&] { return !wall.fault && *force_N == 0.5 && !driver.failure(); }));
  clock.stop = true;
  servo.join();
}

TEST_F(Plugin, IsRefusedWithTheReason) {
  EXPECT_THAT(refusal("", "/no/such/plugin.so"), HasSubstr("cannot be loaded"));
  EXPECT_THAT(refusal("", PALPATE_TEST_PLUGIN_HOST), HasSubstr("cannot be loaded"));
  EXPECT_THAT(refusal("", PALPATE_TEST_OTHER_LIBRARY), HasSubstr("does not export plp_driver_v1"));
  EXPECT_THAT(refusal("fails"), HasSubstr("plp_driver_v1 failed"));
  EXPECT_THAT(refusal("count"), HasSubstr("states 9 devices"));
  EXPECT_THAT(refusal("axes"), HasSubstr("axes that are not a rotation"));
  EXPECT_THAT(refusal("absent"), HasSubstr("no arm answers on the bus"));
  EXPECT_THAT(refusal("moves"), HasSubstr("moves by itself to calibrate"));
}

TEST_F(Plugin, IsExaminedWithoutBeingOpened) {
  use("absent");
  const DeviceReport report = plugin_vendor(settings()).detect();
  ASSERT_EQ(report.checks.size(), 1u);
  EXPECT_TRUE(report.checks[0].passed) << report.checks[0].found;
  use("fails");
  EXPECT_FALSE(plugin_vendor(settings()).detect().checks[0].passed);
}

}  // namespace
}  // namespace palpate
