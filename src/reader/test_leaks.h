#pragma once

#include <dirent.h>
#include <sys/wait.h>

#include <cerrno>
#include <cstddef>

#include "palpate/base/check.h"

/// What a process that was started may leave behind.
namespace palpate::test {

/// Descriptors that this process has open.
inline std::size_t open_descriptors() {
  DIR* folder = ::opendir("/proc/self/fd");
  PALPATE_CHECK(folder != nullptr);
  std::size_t count = 0;
  while (::readdir(folder) != nullptr) ++count;
  ::closedir(folder);
  return count;
}

/// Whether this process has no child, not even one that has ended.
inline bool has_no_child() {
  return ::waitpid(-1, nullptr, WNOHANG | __WALL) < 0 && errno == ECHILD;
}

}  // namespace palpate::test
