#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

/// Serialisation of cache entries: numbers in native byte order, and arrays with run-length encoding, because
/// volumes contain long runs, such as background and distances beyond a surface's reach.
///
///   values:  u32 2n + 1, one value      n equal values           repeated
///            u32 2n,     n values       n different values
namespace palpate::cache {

class FieldWriter {
 public:
  template <class Plain>
  requires std::is_arithmetic_v<Plain>
  void put(const Plain& value) { put_bytes(&value, sizeof value); }

  template <class Plain>
  requires std::is_arithmetic_v<Plain>
  void put_values(std::span<const Plain> values) {
    // a shorter run costs more than it saves
    constexpr std::size_t kMinRun = 4 + 16 / sizeof(Plain), kMaxRun = 0x7fffffff;
    std::size_t first = 0;  // first of the different values that are not written yet
    for (std::size_t at = 0; at < values.size();) {
      const std::size_t end = std::min(values.size(), at + kMaxRun);
      std::size_t after = at + 1;
      while (after < end && same(values[after], values[at])) ++after;
      if (after - at >= kMinRun) {
        append_literal_run(values.subspan(first, at - first));
        put(static_cast<std::uint32_t>(2 * (after - at) + 1));
        put(values[at]);
        first = after;
      } else if (after - first >= kMaxRun) {
        append_literal_run(values.subspan(first, at - first));
        first = at;
      }
      at = after;
    }
    append_literal_run(values.subspan(first));
  }

  const std::vector<std::byte>& bytes() const { return bytes_; }

 private:
  // bitwise: 0 and -0 differ, and a NaN equals itself
  template <class Plain>
  static bool same(const Plain& a, const Plain& b) {
    return std::memcmp(&a, &b, sizeof a) == 0;
  }
  template <class Plain>
  void append_literal_run(std::span<const Plain> values) {
    if (values.empty()) return;
    put(static_cast<std::uint32_t>(2 * values.size()));
    put_bytes(values.data(), values.size_bytes());
  }
  void put_bytes(const void* data, std::size_t size) {
    const auto* first = static_cast<const std::byte*>(data);
    bytes_.insert(bytes_.end(), first, first + size);
  }

  std::vector<std::byte> bytes_;
};

/// Deserialises fields of an untrusted entry: after the first invalid one ok() is false, and values are left
/// unchanged.
class FieldReader {
 public:
  explicit FieldReader(std::span<const std::byte> bytes) : rest_(bytes) {}

  bool ok() const { return ok_; }
  /// True if all fields were valid and nothing is left.
  bool finished() const { return ok_ && rest_.empty(); }

  template <class Plain>
  requires std::is_arithmetic_v<Plain>
  void get(Plain& value) { get_bytes(&value, sizeof value); }

  /// Reads exactly as many values as `values` holds.
  template <class Plain>
  requires std::is_arithmetic_v<Plain>
  void get_values(std::span<Plain> values) {
    while (ok_ && !values.empty()) {
      std::uint32_t token = 0;
      get(token);
      const std::size_t count = token / 2;
      ok_ = ok_ && count > 0 && count <= values.size();
      if (!ok_) return;
      const auto part = values.first(count);
      if (token % 2 == 0) {
        get_bytes(part.data(), part.size_bytes());
      } else {
        Plain value{};
        get(value);
        std::fill(part.begin(), part.end(), value);
      }
      values = values.subspan(count);
    }
  }

 private:
  void get_bytes(void* into, std::size_t size) {
    ok_ = ok_ && size <= rest_.size();
    if (!ok_) return;
    std::memcpy(into, rest_.data(), size);
    rest_ = rest_.subspan(size);
  }

  std::span<const std::byte> rest_;
  bool ok_ = true;
};

}  // namespace palpate::cache
