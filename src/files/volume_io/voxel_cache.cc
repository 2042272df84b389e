#include "volume_io/voxel_cache.h"

#include <sys/stat.h>

#include <cmath>
#include <cstring>
#include <new>

#include "palpate/cache/entries.h"
#include "palpate/cache/fields.h"

namespace palpate::volume_io {
namespace {

/// To be incremented whenever the values decoded from the same compressed bytes change.
constexpr std::uint32_t kUnpackingVersion = 1;

timespec changed_at(const InputFile& file) {
  struct stat status {};
  return ::fstat(file.descriptor(), &status) == 0 ? status.st_ctim : timespec{};
}

// true if all values are 16-bit integers, as produced by scanners, which halves the size of the entry
bool fit_into_16_bits(const std::vector<float>& voxels) {
  for (const float voxel : voxels) {
    // tested first, so that the conversion is defined
    if (!(voxel >= -32768.f && voxel <= 32767.f)) return false;
    const float back = static_cast<float>(static_cast<std::int16_t>(voxel));
    if (std::memcmp(&back, &voxel, sizeof voxel) != 0) return false;
  }
  return true;
}

}  // namespace

VoxelCacheEntry::VoxelCacheEntry(const VolumeReader& reader, std::string_view kind, VoxelCaching caching)
    : reader_(reader) {
  const VolumeFile& file = reader.file();
  if (caching == VoxelCaching::kOff || !cache::is_cache_enabled() || file.voxels.encoding == Encoding::kRaw ||
      file.voxels.encoding == Encoding::kSlices)
    return;
  changed_ = changed_at(reader.voxel_file());
  const auto packed = cache::digest_of(reader.voxel_file(), file.voxels.offset);
  if (!packed) return;
  cache::Key key("voxels", kUnpackingVersion);
  key.put(kind);
  key.put(*packed);
  for (const int dim : file.header.geometry.dims) key.put(dim);
  key.put(file.header.layers);
  key.put(file.layers_first);
  const VoxelSource& source = file.voxels;
  key.put(source.encoding);
  key.put(source.component);
  key.put(source.big_endian);
  key.put(source.skip);
  key.put(source.trailing_bytes.has_value());
  key.put(source.trailing_bytes.value_or(0));
  key.put(source.may_have_more);
  key.put(source.slope);
  key.put(source.intercept);
  key_ = key.digest();
}

std::vector<std::vector<LabelId>> VoxelCacheEntry::find_labels(std::size_t layers) const try {
  const auto payload = key_ ? cache::find(*key_) : std::nullopt;
  if (!payload) return {};
  cache::FieldReader in(payload->bytes());
  std::vector<std::vector<LabelId>> found(layers);
  for (std::vector<LabelId>& layer : found) {
    layer.resize(reader_.file().header.geometry.voxel_count());
    in.get_values(std::span(layer));
  }
  if (!in.finished()) return {};
  return found;
} catch (const std::bad_alloc&) {
  return {};
}

void VoxelCacheEntry::store_labels(const std::vector<std::vector<LabelId>>& layers) const try {
  if (!key_ || file_has_changed()) return;
  cache::FieldWriter out;
  for (const std::vector<LabelId>& layer : layers) out.put_values(std::span(layer));
  cache::store(*key_, out.bytes());
} catch (const std::bad_alloc&) {
  // out of memory: the values are decompressed again next time
}

bool VoxelCacheEntry::find_scan(std::vector<float>& voxels, std::uint64_t& replaced) const try {
  const auto payload = key_ ? cache::find(*key_) : std::nullopt;
  if (!payload) return false;
  cache::FieldReader in(payload->bytes());
  std::uint64_t were_replaced = 0;
  std::uint8_t narrow = 0;
  in.get(were_replaced);
  in.get(narrow);
  const std::size_t count = reader_.file().header.geometry.voxel_count();
  std::vector<float> found(count);
  if (narrow != 0) {
    std::vector<std::int16_t> whole(count);
    in.get_values(std::span(whole));
    for (std::size_t n = 0; n < count; ++n) found[n] = whole[n];
  } else {
    in.get_values(std::span(found));
    // the reader leaves no NaN or infinity
    for (const float voxel : found)
      if (!std::isfinite(voxel)) return false;
  }
  if (!in.finished()) return false;
  voxels = std::move(found);
  replaced = were_replaced;
  return true;
} catch (const std::bad_alloc&) {
  return false;
}

void VoxelCacheEntry::store_scan(const std::vector<float>& voxels, std::uint64_t replaced) const try {
  if (!key_ || file_has_changed()) return;
  cache::FieldWriter out;
  const bool narrow = fit_into_16_bits(voxels);
  out.put(replaced);
  out.put(static_cast<std::uint8_t>(narrow));
  if (narrow)
    out.put_values(std::span<const std::int16_t>(std::vector<std::int16_t>(voxels.begin(), voxels.end())));
  else
    out.put_values(std::span(voxels));
  cache::store(*key_, out.bytes());
} catch (const std::bad_alloc&) {
  // out of memory: the values are decompressed again next time
}

bool VoxelCacheEntry::file_has_changed() const {
  const timespec now = changed_at(reader_.voxel_file());
  return now.tv_sec != changed_.tv_sec || now.tv_nsec != changed_.tv_nsec;
}

}  // namespace palpate::volume_io
