#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <vector>

#include "lint/shapes.h"

namespace palpate::internal {
namespace {

constexpr std::size_t kPatch_voxels = 12;
// A patch is reported if (area >= kPatch_mm2 and fraction of its structure >= kPatchFraction) or
// area >= kLargePatch_mm2 or fraction >= kSheetFraction.
constexpr double kPatch_mm2 = 30, kPatchFraction = 0.05, kLargePatch_mm2 = 100;
// fraction of the structure from which a sheet is a fault
constexpr double kSheetFraction = 0.2;

constexpr std::int32_t kNoNeighbour = -1, kSeveral = -2;

/// Updates the value around a component with a further neighbour: kSeveral if they differ.
std::int32_t with_neighbour(std::int32_t around, LabelId neighbour) {
  return around == kNoNeighbour || around == neighbour ? neighbour : kSeveral;
}

}  // namespace

void report_islands(Layer& layer) {
  LintContext& context = layer.context;
  const double voxel_mm3 = context.grid.voxel_volume_mm3();
  const Islands found = islands_and_cavities(layer.runs, layer.components, voxel_mm3);
  struct Sum {
    std::size_t parts = 0, voxels = 0, largest = 0;
    std::array<int, 3> voxel{};
    void add(const Component& component) {
      ++parts;
      voxels += component.voxels;
      if (component.voxels > largest) {
        largest = component.voxels;
        voxel = component.first;
      }
    }
  };
  std::map<LabelId, Sum> islands, holes, cavities;
  for (const std::uint32_t n : found.islands) {
    const Component& component = layer.components[n];
    islands[layer.id_of(component.value)].add(component);
  }
  for (const Islands::Cavity& cavity : found.cavities)
    (cavity.is_hole ? holes : cavities)[layer.id_of(cavity.around)].add(layer.components[cavity.component]);

  for (const auto& [id, sum] : islands)
    context.add(LintKind::kIslands, LintSeverity::kFault, {id},
                {static_cast<double>(sum.voxels) * voxel_mm3, "mm3", sum.voxels, sum.voxel},
                context.name_of(id) + " has " + counted(sum.parts, "island") + " of " +
                    counted(sum.voxels, "voxel") + " in all, " +
                    figure(static_cast<double>(sum.voxels) * voxel_mm3, "mm3"));
  for (const auto& [id, sum] : holes)
    context.add(LintKind::kHoles, LintSeverity::kFault, {id},
                {static_cast<double>(sum.voxels) * voxel_mm3, "mm3", sum.voxels, sum.voxel},
                context.name_of(id) + " encloses " + counted(sum.parts, "hole") + " of " +
                    counted(sum.voxels, "voxel") + " in all, " +
                    figure(static_cast<double>(sum.voxels) * voxel_mm3, "mm3"));
  for (const auto& [id, sum] : cavities)
    context.add(LintKind::kHoles, LintSeverity::kUndetermined, {id},
                {static_cast<double>(sum.voxels) * voxel_mm3, "mm3", sum.voxels, sum.voxel},
                context.name_of(id) + " encloses a cavity of " +
                    figure(static_cast<double>(sum.voxels) * voxel_mm3, "mm3") +
                    ", which may be anatomy or a missing label");
}

void report_sheets(Layer& layer, RunVolume& thin) {
  LintContext& context = layer.context;
  const std::vector<Component> patches = connect(thin);
  const double voxel_mm2 = std::cbrt(std::pow(context.grid.voxel_volume_mm3(), 2));
  struct Sum {
    std::size_t voxels = 0, largest = 0;
    std::uint32_t patch = 0;
  };
  std::map<LabelId, Sum> sums;
  for (std::uint32_t n = 0; n < patches.size(); ++n) {
    const Component& patch = patches[n];
    const SegmentStatistics* of = context.statistics_of(layer.id_of(patch.value));
    if (of == nullptr || patch.voxels < kPatch_voxels) continue;
    const double area = static_cast<double>(patch.voxels) * voxel_mm2;
    const double fraction = static_cast<double>(patch.voxels) / static_cast<double>(of->voxels);
    if (area < kLargePatch_mm2 && fraction < kSheetFraction &&
        (area < kPatch_mm2 || fraction < kPatchFraction))
      continue;
    Sum& sum = sums[of->id];
    sum.voxels += patch.voxels;
    if (patch.voxels > sum.largest) {
      sum.largest = patch.voxels;
      sum.patch = n;
    }
  }
  for (const auto& [id, sum] : sums) {
    const double fraction =
        static_cast<double>(sum.voxels) / static_cast<double>(context.statistics_of(id)->voxels);
    const double area = static_cast<double>(sum.voxels) * voxel_mm2;
    // the voxel of the largest patch that is nearest to the centre of its bounding box
    const Component& patch = patches[sum.patch];
    std::array<int, 3> voxel = patch.first;
    double nearest = std::numeric_limits<double>::infinity();
    for (int k = patch.box_min[2]; k <= patch.box_max[2]; ++k)
      for (int j = patch.box_min[1]; j <= patch.box_max[1]; ++j)
        for (const VoxelRun& run : thin.row(j, k)) {
          if (run.node != sum.patch) continue;
          const int middle = (patch.box_min[0] + patch.box_max[0]) / 2;
          const std::array<int, 3> at{std::clamp(middle, run.first, run.last), j, k};
          double squared_distance = 0;
          for (std::size_t a = 0; a < 3; ++a)
            squared_distance += std::pow(at[a] - 0.5 * (patch.box_min[a] + patch.box_max[a]), 2);
          if (squared_distance < nearest) {
            nearest = squared_distance;
            voxel = at;
          }
        }
    context.add(LintKind::kOneVoxelSheet,
                fraction >= kSheetFraction ? LintSeverity::kFault : LintSeverity::kWarning, {id},
                {area, "mm2", sum.voxels, voxel},
                context.name_of(id) + " is one voxel thick over " + figure(area, "mm2") + ", " +
                    figure(100 * fraction, "%") + " of its voxels");
  }
}

Islands islands_and_cavities(const RunVolume& runs, const std::vector<Component>& components,
                             double voxel_mm3) {
  std::vector<std::size_t> largest, whole;
  std::vector<std::int32_t> around(components.size(), kNoNeighbour);
  for (const Component& component : components) {
    if (component.value >= largest.size()) {
      largest.resize(component.value + 1u);
      whole.resize(component.value + 1u);
    }
    largest[component.value] = std::max(largest[component.value], component.voxels);
    whole[component.value] += component.voxels;
  }
  for_each_face(runs, [&](int, const VoxelRun& a, const VoxelRun& b, int, const std::array<int, 3>&) {
    if (a.value == 0) around[a.node] = with_neighbour(around[a.node], b.value);
    if (b.value == 0) around[b.node] = with_neighbour(around[b.node], a.value);
  });
  Islands found;
  for (std::uint32_t n = 0; n < components.size(); ++n) {
    const Component& component = components[n];
    const auto voxels = static_cast<double>(component.voxels);
    if (component.value != 0) {
      if (voxels < kIslandFraction * static_cast<double>(largest[component.value]) &&
          voxels * voxel_mm3 <= kIsland_mm3)
        found.islands.push_back(n);
    } else if (!component.at_border && around[n] > 0) {
      const auto value = static_cast<LabelId>(around[n]);
      found.cavities.push_back(
          {n, value,
           voxels <= kHoleFraction * static_cast<double>(whole[value]) && voxels * voxel_mm3 <= kHole_mm3});
    }
  }
  return found;
}

}  // namespace palpate::internal
