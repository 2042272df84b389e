#pragma once

#include <functional>
#include <string_view>

#include "palpate/base/for_each_index.h"
#include "palpate/base/progress.h"
#include "palpate/base/result.h"

namespace palpate::internal {

/// Interval of a stage's progress that one piece of work covers.
struct ProgressSpan {
  std::string_view stage;
  double from = 0, to = 1;
  ProgressSpan part(double a, double b) const {
    return {stage, from + a * (to - from), from + b * (to - from)};
  }
};

/// for_each_index() over slices that reports its progress, `to` of its span at the end, and returns
/// Progress::interrupted() before the next slice once it is cancelled.
Result<void> for_each_slice(int count, int workers, const Progress& progress, const ProgressSpan& span,
                            const std::function<void(int worker, int slice)>& work);

}  // namespace palpate::internal
