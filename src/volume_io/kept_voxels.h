#pragma once

#include <cstdint>
#include <ctime>
#include <optional>
#include <string_view>
#include <vector>

#include "palpate/cache/digest.h"
#include "volume_io/volume_reader.h"

namespace palpate::volume_io {

/// A volume's values, unpacked before: found by the packed bytes and by what the header says of their
/// meaning, not by the rest of the header, which may say who it is. Values that are not packed are as soon
/// read.
class KeptVoxels {
 public:
  /// @param kind  what is made of the values
  KeptVoxels(const VolumeReader& reader, std::string_view kind, Unpacked unpacked);

  /// Empty where they are not kept.
  std::vector<std::vector<LabelId>> find_labels(std::size_t layers) const;
  /// Nothing where the file has changed since it was first looked at.
  void keep_labels(const std::vector<std::vector<LabelId>>& layers) const;
  /// @param replaced  how many values were no numbers
  bool find_scan(std::vector<float>& voxels, std::uint64_t& replaced) const;
  void keep_scan(const std::vector<float>& voxels, std::uint64_t replaced) const;

 private:
  bool file_has_changed() const;

  const VolumeReader& reader_;
  std::optional<cache::Digest> key_;
  timespec changed_{};
};

}  // namespace palpate::volume_io
