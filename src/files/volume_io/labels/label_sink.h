#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <set>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "volume_io/volume_message.h"
#include "volume_io/voxel_cache.h"
#include "volume_io/voxel_values.h"

/// Voxels of a label file while they are read.
namespace palpate::volume_io {

/// Distributes the values of a label file over the layers, and records which values occur.
class LabelSink {
 public:
  explicit LabelSink(const VolumeFile& file);

  /// Distributes a piece of the file. Errors: a value that is no label.
  /// @param first  index of the piece's first value
  template <class T>
  Result<void> take(std::uint64_t first, std::span<const std::byte> bytes) {
    const std::uint64_t layers = layers_.size(), voxels = file_.header.geometry.voxel_count();
    const bool scaled = is_scaled(file_.voxels);
    grow(first + bytes.size() / sizeof(T));
    std::optional<std::uint64_t> wrong;
    for_each_value<T>(first, bytes, [&](std::uint64_t n, T stored) {
      LabelId label = 0;
      if (!to_label(stored, scaled, label)) {
        if (is_large_id(stored, scaled))
          large_ids_.insert(static_cast<std::uint64_t>(stored));
        else if (!wrong)
          wrong = n;
        return;
      }
      // avoids two divisions per voxel in the usual case of a single layer
      std::uint64_t layer = 0, voxel = n;
      if (layers > 1) {
        layer = file_.layers_first ? n % layers : n / voxels;
        voxel = file_.layers_first ? n / layers : n % voxels;
      }
      const auto in_layer = static_cast<std::size_t>(layer);
      layers_[in_layer][static_cast<std::size_t>(voxel)] = label;
      present_[layer][label] = 1;
    });
    if (wrong) return label_error(*wrong);
    // a 32-bit scan may have any number of them
    if (large_ids_.size() > kLabelValues) return large_id_error();
    return {};
  }
  /// To be called after the last voxel. Errors: ids above 65535.
  Result<void> check_ids() const;

  /// Takes all voxels from the cache; false if they are not cached.
  bool load(const VoxelCacheEntry& cache_entry);
  /// Stores the voxels in the cache, after the last voxel.
  void store(const VoxelCacheEntry& cache_entry) const { cache_entry.store_labels(layers_); }
  /// Moves the layers out, after the last voxel.
  std::vector<Volume<LabelId>> take_layers();
  bool present(std::size_t layer, LabelId value) const { return present_[layer][value] != 0; }

 private:
  // grows every layer to cover the first `values` values of the file
  void grow(std::uint64_t values);
  // most voxels equal their predecessor
  static void observe(const std::vector<LabelId>& voxels, std::vector<char>& present);
  template <class T>
  bool to_label(T stored, bool scaled, LabelId& label) const {
    if constexpr (std::is_integral_v<T>) {
      if (!scaled) {
        if (!std::in_range<LabelId>(stored)) return false;
        label = static_cast<LabelId>(stored);
        return true;
      }
    }
    double value = file_.voxels.slope * static_cast<double>(stored) + file_.voxels.intercept;
    // a 32-bit slope, as in NIfTI, is accurate to 6e-8
    constexpr double kSlopeRounding = 1e-6;
    if (scaled && std::abs(value - std::round(value)) <= kSlopeRounding * std::max(1.0, value))
      value = std::round(value);
    if (!(value >= 0 && value <= 65535) || value != std::floor(value)) return false;
    label = static_cast<LabelId>(value);
    return true;
  }
  template <class T>
  static bool is_large_id(T stored, bool scaled) {
    if constexpr (std::is_integral_v<T>)
      return !scaled && std::cmp_greater_equal(stored, kLabelValues);
    else
      return false;
  }
  Error large_id_error() const;
  Error label_error(std::uint64_t n) const;

  const VolumeFile& file_;
  std::vector<std::vector<LabelId>> layers_;
  std::vector<std::vector<char>> present_;  // indexed by layer and value
  std::set<std::uint64_t> large_ids_;       // ids above 65535
};

}  // namespace palpate::volume_io
