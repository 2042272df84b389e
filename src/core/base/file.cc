#include "palpate/base/file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

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

}  // namespace palpate
