#include "server/volume_payload.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate::server {
namespace {

constexpr double kLowest = std::numeric_limits<std::int16_t>::min();
constexpr double kHighest = std::numeric_limits<std::int16_t>::max();
constexpr int kMaxShrink = 4;

/// Calls take(i, j, k) for every voxel of a block that is inside the grid.
template <class Take>
void for_block(const std::array<int, 3>& dims, const std::array<int, 3>& block, int shrink, Take&& visit) {
  const auto end = [&](int axis) { return std::min(dims[axis], (block[axis] + 1) * shrink); };
  for (int k = block[2] * shrink; k < end(2); ++k)
    for (int j = block[1] * shrink; j < end(1); ++j)
      for (int i = block[0] * shrink; i < end(0); ++i) visit(i, j, k);
}

/// Fills the payload with value(i, j, k) for each voxel, `kBytes` bytes each.
template <int kBytes, class Value>
std::shared_ptr<const std::string> fill(const std::array<int, 3>& dims, const std::atomic<bool>& stop,
                                        Value&& value) {
  auto bytes = std::make_shared<std::string>();
  bytes->resize(static_cast<std::size_t>(dims[0]) * static_cast<std::size_t>(dims[1]) *
                static_cast<std::size_t>(dims[2]) * kBytes);
  char* at = bytes->data();
  for (int k = 0; k < dims[2]; ++k) {
    if (stop) return nullptr;
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i) {
        const auto voxel = static_cast<std::uint16_t>(value(i, j, k));
        for (int byte = 0; byte < kBytes; ++byte) *at++ = static_cast<char>(voxel >> (8 * byte) & 0xff);
      }
  }
  return bytes;
}

float block_mean(const Volume<float>& scan, const std::array<int, 3>& block, int shrink) {
  double sum = 0;
  int count = 0;
  for_block(scan.geometry().dims, block, shrink, [&](int i, int j, int k) {
    const float value = scan.at(i, j, k);
    if (!std::isfinite(value)) return;
    sum += value;
    ++count;
  });
  return count > 0 ? static_cast<float>(sum / count) : std::numeric_limits<float>::quiet_NaN();
}

LabelId block_label(const Bricks<LabelId>& labels, const std::array<int, 3>& block, int shrink) {
  std::array<LabelId, kMaxShrink * kMaxShrink * kMaxShrink> members;
  std::size_t count = 0;
  for_block(labels.geometry().dims, block, shrink,
            [&](int i, int j, int k) { members[count++] = labels.at(i, j, k); });
  // most blocks are uniform
  if (std::all_of(members.begin(), members.begin() + count, [&](LabelId l) { return l == members[0]; }))
    return members[0];
  std::sort(members.begin(), members.begin() + count);
  LabelId best = 0;
  std::size_t largest = 0;
  for (std::size_t begin = 0, end = 0; begin < count; begin = end) {
    while (end < count && members[end] == members[begin]) ++end;
    // in a tie, a structure wins over background
    if (end - begin > largest || (end - begin == largest && best == 0)) {
      best = members[begin];
      largest = end - begin;
    }
  }
  return best;
}

template <int kBytes>
std::shared_ptr<const std::string> labels_of_width(const Bricks<LabelId>& labels, int shrink,
                                                   const std::atomic<bool>& stop) {
  const auto dims = shrunk_dims(labels.geometry().dims, shrink);
  if (shrink == 1) return fill<kBytes>(dims, stop, [&](int i, int j, int k) { return labels.at(i, j, k); });
  return fill<kBytes>(dims, stop, [&](int i, int j, int k) {
    return block_label(labels, {i, j, k}, shrink);
  });
}

}  // namespace

ScanScale ScanScale::of(const Volume<float>& scan) {
  ScanScale found;
  double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
  bool whole = true;
  for (const float voxel : scan.voxels()) {
    if (!std::isfinite(voxel)) continue;
    const double value = voxel;
    lowest = std::min(lowest, value);
    highest = std::max(highest, value);
    whole = whole && value == std::floor(value);
  }
  if (lowest > highest) return found;
  found.range = {lowest, highest};
  if (whole && lowest >= kLowest && highest <= kHighest) return found;
  if (whole && highest - lowest <= kHighest - kLowest) {
    found.offset = lowest - kLowest;
    return found;
  }
  if (highest > lowest) found.scale = (highest - lowest) / (kHighest - kLowest);
  found.offset = lowest - found.scale * kLowest;
  return found;
}

std::int16_t ScanScale::quantise(double value) const {
  const double within = std::isnan(value) ? range[0] : std::clamp(value, range[0], range[1]);
  return static_cast<std::int16_t>(std::clamp(std::round((within - offset) / scale), kLowest, kHighest));
}

bool needs_wide_labels(const Bricks<LabelId>& labels) {
  const std::vector<std::size_t> voxels = label_counts(labels);
  constexpr std::ptrdiff_t kNarrow = std::numeric_limits<std::uint8_t>::max();
  return std::any_of(voxels.begin() + kNarrow + 1, voxels.end(), [](std::size_t count) { return count > 0; });
}

std::array<int, 3> shrunk_dims(const std::array<int, 3>& dims, int shrink) {
  return {(dims[0] + shrink - 1) / shrink, (dims[1] + shrink - 1) / shrink, (dims[2] + shrink - 1) / shrink};
}

std::shared_ptr<const std::string> scan_payload(const Volume<float>& scan, const ScanScale& scale, int shrink,
                                                const std::atomic<bool>& stop) {
  const auto dims = shrunk_dims(scan.geometry().dims, shrink);
  if (shrink == 1)
    return fill<2>(dims, stop, [&](int i, int j, int k) { return scale.quantise(scan.at(i, j, k)); });
  return fill<2>(dims, stop, [&](int i, int j, int k) {
    return scale.quantise(block_mean(scan, {i, j, k}, shrink));
  });
}

std::shared_ptr<const std::string> labels_payload(const Bricks<LabelId>& labels, bool wide, int shrink,
                                                  const std::atomic<bool>& stop) {
  return wide ? labels_of_width<2>(labels, shrink, stop) : labels_of_width<1>(labels, shrink, stop);
}

}  // namespace palpate::server
