#include "cohort/process.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "palpate/cohort/engines.h"

namespace palpate::cohort {

MemoryFile::MemoryFile() : file_(::memfd_create("palpate", MFD_CLOEXEC)) {}
MemoryFile::~MemoryFile() {
  if (file_ >= 0) ::close(file_);
}

void MemoryFile::write(const std::string& text) {
  for (std::size_t done = 0; done < text.size();) {
    const ssize_t some = ::write(file_, text.data() + done, text.size() - done);
    if (some <= 0) return;
    done += static_cast<std::size_t>(some);
  }
  ::lseek(file_, 0, SEEK_SET);
}

std::string MemoryFile::tail(std::size_t max_bytes) const {
  const off_t size = ::lseek(file_, 0, SEEK_END);
  if (size <= 0) return "";
  const auto count = std::min(max_bytes, static_cast<std::size_t>(size));
  std::string text(count, '\0');
  const ssize_t received = ::pread(file_, text.data(), count, size - static_cast<off_t>(count));
  text.resize(received > 0 ? static_cast<std::size_t>(received) : 0);
  return text;
}

Result<pid_t> start(const std::vector<std::string>& command, int in, int out, int err) {
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const pid_t parent = ::getpid();
  const pid_t id = ::fork();
  if (id < 0)
    return Error{ErrorKind::kUnavailable, "cannot start a process", command.front(),
                 "close other programs, or raise the process limit (ulimit -u)"};
  if (id > 0) return id;
  // only async-signal-safe calls after a fork of a multithreaded process
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != parent) ::_exit(127);
  ::setpgid(0, 0);
  const int nothing = ::open("/dev/null", O_RDWR);
  int to = 0;
  for (const int from : {in, out, err}) ::dup2(from >= 0 ? from : nothing, to++);
  // exec resets handlers, but ignored signals would stay ignored
  for (const int signal : {SIGPIPE, SIGXFSZ, SIGINT, SIGTERM, SIGHUP}) ::signal(signal, SIG_DFL);
  ::execvp(arguments.front(), arguments.data());
  ::_exit(127);
}

bool has_ended(pid_t id, ExitStatus& how) {
  int status = 0;
  const pid_t received = ::waitpid(id, &status, WNOHANG);
  if (received == 0 || (received < 0 && errno == EINTR)) return false;
  how = {};
  if (received < 0 || WIFSIGNALED(status)) {
    how.exit_code = -1;
    how.signal = received < 0 ? 0 : WTERMSIG(status);
  } else {
    how.exit_code = WEXITSTATUS(status);
  }
  return true;
}

void end_groups(std::vector<pid_t> ids) {
  ExitStatus how;
  const auto sweep = [&] { std::erase_if(ids, [&](pid_t id) { return has_ended(id, how); }); };
  // signal all of them before waiting for any
  for (const pid_t id : ids) ::kill(id, SIGTERM);
  for (int tries = 0; tries < 500 && !ids.empty(); ++tries) {
    sweep();
    if (!ids.empty()) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  for (const pid_t id : ids) ::kill(-id, SIGKILL);
  while (!ids.empty()) {
    sweep();
    if (!ids.empty()) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

Result<CommandOutput> run_command(const std::vector<std::string>& command, const std::string& in) {
  MemoryFile input, out, err;
  input.write(in);
  const auto id = start(command, input.descriptor(), out.descriptor(), err.descriptor());
  if (!id) return id.error();
  ExitStatus how;
  while (!has_ended(*id, how)) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  constexpr std::size_t kMaxOutput_bytes = 1 << 20;
  return CommandOutput{how.exit_code, out.tail(kMaxOutput_bytes), err.tail(kMaxOutput_bytes)};
}

}  // namespace palpate::cohort

namespace palpate {

Result<EndedProcess> run_process(const std::vector<std::string>& command, const Progress& progress) {
  using namespace cohort;
  MemoryFile error_output;
  const auto id = start(command, -1, -1, error_output.descriptor());
  if (!id) return id.error();
  ExitStatus how;
  while (!has_ended(*id, how)) {
    if (progress.stopped()) {
      end_groups({*id});
      return Progress::interrupted();
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return EndedProcess{how.exit_code, how.signal, error_output.tail(kRetainedOutput)};
}

}  // namespace palpate
