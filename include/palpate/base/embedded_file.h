#pragma once

#include <string_view>
#include <vector>

namespace palpate {

/// A file of the source tree that is compiled in (cmake/embed.cmake).
struct EmbeddedFile {
  std::string_view name;  ///< without its folder
  std::string_view text;
  std::string_view sha256;  ///< lower-case hexadecimal
};

/// The file of that name, or nullptr.
inline const EmbeddedFile* find_file(const std::vector<EmbeddedFile>& files, std::string_view name) {
  for (const EmbeddedFile& file : files)
    if (file.name == name) return &file;
  return nullptr;
}

}  // namespace palpate
