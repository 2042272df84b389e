#include "palpate/cache/entries.h"

#include <fcntl.h>
#include <pwd.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <new>
#include <utility>

#include "palpate/base/file.h"
#include "palpate/base/hash.h"
#include "palpate/base/reading.h"
#include "palpate/cache/cache.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

constexpr const char* kEnding = ".kept";
// prefix of PendingFile's temporaries
constexpr const char* kTemporary = ".palpate-";
constexpr auto kAbandonedAfter = std::chrono::hours(1);

struct Cache {
  CacheSettings settings;
  // several threads may store entries
  std::mutex mutex;
  bool warned = false;
};

Cache& the_cache() {
  static Cache cache;
  return cache;
}

std::optional<std::string> environment_text(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? std::nullopt : std::optional<std::string>(value);
}

fs::path cache_home() {
  const fs::path xdg = environment_text("XDG_CACHE_HOME").value_or("");
  // the XDG specification ignores relative paths
  if (xdg.is_absolute()) return xdg;
  fs::path home = environment_text("HOME").value_or("");
  if (home.empty())
    if (const passwd* user = ::getpwuid(::getuid()); user != nullptr && user->pw_dir != nullptr)
      home = user->pw_dir;
  return home.is_absolute() ? home / ".cache" : fs::path();
}

struct CacheEntryFile {
  fs::path file;
  std::uint64_t bytes;
  fs::file_time_type used;
};

// entries, least recently used first; also removes files left by killed processes
std::vector<CacheEntryFile> cached_files(const fs::path& folder) {
  std::vector<CacheEntryFile> files;
  std::vector<fs::path> abandoned;
  std::error_code failed;
  fs::directory_iterator entry(folder, failed);
  for (; !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
    std::error_code removed;
    const auto used = fs::last_write_time(entry->path(), removed);
    if (removed) continue;
    if (entry->path().extension() == kEnding && !entry->path().filename().string().starts_with(kTemporary)) {
      const auto bytes = fs::file_size(entry->path(), removed);
      if (!removed) files.push_back({entry->path(), bytes, used});
    } else if (entry->path().filename().string().starts_with(kTemporary) &&
               used + kAbandonedAfter < fs::file_time_type::clock::now()) {
      abandoned.push_back(entry->path());
    }
  }
  std::error_code ignored;
  for (const fs::path& file : abandoned) fs::remove(file, ignored);
  std::sort(files.begin(), files.end(),
            [](const CacheEntryFile& a, const CacheEntryFile& b) { return a.used < b.used; });
  return files;
}

std::uint64_t bytes_of_files(const std::vector<CacheEntryFile>& files) {
  std::uint64_t bytes = 0;
  for (const CacheEntryFile& file : files) bytes += file.bytes;
  return bytes;
}

// maximum size: the user's limit, and a fraction of the space that the disk would have free without the cache
std::uint64_t max_bytes_of(const CacheSettings& settings, std::uint64_t used) {
  struct statvfs disk {};
  if (::statvfs(settings.folder.c_str(), &disk) != 0) return settings.max_bytes;
  const double free = static_cast<double>(disk.f_bavail) * static_cast<double>(disk.f_frsize);
  const double part = kMaxCacheDiskFraction * (free + static_cast<double>(used));
  return part < static_cast<double>(settings.max_bytes) ? static_cast<std::uint64_t>(part)
                                                        : settings.max_bytes;
}

void warn_once(const std::string& why) {
  Cache& cache = the_cache();
  if (std::exchange(cache.warned, true) || !cache.settings.warn) return;
  cache.settings.warn("prepared scenes are not cached, " + cache.settings.folder.string() + " " + why +
                      " (--no-cache turns the cache off, PALPATE_CACHE sets another folder)");
}

bool is_ours_alone_to_write(const struct stat& status) {
  return status.st_uid == ::geteuid() && (status.st_mode & (S_IWGRP | S_IWOTH)) == 0;
}

// true if the folder exists or was created, and only this account can write to it
bool folder_is_ours(const fs::path& folder) {
  std::error_code ignored;
  fs::create_directories(folder.parent_path(), ignored);
  if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST) {
    warn_once(std::string("cannot be created: ") + std::strerror(errno));
    return false;
  }
  struct stat status {};
  if (::stat(folder.c_str(), &status) != 0 || !S_ISDIR(status.st_mode)) {
    warn_once("is not a folder");
    return false;
  }
  if (!is_ours_alone_to_write(status)) {
    warn_once("belongs to another account, or other accounts may write to it");
    return false;
  }
  return true;
}

struct EntryHead {
  char magic[8] = {'p', 'a', 'l', 'p', 'k', 'e', 'p', 't'};
  std::uint32_t format = 2;
  std::uint32_t reserved = 0;
  cache::Digest key{};
  std::uint64_t size = 0, checksum = 0;
};
static_assert(sizeof(EntryHead) == 64);

EntryHead head_of(const cache::Digest& key, std::span<const std::byte> payload) {
  EntryHead head;
  head.key = key;
  head.size = payload.size();
  WordHasher hash;
  hash.add_bytes(key.data(), key.size());
  hash.add_bytes(payload.data(), payload.size());
  head.checksum = hash.value();
  return head;
}

bool write_all(int descriptor, std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t wrote = ::write(descriptor, bytes.data(), bytes.size());
    if (wrote < 0 && errno == EINTR) continue;
    if (wrote <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(wrote));
  }
  return true;
}

