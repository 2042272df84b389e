#include "palpate/model/memory_forecast.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <vector>

#include "model/surface_reach.h"
#include "model/surfaces_needed.h"
#include "palpate/base/for_each_index.h"
#include "palpate/model/make_model.h"
#include "palpate/model/ramp_structures.h"

namespace palpate {
namespace {

using L = BrickLayout;

// size of a brick of 16-bit values with its reference counts and malloc overhead, and of its entry in a table
constexpr double kBrick_bytes = sizeof(std::uint16_t) * (L::kStored + 2 * L::kSpare) + 64,
                 kPosition_bytes = 24;
// entry of the least distances in a surface's table
constexpr double kMin_bytes = 8 * sizeof(float);
// Ratio of the area of voxel faces to the smooth surface that they represent, averaged over directions.
constexpr double kFacesPerSurface = 1.5;
// mean extent of a brick along the normal of a surface in random orientation, relative to its edge
constexpr double kAlongNormal = 1.5;

// statistics of a label volume
struct LabelStatistics {
  struct Box {
    std::array<int, 3> low{std::numeric_limits<int>::max(), std::numeric_limits<int>::max(),
                           std::numeric_limits<int>::max()};
    std::array<int, 3> high{-1, -1, -1};
  };
  std::vector<double> voxels = std::vector<double>(kLabelValues, 0);
  std::vector<Box> box = std::vector<Box>(kLabelValues);
  std::map<std::pair<LabelId, LabelId>, double> faces_mm2;  // key: the smaller label first

  void observe(LabelId label, int i, int count, int j, int k) {
    voxels[label] += count;
    Box& b = box[label];
    const std::array<int, 3> first{i, j, k}, last{i + count - 1, j, k};
    for (std::size_t a = 0; a < 3; ++a) {
      b.low[a] = std::min(b.low[a], first[a]);
      b.high[a] = std::max(b.high[a], last[a]);
    }
  }
  void add(const LabelStatistics& other) {
    for (std::size_t label = 0; label < voxels.size(); ++label) {
      if (other.voxels[label] == 0) continue;
      voxels[label] += other.voxels[label];
      for (std::size_t a = 0; a < 3; ++a) {
        box[label].low[a] = std::min(box[label].low[a], other.box[label].low[a]);
        box[label].high[a] = std::max(box[label].high[a], other.box[label].high[a]);
      }
    }
    for (const auto& [pair, area] : other.faces_mm2) faces_mm2[pair] += area;
  }
};

// statistics of one slice, and of the faces towards the next
void observe_slice(const Bricks<LabelId>& labels, int k, LabelStatistics& statistics) {
  const Eigen::Vector3d& mm = labels.geometry().spacing_mm;
  const std::array<double, 3> face_mm2{mm[1] * mm[2], mm[0] * mm[2], mm[0] * mm[1]};
  constexpr std::array<std::ptrdiff_t, 3> kNext{1, L::kRow, L::kSlice};
  const auto visit_piece = [&](const RowPiece<LabelId>& piece) {
    if (piece.uniform) {
      statistics.observe(*piece.voxels, piece.i, piece.count, piece.j, k);
      return;
    }
    for (int i = 0; i < piece.count; ++i) {
      const LabelId* const here = piece.voxels + i;
      statistics.observe(*here, piece.i + i, 1, piece.j, k);
      for (std::size_t a = 0; a < 3; ++a)
        if (const LabelId there = here[kNext[a]]; there != *here)
          statistics.faces_mm2[std::minmax(*here, there)] += face_mm2[a];
    }
  };
  for (int j = 0; j < labels.geometry().dims[1]; ++j) labels.for_each_piece(j, k, visit_piece);
}

LabelStatistics label_statistics(const Bricks<LabelId>& labels) {
  const int slices = labels.geometry().dims[2], workers = worker_count(0, slices);
  std::vector<LabelStatistics> of_worker(static_cast<std::size_t>(workers));
  for_each_index(slices, workers, [&](int worker, int k) {
    observe_slice(labels, k, of_worker[static_cast<std::size_t>(worker)]);
    return true;
  });
  for (std::size_t w = 1; w < of_worker.size(); ++w) of_worker[0].add(of_worker[w]);
  return std::move(of_worker[0]);
}

// geometry of some structures together
struct Body {
  double volume_mm3 = 0, surface_mm2 = 0;
  std::array<double, 3> box{};  // in voxels along each axis, with a margin
  double box_voxels() const { return box[0] * box[1] * box[2]; }
};

// Temporary memory while threads build a box by slices (surfaces/pieces.h): slices that are not in bricks
// yet, and each thread's surroundings of its piece. The coefficients were measured on knees of 1.5 to 1007
// million voxels with two threads.
double temporary_bytes(const Body& body, const Eigen::Vector3d& spacing_mm, double margin_mm) {
  constexpr double kSlices = 24, kBorder_bytes = 6, kMaxBorder_bytes = 1300 << 20;
  const double threads = processors();
  const auto around = [&](int a, double voxels) {
    return std::min(body.box[static_cast<std::size_t>(a)], voxels) + 2 * margin_mm / spacing_mm[a];
  };
  const double surroundings_bytes =
      kBorder_bytes * around(0, body.box[0]) * around(1, body.box[1]) * around(2, kSlices);
  const double slices = std::min(body.box[2], 2 * kSlices * threads);
  return slices * body.box[0] * body.box[1] * sizeof(std::int16_t) +
         std::min(threads * surroundings_bytes, kMaxBorder_bytes);
}

// Adds the program itself and the freed memory that malloc retains: measured.
double with_heap(double bytes) {
  constexpr double kProgram_bytes = 30 << 20, kMaxRetained_bytes = 150 << 20, kRetainedFraction = 0.8;
  return bytes + kProgram_bytes + std::min(kMaxRetained_bytes, kRetainedFraction * bytes);
}

class Estimate {
 public:
  Estimate(const GridGeometry& grid, LabelStatistics statistics)
      : grid_(grid), statistics_(std::move(statistics)) {}

