#include "palpate/tissue/carved_cells.h"

#include <algorithm>
#include <utility>

#include "palpate/base/check.h"
#include "palpate/tissue/carving.h"
#include "palpate/tissue/tissue_settings.h"

namespace palpate {
namespace {

ElasticGrid grid_with_springs(const CarvedLabels& labels, const std::vector<ElasticMaterial>& by_label,
                              const ElasticBox& box, const Point<Patient>& about) {
  auto grid = ElasticGrid::of_labels(*labels.original, by_label, box, labels.removed_fraction.get());
  PALPATE_CHECK(grid.ok());
  grid->set_boundary_springs({true, true, true, true, true, true}, about);
  return *std::move(grid);
}

}  // namespace

std::vector<ElasticMaterial> materials_of(const Model& model) {
  std::vector<ElasticMaterial> by_label(model.tissue_of_label.size());
  for (std::size_t label = 1; label < by_label.size(); ++label) {
    const Tissue* tissue = model.tissue_of(static_cast<LabelId>(label));
    if (tissue == nullptr || !tissue->touchable) continue;
    by_label[label] = tissue->elastic ? ElasticMaterial{Matter::kSoft, tissue->elastic->youngs_modulus_kPa,
                                                        tissue->elastic->poissons_ratio}
                                      : ElasticMaterial{Matter::kRigid};
  }
  return by_label;
}

CarvedLabels carved_labels(const Model& model) {
  if (model.carving == nullptr) return {model.labels, nullptr};
  return {model.carving->original_labels(), model.carving->removed_fraction()};
}

VoxelBox changed_voxels(const Bricks<std::uint8_t>* before, const Bricks<std::uint8_t>* now,
                        const VoxelBox& within) {
  using L = BrickLayout;
  VoxelBox none;
  if (before == now || within.voxel_count() == 0) return none;
  const Bricks<std::uint8_t>& any = before != nullptr ? *before : *now;
  const auto value = [](const Bricks<std::uint8_t>* bricks, int i, int j, int k) {
    return bricks != nullptr ? bricks->at(i, j, k) : std::uint8_t{0};
  };
  std::array<int, 3> low, high, first_brick, last_brick;
  for (std::size_t a = 0; a < 3; ++a) {
    low[a] = within.first[a] + within.size[a];
    high[a] = within.first[a];
    first_brick[a] = (within.first[a] + L::kBorder) / L::kCells;
    last_brick[a] = (within.first[a] + within.size[a] - 1 + L::kBorder) / L::kCells;
  }
  for (int c = first_brick[2]; c <= last_brick[2]; ++c)
    for (int b = first_brick[1]; b <= last_brick[1]; ++b)
      for (int a = first_brick[0]; a <= last_brick[0]; ++a) {
        const std::size_t number =
            static_cast<std::size_t>(a) +
            static_cast<std::size_t>(any.counts()[0]) *
                (static_cast<std::size_t>(b) +
                 static_cast<std::size_t>(any.counts()[1]) * static_cast<std::size_t>(c));
        if (before != nullptr && now != nullptr && before->brick(number) == now->brick(number)) continue;
        const std::array<int, 3> brick{a, b, c};
        std::array<int, 3> from, to;
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const int begin = L::kCells * brick[axis] - L::kBorder;
          from[axis] = std::max(within.first[axis], begin);
          to[axis] = std::min(within.first[axis] + within.size[axis], begin + L::kCells);
        }
        for (int k = from[2]; k < to[2]; ++k)
          for (int j = from[1]; j < to[1]; ++j)
            for (int i = from[0]; i < to[0]; ++i) {
              if (value(before, i, j, k) == value(now, i, j, k)) continue;
              const std::array<int, 3> voxel{i, j, k};
              for (std::size_t axis = 0; axis < 3; ++axis) {
                low[axis] = std::min(low[axis], voxel[axis]);
                high[axis] = std::max(high[axis], voxel[axis] + 1);
              }
            }
      }
  if (low[0] >= high[0]) return none;
  return {low, {high[0] - low[0], high[1] - low[1], high[2] - low[2]}};
}

CarvedCells::CarvedCells(CarvedLabels labels, const std::vector<ElasticMaterial>& by_label,
                         const ElasticBox& box, const Point<Patient>& about)
    : labels_(std::move(labels)),
      cells_(labels_.original->geometry(), by_label, box),
      grid_(grid_with_springs(labels_, by_label, box, about)) {}

void CarvedCells::mark_changed_cells(const CarvedLabels& labels) {
  const VoxelBox voxels =
      changed_voxels(labels_.removed_fraction.get(), labels.removed_fraction.get(), cells_.voxels());
  if (voxels.voxel_count() > 0) changing_cells_ = changing_cells_.joined(cells_.cells_of(voxels));
  labels_ = labels;
}

CellBox CarvedCells::follow(const CarvedLabels& labels, ElasticSolver& solver) {
  mark_changed_cells(labels);
  const CellBox changed = std::exchange(changing_cells_, {});
  if (changed.empty()) return changed;
  const bool topology_changed = grid_.set_cells(changed, [&](int i, int j, int k) {
    const ElasticCell target = cells_.cell(*labels_.original, labels_.removed_fraction.get(), i, j, k);
    const ElasticCell next = step_towards(grid_.cell(i, j, k), target, kSolverSettings.max_fill_change);
    if (next != target) changing_cells_ = changing_cells_.joined({{i, j, k}, {i + 1, j + 1, k + 1}});
    return next;
  });
  solver.update_cells(grid_, changed, topology_changed);
  return changed;
}

void CarvedCells::copy_overlap(const CarvedCells& other, const std::array<int, 3>& offset) {
  CellBox shared = other.changing_cells_;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    shared.low[axis] -= offset[axis];
    shared.high[axis] -= offset[axis];
  }
  shared = shared.clipped(grid_.layout().cells);
  if (shared.empty()) return;
  grid_.set_cells(shared, [&](int i, int j, int k) {
    return other.grid_.cell(i + offset[0], j + offset[1], k + offset[2]);
  });
  changing_cells_ = shared;
}

}  // namespace palpate
