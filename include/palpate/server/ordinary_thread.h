#pragma once

#include <pthread.h>
#include <sched.h>

namespace palpate::server {

/// Names the calling thread and gives it ordinary priority, whatever it inherited: viewers never compete with
/// the servo.
inline void use_ordinary_priority(const char* name) {
  ::pthread_setname_np(::pthread_self(), name);
  const sched_param none{};
  ::pthread_setschedparam(::pthread_self(), SCHED_OTHER, &none);
}

}  // namespace palpate::server
