#include "volume_io/value_statistics.h"

#include <algorithm>
#include <cmath>

#include "palpate/base/for_each_index.h"

namespace palpate {

using namespace volume_io;

namespace {

/// Counts of one worker.
struct ValueCounts {
  std::size_t equal = 0, unequal = 0, near = 0;
  std::vector<std::uint64_t> voxels = std::vector<std::uint64_t>(kLabelValues),
                             runs = std::vector<std::uint64_t>(kLabelValues);

  /// Compares each of these voxels with its predecessor. Returns false if one is not a valid label.
  template <class T>
  bool add(const std::vector<T>& values, std::size_t begin, std::size_t end) {
    T before = begin > 0 ? values[begin - 1] : T{0};
    for (std::size_t n = begin; n < end; ++n) {
      const T value = values[n];
      if constexpr (!std::is_same_v<T, LabelId>) {
        // tested first, so that the conversion is defined
        if (!(value >= 0 && value < static_cast<T>(kLabelValues)) || value != std::floor(value)) return false;
      }
      if (value != 0) {
        const auto at = static_cast<std::size_t>(value);
        ++voxels[at];
        if (value != before) ++runs[at];
        if (before != 0) {
          ++(value == before ? equal : unequal);
          near += value != before && std::abs(value - before) <= 2;
        }
      }
      before = value;
    }
    return true;
  }
  void add(const ValueCounts& more) {
    equal += more.equal;
    unequal += more.unequal;
    near += more.near;
    for (std::size_t value = 0; value < kLabelValues; ++value) {
      voxels[value] += more.voxels[value];
      runs[value] += more.runs[value];
    }
  }
  ValueStatistics statistics() const {
    ValueStatistics all{.equal = equal, .unequal = unequal, .near = near};
    all.is_present.resize(kLabelValues);
    std::vector<double> mean_runs;
    for (std::size_t value = 1; value < kLabelValues; ++value) {
      if (voxels[value] == 0) continue;
      all.is_present[value] = 1;
      // a run may continue from the previous piece
      mean_runs.push_back(static_cast<double>(voxels[value]) /
                          static_cast<double>(std::max<std::uint64_t>(runs[value], 1)));
    }
    all.distinct = mean_runs.size();
    if (mean_runs.empty()) return all;
    const auto middle = mean_runs.begin() + static_cast<std::ptrdiff_t>(mean_runs.size() / 2);
    std::nth_element(mean_runs.begin(), middle, mean_runs.end());
    all.median_run = *middle;
    return all;
  }
};

}  // namespace

namespace volume_io {

ValueStatistics statistics_of(const std::vector<float>& voxels) {
  constexpr std::size_t kPiece = std::size_t{1} << 20;
  const auto pieces = static_cast<int>((voxels.size() + kPiece - 1) / kPiece);
  const int workers = worker_count(0, pieces);
  std::vector<ValueCounts> of_worker(static_cast<std::size_t>(workers));
  const bool only_whole = for_each_index(pieces, workers, [&](int worker, int index) {
    const std::size_t begin = static_cast<std::size_t>(index) * kPiece;
    const std::size_t end = std::min(voxels.size(), begin + kPiece);
    return of_worker[static_cast<std::size_t>(worker)].add(voxels, begin, end);
  });
  if (!only_whole) return {.only_whole = false};
  for (std::size_t w = 1; w < of_worker.size(); ++w) of_worker.front().add(of_worker[w]);
  return of_worker.front().statistics();
}

VolumeContent content_by_values(const ValueStatistics& s) {
  using Kind = VolumeContent::Kind;
  // up to kFew values, step sizes are not informative; more than kMany are rare in a label map
  constexpr std::size_t kFew = 8, kMany = 64;
  if (!s.only_whole) return {Kind::kScan, "it holds values other than whole numbers in 0 ... 65535"};
  if (s.distinct == 0) return {Kind::kScan, "it holds only 0"};
  const std::string values = "its " + std::to_string(s.distinct) + (s.distinct == 1 ? " value " : " values ");
  if (s.unequal > s.equal) return {Kind::kScan, values + "change from voxel to voxel"};
  const bool in_small_steps = 5 * s.near >= 4 * s.unequal && s.unequal > 0;
  const bool unequal_often = 2 * s.unequal > s.equal;
  if (s.distinct > kFew) {
    if (unequal_often && (in_small_steps || (s.distinct > kMany && 2 * s.near > s.unequal)))
      return {Kind::kScan, values + "change by small steps"};
    if (s.median_run < 1.5) return {Kind::kScan, values + "occur mostly in single voxels"};
    // adjacent structures touch in few voxels of a row
    if (in_small_steps && (s.distinct > kMany || 8 * s.unequal > s.equal))
      return {Kind::kUnclear, values + "form patches and change by small steps"};
  }
  if (s.distinct > kMany && s.median_run < 2)
    return {Kind::kUnclear, values + "occur mostly in one or two voxels"};
  return {Kind::kLabels, values + (s.distinct == 1 ? "forms patches" : "form patches")};
}

bool has_large_ids(const std::vector<float>& voxels) {
  std::size_t equal = 0, unequal = 0;
  bool any = false;
  for (std::size_t n = 0; n < voxels.size(); ++n) {
    if (!(voxels[n] >= 0) || voxels[n] != std::floor(voxels[n])) return false;
    any = any || voxels[n] >= static_cast<float>(kLabelValues);
    if (n > 0 && voxels[n] != 0 && voxels[n - 1] != 0) ++(voxels[n] == voxels[n - 1] ? equal : unequal);
  }
  return any && equal >= unequal;
}

}  // namespace volume_io

bool resembles_labels(const ScanFile& file) {
  if (file.header.has_segments || file.header.meaning == ValueMeaning::kLabels) return true;
  return file.header.meaning == ValueMeaning::kUnspecified &&
         content_by_values(statistics_of(file.scan.voxels())).kind == VolumeContent::Kind::kLabels;
}

bool resembles_scan(const LabelMap& labels) {
  constexpr std::size_t kManyLabels = 64;
  if (labels.segments.size() <= kManyLabels) return false;
  ValueCounts counts;
  for (const Volume<LabelId>& layer : labels.layers) counts.add(layer.voxels(), 0, layer.voxels().size());
  return content_by_values(counts.statistics()).kind == VolumeContent::Kind::kScan;
}

}  // namespace palpate
