#include <algorithm>
#include <cstdint>

#include "palpate/base/file.h"
#include "palpate/base/reading.h"

// A page has no files, and its memory is that of WebAssembly.
namespace palpate {
namespace {

constexpr std::uint64_t kPage_bytes = 64 << 10, kMax_bytes = std::uint64_t{4} << 30;

}  // namespace

Result<void> check_memory(std::uint64_t more_bytes, const std::string& what) {
  const std::uint64_t now = __builtin_wasm_memory_size(0) * kPage_bytes;
  if (more_bytes <= kMax_bytes - std::min(kMax_bytes, now)) return {};
  return Error{ErrorKind::kBadInput,
               "needs " + memory_size_text(now + more_bytes) + " of memory, a page has at most " +
                   memory_size_text(kMax_bytes),
               what, "crop or resample it first, or open it with palpate installed on a computer"};
}

Result<std::string> read_file(const std::filesystem::path& file, std::size_t /*max_bytes*/) {
  return Error{ErrorKind::kBadInput, "a page has no files", file.string(), ""};
}

}  // namespace palpate
