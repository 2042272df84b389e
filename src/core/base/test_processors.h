#pragma once

#include <pthread.h>
#include <sched.h>

#include <cstddef>

#include "palpate/base/check.h"

namespace palpate::test {

/// While this object lives, the thread that created it and the threads that it starts are restricted to one
/// processor.
class OneProcessor {
 public:
  OneProcessor() {
    PALPATE_CHECK(::sched_getaffinity(0, sizeof before_, &before_) == 0);
    cpu_set_t one;
    CPU_ZERO(&one);
    CPU_SET(static_cast<unsigned>(::sched_getcpu()), &one);
    PALPATE_CHECK(::sched_setaffinity(0, sizeof one, &one) == 0);
  }
  ~OneProcessor() { ::sched_setaffinity(0, sizeof before_, &before_); }
  OneProcessor(const OneProcessor&) = delete;
  OneProcessor& operator=(const OneProcessor&) = delete;

 private:
  cpu_set_t before_;
};

/// While this object lives, this process can create no thread: each would need more stack than there is
/// memory.
class NoThreads {
 public:
  NoThreads() {
    PALPATE_CHECK(::pthread_getattr_default_np(&before_) == 0);
    pthread_attr_t huge;
    ::pthread_attr_init(&huge);
    ::pthread_attr_setstacksize(&huge, std::size_t{1} << 46);
    PALPATE_CHECK(::pthread_setattr_default_np(&huge) == 0);
    ::pthread_attr_destroy(&huge);
  }
  ~NoThreads() {
    ::pthread_setattr_default_np(&before_);
    ::pthread_attr_destroy(&before_);
  }
  NoThreads(const NoThreads&) = delete;
  NoThreads& operator=(const NoThreads&) = delete;

 private:
  pthread_attr_t before_;
};

}  // namespace palpate::test
