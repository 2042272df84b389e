#include "palpate/base/file.h"

#include "palpate/base/output.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <exception>
#include <map>
#include <mutex>
#include <set>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "palpate/base/hash.h"

namespace palpate {
namespace {

// open file descriptor, closed on scope exit
struct Descriptor {
  int fd;
  ~Descriptor() {
    if (fd >= 0) ::close(fd);
  }
};

std::filesystem::path folder_of(const std::filesystem::path& file) {
  const auto parent = file.parent_path();
  return parent.empty() ? std::filesystem::path(".") : parent;
}

// target of a chain of symbolic links, whether or not it exists; other paths are returned unchanged
std::filesystem::path end_of_links(std::filesystem::path file) {
  constexpr int kMaxLinks = 40;  // the kernel's limit
  std::error_code failed;
  for (int links = 0; links < kMaxLinks; ++links) {
    if (!std::filesystem::is_symlink(std::filesystem::symlink_status(file, failed))) break;
    const auto next = std::filesystem::read_symlink(file, failed);
    if (failed) break;
    file = folder_of(file) / next;
  }
  return file;
}

// completes the error with the first part of the path that is missing or is not a folder
void describe_missing_path(Error& error, const std::filesystem::path& file, int error_number) {
  std::error_code ignored;
  const auto folder = folder_of(file);
  auto there = error_number == ENOTDIR ? file : folder;
  while (!there.empty() && !std::filesystem::exists(there, ignored)) there = there.parent_path();
  if (!there.empty() && !std::filesystem::is_directory(there, ignored)) {
    error.what = "is a file, not a folder, so nothing can be written in it";
    error.where = there.string();
    error.remedy = "choose a folder";
  } else if (there == folder) {
    error.what = "cannot be written, this folder does not accept files";
    error.remedy = "choose another";
  } else {
    error.what = "cannot be written, the folder does not exist";
    error.remedy = "create it first, or choose another";
  }
}

// Extension by which writers choose the format: ".nii.gz", ".seg.nrrd", ".h5". Limited in length, so that the
// temporary's name fits wherever the target's does.
std::string ending_of(const std::string& name) {
  constexpr std::size_t kMaxEnding = 12;
  const auto last = name.rfind('.');
  if (last == std::string::npos || last == 0 || name.size() - last > kMaxEnding) return "";
  const auto before = name.rfind('.', last - 1);
  const bool two = before != std::string::npos && before > 0 && name.size() - before <= kMaxEnding;
  return name.substr(two ? before : last);
}

// ---- claims on output files ----------------------------------------------------------------------

// common prefix of the names of a target's temporaries and lock file
std::string hidden_prefix(const std::filesystem::path& target) {
  const std::string name = target.filename().string();
  std::uint64_t hash = kHashSeed;
  hash_bytes(hash, name.data(), name.size());
  char text[40];
  std::snprintf(text, sizeof text, ".palpate-%016llx", static_cast<unsigned long long>(hash_finish(hash)));
  return text;
}

bool is_there_still(int descriptor, const std::string& file) {
  struct stat opened {
  }, named{};
  return ::fstat(descriptor, &opened) == 0 && ::stat(file.c_str(), &named) == 0 &&
         opened.st_ino == named.st_ino && opened.st_dev == named.st_dev;
}

// prefix of a hidden file's name, in the form of hidden_prefix(); empty: named by another program
std::string prefix_of_hidden(std::string_view name) {
  constexpr std::string_view kBegin = ".palpate-";
  constexpr std::size_t kLength = kBegin.size() + 16;
  if (!name.starts_with(kBegin) || name.size() <= kLength) return "";
  const std::string_view hash = name.substr(kBegin.size(), 16), remaining = name.substr(kLength);
  if (hash.find_first_not_of("0123456789abcdef") != std::string_view::npos) return "";
  return remaining == ".lock" || remaining.starts_with('-') ? std::string(name.substr(0, kLength)) : "";
}

// temporaries of a folder, by prefix; a prefix with only a lock file has an empty list
std::map<std::string, std::vector<std::filesystem::path>> temporaries_in(
    const std::filesystem::path& folder) {
  std::map<std::string, std::vector<std::filesystem::path>> found;
  std::error_code failed;
  std::filesystem::directory_iterator entry(folder, failed);
  for (; !failed && entry != std::filesystem::directory_iterator(); entry.increment(failed)) {
    const std::string name = entry->path().filename().string(), prefix = prefix_of_hidden(name);
    if (prefix.empty()) continue;
    auto& files = found[prefix];
    if (name != prefix + ".lock") files.push_back(entry->path());
  }
  return found;
}

// removes only regular files of this account: a link, or another account's file of such a name, is not a
// temporary of palpate
void remove_temporaries(const std::vector<std::filesystem::path>& files) {
  for (const auto& file : files) {
    struct stat status {};
    if (::lstat(file.c_str(), &status) == 0 && S_ISREG(status.st_mode) && status.st_uid == ::geteuid())
      ::unlink(file.c_str());
  }
}

Error claimed_by_other_process(const std::filesystem::path& target, int descriptor) {
  struct flock other {};
  other.l_type = F_WRLCK;
  const bool known = ::fcntl(descriptor, F_GETLK, &other) == 0 && other.l_type != F_UNLCK && other.l_pid > 0;
  return {ErrorKind::kOutput,
          "is being written by another run" +
              (known ? " (process " + std::to_string(other.l_pid) + ")" : std::string()),
          target.string(), "wait until that has ended, or name another file"};
}

/// Registry of the output files that this process claims. A POSIX lock is released when the process closes
/// any descriptor of the file, so each lock file is opened once and its claims are counted.
class Claims {
 public:
  /// Claims a file; returns the path of its lock file.
  /// @param target  path with symbolic links resolved
  /// @param named  path as the user named it, for errors
  Result<std::string> take(const std::filesystem::path& target, const std::filesystem::path& named) {
    const std::lock_guard guard(mutex_);
    std::error_code failed;
    const auto folder = std::filesystem::canonical(folder_of(target), failed);
    if (failed) return output_error(named, failed.value());
    const std::string prefix = hidden_prefix(target), lock = (folder / (prefix + ".lock")).string();
    if (const auto held = held_.find(lock); held != held_.end() && held->second.process == ::getpid()) {
      ++held->second.count;
      return lock;
    }
    const auto descriptor = lock_file(lock, named);
    if (!descriptor) return descriptor.error();
    held_[lock] = {*descriptor, ::getpid(), 1};
    for (const auto& [abandoned, files] : temporaries_in(folder))
      if (abandoned == prefix)
        remove_temporaries(files);
      else
        sweep((folder / (abandoned + ".lock")).string(), files);
    return lock;
  }

