#include "catalog/download.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <thread>

#include "catalog/digest.h"
#include "catalog/transfer.h"
#include "palpate/base/file.h"

namespace palpate {
namespace {

// the file NAME.part: open, locked against other processes, written at its end
class PartFile {
 public:
  explicit PartFile(std::filesystem::path path) : path_(std::move(path)) {}
  PartFile(const PartFile&) = delete;
  PartFile& operator=(const PartFile&) = delete;
  ~PartFile() {
    // nothing was received: remove the file
    if (mine_ && size() == 0) ::unlink(path_.c_str());
    if (fd_ >= 0) ::close(fd_);
  }

  Result<void> open() {
    fd_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY, 0666);
    if (fd_ < 0) return output_error(path_, errno);
    struct stat status {};
    if (::fstat(fd_, &status) != 0) return output_error(path_, errno);
    if (!S_ISREG(status.st_mode))
      return Error{ErrorKind::kOutput, "cannot be written, it is not an ordinary file", path_.string(),
                   "remove it"};
    if (::flock(fd_, LOCK_EX | LOCK_NB) != 0)
      return Error{ErrorKind::kUnavailable, "is being fetched by another program", path_.string(),
                   "wait until it is done"};
    mine_ = true;
    return {};
  }

  std::uint64_t size() const {
    struct stat status {};
    return ::fstat(fd_, &status) == 0 ? static_cast<std::uint64_t>(status.st_size) : 0;
  }

  bool append(std::string_view bytes) {
    while (!bytes.empty()) {
      const ssize_t wrote = ::write(fd_, bytes.data(), bytes.size());
      if (wrote < 0 && errno == EINTR) continue;
      if (wrote < 0) return fail();
      bytes.remove_prefix(static_cast<std::size_t>(wrote));
    }
    return true;
  }

  /// Truncates the file to `size` and continues there.
  bool cut(std::uint64_t size) {
    const auto end = static_cast<off_t>(size);
    return (::ftruncate(fd_, end) == 0 && ::lseek(fd_, end, SEEK_SET) == end) || fail();
  }

  Result<void> finish(const std::filesystem::path& target) {
    if (::fsync(fd_) != 0 || ::rename(path_.c_str(), target.c_str()) != 0) return output_error(target, errno);
    mine_ = false;
    return {};
  }

  const std::filesystem::path& path() const { return path_; }
  /// errno of a failed write, or 0.
  int failure() const { return failure_; }

 private:
  bool fail() {
    failure_ = errno;
    return false;
  }

  std::filesystem::path path_;
  int fd_ = -1;
  bool mine_ = false;  ///< Locked, and not renamed yet.
  int failure_ = 0;
};

enum class Next : std::uint8_t { kCheck, kRetry };

// one call of download(): its attempts and their state
class Fetching {
 public:
  Fetching(const Download& download, const Progress& progress)
      : download_(download), progress_(progress), part_(download.target.string() + ".part") {}

  Result<void> run() {
    if (const auto opened = part_.open(); !opened) return opened;
    for (int attempt = 1;; ++attempt) {
      const auto next = try_once();
      if (!next) return next.error();
      if (*next == Next::kCheck) {
        const auto checked =
            check_content(part_.path(), download_.bytes, download_.sha256, download_.git_blob);
        if (checked) return part_.finish(download_.target);
        part_.cut(0);
        if (!resumed_)
          return unavailable(checked.error().what, "what arrived was deleted; try again, or another mirror");
        failure_ = "the rest of the file did not match its beginning";
      }
      if (attempt >= download_.attempts)
        return unavailable(failure_, part_.size() > 0 ? "try again later: the part received so far is kept"
                                                      : "try again later");
      if (!pause(attempt)) return Progress::interrupted();
    }
  }

 private:
  /// Writes a piece of the body at its position; returning false cancels the transfer.
  bool take(const TransferReply& reply, std::string_view bytes) {
    if (first_piece_) {
      first_piece_ = false;
      // a server that ignores the range sends the whole file: start from the beginning
      const std::uint64_t start = reply.status == 206 ? reply.range_start.value_or(offset_) : 0;
      misplaced_ = start > offset_;
      if (misplaced_ || !part_.cut(start)) return false;
      resumed_ = start > 0;
      offset_ = start;
    }
    offset_ += bytes.size();
    const std::uint64_t limit = download_.bytes.value_or(download_.max_bytes);
    too_large_ = offset_ > limit || reply.whole_size.value_or(0) > limit;
    if (too_large_ || !part_.append(bytes)) return false;
    const auto whole = download_.bytes ? download_.bytes : reply.whole_size;
    if (whole && *whole > 0)
      progress_.report(stage(), std::min(1.0, static_cast<double>(offset_) / static_cast<double>(*whole)));
    return true;
  }

