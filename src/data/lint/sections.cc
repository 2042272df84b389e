#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <vector>

#include "lint/shapes.h"

namespace palpate::internal {
namespace {

// minimum area over which the volume's border cuts a structure
constexpr double kCut_mm2 = 5;
// number of slices on each side of a seam with which its change of the cross-section is compared
constexpr int kSeamWindow = 3;
// minimum change at a seam as a fraction of the smaller of the two cross-sections
constexpr double kSeamFraction = 0.05;
/// Ratio of the change of a cross-section at a seam to the change in the slices around it.
struct SeamRatios {
  double over_median, over_most;
};
// thresholds for a plane in which several structures change, and in which one does
constexpr SeamRatios kSharedSeam{3, 1.5}, kLoneSeam{4, 2};
constexpr std::uint32_t kSeam_voxels = 20, kLoneSeam_voxels = 40;

/// Cross-sections of a structure, by axis and slice: their number of voxels, and the number of faces between
/// a slice and the next that separate the structure from another value.
struct Sections {
  std::array<std::vector<std::uint32_t>, 3> area, change;

  explicit Sections(const std::array<int, 3>& dims) {
    for (std::size_t a = 0; a < 3; ++a) {
      area[a].resize(static_cast<std::size_t>(dims[a]) + 1);
      change[a].resize(static_cast<std::size_t>(dims[a]));
    }
  }
};

std::vector<Sections> sections_of(const Layer& layer) {
  std::vector<Sections> all;
  std::vector<std::size_t> position_of(layer.segment_of_value.size(), SIZE_MAX);
  for (std::size_t value = 1; value < position_of.size(); ++value)
    if (layer.segment_of_value[value] != nullptr) {
      position_of[value] = all.size();
      all.emplace_back(layer.context.grid.dims);
    }
  const auto of = [&](LabelId value) { return value == 0 ? nullptr : &all[position_of[value]]; };
  const auto& dims = layer.context.grid.dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (const VoxelRun& run : layer.runs.row(j, k)) {
        Sections* sections = of(run.value);
        if (sections == nullptr) continue;
        const auto length = static_cast<std::uint32_t>(run.length());
        // the area along i is accumulated as differences and summed below
        ++sections->area[0][static_cast<std::size_t>(run.first)];
        --sections->area[0][static_cast<std::size_t>(run.last) + 1];
        sections->area[1][static_cast<std::size_t>(j)] += length;
        sections->area[2][static_cast<std::size_t>(k)] += length;
      }
  for (Sections& sections : all)
    for (std::size_t n = 1; n < sections.area[0].size(); ++n) sections.area[0][n] += sections.area[0][n - 1];
  for_each_face(layer.runs, [&](int axis, const VoxelRun& a, const VoxelRun& b, int faces,
                                const std::array<int, 3>& voxel) {
    const auto before = static_cast<std::size_t>(voxel[static_cast<std::size_t>(axis)] - 1);
    for (const LabelId value : {a.value, b.value})
      if (Sections* sections = of(value))
        sections->change[static_cast<std::size_t>(axis)][before] += static_cast<std::uint32_t>(faces);
  });
  return all;
}

/// Detects terraces: slices from `low` to `high` that mostly repeat the previous one, with jumps between
/// them. Returns the median height of a step in slices; 0: no terraces.
int step_of_terraces(const std::vector<std::uint32_t>& change, int low, int high) {
  std::vector<int> jumps;
  int still = 0;
  for (int p = low; p < high; ++p) {
    if (change[static_cast<std::size_t>(p)] == 0)
      ++still;
    else
      jumps.push_back(p);
  }
  const int planes = high - low;
  if (planes < 8 || still < 0.3 * planes || jumps.size() < 4) return 0;
  std::vector<int> steps;
  std::size_t alone = 0;
  double mean = 0;
  for (std::size_t n = 0; n < jumps.size(); ++n) {
    const bool near_before = n > 0 && jumps[n] - jumps[n - 1] == 1;
    const bool near_after = n + 1 < jumps.size() && jumps[n + 1] - jumps[n] == 1;
    alone += !near_before && !near_after;
    mean += change[static_cast<std::size_t>(jumps[n])];
    if (n > 0) steps.push_back(jumps[n] - jumps[n - 1]);
  }
  mean /= static_cast<double>(jumps.size());
  std::ranges::nth_element(steps, steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2));
  const int step = steps[steps.size() / 2];
  const auto regular = std::ranges::count_if(steps, [&](int s) { return s <= step + 1; });
  if (static_cast<double>(alone) < 0.8 * static_cast<double>(jumps.size()) || mean < 8 ||
      static_cast<double>(regular) < 0.7 * static_cast<double>(steps.size()))
    return 0;
  return step;
}

constexpr std::array<const char*, 3> kAxisNames{"i", "j", "k"};

/// Plane between two slices in which outlines jump.
struct SeamPlane {
  std::vector<LabelId> structures;
  bool stands_alone = false;  ///< Is a seam although only one structure's outline jumps.
  std::uint32_t voxels = 0,
                most = 0;      ///< Changed faces of all structures, and of the structure with the most.
  std::array<int, 3> voxel{};  ///< Middle of that structure's box, in the plane.
};
using SeamPlanes = std::map<int, SeamPlane>;  // by the slice in front of the plane

std::array<int, 3> middle_of(const SegmentStatistics& of) {
  return {(of.box_min[0] + of.box_max[0]) / 2, (of.box_min[1] + of.box_max[1]) / 2,
          (of.box_min[2] + of.box_max[2]) / 2};
}

// Adds the planes along an axis at which a structure's cross-section changes more than around them.
void find_seams(const Sections& sections, const SegmentStatistics& of, std::size_t axis, SeamPlanes& planes) {
  const auto& change = sections.change[axis];
  const int low = of.box_min[axis] + 1, high = of.box_max[axis] - 1;
  for (int p = low + 1; p + 1 < high; ++p) {
    const std::uint32_t here = change[static_cast<std::size_t>(p)];
    if (here < kSeam_voxels) continue;
    std::vector<std::uint32_t> others;
    for (int q = std::max(low, p - kSeamWindow); q <= std::min(high - 1, p + kSeamWindow); ++q)
      if (q != p) others.push_back(change[static_cast<std::size_t>(q)]);
    std::ranges::sort(others);
    const std::uint32_t median = std::max<std::uint32_t>(others[others.size() / 2], 2);
    const std::uint32_t one = sections.area[axis][static_cast<std::size_t>(p)],
                        other = sections.area[axis][static_cast<std::size_t>(p) + 1];
    const auto exceeds = [&](const SeamRatios& ratios) {
      return here >= ratios.over_median * median && here >= ratios.over_most * others.back();
    };
    if (!exceeds(kSharedSeam) || here < kSeamFraction * std::min(one, other)) continue;
    SeamPlane& plane = planes[p];
    plane.structures.push_back(of.id);
    // a shifted cross-section keeps its area; a part of the structure that ends in a flat face does not
    plane.stands_alone = exceeds(kLoneSeam) && here >= kLoneSeam_voxels &&
                         2 * (std::max(one, other) - std::min(one, other)) < here;
    plane.voxels += here;
    if (here <= plane.most) continue;
    plane.most = here;
    plane.voxel = middle_of(of);
    plane.voxel[axis] = p;
  }
}

void report_seams(LintContext& context, std::size_t axis, const SeamPlanes& planes) {
  for (const auto& [p, plane] : planes) {
    const bool is_shared = plane.structures.size() > 1;
    if (!is_shared && !plane.stands_alone) continue;
    context.add(LintKind::kSeam, is_shared ? LintSeverity::kFault : LintSeverity::kWarning, plane.structures,
                {plane.voxels * context.face_mm2(axis), "mm2", plane.voxels, plane.voxel},
                "between slices " + std::to_string(p) + " and " + std::to_string(p + 1) + " along " +
                    kAxisNames[axis] + " the outline of " + context.names_of(plane.structures) +
                    " jumps by " + figure(plane.voxels * context.face_mm2(axis), "mm2"));
  }
}

/// Structures with terraces along one axis.
struct Terraces {
  std::vector<LabelId> structures;
  int step = 0;  ///< Greatest height of their steps, slices.
  std::size_t voxels = 0;
};

void report_terraces(LintContext& context, std::size_t axis, const Terraces& terraces) {
  if (terraces.structures.empty()) return;
  const double step_mm = terraces.step * context.grid.spacing_mm[static_cast<Eigen::Index>(axis)];
  const SegmentStatistics* first = context.statistics_of(terraces.structures.front());
  context.add(LintKind::kTerraces, LintSeverity::kFault, terraces.structures,
              {step_mm, "mm", terraces.voxels, middle_of(*first)},
              "slices along " + std::string(kAxisNames[axis]) + " repeat in groups of " +
                  std::to_string(terraces.step) + " in " + context.names_of(terraces.structures) +
                  ": steps of " + figure(step_mm, "mm"));
}

}  // namespace

