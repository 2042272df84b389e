#include "palpate/base/for_each_index.h"

#include <sched.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <new>
#include <system_error>
#include <thread>
#include <vector>

namespace palpate {
namespace {

// Maximum number of indices that a worker takes at once. Neighbouring indices often share most of their
// input, but large chunks would leave the other workers idle at the end.
constexpr int kMaxChunk = 8;

/// State shared by the workers: the next index, and whether to stop.
class IndexQueue {
 public:
  IndexQueue(int count, int workers, const std::function<bool(int, int)>& work)
      : count_(count), chunk_size_(std::clamp(count / (4 * workers), 1, kMaxChunk)), work_(work) {}

  void run(int worker) noexcept {
    try {
      for (;;) {
        const int first = next_.fetch_add(chunk_size_, std::memory_order_relaxed);
        if (first >= count_) return;
        for (int index = first; index < std::min(first + chunk_size_, count_); ++index) {
          if (stopped()) return;
          if (!work_(worker, index)) stopped_.store(true, std::memory_order_relaxed);
        }
      }
    } catch (...) {
      // the first exception is rethrown
      if (!failed_.exchange(true, std::memory_order_relaxed)) failure_ = std::current_exception();
      stopped_.store(true, std::memory_order_relaxed);
    }
  }

  // ---- after all workers have ended
  bool stopped() const { return stopped_.load(std::memory_order_relaxed); }
  void rethrow() const {
    if (failure_ != nullptr) std::rethrow_exception(failure_);
  }

 private:
  const int count_, chunk_size_;
  const std::function<bool(int, int)>& work_;
  std::atomic<int> next_{0};
  std::atomic<bool> stopped_{false}, failed_{false};
  std::exception_ptr failure_;
};

}  // namespace

int processors() {
  cpu_set_t set;
  CPU_ZERO(&set);
  if (::sched_getaffinity(0, sizeof set, &set) == 0) return std::max(1, CPU_COUNT(&set));
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

int worker_count(int threads, int count) {
  return std::clamp(threads > 0 ? threads : processors(), 1, std::max(1, count));
}

bool for_each_index(int count, int workers, const std::function<bool(int worker, int index)>& work) {
  workers = worker_count(std::max(1, workers), count);
  IndexQueue queue(count, workers, work);
  {
    std::vector<std::jthread> others;
    try {
      for (int worker = 1; worker < workers; ++worker)
        others.emplace_back([&queue, worker] { queue.run(worker); });
    } catch (const std::system_error&) {
    } catch (const std::bad_alloc&) {
      // the threads that could be created do all the work
    }
    queue.run(0);
  }
  queue.rethrow();
  return !queue.stopped();
}

}  // namespace palpate
