// Scheduling of Linux where there is one thread on one processor.
#pragma once
#include_next <sched.h>

typedef unsigned long cpu_set_t;
#define CPU_ZERO(set) ((void)(*(set) = 0))
#define CPU_COUNT(set) __builtin_popcountl(*(set))

static inline int sched_getcpu(void) {
  return 0;
}
static inline int sched_getaffinity(int thread, unsigned long bytes, cpu_set_t* set) {
  (void)thread, (void)bytes;
  *set = 1;
  return 0;
}
