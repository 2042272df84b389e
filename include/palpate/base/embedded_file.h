#pragma once

#include <string_view>
#include <vector>

namespace palpate {

/// File of the source tree that is embedded in the binary (cmake/embed.cmake).
struct EmbeddedFile {
  std::string_view name;  ///< File name without its folder.
  std::string_view text;
  std::string_view sha256;  ///< SHA-256 of `text`, lower-case hexadecimal.
};

/// Finds a file by its exact name; nullptr if there is none.
inline const EmbeddedFile* find_file(const std::vector<EmbeddedFile>& files, std::string_view name) {
  for (const EmbeddedFile& file : files)
    if (file.name == name) return &file;
  return nullptr;
}

}  // namespace palpate
