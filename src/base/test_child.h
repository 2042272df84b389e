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

/// Child processes for tests of what happens when somebody stops or dies half-way.
namespace palpate::testing {

/// Runs a function in a child process, which is killed at the latest with this object. Make it while the test
/// has no other threads.
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
      // not _exit: under a sanitizer that looks for leaks first
      ::syscall(SYS_exit_group, 0);
    }
  }
  ~Child() { kill(); }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  pid_t id() const { return id_; }
  /// Returns when the child stands still, in whatever it was doing.
  void stop() const {
    ::kill(id_, SIGSTOP);
    ::waitpid(id_, nullptr, WUNTRACED);
  }
  void go_on() const { ::kill(id_, SIGCONT); }
  /// Stops it again and again until `condition` holds while it stands still; false: never in 5 s.
  template <class Condition>
  [[nodiscard]] bool stop_when(Condition&& condition) const {
    for (int n = 0; n < 5000; ++n) {
      ::usleep(1000);
      stop();
      if (condition()) return true;
      go_on();
    }
    return false;
  }
  /// Returns when the child is gone, in whatever it was doing.
  void kill() {
    if (id_ <= 0) return;
    ::kill(id_, SIGKILL);
    ::waitpid(std::exchange(id_, 0), nullptr, 0);
  }
  /// Waits for its end; whether the work came to its own.
  bool finished() {
    int status = 0;
    ::waitpid(std::exchange(id_, 0), &status, 0);
    return WIFEXITED(status) && WEXITSTATUS(status) == 0;
  }

 private:
  pid_t id_ = 0;
};

/// One object in memory that children share with this process.
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