// returns 0 or the errno of the failure
int write_entry(const fs::path& file, const EntryHead& head, std::span<const std::byte> payload) {
  const int descriptor = ::open(file.c_str(), O_WRONLY | O_TRUNC | O_CLOEXEC);
  if (descriptor < 0) return errno;
  const bool written = ::fchmod(descriptor, 0600) == 0 &&
                       write_all(descriptor, std::as_bytes(std::span(&head, 1))) &&
                       write_all(descriptor, payload);
  const int failure = written ? 0 : errno;
  ::close(descriptor);
  return failure;
}

}  // namespace

Result<CacheSettings> cache_settings_of_environment() {
  CacheSettings settings;
  const auto named = environment_text("PALPATE_CACHE");
  std::error_code failed;
  if (named && !named->empty()) settings.folder = fs::absolute(*named, failed);
  if (!named)
    if (const fs::path home = cache_home(); !home.empty()) settings.folder = home / "palpate";
  if (const auto limit = environment_text("PALPATE_CACHE_LIMIT"); limit && !limit->empty()) {
    settings.max_bytes = parse_memory_size(*limit);
    if (settings.max_bytes == 0)
      return Error{ErrorKind::kUsage, "'" + *limit + "' is not an amount of memory", "PALPATE_CACHE_LIMIT",
                   "give one such as 800M or 8G, or leave it unset"};
  }
  return settings;
}

void set_cache(CacheSettings settings) {
  Cache& cache = the_cache();
  cache.settings = std::move(settings);
  cache.warned = false;
}

const CacheSettings& cache_settings() {
  return the_cache().settings;
}

CacheContents cache_contents() {
  CacheContents contents;
  if (!cache::is_cache_enabled()) return contents;
  const auto files = cached_files(cache_settings().folder);
  contents.entries = files.size();
  contents.bytes = bytes_of_files(files);
  contents.max_bytes = max_bytes_of(cache_settings(), contents.bytes);
  return contents;
}

Result<CacheContents> empty_cache() {
  const CacheContents contents = cache_contents();
  if (!cache::is_cache_enabled()) return contents;
  for (const CacheEntryFile& stored : cached_files(cache_settings().folder)) {
    std::error_code failed;
    fs::remove(stored.file, failed);
    if (failed)
      return Error{ErrorKind::kOutput, "cannot be removed: " + failed.message(), stored.file.string(),
                   "check the folder's permissions"};
  }
  return contents;
}

namespace cache {

bool is_cache_enabled() {
  return !cache_settings().folder.empty();
}

std::string name_of_entry(const Digest& key) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string name;
  for (const std::byte byte : key) {
    name += kDigits[std::to_integer<unsigned>(byte) >> 4];
    name += kDigits[std::to_integer<unsigned>(byte) & 15];
  }
  return name + kEnding;
}

std::optional<Payload> find(const Digest& key) try {
  if (!is_cache_enabled()) return std::nullopt;
  auto file = InputFile::open(cache_settings().folder / name_of_entry(key));
  if (!file || file->size() < sizeof(EntryHead)) return std::nullopt;
  // an entry that another account could have written is not trusted
  struct stat status {};
  if (::fstat(file->descriptor(), &status) != 0 || !is_ours_alone_to_write(status)) return std::nullopt;
  EntryHead head;
  const auto head_bytes = file->read(std::as_writable_bytes(std::span(&head, 1)));
  if (!head_bytes || head.size != file->size() - sizeof head) return std::nullopt;
  Payload payload(static_cast<std::size_t>(head.size));
  const auto received = file->read(payload.writable_bytes());
  if (!received || *received != payload.bytes().size()) return std::nullopt;
  const EntryHead whole = head_of(key, payload.bytes());
  if (std::memcmp(&head, &whole, sizeof head) != 0) return std::nullopt;
  // marks the entry as most recently used
  ::futimens(file->descriptor(), nullptr);
  return payload;
} catch (const std::bad_alloc&) {
  return std::nullopt;
}

void store(const Digest& key, std::span<const std::byte> payload) {
  if (!is_cache_enabled()) return;
  const std::lock_guard guard(the_cache().mutex);
  const CacheSettings& settings = cache_settings();
  if (!folder_is_ours(settings.folder)) return;

  // free the space required
  const auto files = cached_files(settings.folder);
  std::uint64_t used = bytes_of_files(files);
  const std::uint64_t largest = max_bytes_of(settings, used), wanted = sizeof(EntryHead) + payload.size();
  if (wanted > largest) return;
  for (const CacheEntryFile& stored : files) {
    if (used + wanted <= largest) break;
    std::error_code ignored;
    fs::remove(stored.file, ignored);
    used -= stored.bytes;
  }

  // another process may be writing the same entry
  auto pending = PendingFile::create(settings.folder / name_of_entry(key));
  if (!pending) {
    if (::access(settings.folder.c_str(), W_OK) != 0) warn_once("does not accept files");
    return;
  }
  const int failure = write_entry(pending->path(), head_of(key, payload), payload);
  if (failure != 0) return warn_once(std::string("cannot be written: ") + std::strerror(failure));
  // not flushed: the checksum detects an entry damaged by a power cut
  if (!pending->commit(Flush::kNone)) warn_once("cannot be written");
}

}  // namespace cache
}  // namespace palpate
