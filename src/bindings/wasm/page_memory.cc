#include <algorithm>
#include <cstdint>

#include "palpate/base/reading.h"

// Memory limits in a page, whose memory is that of WebAssembly.
namespace palpate {
namespace {

constexpr std::uint64_t kPage_bytes = 64 << 10, kMax_bytes = std::uint64_t{4} << 30;

ReadingLimits& limits() {
  static ReadingLimits limits{.max_memory_bytes = kMax_bytes, .follow_links = false};
  return limits;
}

}  // namespace

void set_reading_limits(const ReadingLimits& chosen) {
  limits() = chosen;
  limits().max_memory_bytes = std::min(chosen.max_memory_bytes, kMax_bytes);
}

const ReadingLimits& reading_limits() {
  return limits();
}

Result<void> check_memory(std::uint64_t more_bytes, const std::string& what) {
  const std::uint64_t most = limits().max_memory_bytes, now = __builtin_wasm_memory_size(0) * kPage_bytes;
  if (more_bytes <= most - std::min(most, now)) return {};
  return Error{ErrorKind::kBadInput,
               "needs " + memory_size_text(now + more_bytes) + " of memory, this page may take " +
                   memory_size_text(most),
               what, "crop or resample it first, or open it with palpate installed on a computer"};
}

// a page's files lie in one folder, without links
Result<void> check_stays_in(const std::filesystem::path& /*folder*/, const std::filesystem::path& /*file*/) {
  return {};
}

}  // namespace palpate