  /// Removes all unfinished output of this process. Returns without effect if another thread holds the mutex.
  void abandon() {
    const std::unique_lock guard(mutex_, std::try_to_lock);
    if (!guard) return;
    std::error_code ignored;
    for (const auto& folder : unfinished_) std::filesystem::remove_all(folder, ignored);
    for (const auto& [lock, held] : held_) {
      if (held.process != ::getpid()) continue;
      const std::filesystem::path file = lock;
      remove_temporaries(temporaries_in(file.parent_path())[file.stem().string()]);
      ::unlink(lock.c_str());
    }
  }

  void begin(const std::filesystem::path& folder) {
    const std::lock_guard guard(mutex_);
    unfinished_.insert(folder);
  }
  void finish(const std::filesystem::path& folder) {
    const std::lock_guard guard(mutex_);
    unfinished_.erase(folder);
  }

  void give_back(const std::string& lock) {
    const std::lock_guard guard(mutex_);
    const auto held = held_.find(lock);
    // a forked copy of the process that made the claim has none
    if (held == held_.end() || held->second.process != ::getpid() || --held->second.count > 0) return;
    ::unlink(lock.c_str());
    ::close(held->second.descriptor);
    held_.erase(held);
  }

 private:
  struct Held {
    int descriptor;
    pid_t process;
    int count;
  };

