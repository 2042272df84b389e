#include "rendering/section_volumes.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate::internal::section {
namespace {

int bricks_along(int voxels) {
  return std::max(0, voxels - 2) / kBrickStep + 1;
}

Lattice plain_lattice(const GridGeometry& grid) {
  PALPATE_CHECK(grid.voxel_count() <= std::numeric_limits<std::int32_t>::max());
  Lattice lattice;
  std::copy(grid.dims.begin(), grid.dims.end(), lattice.dims);
  lattice.stride[0] = 1;
  lattice.stride[1] = grid.dims[0];
  lattice.stride[2] = grid.dims[0] * grid.dims[1];
  return lattice;
}

std::size_t brick_count(const GridGeometry& grid) {
  std::size_t bricks = 1;
  for (const int voxels : grid.dims) bricks *= static_cast<std::size_t>(bricks_along(voxels));
  return bricks;
}

bool fits_bricks(const GridGeometry& grid) {
  return *std::max_element(grid.dims.begin(), grid.dims.end()) <= kMaxVoxelsAlongBricks &&
         brick_count(grid) <= std::numeric_limits<std::int32_t>::max() / kBrickVoxels;
}

Lattice brick_lattice(const GridGeometry& grid) {
  Lattice lattice;
  std::copy(grid.dims.begin(), grid.dims.end(), lattice.dims);
  int stride = 1, brick = kBrickVoxels;
  for (int a = 0; a < 3; ++a) {
    lattice.stride[a] = stride;
    lattice.jump[a] = brick - kBrickStep * stride;
    stride *= kBrick;
    brick *= bricks_along(grid.dims[a]);
  }
  return lattice;
}

/// Copies voxels i ... i + count - 1 of row (j, k).
void copy_row(const Volume<float>& scan, int i, int j, int k, int count, float* to) {
  std::copy_n(&scan.at(i, j, k), count, to);
}
void copy_row(const Bricks<LabelId>& labels, int i, int j, int k, int count, LabelId* to) {
  labels.copy_row(i, j, k, count, to);
}

/// Volume in bricks, with each voxel converted by `code`. Beyond the volume a brick repeats the last voxels.
template <class To, class From, class Source, class Code>
HugePageVector<To> in_bricks(const Source& source, Code code) {
  const GridGeometry& grid = source.geometry();
  std::array<From, kBrick> row;
  const auto within = [&](int axis, int brick, int n) {
    return std::min(brick * kBrickStep + n, grid.dims[axis] - 1);
  };
  HugePageVector<To> bricks(brick_count(grid) * kBrickVoxels);
  auto to = bricks.begin();
  for (int c = 0; c < bricks_along(grid.dims[2]); ++c)
    for (int b = 0; b < bricks_along(grid.dims[1]); ++b)
      for (int a = 0; a < bricks_along(grid.dims[0]); ++a) {
        const int first = a * kBrickStep, count = std::min(kBrick, grid.dims[0] - first);
        for (int k = 0; k < kBrick; ++k)
          for (int j = 0; j < kBrick; ++j) {
            copy_row(source, first, within(1, b, j), within(2, c, k), count, row.data());
            for (int i = 0; i < kBrick; ++i)
              *to++ = code(row[static_cast<std::size_t>(std::min(i, count - 1))]);
          }
      }
  return bricks;
}

struct Extent {
  double low = 0, high = 0;
  bool whole = true;  ///< Whether all are integers
  bool finite = true;
  bool any = false;
};

Extent extent_of(const std::vector<float>& values) {
  float low = std::numeric_limits<float>::infinity(), high = -low;
  Extent extent;
  for (const float value : values) {
    if (!std::isfinite(value)) {
      extent.finite = false;
      continue;
    }
    low = std::min(low, value);
    high = std::max(high, value);
    extent.whole = extent.whole && std::nearbyint(value) == value;
  }
  extent.any = low <= high;
  if (extent.any) extent.low = low, extent.high = high;
  return extent;
}

constexpr double kMaxCode = std::numeric_limits<std::uint16_t>::max(), kMinCode = 1;
constexpr double kMaxWindows = 16;

}  // namespace

