#pragma once
#include <unistd.h>

static inline ssize_t getrandom(void* bytes, size_t count, unsigned flags) {
  return (void)flags, getentropy(bytes, count) == 0 ? (ssize_t)count : -1;
}
