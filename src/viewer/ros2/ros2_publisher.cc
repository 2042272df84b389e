#include "palpate/ros2/ros2_publisher.h"

#include <dlfcn.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#include "palpate/server/ordinary_thread.h"
#include "ros2/dds_session.h"
#include "ros2/sampler.h"

namespace palpate {
namespace {

using namespace ros2;
using Clock = std::chrono::steady_clock;

constexpr const char* kLibrary = "libpalpate_ros2.so";
constexpr std::array<double, 2> kRates_hz{1, 1000};
// The ports of higher domains are among those that Linux assigns to clients, from 32768 on.
constexpr int kMaxDomain = 101;
// ViewedScene::input of a session whose tip a node moves
constexpr const char* kRos2Input = "ros2";
constexpr auto kDiagnosisPeriod = std::chrono::seconds(1);
// maximum period of reading stops and commanded positions, whatever the publishing rate
constexpr Clock::duration kMaxReadPeriod = std::chrono::milliseconds(5);

std::int64_t now_ns() {
  using namespace std::chrono;
  return duration_cast<nanoseconds>(system_clock::now().time_since_epoch()).count();
}

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

Diagnosis diagnosis_of(const ViewedHealth& health, const ViewedState& state) {
  Diagnosis diagnosis;
  diagnosis.level = state.stop ? Level::kError : Level::kOk;
  diagnosis.message = state.stop ? "force stopped" : "force enabled";
  diagnosis.values = {{"rate, Hz", number(health.rate_hz)},
                      {"lateness p99, us", number(health.lateness_p99_us)},
                      {"compute time p50, us", number(health.compute_p50_us)},
                      {"ticks skipped", std::to_string(health.skipped)},
                      {"armed", state.armed ? "yes" : "no"}};
  return diagnosis;
}

class Publisher final : public Ros2Publisher {
 public:
  Publisher(ViewerHost& host, const Ros2Options& options, std::unique_ptr<DdsSession> session)
      : host_(host),
        session_(std::move(session)),
        sampler_(host.scene()),
        period_(
            std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / options.rate_hz))),
        thread_([this] { run(); }) {}
  ~Publisher() override {
    {
      const std::lock_guard lock(mutex_);
      ended_ = true;
    }
    wake_.notify_one();
    thread_.join();
  }

 private:
  void run() {
    server::use_ordinary_priority("ros2");
    const bool has_virtual_time = host_.playback() != nullptr;
    auto next_tick = Clock::now(), next_diagnosis = next_tick;
    bool is_scene_published = false;
    std::unique_lock lock(mutex_);
    while (!wake_.wait_until(lock, std::min(next_tick, Clock::now() + kMaxReadPeriod),
                             [this] { return ended_; })) {
      // without memory nodes miss a sample, and the session continues
      try {
        if (session_->read_stop()) host_.emergency_stop({});
        move_hand();
        if (Clock::now() < next_tick) continue;
        next_tick = std::max(next_tick + period_, Clock::now());
        const std::int64_t stamp_ns = publish_tick(has_virtual_time);
        if (!std::exchange(is_scene_published, true))
          session_->publish_scene(stamp_ns, scene_text(host_.scene()), patient_in_base());
        if (Clock::now() < next_diagnosis) continue;
        next_diagnosis = Clock::now() + kDiagnosisPeriod;
        session_->publish(stamp_ns, diagnosis_of(host_.health(), host_.state()));
      } catch (const std::bad_alloc&) {
      }
    }
  }

  // Moves the tip to where a node commands it to be. With this input nothing but this thread moves it.
  void move_hand() {
    const auto tip_m = session_->read_servo_cp();
    LiveHost* const live = host_.live();
    if (!tip_m || live == nullptr) return;
    if (!is_tip_claimed_) is_tip_claimed_ = live->claim_pointer(true, {}).ok();
    PointerTarget target;
    for (std::size_t axis = 0; axis < 3; ++axis) target.tip_patient_mm[axis] = kMetre_mm * (*tip_m)[axis];
    // a position that is not finite, or out of the workspace, is ignored
    live->move_pointer(target);
  }

