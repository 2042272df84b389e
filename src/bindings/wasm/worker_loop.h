#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "palpate/device/device.h"
#include "server/transport.h"

/// Event loop, sockets and clock of a session in a browser's worker, which JavaScript calls every few
/// milliseconds (web/src/worker/palpate_worker.ts).
namespace palpate::wasm {

/// Timers and jobs, run by run_due().
class WorkerLoop final : public server::EventLoop {
 public:
  /// Runs the jobs that have been posted, and the timers that are due.
  void run_due();

  std::unique_ptr<server::Timer> timer() override;
  void post(std::function<void()> job) override { jobs_.push_back(std::move(job)); }
  bool is_stopped() const override { return false; }
  /// A worker has no network and returns to JavaScript: these must not be called.
  Result<std::unique_ptr<server::Listener>> listen(const server::IpAddress& address, int port,
                                                   std::shared_ptr<server::TlsIdentity> tls) override;
  void run() override;
  void stop() override;

 private:
  class WorkerTimer;
  std::deque<std::function<void()>> jobs_;
  std::multimap<server::Timer::Clock::time_point, WorkerTimer*> waiting_;
};

/// The page's end of the protocol: messages pass through functions that JavaScript provides and calls.
class WorkerSocket final : public server::WebSocket {
 public:
  /// @param loop  outlives the socket
  explicit WorkerSocket(WorkerLoop& loop) : loop_(loop) {}

  /// Takes a text message of the page.
  void receive(std::string text);
  /// The page has closed its end.
  void closed_by_page();

  void accept(std::function<void()> on_control, std::function<void(bool ok)> then) override;
  void read(std::function<void(Read outcome, std::string_view text)> then) override;
  void write(std::string_view bytes, bool is_binary, std::function<void(bool ok)> then) override;
  void close(std::uint16_t code, std::function<void()> then) override;
  void drop() override;

 private:
  void deliver();

  WorkerLoop& loop_;
  std::deque<std::string> received_;
  std::string text_;  // being read
  std::function<void(Read outcome, std::string_view text)> reader_;
  bool is_closed_ = false;
};

/// Clock of ticks on an exact grid of time. JavaScript wakes up every few milliseconds; the ticks due until
/// then run one after the other, each at its own grid point, so that time between two ticks is a period
/// although the processor runs them together.
class GridClock final : public ServoClock {
 public:
  explicit GridClock(double rate_hz);

  /// Lets wait() return the grid points up to now. If more than kMaxBehind_ns of them are due, the older ones
  /// are skipped, as a servo thread skips them that was not scheduled.
  void wake();
  bool wait() noexcept override;
  bool stopped() const noexcept override { return false; }

  /// Current grid point, plus the time since its tick began, up to the next grid point: the loop's
  /// TimeSource. Never goes back.
  static std::int64_t now() noexcept;

 private:
  static constexpr std::int64_t kMaxBehind_ns = 50'000'000;
  const std::int64_t period_ns_;
  std::int64_t until_ns_ = 0;
};

}  // namespace palpate::wasm
