#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>

#include "base/test_folder.h"

namespace palpate::test {

/// Path of a shared data file, searched for in the folders of PALPATE_DATA.
inline std::optional<std::filesystem::path> shared_file(const std::string& name) {
  const char* folders = std::getenv("PALPATE_DATA");
  std::string remaining = folders != nullptr ? folders : "";
  while (!remaining.empty()) {
    const auto end = remaining.find(':');
    const std::filesystem::path candidate = std::filesystem::path(remaining.substr(0, end)) / name;
    if (std::filesystem::exists(candidate)) return candidate;
    remaining = end == std::string::npos ? "" : remaining.substr(end + 1);
  }
  return std::nullopt;
}

inline bool in_ci() {
  const char* ci = std::getenv("CI");
  return ci != nullptr && std::string(ci) == "true";
}

}  // namespace palpate::test

/// Declares `variable` as the path of a shared file. If the file is missing the test is skipped, and fails in
/// CI.
#define PALPATE_SHARED_FILE(variable, name)                                                        \
  const auto variable##_found = ::palpate::test::shared_file(name);                                \
  if (!variable##_found && ::palpate::test::in_ci()) FAIL() << "PALPATE_DATA holds no " << (name); \
  if (!variable##_found) GTEST_SKIP() << "needs " << (name) << " in a folder of PALPATE_DATA";     \
  const std::filesystem::path variable = *variable##_found
