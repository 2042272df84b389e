#include "palpate/base/file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string_view>
#include <utility>

#include "base/output_paths.h"
#include "palpate/base/output.h"

namespace palpate {
namespace {

// open file descriptor, closed on scope exit
struct Descriptor {
  int fd;
  ~Descriptor() {
    if (fd >= 0) ::close(fd);
  }
};

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

bool is_special(mode_t mode) {
  return !S_ISREG(mode) && !S_ISDIR(mode);
}

Error not_a_file(const std::filesystem::path& file, mode_t mode) {
  if (S_ISDIR(mode))
    return {ErrorKind::kBadInput, "is a folder, not a file", file.string(), "name a file in it"};
  const char* kind = S_ISFIFO(mode) ? "a pipe" : S_ISSOCK(mode) ? "a socket" : "a device";
  return {ErrorKind::kBadInput, std::string("is ") + kind + ", not a file", file.string(),
          "give a regular file; save the output of a program to a file first"};
}

Error cannot_be_read(const std::filesystem::path& file, int error_number) {
  return {ErrorKind::kBadInput, std::string("cannot be read: ") + std::strerror(error_number), file.string(),
          ""};
}

// calls read_some(bytes read, rest of the buffer) until the buffer is full or the file ends
template <class ReadSome>
Result<std::size_t> read_by(const std::filesystem::path& file, std::span<std::byte> bytes,
                            const ReadSome& read_some) {
  std::size_t used = 0;
  while (used < bytes.size()) {
    const ssize_t received = read_some(used, bytes.subspan(used));
    if (received < 0 && errno == EINTR) continue;
    if (received < 0) return cannot_be_read(file, errno);
    if (received == 0) break;
    used += static_cast<std::size_t>(received);
  }
  return used;
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

Result<InputFile> InputFile::open(const std::filesystem::path& file) {
  // O_NONBLOCK: no wait for a pipe's writer or a line's carrier. O_NOCTTY: no terminal becomes the
  // controlling terminal.
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
  if (descriptor < 0) {
    const int failure = errno;
    struct stat status {};
    // opening a socket, or a device that is absent, fails
    if (::stat(file.c_str(), &status) == 0 && is_special(status.st_mode))
      return not_a_file(file, status.st_mode);
    const bool missing = failure == ENOENT;
    const char* remedy = failure == EACCES ? "check its permissions" : "check the name and the folder";
    return Error{ErrorKind::kBadInput,
                 missing ? "no such file" : std::string("cannot be read: ") + std::strerror(failure),
                 file.string(), remedy};
  }
  InputFile opened(descriptor, 0, file);
  struct stat status {};
  if (::fstat(descriptor, &status) != 0) return cannot_be_read(file, errno);
  if (!S_ISREG(status.st_mode)) return not_a_file(file, status.st_mode);
  opened.size_ = static_cast<std::uint64_t>(status.st_size);
  return opened;
}

InputFile::InputFile(InputFile&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), size_(other.size_), file_(std::move(other.file_)) {}

InputFile& InputFile::operator=(InputFile&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(size_, other.size_);
  std::swap(file_, other.file_);
  return *this;
}

InputFile::~InputFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

std::filesystem::path InputFile::name_for_libraries() const {
  return "/proc/self/fd/" + std::to_string(descriptor_);
}

Result<std::size_t> InputFile::read(std::span<std::byte> bytes) {
  return read_by(file_, bytes, [&](std::size_t, std::span<std::byte> remaining) {
    return ::read(descriptor_, remaining.data(), remaining.size());
  });
}

Result<std::size_t> InputFile::read_at(std::uint64_t offset, std::span<std::byte> bytes) const {
  return read_by(file_, bytes, [&](std::size_t used, std::span<std::byte> remaining) {
    return ::pread(descriptor_, remaining.data(), remaining.size(), static_cast<off_t>(offset + used));
  });
}

Result<std::string> read_file(const std::filesystem::path& file, std::size_t max_bytes) {
  auto opened = InputFile::open(file);
  if (!opened) return opened.error();
  // the size is only a hint: files grow
  std::string bytes;
  std::size_t used = 0;
  bytes.resize(static_cast<std::size_t>(std::min<std::uint64_t>(opened->size(), max_bytes)) + 1);
  while (true) {
    const auto remaining = std::as_writable_bytes(std::span(bytes)).subspan(used);
    const auto received = opened->read(remaining);
    if (!received) return received.error();
    used += *received;
    if (used > max_bytes)
      return Error{ErrorKind::kBadInput, "is larger than " + std::to_string(max_bytes >> 20) + " MiB",
                   file.string(), "is it the right file?"};
    if (*received < remaining.size()) break;
    bytes.resize(bytes.size() * 2);
  }
  bytes.resize(used);
  return bytes;
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

}  // namespace palpate
