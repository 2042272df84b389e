#pragma once

#include <sys/types.h>

#include <string>
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
/// Asks it, and its group, to end; after 10 s ends it.
void end_group(pid_t id);

/// What a short command says.
struct Said {
  int exit_code = 0;
  std::string out, err;
};
/// @param in  what it reads
Result<Said> ask(const std::vector<std::string>& command, const std::string& in = "");

}  // namespace palpate::cohort
