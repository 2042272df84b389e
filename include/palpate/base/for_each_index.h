#pragma once

#include <functional>

namespace palpate {

/// Number of processors on which the calling thread may run (taskset and containers may exclude some); at
/// least 1.
int processors();

/// Number of workers for `count` items: `threads`, or one per processor if `threads` is 0; at least 1 and at
/// most `count`.
int worker_count(int threads, int count);

/// Parallel loop, the only one in palpate. Calls work(worker, index) once for each index 0 ... count-1 on up
/// to `workers` threads, including the calling thread; each thread takes a few neighbouring indices at a
/// time. `worker`, 0 ... workers-1, selects scratch memory that no other thread uses. The result for one
/// index must not depend on another index, so that the outcome is independent of the number of workers. After
/// work has returned false or thrown, no further index is started. Returns once every thread has ended: false
/// if any call returned false; rethrows the first exception. If the machine grants fewer threads than
/// requested, the loop only takes longer.
///
/// Threads are created and joined within each call, and handing out indices establishes no other ordering, so
/// ThreadSanitizer detects a race between two calls of work.
bool for_each_index(int count, int workers, const std::function<bool(int worker, int index)>& work);

}  // namespace palpate
