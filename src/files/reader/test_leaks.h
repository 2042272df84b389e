#pragma once

#include <dirent.h>
#include <sys/wait.h>

#include <cerrno>
#include <cstddef>

#include "palpate/base/check.h"

/// Resources that a child process may leave behind.
namespace palpate::test {

/// Number of descriptors open in this process.
inline std::size_t open_descriptors() {
  DIR* folder = ::opendir("/proc/self/fd");
  PALPATE_CHECK(folder != nullptr);
  std::size_t count = 0;
  while (::readdir(folder) != nullptr) ++count;
  ::closedir(folder);
  return count;
}

/// True if this process has no child, not even a zombie.
inline bool has_no_child() {
  return ::waitpid(-1, nullptr, WNOHANG | __WALL) < 0 && errno == ECHILD;
}

}  // namespace palpate::test
