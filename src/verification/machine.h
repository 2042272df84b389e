#pragma once

#include <string>

namespace palpate {

/// "AMD EPYC 9R14, 2 cores, SIMD AVX3"
std::string machine_description();
/// "palpate 0.1.0, commit 0123456789ab, Release, GNU 12.2.0"
std::string build_description();
/// "2026-11-27", UTC
std::string today();

}  // namespace palpate
