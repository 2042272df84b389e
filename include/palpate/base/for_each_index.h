#pragma once

#include <functional>

namespace palpate {

/// Processors that the calling thread may run on (taskset and containers leave out some); at least 1.
int processors();

/// How many workers share `count` pieces of work: `threads`, or 0 for one a processor; never more than there
/// are pieces, at least 1.
int worker_count(int threads, int count);

/// The loop on several threads; there is no other. Calls work(worker, index) once for each index 0 ...
/// count-1 on up to `workers` threads, the caller's among them, a few neighbours at a time; worker, 0 ...
/// workers-1, tells a call which scratch memory is its own. What is done for an index must not depend on what
/// is done for another, so that the outcome does not depend on the number of workers. Where work returns
/// false or throws, no further index is begun. Returns when every thread has ended: false where work did, and
/// throws the first that it threw. A machine that grants fewer threads is slower, nothing else.
///
/// The threads are begun here and ended here, and the order in which indices are handed out orders nothing
/// else: so ThreadSanitizer sees what two calls do to the same memory.
bool for_each_index(int count, int workers, const std::function<bool(int worker, int index)>& work);

}  // namespace palpate
