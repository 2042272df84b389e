#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/sampling/surface.h"

/// The block of bone for the verification of burrs.
namespace palpate {

struct BlockGrid {
  double voxel_mm, turned_rad;
};
inline constexpr BlockGrid kBlockGrids[] = {{0.6, 0}, {0.6, 0.5}, {0.3, 0}, {0.3, 0.5}};
inline constexpr double kTickRates_Hz[] = {500, 1000, 2000, 4000, 10000};
/// Interval at which the surface is carved.
inline constexpr double kCarvedEvery_s = 0.02;

/// Surface of a block below z = 0, prepared from labels on a grid rotated relative to it. Errors:
/// kInterrupted.
Result<std::shared_ptr<const Surface>> bone_block(const BlockGrid& on, const Progress& progress);

/// Difference of the largest and the smallest of some values, relative to their mean.
class RelativeRange {
 public:
  void add(double value) {
    least_ = std::min(least_, value);
    most_ = std::max(most_, value);
    sum_ += value;
    ++count_;
  }
  double percent() const { return 100 * (most_ - least_) * count_ / sum_; }
  std::uint64_t count() const { return static_cast<std::uint64_t>(count_); }

 private:
  double least_ = std::numeric_limits<double>::infinity(), most_ = 0, sum_ = 0;
  int count_ = 0;
};

}  // namespace palpate
