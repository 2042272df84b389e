#pragma once

#include <cstdint>
#include <ctime>
#include <optional>
#include <string_view>
#include <vector>

#include "palpate/cache/digest.h"
#include "volume_io/volume_reader.h"

namespace palpate::volume_io {

/// Cache entry of a volume's decompressed values. The key covers the compressed bytes and the part of the
/// header that determines their interpretation, but not the rest of the header, which may identify a patient.
/// Uncompressed values are not cached, because reading them is as fast.
class VoxelCacheEntry {
 public:
  /// @param kind  what is derived from the values; part of the key
  VoxelCacheEntry(const VolumeReader& reader, std::string_view kind, VoxelCaching caching);

  /// Cached layers; empty if there are none.
  std::vector<std::vector<LabelId>> find_labels(std::size_t layers) const;
  /// Stores the layers, unless the file has changed since it was opened.
  void store_labels(const std::vector<std::vector<LabelId>>& layers) const;
  /// @param replaced  number of NaN values that were replaced
  bool find_scan(std::vector<float>& voxels, std::uint64_t& replaced) const;
  void store_scan(const std::vector<float>& voxels, std::uint64_t replaced) const;

 private:
  bool file_has_changed() const;

  const VolumeReader& reader_;
  std::optional<cache::Digest> key_;
  timespec changed_{};
};

}  // namespace palpate::volume_io