  // Removes temporaries left by a process that died while writing another file of the folder: that file's
  // lock is then free. `files` were listed before the lock is tested, and a process that takes the lock
  // meanwhile creates temporaries with new names, so none of them belongs to a running process.
  void sweep(const std::string& lock, const std::vector<std::filesystem::path>& files) {
    struct stat status {};
    // Without its lock file no process may write a temporary, except on a file system without locks.
    if (::lstat(lock.c_str(), &status) != 0 || !S_ISREG(status.st_mode) || is_held(status)) return;
    const int descriptor = ::open(lock.c_str(), O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY);
    if (descriptor < 0) return;
    struct flock whole {};
    whole.l_type = F_WRLCK;
    if (::fcntl(descriptor, F_SETLK, &whole) == 0 && is_there_still(descriptor, lock)) {
      remove_temporaries(files);
      ::unlink(lock.c_str());
    }
    ::close(descriptor);
  }

  // closing another descriptor of a file locked by this process would release its lock
  bool is_held(const struct stat& lock) const {
    return std::ranges::any_of(held_, [&](const auto& entry) {
      struct stat status {};
      return ::fstat(entry.second.descriptor, &status) == 0 && status.st_ino == lock.st_ino &&
             status.st_dev == lock.st_dev;
    });
  }

  static Result<int> lock_file(const std::string& lock, const std::filesystem::path& named) {
    // The owner removes the lock file when it has finished, perhaps between the open and the lock below;
    // another run that sweeps the folder holds the lock briefly.
    constexpr int kTries = 5;
    for (int tries = 0;;) {
      const int descriptor =
          ::open(lock.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY, 0666);
      if (descriptor < 0) return output_error(named, errno);
      struct flock whole {};
      whole.l_type = F_WRLCK;
      if (::fcntl(descriptor, F_SETLK, &whole) != 0 && (errno == EACCES || errno == EAGAIN)) {
        const Error error = claimed_by_other_process(named, descriptor);
        ::close(descriptor);
        if (++tries == kTries) return error;
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
        continue;
      }
      if (is_there_still(descriptor, lock)) return descriptor;
      ::close(descriptor);
    }
  }

  std::mutex mutex_;
  std::map<std::string, Held> held_;
  std::set<std::filesystem::path> unfinished_;
};

// never destroyed: claims may be released at any time, including during static destruction
Claims& claims() {
  static Claims* const all = new Claims;
  return *all;
}

}  // namespace

Error output_error(const std::filesystem::path& file, int error_number) {
  Error error{ErrorKind::kOutput, std::strerror(error_number), file.string(), ""};
  switch (error_number) {
    case ENOSPC:
    case EDQUOT:
      error.what = "cannot be written, the disk is full";
      error.remedy = "free some space or write elsewhere";
      break;
    case EACCES:
    case EPERM:
    case EROFS:
      error.what = "cannot be written, permission denied";
      error.remedy = "choose a folder that you may write to";
      break;
    case ENOENT:
    case ENOTDIR:
      describe_missing_path(error, file, error_number);
      break;
    case ENAMETOOLONG:
      error.what = "cannot be written, the name is too long";
      error.remedy = "choose a shorter one";
      break;
    case EFBIG:
      error.what = "cannot be written, it would be larger than this session's file size limit";
      error.remedy = "raise it (ulimit -f) or write less";
      break;
    case EISDIR:
      error.what = "cannot be written, it is a folder";
      error.remedy = "name a file";
      break;
    default:
      error.what = std::string("cannot be written: ") + std::strerror(error_number);
  }
  return error;
}

Result<PendingFile> PendingFile::create(const std::filesystem::path& target) {
  if (target.empty()) return Error{ErrorKind::kOutput, "an output has an empty name", "", "name a file"};
  // a link is preserved: its target is written
  const auto file = end_of_links(target);
  std::error_code failed;
  const auto status = std::filesystem::status(file, failed);
  if (status.type() == std::filesystem::file_type::none) return output_error(target, failed.value());
  if (std::filesystem::is_directory(status)) return output_error(target, EISDIR);
  // renaming over a device would replace it
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))
    return Error{ErrorKind::kOutput, "cannot be written, it is not a regular file", target.string(),
                 "name a file"};
  auto claim = OutputClaim::take(target);
  if (!claim) return claim.error();
  const std::string ending = ending_of(file.filename().string());
  std::string pattern = (folder_of(file) / (hidden_prefix(file) + "-XXXXXX" + ending)).string();
  const int fd = ::mkostemps(pattern.data(), static_cast<int>(ending.size()), O_CLOEXEC);
  if (fd < 0) return output_error(target, errno);
  // the default permissions of a new file instead of mkstemp's private ones
  const mode_t mask = ::umask(0);
  ::umask(mask);
  ::fchmod(fd, 0666 & ~mask);
  ::close(fd);
  return PendingFile(*std::move(claim), file, pattern);
}

