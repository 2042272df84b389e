#pragma once

#include <sys/types.h>

#include <string>
#include <utility>
#include <vector>

#include "palpate/base/result.h"

namespace palpate::cohort {

/// Starts a program, found as a shell finds it, that ends (SIGKILL) where the calling thread's process ends,
/// in a process group of its own: what a terminal sends to the user's own does not reach it.
/// @param in, out, err  descriptors that it gets; -1: nothing, /dev/null
/// Errors: kUnavailable.
Result<pid_t> start(const std::vector<std::string>& command, int in, int out, int err);

/// How a process has ended, as waitpid says it; nothing while it runs.
struct Ended {
  int exit_code = 0;  ///< -1 where a signal ended it
  int signal = 0;
};
bool has_ended(pid_t id, Ended& how);
/// Asks all of them to end, and waits; after 10 s ends them and their groups.
void end_groups(std::vector<pid_t> ids);

/// A file in memory, for what a process says or reads.
class MemoryFile {
 public:
  MemoryFile();
  ~MemoryFile();
  MemoryFile(MemoryFile&& other) noexcept : file_(std::exchange(other.file_, -1)) {}
  MemoryFile& operator=(MemoryFile&& other) noexcept {
    std::swap(file_, other.file_);
    return *this;
  }
  int descriptor() const { return file_; }
  void write(const std::string& text);
  /// The last bytes.
  std::string tail(std::size_t most) const;

 private:
  int file_;
};
inline constexpr std::size_t kKeptSaid = 4096;  ///< bytes of what a case's process says

/// What a short command says.
struct Said {
  int exit_code = 0;
  std::string out, err;
};
/// @param in  what it reads
Result<Said> ask(const std::vector<std::string>& command, const std::string& in = "");

}  // namespace palpate::cohort
