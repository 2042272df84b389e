#include "loading/read_scene.h"
#include "palpate/phantoms/phantoms.h"

namespace palpate {

Result<LoadedScene> load_scene_or_data_set(const SceneSource& source, const Progress& progress,
                                           const Warn& warn, std::optional<PreparationMethod> preparation,
                                           const MemoryCallback& report_memory) {
  if (!is_phantom_name(source.target))
    return Error{ErrorKind::kUsage, "is not the name of a phantom", source.target,
                 "palpate in a browser generates phantoms: knee-phantom, palpation-block, palpation-dome"};
  auto read = read_phantom(source.target, progress, preparation);
  if (!read) return read.error();
  return with_model(*std::move(read), progress, warn, report_memory);
}

}  // namespace palpate
