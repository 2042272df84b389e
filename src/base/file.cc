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

// Where a link leads, through further links, also when nothing is there; other names as they are.
std::filesystem::path end_of_links(std::filesystem::path file) {
  constexpr int kMostLinks = 40;  // as the kernel follows
  std::error_code failed;
  for (int links = 0; links < kMostLinks; ++links) {
    if (!std::filesystem::is_symlink(std::filesystem::symlink_status(file, failed))) break;
    const auto next = std::filesystem::read_symlink(file, failed);
    if (failed) break;
    file = folder_of(file) / next;
  }
  return file;
}

// Which part of the way to a file is missing, or is no folder.
void tell_what_is_missing(Error& error, const std::filesystem::path& file, int error_number) {
  std::error_code ignored;
  const auto folder = folder_of(file);
  auto there = error_number == ENOTDIR ? file : folder;
  while (!there.empty() && !std::filesystem::exists(there, ignored)) there = there.parent_path();
  if (!there.empty() && !std::filesystem::is_directory(there, ignored)) {
    error.what = "cannot be written, " + there.filename().string() + " is a file and not a folder";
    error.remedy = "choose a folder";
  } else if (there == folder) {
    error.what = "cannot be written, this folder takes no files";
    error.remedy = "choose another";
  } else {
    error.what = "cannot be written, the folder does not exist";
    error.remedy = "create it first, or choose another";
  }
}

// The end of a name that writers choose the format by: ".nii.gz", ".seg.nrrd", ".h5". Short, so that the
// temporary's name fits wherever the target's does.
std::string ending_of(const std::string& name) {
  constexpr std::size_t kLongest = 12;
  const auto last = name.rfind('.');
  if (last == std::string::npos || last == 0 || name.size() - last > kLongest) return "";
  const auto before = name.rfind('.', last - 1);
  const bool two = before != std::string::npos && before > 0 && name.size() - before <= kLongest;
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
      tell_what_is_missing(error, file, error_number);
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

Result<std::string> read_file(const std::filesystem::path& file, std::size_t max_bytes) {
  Descriptor d{::open(file.c_str(), O_RDONLY | O_CLOEXEC)};
  if (d.fd < 0) {
    const bool missing = errno == ENOENT;
    const char* remedy = errno == EACCES ? "check its permissions" : "check the name and the folder";
    return Error{ErrorKind::kBadInput,
                 missing ? "no such file" : std::string("cannot be read: ") + std::strerror(errno),
                 file.string(), remedy};
  }
  struct stat status;
  if (::fstat(d.fd, &status) != 0)
    return Error{ErrorKind::kBadInput, std::string("cannot be read: ") + std::strerror(errno), file.string(),
                 ""};
  if (S_ISDIR(status.st_mode))
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
  if (target.empty()) return Error{ErrorKind::kOutput, "an output has an empty name", "", "name a file"};
  // a link stays, and what it leads to is written
  const auto file = end_of_links(target);
  std::error_code failed;
  const auto status = std::filesystem::status(file, failed);
  if (status.type() == std::filesystem::file_type::none) return output_error(target, failed.value());
  if (std::filesystem::is_directory(status)) return output_error(target, EISDIR);
  // renaming over a device would replace it
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))
    return Error{ErrorKind::kOutput, "cannot be written, it is not an ordinary file", target.string(),
                 "name a file"};
  const std::string ending = ending_of(file.filename().string());
  std::string pattern = (folder_of(file) / (".palpate-XXXXXX" + ending)).string();
  const int fd = ::mkostemps(pattern.data(), static_cast<int>(ending.size()), O_CLOEXEC);
  if (fd < 0) return output_error(target, errno);
  // the usual permissions of a new file instead of mkstemp's private ones
  const mode_t mask = ::umask(0);
  ::umask(mask);
  ::fchmod(fd, 0666 & ~mask);
  ::close(fd);
  return PendingFile(file, pattern);
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

bool same_file(const std::filesystem::path& a, const std::filesystem::path& b) {
  std::error_code failed;
  if (std::filesystem::equivalent(a, b, failed)) return true;
  // a file that is not there yet is known by the place where it would be
  const auto place = [&](const std::filesystem::path& file) {
    return std::filesystem::weakly_canonical(std::filesystem::absolute(end_of_links(file), failed), failed);
  };
  const auto place_a = place(a), place_b = place(b);
  return !place_a.empty() && place_a == place_b;
}

Result<void> check_output(const std::filesystem::path& file, std::span<const std::filesystem::path> never) {
  for (const auto& input : never)
    if (same_file(file, input))
      return Error{ErrorKind::kUsage, "would replace an input", file.string(), "write to another file"};
  if (auto pending = PendingFile::create(file); !pending) return pending.error();
  return {};
}

}  // namespace palpate
