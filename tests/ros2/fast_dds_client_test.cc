#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "fast_dds_node.h"
#include "palpate/base/check.h"
#include "palpate/ros2/ros2_publisher.h"
#include "server/test_host.h"

// Every topic, received by Fast DDS under the names by which ROS 2 subscribes.
namespace palpate {
namespace {

using fast_dds::Bytes;
using fast_dds::Cdr;
using fast_dds::kPatience;
using fast_dds::message_type;
using fast_dds::Node;
using ::testing::HasSubstr;
namespace dds = fast_dds::dds;

std::int64_t now_ns() {
  using namespace std::chrono;
  return duration_cast<nanoseconds>(system_clock::now().time_since_epoch()).count();
}

template <std::size_t N>
void expect_near(const std::array<double, N>& numbers, const std::array<double, N>& expected) {
  for (std::size_t n = 0; n < N; ++n) EXPECT_NEAR(numbers[n], expected[n], 1e-12) << n;
}

class FastDds : public ::testing::Test {
 protected:
  FastDds() : node_(domain_) {
    DeviceTick touching;
    touching.label = 1;
    touching.force_N = {0.5, -0.25, 1};
    touching.proxy_patient_mm = {1, 2, 4};
    touching.velocity_patient_mm_s = {10, 20, 30};
    touching.torque_Nmm = {100, 0, -50};
    touching.near_label = {2};
    touching.near_mm = {7};
    host_.bring_near(touching);
    Ros2Options options;
    options.domain = domain_;
    auto started = Ros2Publisher::start(host_, options);
    PALPATE_CHECK(started.ok());
    publisher_ = *std::move(started);
  }
  Cdr receive(const std::string& topic, const std::string& package, const std::string& name, bool reliable,
              bool late = false) {
    auto bytes = Node::next(node_.subscribe(topic, message_type(package, name), reliable, late));
    PALPATE_CHECK(bytes.has_value());
    return Cdr(*std::move(bytes));
  }
  // Checks a header: its stamp is of now, its frame the patient's.
  static void expect_header(Cdr& message) {
    EXPECT_NEAR(static_cast<double>(message.time_ns()), static_cast<double>(now_ns()), 5e9);
    EXPECT_EQ(message.text(), "patient_lps");
  }

