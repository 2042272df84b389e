#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "palpate/base/file.h"

namespace palpate {
namespace {

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

}  // namespace palpate
