#include "session/explore_hand.h"

#include <algorithm>
#include <chrono>
#include <system_error>

#include "base/clock.h"
#include "session/told_loop.h"

namespace palpate {
namespace {

constexpr std::chrono::nanoseconds kHandPeriod = std::chrono::milliseconds(2);
// the way to the next intention, so that it is not reached before the one after it comes
constexpr std::int64_t kLead_ns = 2 * kHandPeriod.count();
// a hand that was held up longer goes on from where it was
constexpr double kMostStep_s = 0.02;
constexpr std::uint32_t kForceIsOff = kFaultFlags | kFlagRamp | kFlagStale;

}  // namespace

HandThread::HandThread(ScriptedHand hand, const WorkspaceSettings& workspace, SimulatedDriver& driver,
                       ServoLoop& loop, EventLog& told, bool repeat)
    : hand_(std::move(hand)),
      mapping_(driver.devices()[0], workspace),
      driver_(driver),
      loop_(loop),
      told_(told),
      repeat_(repeat) {}

Result<void> HandThread::begin() try {
  thread_ = std::thread([this] { run(); });
  return {};
} catch (const std::system_error& error) {
  return Error{ErrorKind::kUnavailable, std::string("no thread for the simulated hand: ") + error.what(), "",
               "close other programs, or raise the limit of processes (ulimit -u)"};
}

void HandThread::end() {
  end_.store(true);
  if (thread_.joinable()) thread_.join();
}

void HandThread::run() {
  auto next = std::chrono::steady_clock::now();
  std::int64_t last_ns = monotonic_ns();
  while (!end_.load() && !done_.load()) {
    next = std::max(next + kHandPeriod, std::chrono::steady_clock::now());
    std::this_thread::sleep_until(next);
    const std::int64_t now_ns = monotonic_ns();
    move(std::min(static_cast<double>(now_ns - last_ns) * 1e-9, kMostStep_s));
    last_ns = now_ns;
  }
}

void HandThread::move(double dt_s) {
  const TickRecord felt = loop_.snapshot();
  const bool felt_nothing_yet = felt.dt_s == 0;
  if (felt_nothing_yet || (felt.device[0].flags & kForceIsOff) != 0) return;

  // viewers turn the object too
  const Eigen::Quaterniond rotation_target = loop_.parameters().rotation_target;
  HandCommands commands{rotation_target, {}};
  const auto intention = hand_.next(felt, dt_s, commands);
  progress_.store(hand_.progress());
  if (!intention) {
    if (repeat_)
      hand_.begin_again();
    else
      done_.store(true);
    return;
  }
  driver_.intend(mapping_.to_device(*intention), monotonic_ns() + kLead_ns);
  const bool turned = commands.rotation_target.coeffs() != rotation_target.coeffs();
  if (!turned && !commands.method) return;
  change_told(loop_, told_, {Asker::kScript}, [&](Parameters& parameters) {
    if (turned) parameters.rotation_target = commands.rotation_target;
    if (commands.method) parameters.method = *commands.method;
  });
}

}  // namespace palpate
