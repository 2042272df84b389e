#pragma once

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <sstream>
#include <string>

/// Real knees for the tests of this folder.
namespace palpate::testing {

/// A file below a folder of PALPATE_DATA, a colon-separated list.
inline std::optional<std::filesystem::path> shared_file(const std::string& name) {
  const char* folders = std::getenv("PALPATE_DATA");
  std::istringstream list(folders != nullptr ? folders : "");
  for (std::string folder; std::getline(list, folder, ':');) {
    if (std::filesystem::exists(std::filesystem::path(folder) / name))
      return std::filesystem::path(folder) / name;
  }
  return std::nullopt;
}

inline bool in_ci() {
  const char* ci = std::getenv("CI");
  return ci != nullptr && std::string(ci) == "true";
}

}  // namespace palpate::testing
