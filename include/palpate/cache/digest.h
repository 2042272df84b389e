#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <type_traits>
#include <vector>

#include "palpate/base/file.h"

/// Keys of the cache: SHA-256, for which no collision is known. The 64-bit hash of base/hash.h is not
/// collision resistant.
namespace palpate::cache {

using Digest = std::array<std::byte, 32>;

/// Digest of bytes, computed by several threads if they are many; nullopt if OpenSSL fails.
std::optional<Digest> digest_of(std::span<const std::byte> bytes);
template <class T>
requires std::is_arithmetic_v<T> std::optional<Digest> digest_of(const std::vector<T>& values) {
  return digest_of(std::as_bytes(std::span(values)));
}

/// Digest of a file from an offset on; nullopt if it cannot be read.
std::optional<Digest> digest_of(const InputFile& file, std::uint64_t from);

/// Key of a result, composed of everything from which it was made. Two keys are equal if the same fields were
/// added in the same order.
class Key {
 public:
  /// @param kind     kind of the result
  /// @param version  to be incremented whenever its computation changes
  Key(std::string_view kind, std::uint32_t version) {
    put(kind);
    put(version);
  }

  void put(std::string_view text) {
    put(static_cast<std::uint64_t>(text.size()));
    put_bytes(std::as_bytes(std::span(text)));
  }
  template <class Plain>
  requires(std::is_arithmetic_v<Plain> || std::is_enum_v<Plain>) void put(const Plain& value) {
    put_bytes(std::as_bytes(std::span(&value, 1)));
  }
  void put(const Digest& digest) { put_bytes(digest); }

  std::optional<Digest> digest() const { return digest_of(std::span<const std::byte>(bytes_)); }

 private:
  void put_bytes(std::span<const std::byte> bytes) {
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
  }

  std::vector<std::byte> bytes_;
};

}  // namespace palpate::cache
