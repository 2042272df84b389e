#include "inputs.h"

#include "palpate/catalog/catalog.h"
#include "palpate/scene/scene.h"

namespace palpate::app {

std::vector<std::filesystem::path> input_files(const std::string& what) {
  std::vector<std::filesystem::path> files;
  const auto add = [&](const std::optional<std::filesystem::path>& file) {
    if (file) files.push_back(*file);
  };
  if (find_entry(what)) {
    if (const auto data = locate(what)) {
      add(data->labels);
      add(data->scan);
      add(data->names);
    }
    return files;
  }
  if (what.empty()) return files;
  files.push_back(what);
  // what is wrong with a scene is told where it is used
  if (const auto scene = load_scene(what))
    for (const auto& file : {scene->scan, scene->labels, scene->names})
      if (file) add(scene->resolve(*file));
  return files;
}

}  // namespace palpate::app
