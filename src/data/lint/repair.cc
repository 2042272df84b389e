#include <algorithm>
#include <map>
#include <set>

#include "lint/lint_context.h"
#include "palpate/base/for_each_index.h"

namespace palpate {
namespace {

using internal::Component;
using internal::Islands;
using internal::RunVolume;
using internal::VoxelRun;

/// Number of faces that each wanted component shares with each neighbouring value, by component.
std::map<std::uint32_t, std::map<LabelId, std::size_t>> neighbours_of(const RunVolume& runs,
                                                                      const std::vector<bool>& requested) {
  std::map<std::uint32_t, std::map<LabelId, std::size_t>> neighbours;
  internal::for_each_face(
      runs, [&](int, const VoxelRun& a, const VoxelRun& b, int faces, const std::array<int, 3>&) {
        if (requested[a.node]) neighbours[a.node][b.value] += static_cast<std::size_t>(faces);
        if (requested[b.node]) neighbours[b.node][a.value] += static_cast<std::size_t>(faces);
      });
  return neighbours;
}

class LayerRepair {
 public:
  LayerRepair(RepairedLabels& repaired, std::size_t layer) : repaired_(repaired), layer_(layer) {}

  /// One pass over the layer. @return whether something changed
  Result<bool> pass(int workers, const Progress& progress) {
    Volume<LabelId>& voxels = repaired_.labels.layers[layer_];
    const GridGeometry& grid = voxels.geometry();
    auto runs = internal::runs_of(voxels, workers, progress, {"repairing the labels"});
    if (!runs) return runs.error();
    const std::vector<Component> components = connect(*runs);
    const Islands found = islands_and_cavities(*runs, components, grid.voxel_volume_mm3());
    std::vector<bool> is_island(components.size()), changes(components.size());
    for (const std::uint32_t n : found.islands) is_island[n] = changes[n] = true;
    const auto neighbours = neighbours_of(*runs, is_island);
    std::vector<LabelId> becomes(components.size());
    for (const std::uint32_t n : found.islands) {
      const auto at = neighbours.find(n);
      if (at == neighbours.end()) continue;
      std::size_t largest = 0;
      for (const auto& [value, faces] : at->second)
        if (faces > largest) {
          largest = faces;
          becomes[n] = value;
        }
      note(LintKind::kIslands, components[n].value, components[n].voxels);
    }
    for (const Islands::Cavity& cavity : found.cavities) {
      if (!cavity.is_hole) continue;
      changes[cavity.component] = true;
      becomes[cavity.component] = cavity.around;
      note(LintKind::kHoles, cavity.around, components[cavity.component].voxels);
    }
    bool any = false;
    for (int k = 0; k < grid.dims[2]; ++k)
      for (int j = 0; j < grid.dims[1]; ++j)
        for (const VoxelRun& run : runs->row(j, k)) {
          if (!changes[run.node]) continue;
          any = true;
          LabelId* row = voxels.voxels().data() + grid.offset(0, j, k);
          std::fill(row + run.first, row + run.last + 1, becomes[run.node]);
        }
    return any;
  }

 private:
  void note(LintKind kind, LabelId value, std::size_t voxels) {
    const auto segment = std::ranges::find_if(repaired_.labels.segments, [&](const Segment& s) {
      return s.value == value && static_cast<std::size_t>(s.layer) == layer_;
    });
    const auto at = std::ranges::find_if(repaired_.repairs, [&](const LintRepair& repair) {
      return repair.kind == kind && repair.structure == segment->id;
    });
    LintRepair& repair = at != repaired_.repairs.end()
                             ? *at
                             : repaired_.repairs.emplace_back(LintRepair{kind, segment->id, 0, 0, ""});
    ++repair.parts;
    repair.voxels += voxels;
  }

  RepairedLabels& repaired_;
  std::size_t layer_;
};

void repair_names(RepairedLabels& repaired) {
  std::vector<Segment>& segments = repaired.labels.segments;
  std::set<std::string> taken_names;
  std::vector<Segment*> wrong;
  for (Segment& segment : segments)
    if (segment.name.empty() || !taken_names.insert(internal::plain_name(segment.name)).second)
      wrong.push_back(&segment);
  for (Segment* segment : wrong) {
    const bool was_empty = segment->name.empty();
    const std::string base = was_empty ? "structure " + std::to_string(segment->id) : segment->name;
    std::string name = base;
    for (int n = 2; !taken_names.insert(internal::plain_name(name)).second || (!was_empty && name == base);
         ++n)
      name = base + " " + std::to_string(n);
    segment->name = name;
    repaired.repairs.push_back(
        {was_empty ? LintKind::kNoName : LintKind::kDuplicateName, segment->id, 0, 0, name});
  }
}

}  // namespace

Result<RepairedLabels> repaired_labels(LabelMap labels, int threads, const Progress& progress) {
  RepairedLabels repaired{std::move(labels), {}};
  const int workers = worker_count(threads, std::max(1, repaired.labels.geometry().dims[2]));
  for (std::size_t layer = 0; layer < repaired.labels.layers.size(); ++layer) {
    LayerRepair repair_of_layer(repaired, layer);
    // removing an island may create a hole, which the next pass fills
    constexpr int kMaxPasses = 16;
    for (int pass = 0; pass < kMaxPasses; ++pass) {
      const auto changed = repair_of_layer.pass(workers, progress);
      if (!changed) return changed.error();
      if (!*changed) break;
    }
  }
  repair_names(repaired);
  return repaired;
}

}  // namespace palpate
