#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "palpate/cache/digest.h"

/// Entries of the cache folder. The file name of an entry is the digest of everything from which it was made.
/// All functions fail silently, or with the single warning of CacheSettings: without the cache, results are
/// merely computed again.
///
///     "palpkept"  u32 format  u32 0  32 bytes key  u64 size  u64 checksum of key and payload
///     payload, `size` bytes
namespace palpate::cache {

/// True if the cache is enabled.
bool is_cache_enabled();
/// Contents of an entry; the memory is not initialised before the file is read into it.
class Payload {
 public:
  explicit Payload(std::size_t size) : bytes_(new std::byte[size]), size_(size) {}
  std::span<std::byte> writable_bytes() { return {bytes_.get(), size_}; }
  std::span<const std::byte> bytes() const { return {bytes_.get(), size_}; }

 private:
  std::unique_ptr<std::byte[]> bytes_;
  std::size_t size_;
};
/// Payload of an entry, which also becomes the most recently used one; nullopt if there is none or it is
/// incomplete.
std::optional<Payload> find(const Digest& key);
/// Stores a payload, evicting the least recently used entries if space is needed. Not stored if it is larger
/// than the whole cache may be.
void store(const Digest& key, std::span<const std::byte> payload);

/// File name of an entry.
std::string name_of_entry(const Digest& key);

}  // namespace palpate::cache