Volumes::Volumes(const Model& model, SectionStorage storage) {
  if (model.scan != nullptr && !model.scan->empty()) scan_ = model.scan;
  if (model.labels != nullptr && model.labels->geometry().voxel_count() > 0) labels_ = model.labels;
  if (empty()) return;
  PALPATE_CHECK(scan_ == nullptr || labels_ == nullptr || scan_->geometry().dims == labels_->geometry().dims);
  if (storage == SectionStorage::kBricks && fits_bricks(grid())) {
    view_.bricks = true;
    view_.lattice = brick_lattice(grid());
    if (scan_ != nullptr) make_scan_bricks();
    if (labels_ != nullptr) make_label_bricks();
    return;
  }
  view_.lattice = plain_lattice(grid());
  if (scan_ != nullptr) view_.scan = scan_->voxels().data();
  if (labels_ != nullptr) {
    plain_labels_ = labels_->dense();
    view_.labels = plain_labels_.voxels().data();
  }
}

void Volumes::make_label_bricks() {
  constexpr std::size_t kMaxNumbers = 256;
  std::vector<std::uint8_t> number(std::size_t{std::numeric_limits<LabelId>::max()} + 1);
  const std::vector<std::size_t> voxels = label_counts(*labels_);
  for (std::size_t label = 0; label < voxels.size(); ++label) {
    if (voxels[label] == 0) continue;
    number[label] = static_cast<std::uint8_t>(label_of_number_.size());
    label_of_number_.push_back(static_cast<LabelId>(label));
  }
  if (label_of_number_.size() <= kMaxNumbers) {
    numbers_ = in_bricks<std::uint8_t, LabelId>(*labels_, [&](LabelId label) { return number[label]; });
    view_.numbers = numbers_.data();
    view_.label_of_number = label_of_number_.data();
  } else {
    brick_labels_ = in_bricks<LabelId, LabelId>(*labels_, [](LabelId label) { return label; });
    view_.labels = brick_labels_.data();
  }
}

void Volumes::make_scan_bricks() {
  const Extent extent = extent_of(scan_->voxels());
  double low = extent.low, high = extent.high;
  const bool exact = extent.whole && high - low <= kMaxCode - kMinCode;
  if (!exact) {
    // an outlier must not take up the code range
    const auto window = automatic_window();
    const double room = kMaxWindows * (window[1] - window[0]);
    if (window != std::array<double, 2>{0, 1}) {
      low = std::max(low, window[0] - room);
      high = std::min(high, window[1] + room);
    }
  }
  per_value_ = exact || !(high > low) ? 1 : (kMaxCode - kMinCode) / (high - low);
  code_zero_ = low - kMinCode / per_value_;
  view_.has_holes = !extent.finite;
  codes_ = in_bricks<std::uint16_t, float>(*scan_, [&](float value) -> std::uint16_t {
    if (!std::isfinite(value)) return 0;
    const double code = (static_cast<double>(value) - code_zero_) * per_value_;
    return static_cast<std::uint16_t>(std::clamp(code, kMinCode, kMaxCode) + 0.5);
  });
  view_.codes = codes_.data();
}

std::array<double, 2> Volumes::automatic_window() const {
  std::call_once(window_known_, [&] {
    if (scan_ != nullptr) window_ = scan_window(*scan_);
  });
  return window_;
}

std::size_t Volumes::prepared_bytes() const {
  return codes_.size() * sizeof(std::uint16_t) + brick_labels_.size() * sizeof(LabelId) + numbers_.size();
}

GreyScale Volumes::grey_scale(const std::array<double, 2>& window, int levels) const {
  const double top = levels - 1, per_value = top / (window[1] - window[0]);
  if (!view_.bricks)
    return {static_cast<float>(window[0]), static_cast<float>(per_value), static_cast<float>(top)};
  return {static_cast<float>((window[0] - code_zero_) * per_value_),
          static_cast<float>(per_value / per_value_), static_cast<float>(top)};
}

}  // namespace palpate::internal::section
