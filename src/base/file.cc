#include "base/file.h"

#include "palpate/output.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

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
      error.what = "cannot be written, the folder does not exist";
      error.remedy = "create it first, or choose another";
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

Result<std::string> read_file(const std::filesystem::path& file, std::size_t max_bytes) {
  Descriptor d{::open(file.c_str(), O_RDONLY | O_CLOEXEC)};
  if (d.fd < 0) {
    const char* remedy = errno == ENOENT ? "check the name and the folder" : "check its permissions";
    const std::string what =
        errno == ENOENT ? "no such file" : std::string("cannot be read: ") + std::strerror(errno);
    return Error{ErrorKind::kBadInput, what, file.string(), remedy};
  }
  struct stat status;
  if (::fstat(d.fd, &status) == 0 && S_ISDIR(status.st_mode))
    return Error{ErrorKind::kBadInput, "is a folder, not a file", file.string(), "name a file in it"};

  // the size is only a hint: pipes have none and files grow
  std::string bytes;
  std::size_t used = 0;
  bytes.resize(S_ISREG(status.st_mode)
                   ? std::min<std::size_t>(static_cast<std::size_t>(status.st_size), max_bytes) + 1
                   : 65536);
  while (true) {
    const ssize_t got = ::read(d.fd, bytes.data() + used, bytes.size() - used);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0)
      return Error{ErrorKind::kBadInput, std::string("cannot be read: ") + std::strerror(errno),
                   file.string(), ""};
    if (got == 0) break;
    used += static_cast<std::size_t>(got);
    if (used > max_bytes)
      return Error{ErrorKind::kBadInput, "is larger than " + std::to_string(max_bytes >> 20) + " MiB",
                   file.string(), "is it the right file?"};
    if (used == bytes.size()) bytes.resize(bytes.size() * 2);
  }
  bytes.resize(used);
  return bytes;
}

Result<PendingFile> PendingFile::create(const std::filesystem::path& target) {
  std::error_code ignored;
  if (std::filesystem::is_directory(target, ignored)) return output_error(target, EISDIR);
  // renaming over a device would replace it
  if (std::filesystem::exists(target, ignored) && !std::filesystem::is_regular_file(target, ignored))
    return Error{ErrorKind::kOutput, "cannot be written, it is not an ordinary file", target.string(),
                 "name a file"};
  const auto folder = folder_of(target);
  // the ending is everything from the first dot, so that .nii.gz and .seg.nrrd survive
  const std::string name = target.filename().string();
  const auto dot = name.find('.', 1);
  const std::string ending = dot == std::string::npos ? "" : name.substr(dot);
  std::string pattern = (folder / (".palpate-XXXXXX" + ending)).string();
  const int fd = ::mkostemps(pattern.data(), static_cast<int>(ending.size()), O_CLOEXEC);
  if (fd < 0) return output_error(target, errno);
  // the usual permissions of a new file instead of mkstemp's private ones
  const mode_t mask = ::umask(0);
  ::umask(mask);
  ::fchmod(fd, 0666 & ~mask);
  ::close(fd);
  return PendingFile(target, pattern);
}

PendingFile::PendingFile(PendingFile&& other) noexcept
    : target_(std::move(other.target_)), temporary_(std::move(other.temporary_)) {
  other.temporary_.clear();
}

PendingFile::~PendingFile() {
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
}

Result<void> PendingFile::commit() {
  {
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

Result<void> check_output(const std::filesystem::path& file) {
  if (auto pending = PendingFile::create(file); !pending) return pending.error();
  return {};
}

}  // namespace palpate
