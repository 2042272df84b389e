#pragma once

#include <sys/types.h>

#include <string>
#include <utility>
#include <vector>

#include "palpate/base/result.h"

namespace palpate::cohort {

/// Starts a program, found by PATH, in its own process group, so that signals from the user's terminal do not
/// reach it. It is killed (SIGKILL) when the process of the calling thread ends.
/// @param in, out, err  descriptors that it inherits; -1: /dev/null
/// Errors: kUnavailable.
Result<pid_t> start(const std::vector<std::string>& command, int in, int out, int err);

/// Exit status of a process, as by waitpid.
struct ExitStatus {
  int exit_code = 0;  ///< -1 if terminated by a signal
  int signal = 0;
};
/// Whether the process has ended; sets `how` if so.
bool has_ended(pid_t id, ExitStatus& how);
/// Sends SIGTERM to all processes and waits; after 10 s kills them and their groups.
void end_groups(std::vector<pid_t> ids);

/// An anonymous file in memory for the input or output of a process.
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
  /// The last `max_bytes` bytes.
  std::string tail(std::size_t max_bytes) const;

 private:
  int file_;
};
inline constexpr std::size_t kRetainedOutput = 4096;  ///< Retained output of a case's process, bytes

/// Output of a short command.
struct CommandOutput {
  int exit_code = 0;
  std::string out, err;
};
/// Runs a command and waits.
/// @param in  its standard input
Result<CommandOutput> run_command(const std::vector<std::string>& command, const std::string& in = "");

}  // namespace palpate::cohort
