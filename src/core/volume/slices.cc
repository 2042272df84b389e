#include "palpate/volume/slices.h"

#include <atomic>
#include <mutex>

namespace palpate::internal {

namespace {

/// Progress of all workers together.
class SliceCount {
 public:
  SliceCount(int count, const Progress& progress, const ProgressSpan& span)
      : count_(count), progress_(progress), span_(span) {}

  /// Counts a slice and reports the progress, serialised and never decreasing; a worker that would have to
  /// wait leaves the report to the other. Completion of the last slice is not reported here.
  void add_one() {
    done_.fetch_add(1, std::memory_order_relaxed);
    const std::unique_lock lock(telling_, std::try_to_lock);
    if (!lock.owns_lock()) return;
    const int done = done_.load(std::memory_order_relaxed);
    if (done == last_published_ || done == count_) return;
    last_published_ = done;
    progress_.report(span_.stage, span_.from + (span_.to - span_.from) * done / count_);
  }

 private:
  const int count_;
  const Progress& progress_;
  const ProgressSpan& span_;
  std::atomic<int> done_{0};
  std::mutex telling_;
  int last_published_ = 0;
};

}  // namespace

Result<void> for_each_slice(int count, int workers, const Progress& progress, const ProgressSpan& span,
                            const std::function<void(int worker, int slice)>& work) {
  SliceCount done(count, progress, span);
  const bool all = for_each_index(count, workers, [&](int worker, int slice) {
    if (progress.stopped()) return false;
    work(worker, slice);
    done.add_one();
    return true;
  });
  if (!all) return Progress::interrupted();
  progress.report(span.stage, span.to);
  return {};
}

}  // namespace palpate::internal
