#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "palpate/cache/digest.h"

/// Entries of the cache's folder: found by the digest of what they were made from, which is all of their
/// name. Everything here fails silently, or with the one warning of CacheSettings: without the cache work is
/// done again, and no more than that.
///
///     "palpkept"  u32 format  u32 0  32 bytes key  u64 size  u64 checksum of key and payload
///     payload, `size` bytes
namespace palpate::cache {

/// Whether anything is kept and looked for at all.
bool is_kept();
/// Bytes that are read from a file, into memory that nobody has filled before.
class Payload {
 public:
  explicit Payload(std::size_t size) : bytes_(new std::byte[size]), size_(size) {}
  std::span<std::byte> room() { return {bytes_.get(), size_}; }
  std::span<const std::byte> bytes() const { return {bytes_.get(), size_}; }

 private:
  std::unique_ptr<std::byte[]> bytes_;
  std::size_t size_;
};
/// The payload of an entry, as it was kept, and that entry is now the one used last. Nothing where there is
/// none, or none that is whole.
std::optional<Payload> find(const Digest& key);
/// Keeps a payload, in the place of what was used longest ago where there is no room; not at all where it is
/// larger than the whole cache may be.
void keep(const Digest& key, std::span<const std::byte> payload);

/// The name of an entry's file in the folder.
std::string name_of_entry(const Digest& key);

}  // namespace palpate::cache
