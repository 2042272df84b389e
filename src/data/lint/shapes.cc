#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>

#include "lint/study.h"
#include "palpate/surfaces/surfaces.h"

namespace palpate::internal {
namespace {

constexpr std::size_t kPatch_voxels = 12;
// A patch is reported if (area >= kPatch_mm2 and fraction of its structure >= kPatchFraction) or
// area >= kLargePatch_mm2 or fraction >= kSheetFraction.
constexpr double kPatch_mm2 = 30, kPatchFraction = 0.05, kLargePatch_mm2 = 100;
// fraction of the structure from which a sheet is a fault
constexpr double kSheetFraction = 0.2;
// minimum size of a bulge or of a cavity, after erosion by one voxel
constexpr std::size_t kCore_voxels = 12;
constexpr double kCore_mm3 = 10;
// A structure counts as thick if the largest component that remains after erosion by one voxel has this
// fraction of its voxels.
constexpr double kThickFraction = 0.25;
// fraction of a cavity's neighbours that must belong to one structure for a pocket of that structure
constexpr double kOneAround = 0.95;
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

constexpr std::int32_t kNobody = -1, kSeveral = -2;

/// Updates the value around a component with a further neighbour: kSeveral if they differ.
std::int32_t with_neighbour(std::int32_t around, LabelId neighbour) {
  return around == kNobody || around == neighbour ? neighbour : kSeveral;
}

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

/// State shared by the checks of one layer.
struct Layer {
  LintStudy& study;
  std::size_t number;
  std::vector<const Segment*> segment_of_value;
  RunVolume runs;
  std::vector<Component> components;

  LabelId id_of(LabelId value) const {
    return value < segment_of_value.size() && segment_of_value[value] != nullptr ? segment_of_value[value]->id
                                                                                 : LabelId{0};
  }
};

void report_islands(Layer& layer) {
  LintStudy& study = layer.study;
  const double voxel_mm3 = study.grid.voxel_volume_mm3();
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
    study.add(LintKind::kIslands, LintSeverity::kFault, {id},
              {static_cast<double>(sum.voxels) * voxel_mm3, "mm3", sum.voxels, sum.voxel},
              study.name_of(id) + " has " + counted(sum.parts, "island") + " of " +
                  counted(sum.voxels, "voxel") + " in all, " +
                  figure(static_cast<double>(sum.voxels) * voxel_mm3, "mm3"));
  for (const auto& [id, sum] : holes)
    study.add(LintKind::kHoles, LintSeverity::kFault, {id},
              {static_cast<double>(sum.voxels) * voxel_mm3, "mm3", sum.voxels, sum.voxel},
              study.name_of(id) + " encloses " + counted(sum.parts, "hole") + " of " +
                  counted(sum.voxels, "voxel") + " in all, " +
                  figure(static_cast<double>(sum.voxels) * voxel_mm3, "mm3"));
  for (const auto& [id, sum] : cavities)
    study.add(LintKind::kHoles, LintSeverity::kUndetermined, {id},
              {static_cast<double>(sum.voxels) * voxel_mm3, "mm3", sum.voxels, sum.voxel},
              study.name_of(id) + " encloses a cavity of " +
                  figure(static_cast<double>(sum.voxels) * voxel_mm3, "mm3") +
                  ", which may be anatomy or a missing label");
}

void report_sheets(Layer& layer, RunVolume& thin) {
  LintStudy& study = layer.study;
  const std::vector<Component> patches = connect(thin);
  const double voxel_mm2 = std::cbrt(std::pow(study.grid.voxel_volume_mm3(), 2));
  struct Sum {
    std::size_t voxels = 0, largest = 0;
    std::uint32_t patch = 0;
  };
  std::map<LabelId, Sum> sums;
  for (std::uint32_t n = 0; n < patches.size(); ++n) {
    const Component& patch = patches[n];
    const SegmentStatistics* of = study.statistics_of(layer.id_of(patch.value));
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
        static_cast<double>(sum.voxels) / static_cast<double>(study.statistics_of(id)->voxels);
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
          double off = 0;
          for (std::size_t a = 0; a < 3; ++a)
            off += std::pow(at[a] - 0.5 * (patch.box_min[a] + patch.box_max[a]), 2);
          if (off < nearest) {
            nearest = off;
            voxel = at;
          }
        }
    study.add(LintKind::kOneVoxelSheet,
              fraction >= kSheetFraction ? LintSeverity::kFault : LintSeverity::kWarning, {id},
              {area, "mm2", sum.voxels, voxel},
              study.name_of(id) + " is one voxel thick over " + figure(area, "mm2") + ", " +
                  figure(100 * fraction, "%") + " of its voxels");
  }
}

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

void report_necks_and_pockets(Layer& layer, RunVolume& inner) {
  LintStudy& study = layer.study;
  const double voxel_mm3 = study.grid.voxel_volume_mm3();
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
    study.add(LintKind::kNeck, LintSeverity::kWarning, {id}, {mm3, "mm3", sum.voxels, sum.voxel},
              study.name_of(id) + " has " + counted(sum.parts, "bulge") + " of at least " +
                  figure(mm3, "mm3") + " behind a neck of at most two voxels");
  }
  for (const auto& [id, sum] : pockets) {
    const double mm3 = static_cast<double>(sum.voxels) * voxel_mm3;
    study.add(LintKind::kOpenCavity, LintSeverity::kWarning, {id}, {mm3, "mm3", sum.voxels, sum.voxel},
              study.name_of(id) + " has a cavity of at least " + figure(mm3, "mm3") +
                  " that is open through a passage of at most two voxels");
  }
}

