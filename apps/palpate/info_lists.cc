#include <cstdio>
#include <iostream>

#include "apps/command/text.h"
#include "info.h"
#include "palpate/base/reading.h"
#include "palpate/loading/loading.h"
#include "palpate/tissue/soft_tissue_solver.h"
#include "scene_options.h"

namespace palpate::app {
namespace {

Json memory_json(const SceneMemory& memory) {
  return {{"peak", memory.peak()},       {"stays", memory.permanent()},       {"labels", memory.model.labels},
          {"field", memory.model.field}, {"surfaces", memory.model.surfaces}, {"scan", memory.scan}};
}

void print_memory(std::ostream& out, const SceneMemory& memory) {
  out << "memory      up to " << memory_size_text(memory.peak()) << " to feel the scene, of which "
      << memory_size_text(memory.permanent()) << " stays: labels " << memory_size_text(memory.model.labels)
      << ", field " << memory_size_text(memory.model.field) << ", surfaces "
      << memory_size_text(memory.model.surfaces) << ", scan " << memory_size_text(memory.scan) << '\n';
}

}  // namespace

int run_info_of_scene(const InfoOptions& options, Console& console) {
  const auto memory = memory_of_scene_or_data_set({options.file}, console.progress());
  if (!memory) return console.fail(memory.error());
  const double cell_mm = memory->tissue_cell_mm, resolved_mm = kResolvedNoduleCells * cell_mm;
  if (options.json) {
    Json json{{"memory_bytes", memory_json(*memory)}};
    if (cell_mm > 0) json["soft_tissue"] = {{"cell_mm", cell_mm}, {"resolved_nodule_mm", resolved_mm}};
    std::cout << json.dump(2) << '\n';
    return kExitOk;
  }
  print_memory(std::cout, *memory);
  const auto number = [](double value) {
    char text[40];
    std::snprintf(text, sizeof text, "%.3g", value);
    return std::string(text);
  };
  if (cell_mm > 0)
    std::cout << "soft tissue solved on cells of " << number(cell_mm) << " mm: nodules of "
              << number(resolved_mm) << " mm and more have their full contrast\n";
  return kExitOk;
}

Json volumes_json(const VolumeList& list) {
  Json volumes = Json::array();
  for (std::size_t n = 0; n < list.volumes.size(); ++n)
    volumes.push_back({{"number", n + 1},
                       {"what", list.volumes[n].what},
                       {"usable", list.volumes[n].fault.empty()},
                       {"fault", list.volumes[n].fault}});
  return {{"volumes", std::move(volumes)}, {"notes", list.notes}};
}

void print_volumes(std::ostream& out, const VolumeList& list) {
  out << list.volumes.size() << (list.volumes.size() == 1 ? " volume\n" : " volumes\n");
  for (std::size_t n = 0; n < list.volumes.size(); ++n) {
    print_wrapped(out, list.volumes[n].what, "  " + std::to_string(n + 1) + "  ", "     ");
    if (!list.volumes[n].fault.empty())
      print_wrapped(out, "cannot be used: " + list.volumes[n].fault, "     ", "     ");
  }
  for (const std::string& note : list.notes) print_wrapped(out, note, "  - ", "    ");
}

}  // namespace palpate::app
