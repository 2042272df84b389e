#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "palpate/base/child_process.h"
#include "palpate/base/progress.h"
#include "palpate/reader/fields.h"

/// Sandbox for code that parses bytes of unknown origin without being hardened against malicious ones. It
/// runs in a process of its own, which may crash, loop or exhaust its memory, but can do nothing else
/// (confine.h). The parent receives plain fields (fields.h), and blocks of bytes in shared memory, and
/// validates all of them.
///
/// The process is a fork of the program with the calling thread only. The caller of start() therefore
/// - holds, while the process is started, every lock that its work will need: a lock held by another thread
///   stays locked in the copy. Those of malloc and stdio are handled;
/// - keeps the calling thread alive while it reads: Linux ends the process with the thread that started it;
/// - pays for copying the page tables, 1 ms plus 50 ms for each GiB of the program's memory, and then, while
///   the process lives, a page fault for each page that the program modifies: none is started in a program
///   whose servo is running.
namespace palpate::reader {

/// Endpoint of the connection in the reader process.
class ParentEnd : public ByteTarget {
 public:
  ParentEnd(int pipe, int grants, std::span<std::byte> shared)
      : pipe_(pipe), grants_(grants), shared_(shared) {}
  /// Sends bytes to the parent; false if the parent accepts no more.
  bool write(std::span<const std::byte> bytes) override;
  /// Waits until the parent has called resume() once more than this function has returned. False if it never
  /// will.
  bool wait_for_grant();
  /// Memory shared with the parent, initially zero.
  std::span<std::byte> shared() const { return shared_; }

 private:
  int pipe_, grants_;
  std::span<std::byte> shared_;
};

/// Endpoint of the connection in the parent. The destructor kills and reaps the process.
class ReaderProcess : public ByteSource {
 public:
  /// Function run in the confined process; returns true if it completed, which is reported only by the exit
  /// status.
  using Work = std::function<bool(ParentEnd& parent)>;

  struct Job {
    /// Open files and folders to which the process has access: by descriptor, and by name; for a folder also
    /// its contents.
    std::span<const int> files;
    std::size_t shared_bytes = 0;  ///< Size of ParentEnd::shared(); bytes.
    std::string death_error;       ///< Error::what if the process ends before it has sent the requested
                                   ///< bytes.
    std::string timeout_error;     ///< Error::what if it sends nothing for `timeout`.
    std::chrono::milliseconds timeout{20'000};
  };

  /// Starts a process.
  /// @param progress  ends read() when it is cancelled; must outlive this object at the same address
  /// Errors: kUnavailable if no process can be created.
  static Result<std::unique_ptr<ReaderProcess>> start(const Job& job, const Work& work,
                                                      const Progress& progress);
  ~ReaderProcess() override;
  ReaderProcess(const ReaderProcess&) = delete;
  ReaderProcess& operator=(const ReaderProcess&) = delete;

  /// Reads the next bytes that the process has sent. Errors: kBadInput with Job::death_error or
  /// Job::timeout_error; interrupted.
  Result<void> read(std::span<std::byte> bytes) override;
  /// Allows the process to pass one wait_for_grant().
  void resume() const;
  /// Shared memory, which the process may modify at any time, even during validation: copy, then check, then
  /// use.
  std::span<const std::byte> shared() const { return shared_; }

 private:
  explicit ReaderProcess(const Progress& progress) : progress_(progress) {}
  Result<void> wait() const;

  const Progress& progress_;
  ChildProcess process_;
  int pipe_ = -1, grants_ = -1;
  std::span<std::byte> shared_;
  std::string death_error_, timeout_error_;
  std::chrono::milliseconds timeout_{};
};

}  // namespace palpate::reader