std::vector<Sections> sections_of(const Layer& layer) {
  std::vector<Sections> all;
  std::vector<std::size_t> position_of(layer.segment_of_value.size(), SIZE_MAX);
  for (std::size_t value = 1; value < position_of.size(); ++value)
    if (layer.segment_of_value[value] != nullptr) {
      position_of[value] = all.size();
      all.emplace_back(layer.study.grid.dims);
    }
  const auto of = [&](LabelId value) { return value == 0 ? nullptr : &all[position_of[value]]; };
  const auto& dims = layer.study.grid.dims;
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

void report_sections(Layer& layer) {
  LintStudy& study = layer.study;
  const std::vector<Sections> all = sections_of(layer);
  struct Plane {
    std::vector<LabelId> structures;
    bool stands_alone = false;
    std::uint32_t voxels = 0;
    std::array<int, 3> voxel{};
    std::uint32_t most = 0;
  };
  std::array<std::map<int, Plane>, 3> seams;
  struct Terraced {
    std::vector<LabelId> structures;
    int step = 0;
    std::size_t voxels = 0;
  };
  std::array<Terraced, 3> terraced;
  std::size_t index = 0;
  for (std::size_t value = 1; value < layer.segment_of_value.size(); ++value) {
    if (layer.segment_of_value[value] == nullptr) continue;
    const Sections& sections = all[index++];
    const LabelId id = layer.segment_of_value[value]->id;
    const SegmentStatistics* of = study.statistics_of(id);
    if (of == nullptr) continue;
    for (std::size_t a = 0; a < 3; ++a) {
      const auto& change = sections.change[a];
      const int low = of->box_min[a] + 1, high = of->box_max[a] - 1;
      if (const int step = step_of_terraces(change, low, high); step > 0) {
        terraced[a].structures.push_back(id);
        terraced[a].step = std::max(terraced[a].step, step);
        terraced[a].voxels += of->voxels;
        continue;
      }
      for (int p = low + 1; p + 1 < high; ++p) {
        const std::uint32_t here = change[static_cast<std::size_t>(p)];
        if (here < kSeam_voxels) continue;
        std::vector<std::uint32_t> others;
        for (int q = std::max(low, p - kSeamWindow); q <= std::min(high - 1, p + kSeamWindow); ++q)
          if (q != p) others.push_back(change[static_cast<std::size_t>(q)]);
        std::ranges::sort(others);
        const std::uint32_t median = std::max<std::uint32_t>(others[others.size() / 2], 2);
        const std::uint32_t one = sections.area[a][static_cast<std::size_t>(p)],
                            other = sections.area[a][static_cast<std::size_t>(p) + 1];
        const auto exceeds = [&](const SeamRatios& ratios) {
          return here >= ratios.over_median * median && here >= ratios.over_most * others.back();
        };
        if (!exceeds(kSharedSeam) || here < kSeamFraction * std::min(one, other)) continue;
        Plane& plane = seams[a][p];
        plane.structures.push_back(id);
        // a shifted cross-section keeps its area; a part of the structure that ends in a flat face does not
        plane.stands_alone = exceeds(kLoneSeam) && here >= kLoneSeam_voxels &&
                             2 * (std::max(one, other) - std::min(one, other)) < here;
        plane.voxels += here;
        if (here > plane.most) {
          plane.most = here;
          plane.voxel = {(of->box_min[0] + of->box_max[0]) / 2, (of->box_min[1] + of->box_max[1]) / 2,
                         (of->box_min[2] + of->box_max[2]) / 2};
          plane.voxel[a] = p;
        }
      }
    }
  }
  for (std::size_t a = 0; a < 3; ++a) {
    for (const auto& [p, plane] : seams[a]) {
      const bool is_shared = plane.structures.size() > 1;
      if (!is_shared && !plane.stands_alone) continue;
      study.add(LintKind::kSeam, is_shared ? LintSeverity::kFault : LintSeverity::kWarning, plane.structures,
                {plane.voxels * study.face_mm2(a), "mm2", plane.voxels, plane.voxel},
                "between slices " + std::to_string(p) + " and " + std::to_string(p + 1) + " along " +
                    kAxisNames[a] + " the outline of " + study.names_of(plane.structures) + " jumps by " +
                    figure(plane.voxels * study.face_mm2(a), "mm2"));
    }
    if (terraced[a].structures.empty()) continue;
    const double step_mm = terraced[a].step * study.grid.spacing_mm[static_cast<Eigen::Index>(a)];
    const SegmentStatistics* first = study.statistics_of(terraced[a].structures.front());
    study.add(LintKind::kTerraces, LintSeverity::kFault, terraced[a].structures,
              {step_mm, "mm", terraced[a].voxels,
               std::array<int, 3>{(first->box_min[0] + first->box_max[0]) / 2,
                                  (first->box_min[1] + first->box_max[1]) / 2,
                                  (first->box_min[2] + first->box_max[2]) / 2}},
              "slices along " + std::string(kAxisNames[a]) + " repeat in groups of " +
                  std::to_string(terraced[a].step) + " in " + study.names_of(terraced[a].structures) +
                  ": steps of " + figure(step_mm, "mm"));
  }
}

void report_cuts(Layer& layer) {
  LintStudy& study = layer.study;
  const auto& dims = study.grid.dims;
  struct Sum {
    double mm2 = 0;
    std::size_t voxels = 0;
    int longest = 0;
    std::array<int, 3> voxel{};
  };
  std::map<LabelId, Sum> sums;
  const auto add = [&](const VoxelRun& run, std::size_t axis, int voxels, const std::array<int, 3>& voxel) {
    Sum& sum = sums[layer.id_of(run.value)];
    sum.mm2 += voxels * study.face_mm2(axis);
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
      study.add(LintKind::kCutByBorder, LintSeverity::kWarning, {id}, {sum.mm2, "mm2", sum.voxels, sum.voxel},
                "the volume's border cuts " + study.name_of(id) + " over " + figure(sum.mm2, "mm2"));
}

}  // namespace

Islands islands_and_cavities(const RunVolume& runs, const std::vector<Component>& components,
                             double voxel_mm3) {
  std::vector<std::size_t> largest, whole;
  std::vector<std::int32_t> around(components.size(), kNobody);
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

Result<void> check_shapes(LintStudy& study, std::size_t number, const ProgressSpan& span) {
  const Volume<LabelId>& voxels = study.labels.layers[number];
  auto runs = runs_of(voxels, study.workers, study.progress, span.part(0, 0.2));
  if (!runs) return runs.error();
  Layer layer{study, number, {}, *std::move(runs), {}};
  for (const Segment& segment : study.labels.segments) {
    if (static_cast<std::size_t>(segment.layer) != number || segment.value == 0) continue;
    if (segment.value >= layer.segment_of_value.size()) layer.segment_of_value.resize(segment.value + 1u);
    layer.segment_of_value[segment.value] = &segment;
  }
  layer.components = connect(layer.runs);
  if (study.progress.stopped()) return Progress::interrupted();
  report_islands(layer);
  report_sections(layer);
  report_cuts(layer);
  if (study.progress.stopped()) return Progress::interrupted();
  auto cubes = cube_morphology(voxels, study.workers, study.progress, span.part(0.5, 0.8));
  if (!cubes) return cubes.error();
  report_sheets(layer, cubes->thin);
  if (study.progress.stopped()) return Progress::interrupted();
  report_necks_and_pockets(layer, cubes->inner);
  return {};
}

Result<void> check_leaks(LintStudy& study, const Volume<LabelId>& flat) {
  std::vector<LabelId> ids;
  for (const SegmentStatistics& s : study.statistics) ids.push_back(s.id);
  const auto leaks = find_leaks(*label_bricks(flat), ids, study.options.threads, study.progress);
  if (!leaks) return leaks.error();
  constexpr std::size_t kManyJoints = 10;
  const auto X_VoxelPatient = study.grid.X_PatientVoxel().inverse();
  for (const Leaks& one : *leaks) {
    const Point<Voxel> at = X_VoxelPatient * one.position;
    study.add(
        LintKind::kLeakySheet, one.joints >= kManyJoints ? LintSeverity::kFault : LintSeverity::kWarning,
        {one.label},
        {static_cast<double>(one.joints), "", 0,
         std::array<int, 3>{static_cast<int>(at.x()), static_cast<int>(at.y()), static_cast<int>(at.z())}},
        study.name_of(one.label) + " is connected only by edges or corners in " +
            counted(one.joints, "place"));
  }
  return {};
}

}  // namespace palpate::internal
