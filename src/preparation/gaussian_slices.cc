#include "preparation/gaussian_slices.h"

#include <algorithm>
#include <atomic>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace palpate::internal {

namespace {

/// Neighbouring slices share most of their input, so a worker takes a few at a time; not so many that
/// the last worker keeps the others waiting.
constexpr int kMaxRun = 8;
int run_length(int count, int workers) {
  return std::clamp(count / (4 * workers), 1, kMaxRun);
}

/// What the workers share: the next slice to take, and how many are done.
class SliceQueue {
 public:
  SliceQueue(int count, int workers, const Progress& progress, const ProgressSpan& span)
      : count_(count), run_(run_length(count, workers)), progress_(progress), span_(span) {}

  void work_off(int worker, const std::function<void(int, int)>& work) {
    for (;;) {
      const int first = next_.fetch_add(run_);
      for (int slice = first; slice < std::min(first + run_, count_); ++slice) {
        if (progress_.stopped()) interrupted_ = true;
        if (interrupted_) return;
        work(worker, slice);
        ++done_;
        report();
      }
      if (first + run_ >= count_) return;
    }
  }
  bool interrupted() const { return interrupted_; }

 private:
  /// Never two at a time, never backwards; a worker that would have to wait leaves it to the other.
  void report() {
    const std::unique_lock lock(reporting_, std::try_to_lock);
    if (!lock.owns_lock()) return;
    progress_.report(span_.stage, span_.from + (span_.to - span_.from) * done_ / count_);
  }

  int count_, run_;
  const Progress& progress_;
  const ProgressSpan& span_;
  std::atomic<int> next_{0}, done_{0};
  std::atomic<bool> interrupted_{false};
  std::mutex reporting_;
};

}  // namespace

int worker_count(int threads, int slices) {
  const int wanted = threads > 0 ? threads : static_cast<int>(std::thread::hardware_concurrency());
  return std::clamp(wanted, 1, std::max(1, slices));
}

Result<void> for_each_slice(int count, int workers, const Progress& progress, const ProgressSpan& span,
                            const std::function<void(int worker, int slice)>& work) {
  SliceQueue queue(count, workers, progress, span);
  {
    std::vector<std::jthread> others;
    try {
      for (int worker = 1; worker < workers; ++worker) {
        others.emplace_back([&queue, &work, worker] { queue.work_off(worker, work); });
      }
    } catch (const std::system_error&) {
      // a machine that grants no more threads is slower, nothing else
    }
    queue.work_off(0, work);
  }
  if (queue.interrupted()) return Progress::interrupted();
  progress.report(span.stage, span.to);
  return {};
}

}  // namespace palpate::internal
