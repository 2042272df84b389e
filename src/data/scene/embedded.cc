#include "scene/embedded.h"

#include "palpate/scene/scene.h"
#include "palpate/scene/script.h"

namespace palpate {
namespace {

// both knees of the catalogue have the same scene and script
std::optional<std::string_view> find_text(const std::vector<EmbeddedFile>& files, std::string_view name) {
  const bool knee = name == "knee-phantom" || name == "knee-atlas";
  const EmbeddedFile* file = find_file(files, std::string(knee ? "knee" : name) + ".toml");
  return file ? std::optional(file->text) : std::nullopt;
}

}  // namespace

std::optional<std::string_view> embedded_scene(std::string_view name) {
  return find_text(embedded_scenes(), name);
}

std::optional<std::string_view> embedded_script(std::string_view name) {
  return find_text(embedded_scripts(), name);
}

}  // namespace palpate
