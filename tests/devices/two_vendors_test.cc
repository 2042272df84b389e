#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <random>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "base/test_seed.h"
#include "contact/test_model.h"
#include "force_dimension/test_dhd_rig.h"
#include "haply/test_haply_rig.h"
#include "openhaptics/test_hd_rig.h"
#include "palpate/servo/composite_driver.h"

/// Devices of two vendors in one session, each on its vendor's clock, under faults of one or both.
namespace palpate {
namespace {

using testing::kBoneRadius_mm;
using testing::soon;

/// A device: the fake of its vendor's library and the driver.
class VendorDevice {
 public:
  virtual ~VendorDevice() = default;
  virtual DeviceDriver& driver() = 0;
  /// Where the hand wants to be, mm within the ball's surface.
  virtual void lead(double deep_mm) = 0;
  virtual double force_N() const = 0;
  virtual double largest_N() const = 0;
  virtual void begin_faults(std::mt19937& random) = 0;
  virtual void end_faults(std::mt19937& random) = 0;
  virtual std::string faults() const = 0;
  /// Destroys the driver. @return the first rule of the vendor's library that was violated; empty: none
  virtual std::string end() = 0;
};

template <class Side>
class DeviceWithFaults : public VendorDevice {
 public:
  DeviceWithFaults(Side& side, const std::vector<testing::DriverFault<Side>>& known) : there_(side, known) {}
  void begin_faults(std::mt19937& random) override {
    there_.begin_any(random, [] {});
  }
  void end_faults(std::mt19937& random) override { there_.end_all(random); }
  std::string faults() const override { return there_.names(); }

 private:
  testing::StartedFaults<Side> there_;
};

class Omega final : testing::DhdSide, public DeviceWithFaults<testing::FakeDhdDevice> {
 public:
  Omega() : DeviceWithFaults(device, testing::dhd_faults()) { device.intended_x_mm = 0; }
  DeviceDriver& driver() override { return *driver_; }
  void lead(double deep_mm) override { device.intended_y_mm = kBoneRadius_mm - deep_mm; }
  double force_N() const override { return device.force_N; }
  double largest_N() const override { return device.largest_N; }
  std::string end() override {
    driver_.reset();
    return fake.violations ? fake.first_violation.load() : "";
  }

 private:
  std::unique_ptr<DeviceDriver> driver_ =
      std::make_unique<ForceDimensionDriver>(testing::fake_dhd_settings());
};

class Touch final : testing::HdSide, public DeviceWithFaults<testing::FakeHd> {
 public:
  Touch() : DeviceWithFaults(fake, testing::hd_faults_and_hang()) { device.max_force_N = kMax_N; }
  DeviceDriver& driver() override { return *driver_; }
  void lead(double deep_mm) override { device.intended_x_mm = deep_mm - kBoneRadius_mm; }
  double force_N() const override { return device.force_N; }
  double largest_N() const override { return device.largest_N; }
  std::string end() override {
    driver_.reset();
    return fake.violations ? fake.first_violation.load() : "";
  }
  static constexpr double kMax_N = 0.25;

 private:
  std::unique_ptr<DeviceDriver> driver_ = std::make_unique<OpenHapticsDriver>(testing::fake_hd_settings());
};

class Inverse3 final : testing::HaplySide, public DeviceWithFaults<testing::FakeInverseService> {
 public:
  Inverse3() : HaplySide("3.1.1"), DeviceWithFaults(service, testing::haply_faults()) {}
  DeviceDriver& driver() override { return *driver_; }
  // its workspace's middle lies before the base and above it
  void lead(double deep_mm) override { service.intend(Point<Device>(kBoneRadius_mm - deep_mm, -120, 150)); }
  double force_N() const override { return service.force_N(); }
  double largest_N() const override {
    double max_N = 0;
    for (const testing::Delivery& delivery : service.delivered())
      max_N = std::max(max_N, delivery.command.force_N.norm());
    return max_N;
  }
  std::string end() override {
    driver_.reset();
    return service.violations() ? "the service's" : "";
  }

 private:
  std::unique_ptr<DeviceDriver> driver_ = std::make_unique<HaplyDriver>(service.settings());
};

using DeviceFactories = std::array<std::unique_ptr<VendorDevice> (*)(), 2>;
template <class Device>
std::unique_ptr<VendorDevice> make() {
  return std::make_unique<Device>();
}

/// Two hands at one ball. The loop is the real one: each device has its own limit.
class TwoVendors {
 public:
  static constexpr double kUsers_N = 0.4;  // the makers' own are 3.3 N and more

  explicit TwoVendors(const DeviceFactories& vendors) : devices_{vendors[0](), vendors[1]()} {
    for (const auto& each : devices_) {
      each->lead(kFree_mm);
      const auto opened = each->driver().open(false);
      EXPECT_TRUE(opened.ok()) << (opened.ok() ? "" : opened.error().message());
    }
    both_.emplace(std::vector<DeviceDriver*>{&devices_[0]->driver(), &devices_[1]->driver()},
                  CompositeDriverSettings{.rate_hz = 1000, .realtime = false});
    Parameters parameters;
    parameters.max_force_N = kUsers_N;
    auto loop =
        ServoLoop::start(std::make_shared<const Model>(testing::ball_model({1, 1, 1})), *both_, parameters,
                         {WorkspaceSettings{}}, {.rate_hz = 1000, .realtime = false, .ring_s = 1});
    EXPECT_TRUE(loop.ok()) << (loop.ok() ? "" : loop.error().message());
    if (loop) loop_ = std::move(*loop);
  }

