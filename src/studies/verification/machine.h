#pragma once

#include <string>

namespace palpate {

/// Description of the machine, e.g. "AMD EPYC 9R14, 2 cores, SIMD AVX3"
std::string machine_description();
/// Description of the build, e.g. "palpate 1.0.0, commit 0123456789ab, Release, GNU 12.2.0"
std::string build_description();
/// UTC date, e.g. "2026-11-27"
std::string today();

}  // namespace palpate