void report_seams_and_terraces(Layer& layer) {
  LintContext& context = layer.context;
  const std::vector<Sections> all = sections_of(layer);
  std::array<SeamPlanes, 3> seams;
  std::array<Terraces, 3> terraces;
  std::size_t index = 0;
  for (std::size_t value = 1; value < layer.segment_of_value.size(); ++value) {
    if (layer.segment_of_value[value] == nullptr) continue;
    const Sections& sections = all[index++];
    const SegmentStatistics* of = context.statistics_of(layer.segment_of_value[value]->id);
    if (of == nullptr) continue;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const int step = step_of_terraces(sections.change[axis], of->box_min[axis] + 1, of->box_max[axis] - 1);
      if (step == 0) {
        find_seams(sections, *of, axis, seams[axis]);
        continue;
      }
      terraces[axis].structures.push_back(of->id);
      terraces[axis].step = std::max(terraces[axis].step, step);
      terraces[axis].voxels += of->voxels;
    }
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    report_seams(context, axis, seams[axis]);
    report_terraces(context, axis, terraces[axis]);
  }
}

void report_border_cuts(Layer& layer) {
  LintContext& context = layer.context;
  const auto& dims = context.grid.dims;
  struct Sum {
    double mm2 = 0;
    std::size_t voxels = 0;
    int longest = 0;
    std::array<int, 3> voxel{};
  };
  std::map<LabelId, Sum> sums;
  const auto add = [&](const VoxelRun& run, std::size_t axis, int voxels, const std::array<int, 3>& voxel) {
    Sum& sum = sums[layer.id_of(run.value)];
    sum.mm2 += voxels * context.face_mm2(axis);
    if (voxels <= sum.longest) return;
    sum.longest = voxels;
    sum.voxel = voxel;
  };
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (const VoxelRun& run : layer.runs.row(j, k)) {
        if (run.value == 0) continue;
        const int middle = (run.first + run.last) / 2;
        if (run.first == 0) add(run, 0, 1, {0, j, k});
        if (run.last == dims[0] - 1) add(run, 0, 1, {run.last, j, k});
        if (j == 0 || j == dims[1] - 1) add(run, 1, run.length(), {middle, j, k});
        if (k == 0 || k == dims[2] - 1) add(run, 2, run.length(), {middle, j, k});
        // a voxel on an edge or corner of the volume has several faces there
        const bool is_row_on_border = j == 0 || j == dims[1] - 1 || k == 0 || k == dims[2] - 1;
        const int ends = (run.first == 0) + (run.last == dims[0] - 1 && (run.first != 0 || run.length() > 1));
        if (const int voxels = is_row_on_border ? run.length() : ends; voxels > 0)
          sums[layer.id_of(run.value)].voxels += static_cast<std::size_t>(voxels);
      }
  for (const auto& [id, sum] : sums)
    if (sum.mm2 >= kCut_mm2)
      context.add(LintKind::kCutByBorder, LintSeverity::kWarning, {id},
                  {sum.mm2, "mm2", sum.voxels, sum.voxel},
                  "the volume's border cuts " + context.name_of(id) + " over " + figure(sum.mm2, "mm2"));
}

}  // namespace palpate::internal
