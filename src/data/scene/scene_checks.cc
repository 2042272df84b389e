#include "scene/scene_checks.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <optional>
#include <utility>
#include <vector>

#include "palpate/base/reading.h"
#include "palpate/contact/tissue_values.h"

namespace palpate {
namespace {

SupportValues support_values(const TissueSettings& tissue) {
  return {tissue.name, tissue.stiffness_N_per_mm, tissue.touchable};
}

/// The index of a tissue by name, or -1.
int index_of(const std::vector<TissueSettings>& tissues, const std::string& name) {
  for (std::size_t i = 0; i < tissues.size(); ++i) {
    if (tissues[i].name == name) return static_cast<int>(i);
  }
  return -1;
}

/// Depth-first search for a cycle among the supports of a tissue; `path` is the chain of ancestors.
bool check_cycle(const Scene& scene, int index, std::vector<int>& path, std::vector<bool>& done,
                 Problems& problems) {
  const auto begin = std::find(path.begin(), path.end(), index);
  const TissueSettings& tissue = scene.tissues[static_cast<std::size_t>(index)];
  if (begin != path.end()) {
    std::string circle;
    for (auto i = begin; i != path.end(); ++i)
      circle += scene.tissues[static_cast<std::size_t>(*i)].name + " on ";
    problems.add(tissue.line, "rests_on is circular: " + circle + tissue.name,
                 "remove one of them, so that one tissue rests on no other");
    return false;
  }
  if (done[static_cast<std::size_t>(index)]) return true;
  path.push_back(index);
  for (const std::string& name : tissue.rests_on) {
    if (!check_cycle(scene, index_of(scene.tissues, name), path, done, problems)) return false;
  }
  path.pop_back();
  done[static_cast<std::size_t>(index)] = true;
  return true;
}

bool says_elsewhere(const std::filesystem::path& file) {
  return file.is_absolute() || std::find(file.begin(), file.end(), "..") != file.end();
}

}  // namespace

void check_names(const Scene& scene, Problems& problems) {
  std::vector<std::string_view> all;
  std::string list;
  for (const auto& tissue : scene.tissues) {
    all.push_back(tissue.name);
    list += (list.empty() ? "" : ", ") + tissue.name;
  }
  for (std::size_t i = 0; i < scene.tissues.size(); ++i) {
    const TissueSettings& tissue = scene.tissues[i];
    const TissueSettings& first =
        scene.tissues[static_cast<std::size_t>(index_of(scene.tissues, tissue.name))];
    if (&first != &tissue) {
      problems.add(
          tissue.line,
          "a second tissue \"" + tissue.name + "\"; the first is on line " + std::to_string(first.line),
          "give every tissue a name of its own");
    }
    const auto unknown =
        std::find_if(tissue.rests_on.begin(), tissue.rests_on.end(),
                     [&](const std::string& name) { return index_of(scene.tissues, name) < 0; });
    if (unknown != tissue.rests_on.end()) {
      problems.add(
          tissue.line,
          "tissue \"" + tissue.name + "\" rests on \"" + *unknown + "\", which is not a tissue of this scene",
          did_you_mean(*unknown, all, "\"") + "the tissues are " + list);
    }
  }
}

void check_support_cycles(const Scene& scene, Problems& problems) {
  std::vector<bool> done(scene.tissues.size(), false);
  for (std::size_t i = 0; i < scene.tissues.size(); ++i) {
    std::vector<int> path;
    if (!check_cycle(scene, static_cast<int>(i), path, done, problems)) return;
  }
}

void check_stiffness_order(const Scene& scene, Problems& problems) {
  for (const TissueSettings& tissue : scene.tissues) {
    if (!tissue.touchable) continue;
    for (const std::string& name : tissue.rests_on)
      if (auto fault = support_fault(
              support_values(tissue),
              support_values(scene.tissues[static_cast<std::size_t>(index_of(scene.tissues, name))])))
        problems.add(tissue.line, std::move(fault->what), std::move(fault->remedy));
  }
}

void check_volumes(const Scene& scene, int data_line, Problems& problems) {
  if (scene.scan_volume && !scene.scan)
    problems.add(data_line, "[data] has a scan_volume but no scan", "add: scan = \"...\"");
  if ((scene.mesh_space || scene.mesh_unit) && !scene.labels)
    problems.add(data_line, "[data] has settings for surfaces but names no labels", "add: labels = \"...\"");
  if (!scene.scan && !scene.labels) {
    problems.add(data_line, "[data] names neither a scan nor labels",
                 "add: labels = \"...\", or scan = \"...\"");
    return;
  }
  if (scene.full_density_HU && !scene.scan)
    problems.add(data_line, "[density] needs a scan, and the scene has none",
                 "add to [data]: scan = \"...\", or leave out [density]");
  if (scene.names && !scene.labels)
    problems.add(data_line, "[data] has names for labels but no labels", "add: labels = \"...\"");
  for (const TissueSettings& tissue : scene.tissues) {
    if (tissue.threshold && !scene.scan)
      problems.add(tissue.line, "tissue \"" + tissue.name + "\" has a threshold, but the scene has no scan",
                   "add to [data]: scan = \"...\"");
    if (tissue.air_below && !scene.scan)
      problems.add(tissue.line, "tissue \"" + tissue.name + "\" has air_below, but the scene has no scan",
                   "add to [data]: scan = \"...\"");
    if (tissue.embedding && !scene.labels)
      problems.add(tissue.line,
                   "tissue \"" + tissue.name + "\" embeds labels, but the scene has no label map",
                   "add to [data]: labels = \"...\", or give the tissue a threshold");
    if (tissue.embedding && std::ranges::count_if(scene.tissues, &TissueSettings::embedding) > 1)
      problems.add(tissue.line, "more than one tissue is an embedding", "keep one of them");
    if (!tissue.labels.empty() && !scene.labels)
      problems.add(tissue.line, "tissue \"" + tissue.name + "\" has labels, but the scene has no label map",
                   "add to [data]: labels = \"...\", or give the tissue a threshold");
  }
  for (const NoGoSettings& region : scene.no_go)
    if (!region.structures.empty() && !scene.labels)
      problems.add(region.line,
                   "no-go region \"" + region.name + "\" has structures, but the scene has no label map",
                   "add to [data]: labels = \"...\", or make it a plane or a ball");
}

Result<void> check_files(const Scene& scene) {
  const std::array<std::pair<const std::optional<std::filesystem::path>&, int>, 3> files{
      {{scene.scan, scene.lines.scan}, {scene.labels, scene.lines.labels}, {scene.names, scene.lines.names}}};
  for (const auto& [file, line] : files) {
    if (!file) continue;
    std::error_code unknown;
    const std::filesystem::path path = scene.resolve(*file);
    if (std::filesystem::status(path, unknown).type() == std::filesystem::file_type::not_found)
      return Error{ErrorKind::kBadInput, "no such file: " + path.string(), scene.where(line),
                   "paths are absolute, or relative to the folder of the scene file"};
    // a path that leaves the folder explicitly is allowed; the target of a link is not
    if (says_elsewhere(*file)) continue;
    if (auto stays = check_stays_in(scene.folder, path); !stays) return stays.error();
  }
  return {};
}

}  // namespace palpate
