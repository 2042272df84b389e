#pragma once

#include <signal.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <new>
#include <utility>

#include "palpate/base/check.h"

/// Child processes for tests of what happens when a process is stopped or dies half-way.
namespace palpate::testing {

/// Runs a function in a child process, which is killed at the latest with this object. Create it while the
/// test has no other threads.
class Child {
 public:
  template <class Work>
  explicit Child(Work&& work) {
    std::fflush(nullptr);
    id_ = ::fork();
    PALPATE_CHECK(id_ >= 0);
    if (id_ == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      work();
      // not _exit: under a sanitizer that would check for leaks first
      ::syscall(SYS_exit_group, 0);
    }
  }
  ~Child() { kill(); }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  pid_t id() const { return id_; }
  /// Stops the child (SIGSTOP) at an arbitrary point; returns once it has stopped.
  void stop() const {
    ::kill(id_, SIGSTOP);
    ::waitpid(id_, nullptr, WUNTRACED);
  }
  void resume() const { ::kill(id_, SIGCONT); }
  /// Stops it repeatedly until `condition` holds while it is stopped; false if that does not happen within 5
  /// s.
  template <class Condition>
  [[nodiscard]] bool stop_when(Condition&& condition) const {
    for (int n = 0; n < 5000; ++n) {
      ::usleep(1000);
      stop();
      if (condition()) return true;
      resume();
    }
    return false;
  }
  /// Kills the child at an arbitrary point; returns once it has ended.
  void kill() {
    if (id_ <= 0) return;
    ::kill(id_, SIGKILL);
    ::waitpid(std::exchange(id_, 0), nullptr, 0);
  }
  /// Waits for the child to end; true if its work completed.
  bool finished() {
    int status = 0;
    ::waitpid(std::exchange(id_, 0), &status, 0);
    return WIFEXITED(status) && WEXITSTATUS(status) == 0;
  }

 private:
  pid_t id_ = 0;
};

/// Object in memory shared with child processes.
template <class T>
class Shared {
 public:
  Shared() {
    void* room = ::mmap(nullptr, sizeof(T), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    PALPATE_CHECK(room != MAP_FAILED);
    object_ = new (room) T();
  }
  ~Shared() {
    object_->~T();
    ::munmap(object_, sizeof(T));
  }
  Shared(const Shared&) = delete;
  Shared& operator=(const Shared&) = delete;

  T& operator*() const { return *object_; }
  T* operator->() const { return object_; }

 private:
  T* object_;
};

}  // namespace palpate::testing