PendingFile::PendingFile(PendingFile&& other) noexcept
    : claim_(std::move(other.claim_)),
      target_(std::move(other.target_)),
      temporary_(std::move(other.temporary_)) {
  other.temporary_.clear();
}

PendingFile::~PendingFile() {
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
}

Result<void> PendingFile::commit(Flush flush) {
  if (flush == Flush::kToDisk) {
    Descriptor d{::open(temporary_.c_str(), O_RDONLY | O_CLOEXEC)};
    if (d.fd < 0 || ::fsync(d.fd) != 0) return output_error(target_, errno);
  }
  if (::rename(temporary_.c_str(), target_.c_str()) != 0) return output_error(target_, errno);
  temporary_.clear();
  return {};
}

Result<void> write_file(const std::filesystem::path& file, std::string_view bytes) {
  auto pending = PendingFile::create(file);
  if (!pending) return pending.error();
  {
    Descriptor d{::open(pending->path().c_str(), O_WRONLY | O_TRUNC | O_CLOEXEC)};
    if (d.fd < 0) return output_error(file, errno);
    while (!bytes.empty()) {
      const ssize_t wrote = ::write(d.fd, bytes.data(), bytes.size());
      if (wrote < 0 && errno == EINTR) continue;
      if (wrote < 0) return output_error(file, errno);
      bytes.remove_prefix(static_cast<std::size_t>(wrote));
    }
  }
  return pending->commit();
}

bool same_file(const std::filesystem::path& a, const std::filesystem::path& b) {
  std::error_code failed;
  if (std::filesystem::equivalent(a, b, failed)) return true;
  // a file that does not exist yet is identified by its canonical path
  const auto path_to = [&](const std::filesystem::path& file) {
    return std::filesystem::weakly_canonical(std::filesystem::absolute(end_of_links(file), failed), failed);
  };
  const auto position_a = path_to(a), position_b = path_to(b);
  return !position_a.empty() && position_a == position_b;
}

Result<OutputClaim> OutputClaim::take(const std::filesystem::path& file) {
  auto lock = claims().take(end_of_links(file), file);
  if (!lock) return lock.error();
  return OutputClaim(*std::move(lock));
}

void abandon_outputs() noexcept try { claims().abandon(); } catch (const std::exception&) {
  // out of memory: the next run removes the temporaries
}

UnfinishedFolder::UnfinishedFolder(std::filesystem::path folder) : folder_(std::move(folder)) {
  claims().begin(folder_);
}

UnfinishedFolder::~UnfinishedFolder() {
  if (!folder_.empty()) claims().finish(folder_);
}

OutputClaim::~OutputClaim() {
  if (!lock_path_.empty()) claims().give_back(lock_path_);
}

Result<OutputClaim> claim_output(const std::filesystem::path& file,
                                 std::span<const std::filesystem::path> inputs) {
  for (const auto& input : inputs)
    if (same_file(file, input))
      return Error{ErrorKind::kUsage, "would replace an input", file.string(), "write to another file"};
  const auto pending = PendingFile::create(file);
  if (!pending) return pending.error();
  return OutputClaim::take(file);
}

}  // namespace palpate
