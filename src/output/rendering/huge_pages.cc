#include "rendering/huge_pages.h"

#include <sys/mman.h>

#include <new>

namespace palpate::internal {
namespace {

constexpr std::size_t kHugePage = std::size_t{2} << 20, kCacheLine = 64;
std::align_val_t alignment(std::size_t bytes) {
  return std::align_val_t{bytes < kHugePage ? kCacheLine : kHugePage};
}

}  // namespace

void* allocate_huge_pages(std::size_t bytes) {
  if (bytes < kHugePage) return ::operator new(bytes, alignment(bytes));
  const std::size_t whole = (bytes + kHugePage - 1) / kHugePage * kHugePage;
  void* memory = ::operator new(whole, alignment(bytes));
  // only a hint: failure is harmless
  ::madvise(memory, whole, MADV_HUGEPAGE);
  return memory;
}

void free_huge_pages(void* memory, std::size_t bytes) noexcept {
  ::operator delete(memory, alignment(bytes));
}

}  // namespace palpate::internal
