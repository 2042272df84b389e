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

/// Whatever parses bytes of unknown origin with code that is not made for hostile ones runs in a process of
/// its own, which may crash, loop or swallow memory, and can do nothing else (confine.h). The parent takes
/// plain fields from it (fields.h), and pieces of bytes in memory that both have, and believes none of them
/// unchecked.
///
/// The process is a copy of the program as it stands, with the calling thread alone. So who starts one
/// - holds, while it is started, whatever lock its work will want: another thread's lock stays locked in the
///   copy. malloc's and stdio's are seen to;
/// - keeps that thread alive while it reads: Linux ends the process with the thread that started it;
/// - pays for the copy of the page tables, 1 ms and 50 ms more for each GiB that the program has taken, and
///   then, as long as the process lives, a fault for each page that the program changes: none is started in a
///   program whose servo ticks.
namespace palpate::reader {

/// The end that the work in the process has.
class ParentEnd : public ByteTarget {
 public:
  ParentEnd(int pipe, int words, std::span<std::byte> shared) : pipe_(pipe), words_(words), shared_(shared) {}
  /// False: the parent takes no more.
  bool write(std::span<const std::byte> bytes) override;
  /// Waits until the parent has said go_on() once more than this was called before. False: it never will.
  bool wait_for_word();
  /// What the parent reads too, from the first byte on zeros.
  std::span<std::byte> shared() const { return shared_; }

 private:
  int pipe_, words_;
  std::span<std::byte> shared_;
};

/// The parent's end. When it goes, the process is ended and nothing of it is left.
class ReaderProcess : public ByteSource {
 public:
  /// Runs in the process, confined; whether it came to its end, which only the process's exit status tells.
  using Work = std::function<bool(ParentEnd& parent)>;

  struct Job {
    /// Open files: the process has them, and can open them by their names; of a folder what stands in it and
    /// below.
    std::span<const int> files;
    std::size_t shared_bytes = 0;  ///< of ParentEnd::shared()
    std::string died;              ///< Error::what where the process ends before it has sent what is read
    std::string endless;           ///< Error::what where it sends nothing for as long as `patience`
    std::chrono::milliseconds patience{20'000};
  };

  /// @param progress  ends read() when it is stopped; stays where it is as long as this object lives
  /// Errors: kUnavailable, there is no process to be had.
  static Result<std::unique_ptr<ReaderProcess>> start(const Job& job, const Work& work,
                                                      const Progress& progress);
  ~ReaderProcess() override;
  ReaderProcess(const ReaderProcess&) = delete;
  ReaderProcess& operator=(const ReaderProcess&) = delete;

  /// The next bytes that the process wrote. Errors: Job::died and Job::endless, kBadInput; interrupted.
  Result<void> read(std::span<std::byte> bytes) override;
  /// Lets the process pass one wait_for_word().
  void go_on() const;
  /// What the process may change at any moment, also while it is looked at: copy, then check, then use.
  std::span<const std::byte> shared() const { return shared_; }

 private:
  explicit ReaderProcess(const Progress& progress) : progress_(progress) {}
  Result<void> wait() const;

  const Progress& progress_;
  ChildProcess process_;
  int pipe_ = -1, words_ = -1;
  std::span<std::byte> shared_;
  std::string died_, endless_;
  std::chrono::milliseconds patience_{};
};

}  // namespace palpate::reader
