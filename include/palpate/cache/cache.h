#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"

/// Cache folder for prepared results, so that a scene starts faster the second time. No entry contains a name
/// of a file, a patient or a structure. Process-wide, configured before anything is read; disabled until
/// then. docs/guide/cache.md describes the entries and their keys.
namespace palpate {

/// Default maximum size of all entries; bytes.
inline constexpr std::uint64_t kDefaultCacheBytes = 4'000'000'000;
/// Upper limit relative to the space that the disk would have free without the cache.
inline constexpr double kMaxCacheDiskFraction = 0.1;

struct CacheSettings {
  std::filesystem::path folder;  ///< Created if it is missing; empty: no caching.
  std::uint64_t max_bytes = kDefaultCacheBytes;
  Warn warn = {};  ///< Called at most once, if the folder is not writable.
};
/// Settings from the environment. Folder: $PALPATE_CACHE if it is set, where an empty value disables the
/// cache; otherwise $XDG_CACHE_HOME/palpate, otherwise ~/.cache/palpate; none if the home folder is unknown.
/// Maximum size: $PALPATE_CACHE_LIMIT ("800M"). Errors: kUsage if that is not an amount.
Result<CacheSettings> cache_settings_of_environment();
void set_cache(CacheSettings settings);
const CacheSettings& cache_settings();

struct CacheContents {
  std::size_t entries = 0;
  std::uint64_t bytes = 0;
  std::uint64_t max_bytes = 0;  ///< Maximum size, also limited by the disk; bytes.
};
/// Contents of the cache; all 0 without a readable folder.
CacheContents cache_contents();
/// Removes all entries and returns what was removed. Errors: kOutput if an entry cannot be removed.
Result<CacheContents> empty_cache();

}  // namespace palpate