  Body body(const std::vector<LabelId>& structures, double margin_mm) const {
    std::vector<bool> is_member(kLabelValues, false);
    for (const LabelId label : structures) is_member[label] = true;
    Body body;
    LabelStatistics::Box box;
    for (const LabelId label : structures) {
      body.volume_mm3 += statistics_.voxels[label] * grid_.voxel_volume_mm3();
      for (std::size_t a = 0; a < 3; ++a) {
        box.low[a] = std::min(box.low[a], statistics_.box[label].low[a]);
        box.high[a] = std::max(box.high[a], statistics_.box[label].high[a]);
      }
    }
    for (const auto& [pair, area] : statistics_.faces_mm2)
      if (is_member[pair.first] != is_member[pair.second]) body.surface_mm2 += area / kFacesPerSurface;
    for (std::size_t a = 0; a < 3; ++a)
      body.box[a] =
          std::max(0, box.high[a] - box.low[a] + 1) + 2 * margin_mm / grid_.spacing_mm[static_cast<int>(a)];
    return body;
  }

  // bricks of 16-bit values that a band on both sides of a surface occupies, among `voxels` voxels of a grid
  double band_bytes(const Body& body, double voxels, const Eigen::Vector3d& spacing_mm, double inside_mm,
                    double outside_mm, double table_bytes) const {
    // the factor for a band on the inside only was measured: its surface touches fewer of the bricks
    const double brick_count = voxels / std::pow(L::kCells, 3);
    const double brick_mm3 = std::pow(L::kCells, 3) * spacing_mm.prod();
    const double edge_mm =
        (outside_mm > 0 ? 1 : 0.62) * kAlongNormal * (L::kVoxels - 1) * std::cbrt(spacing_mm.prod());
    const double inside_mm3 = std::min(body.surface_mm2 * inside_mm, body.volume_mm3);
    const double band_mm3 = inside_mm3 + body.surface_mm2 * (outside_mm + edge_mm);
    return std::min(brick_count, band_mm3 / brick_mm3) * kBrick_bytes +
           brick_count * (kPosition_bytes + table_bytes);
  }