  // tests of other processes use other domains
  const int domain_ = 1 + ::getpid() % 100;
  testing::FakeHost host_;
  std::unique_ptr<Ros2Publisher> publisher_;
  Node node_;
};

TEST_F(FastDds, PoseTwistAndWrenchArrive) {
  Cdr pose = receive("rt/palpate/hand1/measured_cp", "geometry_msgs", "PoseStamped", false);
  expect_header(pose);
  expect_near(pose.numbers<3>(), {0.001, 0.002, 0.003});
  const std::array<double, 4> orientation = pose.numbers<4>();
  EXPECT_NEAR(
      std::hypot(std::hypot(orientation[0], orientation[1]), std::hypot(orientation[2], orientation[3])), 1,
      1e-12);

  Cdr proxy = receive("rt/palpate/hand1/setpoint_cp", "geometry_msgs", "PoseStamped", false);
  expect_header(proxy);
  expect_near(proxy.numbers<3>(), {0.001, 0.002, 0.004});

  Cdr twist = receive("rt/palpate/hand1/measured_cv", "geometry_msgs", "TwistStamped", false);
  expect_header(twist);
  expect_near(twist.numbers<3>(), {0.01, 0.02, 0.03});

  // in the host's scene World's x, y, z are the patient's x, z, -y
  Cdr wrench = receive("rt/palpate/hand1/measured_cf", "geometry_msgs", "WrenchStamped", false);
  expect_header(wrench);
  expect_near(wrench.numbers<3>(), {0.5, -1, -0.25});
  expect_near(wrench.numbers<3>(), {0.1, 0.05, 0});
}

TEST_F(FastDds, DistancesArrive) {
  Cdr near = receive("rt/palpate/hand1/distances", "palpate_msgs", "Distances", false);
  expect_header(near);
  EXPECT_EQ(near.read<std::uint32_t>(), 1u);
  EXPECT_EQ(near.text(), "tibia");
  EXPECT_EQ(near.read<std::uint32_t>(), 1u);
  EXPECT_DOUBLE_EQ(near.read<double>(), 0.007);
  EXPECT_EQ(near.text(), "");
}

TEST_F(FastDds, TransformsArriveAndTheStaticOneLate) {
  Cdr tf = receive("rt/tf", "tf2_msgs", "TFMessage", true);
  EXPECT_EQ(tf.read<std::uint32_t>(), 1u);
  expect_header(tf);
  EXPECT_EQ(tf.text(), "palpate/hand1");
  expect_near(tf.numbers<3>(), {0.001, 0.002, 0.003});

  Cdr fixed = receive("rt/tf_static", "tf2_msgs", "TFMessage", true, true);
  EXPECT_EQ(fixed.read<std::uint32_t>(), 1u);
  fixed.time_ns();
  EXPECT_EQ(fixed.text(), "patient");
  EXPECT_EQ(fixed.text(), "patient_lps");
  expect_near(fixed.numbers<3>(), {0, 0, 0});
  expect_near(fixed.numbers<4>(), {0, 0, std::sqrt(0.5), std::sqrt(0.5)});

  Cdr scene = receive("rt/palpate/scene", "std_msgs", "String", true, true);
  EXPECT_THAT(scene.text(), HasSubstr("\"femur\""));
}

TEST_F(FastDds, DiagnosticsTellRateAndStop) {
  Cdr array = receive("rt/diagnostics", "diagnostic_msgs", "DiagnosticArray", true);
  array.time_ns();
  array.text();
  EXPECT_EQ(array.read<std::uint32_t>(), 1u);
  EXPECT_EQ(array.read<std::uint8_t>(), 0);
  EXPECT_EQ(array.text(), "palpate: session");
  EXPECT_EQ(array.text(), "force enabled");
  EXPECT_EQ(array.text(), "");
  EXPECT_GE(array.read<std::uint32_t>(), 3u);
  EXPECT_EQ(array.text(), "rate, Hz");
  EXPECT_EQ(array.text(), "999");
}

// by a writer that delivers reliably, as ROS 2's publishers do by default, and by one that does not
TEST_F(FastDds, AMessageAtStopStopsTheForce) {
  publisher_.reset();
  for (const bool reliable : {true, false}) {
    testing::FakeHost host;
    Ros2Options options;
    options.domain = domain_;
    // stops are read more often than poses are published
    options.rate_hz = 1;
    const auto publisher = Ros2Publisher::start(host, options);
    ASSERT_TRUE(publisher.ok());
    dds::DataWriter* const writer =
        node_.advertise("rt/palpate/stop", message_type("std_msgs", "Empty"), reliable);
    Bytes empty{0, 1, 0, 0, 0};
    const auto until = std::chrono::steady_clock::now() + kPatience;
    while (!host.state().stop && std::chrono::steady_clock::now() < until) {
      writer->write(&empty);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    EXPECT_TRUE(host.state().stop.has_value()) << (reliable ? "reliable" : "best effort");
  }
}

Bytes pose_bytes(const std::string& frame, const std::array<double, 3>& position_m) {
  Bytes bytes{0, 1, 0, 0};
  const auto add = [&bytes](const void* data, std::size_t size) {
    const auto* const first = static_cast<const unsigned char*>(data);
    bytes.insert(bytes.end(), first, first + size);
  };
  const std::array<std::uint32_t, 3> head{5, 6, static_cast<std::uint32_t>(frame.size() + 1)};
  add(head.data(), sizeof head);
  add(frame.c_str(), frame.size() + 1);
  while ((bytes.size() - 4) % 8 != 0) bytes.push_back(0);
  add(position_m.data(), sizeof position_m);
  const std::array<double, 4> orientation_xyzw{0, 0, 0, 1};
  add(orientation_xyzw.data(), sizeof orientation_xyzw);
  return bytes;
}

TEST(Ros2Publisher, ANodeMovesTheTipOfItsSessionAlone) {
  const int domain = 1 + ::getpid() % 100;
  for (const char* input : {"ros2", "pointer"}) {
    testing::FakeHost host;
    host.edit_scene().input = input;
    Ros2Options options;
    options.domain = domain;
    const auto publisher = Ros2Publisher::start(host, options);
    ASSERT_TRUE(publisher.ok());
    Node node(domain);
    dds::DataWriter* const writer =
        node.advertise("rt/palpate/hand1/servo_cp", message_type("geometry_msgs", "PoseStamped"), true);
    Bytes elsewhere = pose_bytes("patient", {9, 9, 9}), here = pose_bytes("patient_lps", {0.01, -0.02, 0.03});
    const bool moves = std::string(input) == "ros2";
    const auto until = std::chrono::steady_clock::now() + (moves ? kPatience : std::chrono::seconds(1));
    while (!host.pointer() && std::chrono::steady_clock::now() < until) {
      writer->write(&elsewhere);
      writer->write(&here);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    ASSERT_EQ(host.pointer().has_value(), moves) << input;
    EXPECT_EQ(host.pointer_claimed, moves);
    if (moves) expect_near(host.pointer()->tip_patient_mm, {10, -20, 30});
  }
}

// virtual time of a recording
TEST(Ros2Publisher, ARecordingPublishesItsClock) {
  const int domain = 1 + ::getpid() % 100;
  struct Recording : testing::FakeRecording {
    TickRecord snapshot(std::array<double, kMaxDevices>& /*stiffness_N_per_mm*/) const override {
      TickRecord tick;
      tick.time_s = 2.5;
      return tick;
    }
  } host;
  Ros2Options options;
  options.domain = domain;
  const auto publisher = Ros2Publisher::start(host, options);
  ASSERT_TRUE(publisher.ok());
  Node node(domain);
  auto clock = Node::next(node.subscribe("rt/clock", message_type("rosgraph_msgs", "Clock"), false));
  ASSERT_TRUE(clock.has_value());
  EXPECT_EQ(Cdr(*clock).time_ns(), 2'500'000'000);
}

/// palpate with a simulated hand, until it is interrupted.
class Program {
 public:
  explicit Program(int domain) : id_(::fork()) {
    const std::string text = std::to_string(domain);
    if (id_ == 0) {
      ::execl(PALPATE_PROGRAM, PALPATE_PROGRAM, "--quiet", "explore", "knee-phantom:spacing=3", "--no-viewer",
              "--repeat", "--ros2", text.c_str(), nullptr);
      ::_exit(127);
    }
    PALPATE_CHECK(id_ > 0);
  }
  ~Program() {
    ::kill(id_, SIGINT);
    int status = 0;
    ::waitpid(id_, &status, 0);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

 private:
  const pid_t id_;
};

// the simulated hand touches the knee
TEST(Ros2Publisher, ASessionOfTheProgramIsReceived) {
  const int domain = 1 + ::getpid() % 100;
  const Program program(domain);
  Node node(domain);
  dds::DataReader* const wrenches =
      node.subscribe("rt/palpate/hand1/measured_cf", message_type("geometry_msgs", "WrenchStamped"), false);
  std::int64_t previous_ns = 0;
  double largest_N = 0;
  for (int n = 0; n < 20'000 && largest_N < 0.1; ++n) {
    auto bytes = Node::next(wrenches);
    ASSERT_TRUE(bytes.has_value()) << n;
    Cdr wrench(*std::move(bytes));
    const std::int64_t stamp_ns = wrench.time_ns();
    ASSERT_GT(stamp_ns, previous_ns);
    previous_ns = stamp_ns;
    EXPECT_EQ(wrench.text(), "patient_lps");
    const auto force_N = wrench.numbers<3>();
    largest_N = std::max(largest_N, std::hypot(force_N[0], force_N[1], force_N[2]));
  }
  EXPECT_GT(largest_N, 0.1);
}

TEST(Ros2Publisher, RejectsInvalidOptions) {
  testing::FakeHost host;
  Ros2Options options;
  options.interface = "no_such_if0";
  EXPECT_EQ(Ros2Publisher::start(host, options).error().kind, ErrorKind::kUnavailable);
  options = {};
  options.domain = 102;
  EXPECT_EQ(Ros2Publisher::start(host, options).error().kind, ErrorKind::kBadInput);
  options = {};
  options.rate_hz = std::nan("");
  EXPECT_EQ(Ros2Publisher::start(host, options).error().kind, ErrorKind::kBadInput);
  host.edit_scene().tasks.emplace_back();
  EXPECT_EQ(Ros2Publisher::start(host, {}).error().kind, ErrorKind::kUsage);
}

}  // namespace
}  // namespace palpate
