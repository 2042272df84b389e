#pragma once

#include <cstddef>
#include <vector>

namespace palpate::internal {

/// Allocates memory in huge pages if available, for sizes above one of them; always cache-line aligned. With
/// small pages, a plane through the volume would exceed the TLB.
void* allocate_huge_pages(std::size_t bytes);
void free_huge_pages(void* memory, std::size_t bytes) noexcept;
template <class T>
struct HugePageAllocator {
  using value_type = T;
  HugePageAllocator() = default;
  template <class U>
  HugePageAllocator(const HugePageAllocator<U>&) {}
  T* allocate(std::size_t count) { return static_cast<T*>(allocate_huge_pages(count * sizeof(T))); }
  void deallocate(T* memory, std::size_t count) noexcept { free_huge_pages(memory, count * sizeof(T)); }
  bool operator==(const HugePageAllocator&) const = default;
};
template <class T>
using HugePageVector = std::vector<T, HugePageAllocator<T>>;

}  // namespace palpate::internal