  // Publishes the latest tick unless it has been already; returns its time stamp.
  std::int64_t publish_tick(bool has_virtual_time) {
    std::array<double, kMaxDevices> stiffness_N_per_mm{};
    const TickRecord tick = host_.snapshot(stiffness_N_per_mm);
    const std::int64_t stamp_ns = has_virtual_time ? static_cast<std::int64_t>(1e9 * tick.time_s)
                                                   : clock_.stamp_ns(tick.time_s, now_ns());
    if (has_virtual_time) session_->publish_clock(stamp_ns);
    if (tick.tick == published_tick_) return stamp_ns;
    published_tick_ = tick.tick;
    const auto devices = static_cast<std::size_t>(std::clamp(tick.devices, 0, kMaxDevices));
    for (std::size_t d = 0; d < std::min(devices, host_.scene().tools.size()); ++d)
      if (sampler_.convert(tick, d, sample_)) session_->publish(d, stamp_ns, sample_);
    return stamp_ns;
  }

  ViewerHost& host_;
  const std::unique_ptr<DdsSession> session_;
  const Sampler sampler_;
  const Clock::duration period_;
  TickClock clock_;
  HandSample sample_;
  std::uint64_t published_tick_ = ~std::uint64_t{0};
  std::mutex mutex_;  // guards ended_
  std::condition_variable wake_;
  bool ended_ = false;
  bool is_tip_claimed_ = false;
  std::thread thread_;  // last: it uses the members above
};

// The library stays loaded.
Result<std::unique_ptr<DdsSession>> open_session(const DdsOptions& options) {
  const auto missing = [] {
    const char* why = ::dlerror();
    return Error{
        ErrorKind::kUnavailable,
        "a session cannot be published to ROS 2: " +
            std::string(why ? why : "its library is of another version"),
        "ROS 2",
        std::string("install palpate again, with ") + kLibrary + " and Cyclone DDS (libddsc0debian)"};
  };
  void* library = ::dlopen(kLibrary, RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) return missing();
  const auto open = reinterpret_cast<decltype(&palpate_ros2_open)>(::dlsym(library, "palpate_ros2_open"));
  if (open == nullptr) return missing();
  std::string fault;
  std::unique_ptr<DdsSession> session(open(options, fault));
  if (session == nullptr)
    return Error{ErrorKind::kUnavailable, "Cyclone DDS does not start: " + fault, "ROS 2",
                 "give a network interface of this machine (ip link), or another domain"};
  return session;
}

}  // namespace

Result<std::unique_ptr<Ros2Publisher>> Ros2Publisher::start(ViewerHost& host, const Ros2Options& options) {
  if (!host.scene().tasks.empty())
    return Error{ErrorKind::kUsage, "nodes of ROS 2 have no role, and would see what a task hides", "ROS 2",
                 "leave out the task, or publish without ROS 2"};
  if (!(options.rate_hz >= kRates_hz[0] && options.rate_hz <= kRates_hz[1]))
    return Error{ErrorKind::kBadInput, "the rate is outside 1 to 1000 Hz", "ROS 2", "choose a rate within"};
  if (options.domain < 0 || options.domain > kMaxDomain)
    return Error{ErrorKind::kBadInput, "the domain is outside 0 to 101", "ROS 2",
                 "give the ROS_DOMAIN_ID of the nodes"};
  auto session = open_session({options.domain, options.interface, host.scene().tools.size(),
                               host.playback() != nullptr, host.scene().input == kRos2Input});
  if (!session) return session.error();
  try {
    return std::unique_ptr<Ros2Publisher>(std::make_unique<Publisher>(host, options, *std::move(session)));
  } catch (const std::system_error&) {
    return Error{ErrorKind::kUnavailable, "cannot start a thread", "ROS 2",
                 "close other programs, or raise the limit (ulimit -u)"};
  }
}

}  // namespace palpate
