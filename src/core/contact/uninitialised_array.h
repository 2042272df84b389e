#pragma once

#include <array>
#include <cstddef>
#include <new>
#include <type_traits>
#include <utility>

namespace palpate {

/// Fixed-capacity uninitialised storage of which a tick constructs only the few elements it needs. A
/// std::array would be initialised as a whole, which takes longer than the work on those elements.
template <class T, std::size_t kSize>
class UninitialisedArray {
  static_assert(std::is_trivially_destructible_v<T>, "UninitialisedArray never calls a destructor");

 public:
  // user-provided: a defaulted constructor would zero the storage when an enclosing object is initialised by
  // {}
  UninitialisedArray() {}
  UninitialisedArray(const UninitialisedArray&) = delete;
  UninitialisedArray& operator=(const UninitialisedArray&) = delete;

  static constexpr std::size_t size() { return kSize; }
  template <class... Values>
  T& make(std::size_t n, Values&&... values) {
    return *::new (bytes_.data() + n * sizeof(T)) T{std::forward<Values>(values)...};
  }
  /// Element n; make(n) must have been called.
  T& operator[](std::size_t n) { return data()[n]; }
  const T& operator[](std::size_t n) const { return data()[n]; }
  T* data() { return std::launder(reinterpret_cast<T*>(bytes_.data())); }
  const T* data() const { return std::launder(reinterpret_cast<const T*>(bytes_.data())); }

 private:
  alignas(T) std::array<std::byte, kSize * sizeof(T)> bytes_;
};

}  // namespace palpate
