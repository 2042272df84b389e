#include "palpate/base/reading.h"

#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <limits>
#include <optional>
#include <string_view>

#include "palpate/base/file.h"

namespace palpate {
namespace {

ReadingLimits& limits_in_effect() {
  static ReadingLimits limits;
  return limits;
}

constexpr std::size_t kMaxProcBytes = std::size_t{1} << 20;

std::optional<std::uint64_t> number_in(std::string_view text) {
  std::uint64_t number = 0;
  text.remove_prefix(std::min(text.size(), text.find_first_of("0123456789")));
  const auto read = std::from_chars(text.data(), text.data() + text.size(), number);
  if (read.ec != std::errc()) return std::nullopt;
  return number;
}

std::optional<std::uint64_t> number_of_file(const std::filesystem::path& file) {
  const auto text = read_file(file, kMaxProcBytes);
  return text ? number_in(*text) : std::nullopt;
}

// value of a line "name:   123 kB"; bytes
std::optional<std::uint64_t> line_bytes(const std::filesystem::path& file, std::string_view name) {
  const auto text = read_file(file, kMaxProcBytes);
  if (!text) return std::nullopt;
  const auto at = text->find(name);
  if (at == std::string::npos) return std::nullopt;
  const auto kib = number_in(std::string_view(*text).substr(at + name.size()));
  return kib ? std::optional(*kib << 10) : std::nullopt;
}

// memory that the process's control group and its ancestors leave, of cgroup versions 2 and 1; the maximum
// without a limit
std::uint64_t cgroup_memory_left() {
  std::uint64_t left = std::numeric_limits<std::uint64_t>::max();
  const auto observe = [&](const std::filesystem::path& folder, const char* most, const char* used) {
    const auto limit = number_of_file(folder / most), now = number_of_file(folder / used);
    if (limit && now) left = std::min(left, *limit - std::min(*limit, *now));
  };
  const auto groups = read_file("/proc/self/cgroup", kMaxProcBytes);
  std::string_view remaining = groups ? std::string_view(*groups) : std::string_view();
  while (!remaining.empty()) {
    // "0::/path", or "4:memory:/path"
    const std::string_view line = remaining.substr(0, remaining.find('\n'));
    remaining.remove_prefix(std::min(remaining.size(), line.size() + 1));
    const auto slash = line.find(":/");
    if (slash == std::string_view::npos) continue;
    const bool second = line.starts_with("0::");
    if (!second && line.find("memory") == std::string_view::npos) continue;
    const std::filesystem::path root = second ? "/sys/fs/cgroup" : "/sys/fs/cgroup/memory";
    for (std::filesystem::path group = line.substr(slash + 2);; group = group.parent_path()) {
      observe(root / group, second ? "memory.max" : "memory.limit_in_bytes",
              second ? "memory.current" : "memory.usage_in_bytes");
      if (group.empty()) break;
    }
  }
  return left;
}

std::uint64_t resident_bytes() {
  return line_bytes("/proc/self/status", "VmRSS:").value_or(0);
}

std::uint64_t max_memory() {
  static const std::uint64_t by_default = [] {
    const std::uint64_t machine = line_bytes("/proc/meminfo", "MemAvailable:")
                                      .value_or(static_cast<std::uint64_t>(::sysconf(_SC_PHYS_PAGES)) *
                                                static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE)));
    return resident_bytes() + std::min(machine, cgroup_memory_left()) / 2;
  }();
  const std::uint64_t chosen = limits_in_effect().max_memory_bytes;
  return chosen > 0 ? chosen : by_default;
}

}  // namespace

void set_reading_limits(const ReadingLimits& limits) {
  limits_in_effect() = limits;
}

const ReadingLimits& reading_limits() {
  return limits_in_effect();
}

Result<void> check_memory(std::uint64_t more_bytes, const std::string& what) {
  const std::uint64_t largest = max_memory(), now = resident_bytes();
  if (more_bytes <= largest - std::min(largest, now)) return {};
  // Margin so that the suggested limit suffices: resident memory differs by some MiB between runs of one
  // program.
  constexpr std::uint64_t kMargin_bytes = 16 << 20;
  const std::uint64_t mebibytes = ((now + more_bytes + kMargin_bytes) >> 20) + 1;
  return Error{ErrorKind::kBadInput,
               "needs " + memory_size_text(now + more_bytes) + " of memory, " + memory_size_text(largest) +
                   " are allowed",
               what,
               "if the size is correct, allow more with --memory " + std::to_string(mebibytes) +
                   "M, or crop or resample it first"};
}

Result<void> check_stays_in(const std::filesystem::path& folder, const std::filesystem::path& file) {
  if (reading_limits().follow_links) return {};
  std::error_code failed;
  const auto home = std::filesystem::canonical(folder.empty() ? "." : folder, failed);
  if (failed) return {};
  const auto end = std::filesystem::canonical(file, failed);
  if (failed) return {};
  const auto [differs, ignored] = std::mismatch(home.begin(), home.end(), end.begin(), end.end());
  if (differs == home.end()) return {};
  return Error{ErrorKind::kBadInput, "is a link that leads out of its folder, to " + end.string(),
               file.string(), "if that is intended, allow it with --follow-links"};
}

}  // namespace palpate
