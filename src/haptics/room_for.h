#pragma once

#include <array>
#include <cstddef>
#include <new>
#include <type_traits>
#include <utility>

namespace palpate {

/// Room for up to so many objects, of which a tick makes the few that it needs: an array of them is written
/// from end to end first, which takes longer than what is done with those few.
template <class T, std::size_t kMost>
class RoomFor {
  static_assert(std::is_trivially_destructible_v<T>, "nothing ends what was made here");

 public:
  // not by default: that would write it all where an object with room in it is made by {}
  RoomFor() {}
  RoomFor(const RoomFor&) = delete;
  RoomFor& operator=(const RoomFor&) = delete;

  static constexpr std::size_t size() { return kMost; }
  template <class... Values>
  T& make(std::size_t n, Values&&... values) {
    return *::new (bytes_.data() + n * sizeof(T)) T{std::forward<Values>(values)...};
  }
  /// Of those that were made.
  T& operator[](std::size_t n) { return data()[n]; }
  const T& operator[](std::size_t n) const { return data()[n]; }
  T* data() { return std::launder(reinterpret_cast<T*>(bytes_.data())); }
  const T* data() const { return std::launder(reinterpret_cast<const T*>(bytes_.data())); }

 private:
  alignas(T) std::array<std::byte, kMost * sizeof(T)> bytes_;
};

}  // namespace palpate
