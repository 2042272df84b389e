#pragma once

#include <cstdio>
#include <cstdlib>

namespace palpate::internal {

[[noreturn]] inline void check_failed(const char* condition, const char* file, int line) {
  std::fprintf(stderr, "palpate: bug: check '%s' failed at %s:%d\n", condition, file, line);
  std::abort();
}

}  // namespace palpate::internal

/// Aborts with condition, file and line when `condition` is false. For invariants that only a bug can break;
/// invalid input is reported by a Result.
#define PALPATE_CHECK(condition) \
  ((condition) ? void() : ::palpate::internal::check_failed(#condition, __FILE__, __LINE__))
