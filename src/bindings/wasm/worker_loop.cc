#include "wasm/worker_loop.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "palpate/base/check.h"
#include "palpate/base/clock.h"

// functions of the worker's JavaScript
extern "C" {
__attribute__((import_module("palpate"), import_name("send"))) void palpate_send(const char* bytes,
                                                                                 std::size_t count,
                                                                                 bool is_binary);
__attribute__((import_module("palpate"), import_name("close"))) void palpate_close(int code);
}

namespace palpate::wasm {

// ---- loop

class WorkerLoop::WorkerTimer final : public server::Timer {
 public:
  explicit WorkerTimer(WorkerLoop& loop) : loop_(loop) {}
  ~WorkerTimer() override { cancel(); }
  void wait_until(Clock::time_point at, std::function<void()> then) override {
    cancel();
    then_ = std::move(then);
    loop_.waiting_.emplace(at, this);
  }
  void cancel() override {
    std::erase_if(loop_.waiting_, [this](const auto& entry) { return entry.second == this; });
  }
  std::function<void()> take() { return std::exchange(then_, nullptr); }

 private:
  WorkerLoop& loop_;
  std::function<void()> then_;
};

std::unique_ptr<server::Timer> WorkerLoop::timer() {
  return std::make_unique<WorkerTimer>(*this);
}

void WorkerLoop::run_due() {
  const auto now = server::Timer::Clock::now();
  while (!waiting_.empty() && waiting_.begin()->first <= now) {
    const auto then = waiting_.begin()->second->take();
    waiting_.erase(waiting_.begin());
    then();
  }
  // jobs that these post run the next time
  for (std::size_t left = jobs_.size(); left > 0; --left) {
    const auto job = std::move(jobs_.front());
    jobs_.pop_front();
    job();
  }
}

Result<std::unique_ptr<server::Listener>> WorkerLoop::listen(const server::IpAddress& /*address*/,
                                                             int /*port*/,
                                                             std::shared_ptr<server::TlsIdentity> /*tls*/) {
  return Error{ErrorKind::kUnavailable, "a worker has no network", "", ""};
}

void WorkerLoop::run() {
  PALPATE_CHECK(false);
}

void WorkerLoop::stop() {
  PALPATE_CHECK(false);
}

// ---- socket

void WorkerSocket::receive(std::string text) {
  if (is_closed_) return;
  received_.push_back(std::move(text));
  deliver();
}

void WorkerSocket::closed_by_page() {
  is_closed_ = true;
  deliver();
}

// hands a message to the pending read, outside of the call that caused it
void WorkerSocket::deliver() {
  if (!reader_ || (received_.empty() && !is_closed_)) return;
  loop_.post([this, reader = std::exchange(reader_, nullptr)] {
    if (received_.empty()) return reader(Read::kClosed, {});
    text_ = std::move(received_.front());
    received_.pop_front();
    reader(text_.size() > kMaxMessage_bytes ? Read::kMalformed : Read::kText, text_);
  });
}

void WorkerSocket::accept(std::function<void()> /*on_control*/, std::function<void(bool ok)> then) {
  loop_.post([then = std::move(then)] { then(true); });
}

void WorkerSocket::read(std::function<void(Read outcome, std::string_view text)> then) {
  reader_ = std::move(then);
  deliver();
}

void WorkerSocket::write(std::string_view bytes, bool is_binary, std::function<void(bool ok)> then) {
  if (!is_closed_) palpate_send(bytes.data(), bytes.size(), is_binary);
  loop_.post([then = std::move(then), ok = !is_closed_] { then(ok); });
}

void WorkerSocket::close(std::uint16_t code, std::function<void()> then) {
  palpate_close(code);
  closed_by_page();
  loop_.post(std::move(then));
}

void WorkerSocket::drop() {
  constexpr int kGone = 1006;  // RFC 6455: without a closing handshake
  if (!is_closed_) palpate_close(kGone);
  closed_by_page();
}

// ---- clock

namespace {

std::int64_t grid_ns = 0, started_ns = 0;  // current grid point; time at which its tick began
std::int64_t next_ns = 0;                  // the following grid point

}  // namespace

GridClock::GridClock(double rate_hz) : period_ns_(std::llround(1e9 / rate_hz)) {
  grid_ns = started_ns = monotonic_ns();
  next_ns = grid_ns + period_ns_;
}

void GridClock::wake() {
  until_ns_ = monotonic_ns();
  if (until_ns_ - grid_ns > kMaxBehind_ns) next_ns = until_ns_;
}

bool GridClock::wait() noexcept {
  if (next_ns > until_ns_) return false;
  grid_ns = next_ns;
  next_ns += period_ns_;
  started_ns = monotonic_ns();
  return true;
}

std::int64_t GridClock::now() noexcept {
  // never later than the next tick, which a pause of JavaScript delays
  return std::min(grid_ns + (monotonic_ns() - started_ns), next_ns);
}

}  // namespace palpate::wasm
