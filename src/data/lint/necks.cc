#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <vector>

#include "lint/shapes.h"

namespace palpate::internal {
namespace {

// minimum size of a bulge or of a cavity, after erosion by one voxel
constexpr std::size_t kCore_voxels = 12;
constexpr double kCore_mm3 = 10;
// A structure counts as thick if the largest component that remains after erosion by one voxel has this
// fraction of its voxels.
constexpr double kThickFraction = 0.25;
// fraction of a cavity's neighbours that must belong to one structure for a pocket of that structure
constexpr double kOneAround = 0.95;

/// Labels around a pocket of free space, by the number of short axis-parallel rays from within it that hit
/// them.
struct Around {
  std::map<LabelId, std::size_t> count;
  std::size_t all = 0;

  void inspect(const RunVolume& runs, std::array<int, 3> at, std::size_t axis, int step) {
    // erosion shrinks a round pocket by up to two voxels on each side
    constexpr int kMaxErosion = 4;
    for (int n = 0; n < kMaxErosion; ++n) {
      at[axis] += step;
      const VoxelRun* run = runs.find(at[0], at[1], at[2]);
      if (run == nullptr) return;
      if (run->value == 0) continue;
      ++count[run->value];
      ++all;
      return;
    }
  }
};

/// Whether a component contains a voxel together with all its 26 neighbours.
bool has_inner_voxel(const RunVolume& runs, const Component& component, std::uint32_t node) {
  const auto holds = [&](int first, int last, int j, int k) {
    const VoxelRun* run = runs.find(first, j, k);
    return run != nullptr && run->node == node && run->last >= last;
  };
  for (int k = component.box_min[2] + 1; k < component.box_max[2]; ++k)
    for (int j = component.box_min[1] + 1; j < component.box_max[1]; ++j)
      for (const VoxelRun& run : runs.row(j, k)) {
        if (run.node != node) continue;
        for (int i = run.first + 1; i < run.last; ++i) {
          bool is_inner = true;
          for (int b = -1; b <= 1 && is_inner; ++b)
            for (int a = -1; a <= 1 && is_inner; ++a) is_inner = holds(i - 1, i + 1, j + a, k + b);
          if (is_inner) return true;
        }
      }
  return false;
}

}  // namespace

void report_necks_and_pockets(Layer& layer, RunVolume& inner) {
  LintContext& context = layer.context;
  const double voxel_mm3 = context.grid.voxel_volume_mm3();
  const std::vector<Component> cores = connect(inner);
  const auto whole_of = [&](const Component& core) {
    return layer.runs.find(core.first[0], core.first[1], core.first[2])->node;
  };
  // largest core of each component of the layer
  std::map<std::uint32_t, std::uint32_t> largest;
  for (std::uint32_t n = 0; n < cores.size(); ++n) {
    if (cores[n].value == 0) continue;
    const auto [at, is_new] = largest.try_emplace(whole_of(cores[n]), n);
    if (!is_new && cores[n].voxels > cores[at->second].voxels) at->second = n;
  }
  struct Sum {
    std::size_t parts = 0, voxels = 0, most = 0;
    std::array<int, 3> voxel{};
  };
  std::map<LabelId, Sum> bulges, pockets;
  const auto add = [](Sum& sum, const Component& core) {
    ++sum.parts;
    sum.voxels += core.voxels;
    if (core.voxels <= sum.most) return;
    sum.most = core.voxels;
    sum.voxel = core.first;
  };
  const auto is_large = [&](const Component& core) {
    return core.voxels >= kCore_voxels && static_cast<double>(core.voxels) * voxel_mm3 >= kCore_mm3;
  };
  for (std::uint32_t n = 0; n < cores.size(); ++n) {
    const Component& core = cores[n];
    if (core.value != 0) {
      const std::uint32_t whole = whole_of(core);
      const std::uint32_t main = largest.at(whole);
      // a structure that is thin everywhere, such as a vessel or a cartilage, has passages as thin as itself
      const bool is_thick = static_cast<double>(cores[main].voxels) >=
                            kThickFraction * static_cast<double>(layer.components[whole].voxels);
      if (n != main && is_thick && is_large(core) && has_inner_voxel(inner, cores[main], main))
        add(bulges[layer.id_of(core.value)], core);
      continue;
    }
    if (core.at_border || !is_large(core)) continue;
    if (!layer.components[whole_of(core)].at_border) continue;
    Around around;
    for (int k = core.box_min[2]; k <= core.box_max[2]; ++k)
      for (int j = core.box_min[1]; j <= core.box_max[1]; ++j)
        for (const VoxelRun& run : inner.row(j, k)) {
          if (run.node != n) continue;
          around.inspect(layer.runs, {run.first, j, k}, 0, -1);
          around.inspect(layer.runs, {run.last, j, k}, 0, 1);
          const std::array<int, 3> middle{(run.first + run.last) / 2, j, k};
          for (const int step : {-1, 1})
            for (const std::size_t axis : {1u, 2u}) around.inspect(layer.runs, middle, axis, step);
        }
    for (const auto& [value, count] : around.count)
      if (static_cast<double>(count) >= kOneAround * static_cast<double>(around.all))
        add(pockets[layer.id_of(value)], core);
  }
  for (const auto& [id, sum] : bulges) {
    const double mm3 = static_cast<double>(sum.voxels) * voxel_mm3;
    context.add(LintKind::kNeck, LintSeverity::kWarning, {id}, {mm3, "mm3", sum.voxels, sum.voxel},
                context.name_of(id) + " has " + counted(sum.parts, "bulge") + " of at least " +
                    figure(mm3, "mm3") + " behind a neck of at most two voxels");
  }
  for (const auto& [id, sum] : pockets) {
    const double mm3 = static_cast<double>(sum.voxels) * voxel_mm3;
    context.add(LintKind::kOpenCavity, LintSeverity::kWarning, {id}, {mm3, "mm3", sum.voxels, sum.voxel},
                context.name_of(id) + " has a cavity of at least " + figure(mm3, "mm3") +
                    " that is open through a passage of at most two voxels");
  }
}

}  // namespace palpate::internal
