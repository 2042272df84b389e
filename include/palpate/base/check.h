#pragma once

#include <cstdio>
#include <cstdlib>

namespace palpate::internal {

[[noreturn]] inline void check_failed(const char* condition, const char* file, int line) {
  std::fprintf(stderr, "palpate: bug: check '%s' failed at %s:%d\n", condition, file, line);
  std::abort();
}

}  // namespace palpate::internal

/// A condition that only a bug can break. Not for input: that gets a Result.
#define PALPATE_CHECK(condition) \
  ((condition) ? void() : ::palpate::internal::check_failed(#condition, __FILE__, __LINE__))