  const GridGeometry& grid() const { return grid_; }

 private:
  GridGeometry grid_;
  LabelStatistics statistics_;
};

// ---- the proxy

struct SurfaceBytes {
  double permanent = 0, peak = 0;
};

SurfaceBytes surface_bytes(const Estimate& estimate, const std::vector<LabelId>& group,
                           const SurfaceOptions& options) {
  const Eigen::Vector3d& mm = estimate.grid().spacing_mm;
  const Body body = estimate.body(group, options.reach_mm + 1);
  // spacing of the normal's grid
  constexpr double kNormal_mm = 0.6, kBroad_mm = 2;
  const Eigen::Vector3d coarse_mm = mm.array() * (kNormal_mm / mm.array()).round().max(1);
  const double coarse_voxels = body.box_voxels() * mm.prod() / coarse_mm.prod();
  const double fine =
      estimate.band_bytes(body, body.box_voxels(), mm, options.reach_mm, options.reach_mm, kMin_bytes);
  const double coarse = estimate.band_bytes(body, coarse_voxels, coarse_mm, kBroad_mm, kBroad_mm, 0);
  // node of the net with its links and triangles; for common surfaces a voxel and its owner
  constexpr double kNode_bytes = 240, kOwned_bytes = 16;
  const double cells = kFacesPerSurface * body.surface_mm2 / std::pow(mm.prod(), 2.0 / 3);
  SurfaceBytes bytes;
  bytes.permanent = fine + coarse + (group.size() > 1 ? cells * kOwned_bytes : 0);
  // the distance in bricks and the net, plus the position
  bytes.peak = cells * kNode_bytes + 2 * fine + temporary_bytes(body, mm, options.reach_mm);
  return bytes;
}

// nodes of a SurfaceTree: twice the number of its leaf boxes
double tree_bytes(const Estimate& estimate, LabelId label) {
  constexpr double kPiece_bytes = 72;
  const Eigen::Array3d mm = estimate.grid().spacing_mm;
  const Eigen::Array3d piece_mm = mm / (mm / SurfaceTree::kPiece_mm).ceil();
  const double area_mm2 = std::pow(piece_mm.prod(), 2.0 / 3);
  return kFacesPerSurface * estimate.body({label}, 0).surface_mm2 / area_mm2 * kPiece_bytes;
}

// groups are built one after the other; labels merged for a common surface occupy bricks of their own
SurfaceBytes bytes_of_all(const Estimate& estimate, const std::vector<std::vector<LabelId>>& groups,
                          const SurfaceOptions& options, double labels) {
  SurfaceBytes all;
  for (const std::vector<LabelId>& group : groups) {
    const SurfaceBytes bytes = surface_bytes(estimate, group, options);
    all.peak = std::max(all.peak, labels + all.permanent + bytes.peak);
    all.permanent += bytes.permanent;
  }
  return all;
}

// ramps: a band inside each structure as deep as its ramp rises
FieldMemory field_memory(const Model& model, const Estimate& estimate, double ramp_width_mm) {
  const GridGeometry& grid = model.labels->geometry();
  const double voxels = static_cast<double>(grid.voxel_count());
  const double full_N = model.max_stiffness_N_per_mm() * ramp_width_mm;
  std::vector<LabelId> touchable;
  double rising_mm3 = 0, build_bytes = 0;
  for (const RampStructure& structure : ramp_structures(model, *model.labels)) {
    touchable.push_back(structure.label);
    const Body body = estimate.body({structure.label}, 0);
    const double depth_mm = std::min(full_N / structure.stiffness_N_per_mm, kDeepestRamp_mm);
    rising_mm3 += std::min(body.volume_mm3, body.surface_mm2 * depth_mm);
    // margin of the filters
    constexpr double kBeyond_mm = 8;
    build_bytes = std::max(build_bytes,
                           temporary_bytes(body, grid.spacing_mm, depth_mm + kBeyond_mm) +
                               estimate.band_bytes(body, body.box_voxels(), grid.spacing_mm, depth_mm, 0, 0));
  }
  Body all = estimate.body(touchable, 0);
  all.volume_mm3 = rising_mm3;
  const double reach_mm = all.surface_mm2 > 0 ? rising_mm3 / all.surface_mm2 : 0;
  const double field = estimate.band_bytes(all, voxels, grid.spacing_mm, reach_mm, 0, 0);
  // tiles being raised, with the depth fields of a structure and those on top of it; then the bricks
  return {static_cast<std::uint64_t>(field),
          static_cast<std::uint64_t>(with_heap(field + std::max(field, build_bytes)))};
}

}  // namespace

Result<MemoryForecast> forecast_memory(const ModelParts& parts, const ForecastOptions& options,
                                       const ModelPreparation& preparation, const Progress& progress) {
  Model model;
  model.labels = parts.labels;
  model.tissues = parts.tissues;
  model.tissue_of_label = parts.tissue_of_label;
  model.tools = parts.tools;
  const GridGeometry& grid = parts.labels->geometry();
  const Estimate estimate(grid, label_statistics(*parts.labels));
  const double labels = static_cast<double>(parts.labels->bytes());

  MemoryForecast forecast;
  FieldMemory of_field;
  if (options.field)
    of_field = field_memory(model, estimate, parts.ramp_width_mm.value_or(kUsualRampWidth_mm));
  forecast.field = of_field.permanent;
  forecast.peak_of_field = of_field.peak;
  const double field = static_cast<double>(of_field.permanent);
  double peak = 0;
  double surfaces = 0;
  // surfaces for the tool's distances that the proxy does not have, and all trees
  std::vector<LabelId> tracked = tracked_structures(parts.no_go, parts.reported_distances);
  double trees = 0;
  for (const LabelId label : tracked) trees += tree_bytes(estimate, label);
  const bool has_surfaces = options.proxy || !tracked.empty();
  const auto of_surfaces = has_surfaces ? touchable_surface_options(model.tools, grid) : SurfaceOptions();
  if (!of_surfaces) return of_surfaces.error();
  if (options.proxy) {
    const auto groups = surfaces_needed(model, preparation, progress);
    if (!groups) return groups.error();
    for (const auto& group : *groups)
      if (group.size() == 1) std::erase(tracked, group.front());
    const SurfaceBytes bytes = bytes_of_all(estimate, *groups, *of_surfaces, labels);
    peak = std::max(peak, field + bytes.peak);
    surfaces = bytes.permanent;
  }
  if (!tracked.empty()) {
    std::vector<std::vector<LabelId>> alone;
    for (const LabelId label : tracked) alone.push_back({label});
    const SurfaceBytes bytes = bytes_of_all(estimate, alone, *of_surfaces, labels);
    peak = std::max(peak, field + surfaces + bytes.peak);
    surfaces += bytes.permanent;
  }
  surfaces += trees;
  forecast.labels = parts.labels->bytes();
  forecast.surfaces = static_cast<std::uint64_t>(surfaces);
  forecast.peak =
      std::max(of_field.peak, static_cast<std::uint64_t>(with_heap(std::max(peak, field + surfaces))));
  return forecast;
}

FieldMemory memory_of_ramp_field(const Model& model) {
  const Estimate estimate(model.labels->geometry(), label_statistics(*model.labels));
  return field_memory(model, estimate, model.ramp_width_mm);
}

Result<std::uint64_t> memory_of_surfaces(const Model& model, const ModelPreparation& preparation,
                                         const Progress& progress) {
  const auto groups = surfaces_needed(model, preparation, progress);
  if (!groups) return groups.error();
  const Estimate estimate(model.labels->geometry(), label_statistics(*model.labels));
  const auto options = touchable_surface_options(model.tools, model.labels->geometry());
  if (!options) return options.error();
  const SurfaceBytes bytes =
      bytes_of_all(estimate, *groups, *options, static_cast<double>(model.labels->bytes()));
  return static_cast<std::uint64_t>(with_heap(std::max(bytes.peak, bytes.permanent)));
}

}  // namespace palpate
