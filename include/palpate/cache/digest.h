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

/// By what the cache finds things: SHA-256, which nobody has made collide. The house's own hash (base/hash.h)
/// has 64 bits and is not for what somebody may want to collide.
namespace palpate::cache {

using Digest = std::array<std::byte, 32>;

/// Of any bytes; large ones on several threads. Nothing where OpenSSL cannot.
std::optional<Digest> digest_of(std::span<const std::byte> bytes);
template <class T>
requires std::is_arithmetic_v<T> std::optional<Digest> digest_of(const std::vector<T>& values) {
  return digest_of(std::as_bytes(std::span(values)));
}

/// Of a file from an offset on. Nothing where it cannot be read.
std::optional<Digest> digest_of(const InputFile& file, std::uint64_t from);

/// Everything that a result was made from. Two keys are equal where all that was put in is, in its order.
class Key {
 public:
  /// @param kind     of the result
  /// @param version  raised by whoever changes how it is made
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
