// Names and priorities of threads where there is one, which keeps its own.
#pragma once
#include <sched.h>

typedef int pthread_t;

static inline pthread_t pthread_self(void) {
  return 1;
}
static inline int pthread_setname_np(pthread_t thread, const char* name) {
  return (void)thread, (void)name, 0;
}
static inline int pthread_setschedparam(pthread_t thread, int policy, const struct sched_param* param) {
  return (void)thread, (void)policy, (void)param, 0;
}
