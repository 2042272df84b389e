#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"

/// What was prepared before, kept in a folder so that a scene starts fast the second time. Nothing that is
/// kept holds a name: of a file, a patient or a structure. One answer for the whole process, given before
/// anything is read; until then nothing is kept. docs/guide/cache.md says what is kept and by what it is
/// found.
namespace palpate {

/// Bytes that all that is kept may take, where nothing else is said.
inline constexpr std::uint64_t kUsualCacheBytes = 4'000'000'000;
/// It never takes more than this part of what the disk would have free without it.
inline constexpr double kCachePartOfDisk = 0.1;

struct CacheSettings {
  std::filesystem::path folder;  ///< made where it is missing; empty: nothing is kept or looked for
  std::uint64_t most_bytes = kUsualCacheBytes;
  Warn warn = {};  ///< told at most once, where the folder takes nothing
};
/// $PALPATE_CACHE, where it is set, none where that is empty; else $XDG_CACHE_HOME/palpate, else
/// ~/.cache/palpate; none where nobody knows the home folder. As large as $PALPATE_CACHE_LIMIT ("800M") says.
/// Errors: kUsage where that is no amount.
Result<CacheSettings> cache_settings_of_environment();
void set_cache(CacheSettings settings);
const CacheSettings& cache_settings();

struct CacheContents {
  std::size_t entries = 0;
  std::uint64_t bytes = 0;
  std::uint64_t most_bytes = 0;  ///< that it may take, the disk considered
};
/// Nothing where there is no folder, or none that may be read.
CacheContents cache_contents();
/// Removes all that is kept. Returns what that was. Errors: kOutput where something stays.
Result<CacheContents> empty_cache();

}  // namespace palpate