  Result<Next> try_once() {
    offset_ = part_.size();
    if (download_.bytes && offset_ > *download_.bytes) offset_ = 0;
    if (download_.bytes && offset_ == *download_.bytes) {
      // complete already: the previous call was interrupted before verification
      resumed_ = true;
      return Next::kCheck;
    }
    first_piece_ = true;
    misplaced_ = false;
    resumed_ = offset_ > 0;
    const TransferRequest request{download_.url, download_.allow_http, offset_, download_.stall_timeout_s};
    const auto result = transfer(
        request, [this](const TransferReply& reply, std::string_view bytes) { return take(reply, bytes); },
        [this] { return !progress_.stopped(); });

    switch (result.outcome) {
      case TransferOutcome::kStopped:
        return after_stop();
      case TransferOutcome::kUnreachable:
        return unavailable("cannot be reached (" + result.reason + ")", "is this machine online?");
      case TransferOutcome::kRefused:
        return unavailable("is not fetched (" + result.reason + ")",
                           "use the original address or another mirror");
      case TransferOutcome::kBroken:
      case TransferOutcome::kStalled:
        failure_ = "the transfer was interrupted (" + result.reason + ")";
        return Next::kRetry;
      case TransferOutcome::kDone:
        break;
    }
    return after_answer(result.reply);
  }

  Result<Next> after_stop() {
    if (part_.failure() != 0) return output_error(download_.target, part_.failure());
    if (too_large_) {
      part_.cut(0);
      return unavailable("is larger than expected", "it is not the requested file; try another mirror");
    }
    if (misplaced_) {
      part_.cut(0);
      failure_ = "the server sent a part of the file that was not requested";
      return Next::kRetry;
    }
    return Progress::interrupted();
  }

  Result<Next> after_answer(const TransferReply& reply) {
    switch (reply.status) {
      case 200:
      case 206:
        // an empty body does not call take()
        if (first_piece_ && reply.status == 200) part_.cut(0);
        if (download_.bytes && part_.size() < *download_.bytes) {
          failure_ = "the server sent only " + std::to_string(part_.size()) + " of " +
                     std::to_string(*download_.bytes) + " bytes";
          return Next::kRetry;
        }
        return Next::kCheck;
      case 416:
        // nothing beyond the local part: either the file is complete, or it has changed on the server
        failure_ = "the server does not have the rest of the file";
        if (reply.whole_size == part_.size() && part_.size() > 0) return Next::kCheck;
        part_.cut(0);
        return Next::kRetry;
      case 408:
      case 429:
      case 500:
      case 502:
      case 503:
      case 504:
        failure_ = "the server answers " + std::to_string(reply.status);
        return Next::kRetry;
      default:
        return unavailable("the server answers " + std::to_string(reply.status) +
                               (reply.status == 404 ? ", no such file" : ""),
                           "check the address, or use another mirror");
    }
  }

  /// Waits longer after every attempt; false if the user cancelled.
  bool pause(int attempt) const {
    using Seconds = std::chrono::duration<double>;
    const auto end =
        std::chrono::steady_clock::now() + Seconds(download_.first_pause_s * (1 << std::min(attempt - 1, 5)));
    while (std::chrono::steady_clock::now() < end) {
      if (progress_.stopped()) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    return !progress_.stopped();
  }

  Error unavailable(const std::string& what, const std::string& remedy) const {
    return {ErrorKind::kUnavailable, what, download_.url, remedy};
  }
  std::string stage() const { return "fetching " + download_.target.filename().string(); }

  const Download& download_;
  const Progress& progress_;
  PartFile part_;
  std::uint64_t offset_ = 0;  ///< Bytes on disk.
  bool first_piece_ = true;   ///< The next piece is the first one of this attempt.
  bool resumed_ = false;      ///< The file on disk was received in more than one piece.
  bool too_large_ = false;
  bool misplaced_ = false;
  std::string failure_;  ///< Reason for the failure of the last attempt.
};

}  // namespace

Result<void> check_content(const std::filesystem::path& file, const std::optional<std::uint64_t>& bytes,
                           const std::string& sha256, const std::string& git_blob) {
  const auto compare = [&](const char* name, const std::string& expected,
                           const Result<std::string>& found) -> Result<void> {
    if (!found) return found.error();
    if (*found == expected) return {};
    return Error{
        ErrorKind::kBadInput,
        std::string("is not the expected file: its ") + name + " is " + *found + " instead of " + expected,
        file.string(), "remove it and fetch it again"};
  };
  if (!sha256.empty())
    if (const auto checked = compare("SHA-256", sha256, sha256_of_file(file)); !checked) return checked;
  if (!git_blob.empty())
    if (const auto checked = compare("git blob", git_blob, git_blob_of_file(file)); !checked) return checked;
  std::error_code failed;
  const auto size = std::filesystem::file_size(file, failed);
  if (failed) return Error{ErrorKind::kBadInput, "cannot be read", file.string(), "check its permissions"};
  if (bytes && size != *bytes)
    return Error{ErrorKind::kBadInput,
                 "has " + std::to_string(size) + " bytes instead of " + std::to_string(*bytes), file.string(),
                 "remove it and fetch it again"};
  return {};
}

Result<void> download(const Download& download, const Progress& progress) {
  PALPATE_CHECK(!download.sha256.empty() || !download.git_blob.empty());
  return Fetching(download, progress).run();
}

}  // namespace palpate
