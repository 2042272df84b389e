#pragma once

#include <pthread.h>
#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>

namespace palpate::link {

/// Gives the calling thread its name and ordinary priority, whatever the thread that started it has: viewers
/// never compete with the servo.
inline void be_ordinary_thread(const char* name) {
  ::pthread_setname_np(::pthread_self(), name);
  const sched_param none{};
  ::pthread_setschedparam(::pthread_self(), SCHED_OTHER, &none);
}

/// The same, behind every other thread of ordinary priority: nobody waits for it who pushes.
inline void be_last_thread(const char* name) {
  constexpr int kLowestPriority = 19;
  be_ordinary_thread(name);
  ::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), kLowestPriority);
}

}  // namespace palpate::link
