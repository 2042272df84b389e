#pragma once

#include <functional>
#include <string_view>

#include "palpate/progress.h"
#include "palpate/result.h"

namespace palpate::internal {

/// The part of a stage's progress that a piece of work fills.
struct ProgressSpan {
  std::string_view stage;
  double from = 0, to = 1;
  ProgressSpan part(double a, double b) const {
    return {stage, from + a * (to - from), from + b * (to - from)};
  }
};

/// As many workers as there are slices at most; 0 means as many as the machine has.
int worker_count(int threads, int slices);

/// Calls work(worker, slice) once for every slice 0 ... count-1, on `workers` threads, in runs of
/// neighbouring slices; worker (0 ... workers-1) tells a call which scratch memory is its own. What
/// work does for a slice must not depend on the other slices' results, so that the outcome does not
/// depend on the number of workers. Stops, with Progress::interrupted(), before the next slice.
/// work must not throw.
Result<void> for_each_slice(int count, int workers, const Progress& progress, const ProgressSpan& span,
                            const std::function<void(int worker, int slice)>& work);

}  // namespace palpate::internal
