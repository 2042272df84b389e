#include "input_files.h"

#include "palpate/catalog/catalog.h"
#include "palpate/scene/scene.h"

namespace palpate::app {

void add_input(const std::filesystem::path& input, std::vector<std::filesystem::path>& files) {
  files.push_back(input);
  std::error_code failed;
  // a folder of DICOM
  using std::filesystem::recursive_directory_iterator;
  recursive_directory_iterator entry(input, std::filesystem::directory_options::skip_permission_denied,
                                     failed);
  constexpr std::size_t kMaxFiles = 200'000;
  for (; !failed && entry != recursive_directory_iterator() && files.size() < kMaxFiles;
       entry.increment(failed)) {
    std::error_code ignored;
    if (entry->is_regular_file(ignored)) files.push_back(entry->path());
  }
}

std::vector<std::filesystem::path> input_files(const SceneSource& source) {
  const std::string& what = source.target;
  std::vector<std::filesystem::path> files;
  const auto add = [&](const std::optional<std::filesystem::path>& file) {
    if (file) add_input(*file, files);
  };
  add(source.segmentation);
  add(source.names);
  if (find_entry(what)) {
    if (const auto data = locate(what)) {
      add(data->labels);
      add(data->scan);
      add(data->names);
    }
    return files;
  }
  if (what.empty()) return files;
  add_input(what, files);
  // errors of a scene are reported when it is loaded
  if (const auto scene = load_scene(what))
    for (const auto& file : {scene->scan, scene->labels, scene->names})
      if (file) add(scene->resolve(*file));
  return files;
}

std::vector<std::filesystem::path> recorded_inputs(SceneSource source, const RecordingHeader& header) {
  if (source.target.empty()) source.target = header.data_set;
  return input_files(source);
}

}  // namespace palpate::app