  VendorDevice& device(std::size_t d) { return *devices_[d]; }
  double limit_N(std::size_t d) const {
    return dynamic_cast<Touch*>(devices_[d].get()) ? Touch::kMax_N : kUsers_N;
  }
  bool presses(std::size_t d) const { return devices_[d]->force_N() > 0.4 * limit_N(d); }
  /// Presses until both devices render force. Contact must begin outside the surface, but a device may
  /// recover inside, or jump there after a late tick; hence the retries.
  bool press() {
    return loop_ && soon([&] {
             // the field fades out over four millimetres
             lead(kFree_mm);
             if (!soon([&] { return !device(0).force_N() && !device(1).force_N() && !both_->failure(); }))
               return false;
             for (double deep_mm = kFree_mm; deep_mm < 6; deep_mm += 0.25) {
               lead(deep_mm);
               std::this_thread::sleep_for(std::chrono::milliseconds(5));
             }
             const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(3);
             while (std::chrono::steady_clock::now() < until) {
               if (presses(0) && presses(1)) return true;
               std::this_thread::sleep_for(std::chrono::milliseconds(1));
             }
             return false;
           });
  }
  /// Whether the device keeps pressing, with ticks, for longer than the validity of earlier commands.
  bool goes_on_pressing(std::size_t d) const {
    return soon([&] {
      const std::uint64_t then = loop_->snapshot().tick;
      for (int n = 0; n < 50; ++n) {
        if (!presses(d)) return false;
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
      return loop_->snapshot().tick > then + 20;
    });
  }
  /// Diagnostic text for failure messages.
  std::string diagnostics() const {
    if (!loop_) return "no loop";
    const auto failure = both_->failure();
    std::ostringstream text;
    text << (failure ? failure->message() : "nothing");
    const TickRecord tick = loop_->snapshot();
    for (std::size_t d = 0; d < devices_.size(); ++d)
      text << "; " << devices_[d]->faults() << ": " << devices_[d]->force_N() << " N, "
           << tick.device[d].tip_world_mm[0] << " mm, flags " << std::hex << tick.device[d].flags << std::dec;
    return text.str();
  }
  /// Stops the loop; both devices must end at zero force and have stayed within their limits.
  void end() {
    loop_->stop();
    for (std::size_t d = 0; d < devices_.size(); ++d) {
      EXPECT_TRUE(soon([&] { return device(d).force_N() == 0; }));
      EXPECT_LE(device(d).largest_N(), limit_N(d) + 1e-9) << d;
    }
    loop_.reset();
    both_.reset();
    for (const auto& each : devices_) EXPECT_EQ(each->end(), "");
  }

 private:
  static constexpr double kFree_mm = -6;
  void lead(double deep_mm) {
    for (const auto& each : devices_) each->lead(deep_mm);
  }

  std::array<std::unique_ptr<VendorDevice>, 2> devices_;
  std::optional<CompositeDriver> both_;
  std::unique_ptr<ServoLoop> loop_;
};

struct NamedFactories {
  const char* name;
  DeviceFactories vendors;
};
class TwoVendorsFaults : public ::testing::TestWithParam<NamedFactories> {};
INSTANTIATE_TEST_SUITE_P(First, TwoVendorsFaults,
                         ::testing::Values(NamedFactories{"OmegaAndTouch", {&make<Omega>, &make<Touch>}},
                                           NamedFactories{"TouchAndOmega", {&make<Touch>, &make<Omega>}},
                                           NamedFactories{"Inverse3AndTouch",
                                                          {&make<Inverse3>, &make<Touch>}}),
                         [](const auto& tested) { return std::string(tested.param.name); });

// With either device as clock owner: a faulty device has zero force, the other keeps rendering, each stays
// within its own limit, and both recover. PALPATE_TEST_FAULTS: number of fault sequences.
TEST_P(TwoVendorsFaults, SurvivesAnySequenceOfFaults) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  TwoVendors rig(GetParam().vendors);
  for (int n = 0; n < testing::fault_sequences(3); ++n) {
    SCOPED_TRACE("sequence " + std::to_string(n));
    ASSERT_TRUE(rig.press()) << rig.diagnostics();
    // one of the two, or both
    const auto which = 1 + random() % 3;
    for (std::size_t d = 0; d < 2; ++d)
      if (which >> d & 1) rig.device(d).begin_faults(random);
    const auto is_faulty = [&](std::size_t d) { return (which >> d & 1) != 0; };
    for (std::size_t d = 0; d < 2; ++d) {
      ASSERT_TRUE(!is_faulty(d) || soon([&] { return rig.device(d).force_N() == 0; }))
          << d << ": " << rig.diagnostics();
    }
    for (std::size_t d = 0; d < 2; ++d) {
      ASSERT_TRUE(is_faulty(d) || rig.goes_on_pressing(d)) << d << ": " << rig.diagnostics();
    }
    for (std::size_t d = 0; d < 2; ++d) rig.device(d).end_faults(random);
  }
  ASSERT_TRUE(rig.press()) << rig.diagnostics();
  rig.end();
}

}  // namespace
}  // namespace palpate
