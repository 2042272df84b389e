#include "palpate/palpation/free_path.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>

namespace palpate {
namespace {

constexpr double kCell_mm = 1.2;
// width of the free margin around the volume in cells: the air around the patient
constexpr int kMinMargin = 4;
constexpr std::uint8_t kFar = 8;  // clearance in cells beyond which the cost is constant

// cost per millimetre at this clearance
double price_of(std::uint8_t clearance) {
  return 1 + 6.0 / clearance;
}

template <class Visit>
void for_each_neighbour(const std::array<int, 3>& c, Visit visit) {
  for (int dz = -1; dz <= 1; ++dz)
    for (int dy = -1; dy <= 1; ++dy)
      for (int dx = -1; dx <= 1; ++dx)
        if (dx || dy || dz) visit(std::array<int, 3>{c[0] + dx, c[1] + dy, c[2] + dz});
}

}  // namespace

FreeSpace::FreeSpace(const Model& model, double reach_mm)
    : X_PatientVoxel_(model.labels->geometry().X_PatientVoxel()), X_VoxelPatient_(X_PatientVoxel_.inverse()) {
  const GridGeometry& grid = model.labels->geometry();
  for (int axis = 0; axis < 3; ++axis) {
    voxels_per_cell_[axis] = std::max(1, static_cast<int>(std::lround(kCell_mm / grid.spacing_mm[axis])));
    const double side_mm = voxels_per_cell_[axis] * grid.spacing_mm[axis];
    cell_mm_ = axis == 0 ? side_mm : std::min(cell_mm_, side_mm);
  }
  // at n steps there are n - 1 whole cells in between
  needed_ = static_cast<std::uint8_t>(
      std::min<double>(kFar, 1 + std::ceil(std::min(reach_mm, kMaxReach_mm) / cell_mm_)));
  margin_ = std::max(kMinMargin, static_cast<int>(needed_));
  for (int axis = 0; axis < 3; ++axis)
    cells_[axis] = (grid.dims[axis] + voxels_per_cell_[axis] - 1) / voxels_per_cell_[axis] + 2 * margin_;

  // a cell with any voxel that has contact is occupied
  clearance_.assign(static_cast<std::size_t>(cells_[0]) * cells_[1] * cells_[2], kFar);
  std::vector<Cell> front;
  model.labels->for_each_piece([&](const RowPiece<LabelId>& piece) {
    if (piece.uniform && !model.is_touchable(*piece.voxels)) return;
    for (int n = 0; n < piece.count; ++n) {
      if (piece.voxels[n] == 0 || !model.is_touchable(piece.voxels[n])) continue;
      const Cell c{(piece.i + n) / voxels_per_cell_[0] + margin_, piece.j / voxels_per_cell_[1] + margin_,
                   piece.k / voxels_per_cell_[2] + margin_};
      if (clearance_[index(c)] == 0) continue;
      clearance_[index(c)] = 0;
      front.push_back(c);
    }
  });

  // clearance in steps, by breadth-first search from the occupied cells
  for (std::uint8_t steps = 1; steps < kFar && !front.empty(); ++steps) {
    std::vector<Cell> next;
    for (const Cell& c : front)
      for_each_neighbour(c, [&](const Cell& n) {
        if (!contains(n) || clearance_[index(n)] <= steps) return;
        clearance_[index(n)] = steps;
        next.push_back(n);
      });
    front = std::move(next);
  }

  // cells connected to a corner, which is outside
  from_outside_.assign(clearance_.size(), false);
  from_outside_[0] = true;
  for (front = {Cell{0, 0, 0}}; !front.empty();) {
    const Cell c = front.back();
    front.pop_back();
    for_each_neighbour(c, [&](const Cell& n) {
      if (!contains(n) || from_outside_[index(n)] || clearance_[index(n)] < needed_) return;
      from_outside_[index(n)] = true;
      front.push_back(n);
    });
  }
}

double FreeSpace::clearance_mm(const Point<Patient>& p) const {
  const std::uint8_t steps = clearance_[index(cell_at(p))];
  return steps == 0 ? 0 : (steps - 1) * cell_mm_;
}

FreeSpace::Cell FreeSpace::cell_at(const Point<Patient>& p) const {
  const Point<Voxel> v = X_VoxelPatient_ * p;
  Cell c;
  for (int axis = 0; axis < 3; ++axis) {
    const double cell = std::floor((v[axis] + 0.5) / voxels_per_cell_[axis]) + margin_;
    c[axis] = static_cast<int>(std::clamp(cell, 0.0, cells_[axis] - 1.0));
  }
  return c;
}

Point<Patient> FreeSpace::centre(const Cell& c) const {
  Point<Voxel> v;
  for (int axis = 0; axis < 3; ++axis) v[axis] = (c[axis] - margin_ + 0.5) * voxels_per_cell_[axis] - 0.5;
  return X_PatientVoxel_ * v;
}

std::optional<FreeSpace::Cell> FreeSpace::nearest_free(const Cell& c) const {
  constexpr int kReach = 4;
  std::optional<Cell> best;
  int best_distance = std::numeric_limits<int>::max();
  for (int dz = -kReach; dz <= kReach; ++dz)
    for (int dy = -kReach; dy <= kReach; ++dy)
      for (int dx = -kReach; dx <= kReach; ++dx) {
        const Cell n{c[0] + dx, c[1] + dy, c[2] + dz};
        const int distance = dx * dx + dy * dy + dz * dz;
        if (distance >= best_distance || !contains(n) || clearance_[index(n)] < needed_) continue;
        best = n;
        best_distance = distance;
      }
  return best;
}

std::vector<Point<Patient>> FreeSpace::path(const Point<Patient>& from, const Point<Patient>& to) const {
  const auto start = nearest_free(cell_at(from)), goal = nearest_free(cell_at(to));
  if (!start || !goal) return {};

  // A*: ordered by cost so far plus a lower bound of the remaining cost (the straight line through open
  // space); ties are broken by index, so that the path is reproducible
  const auto remaining_lower_bound = [&](const Cell& c) {
    return static_cast<float>((centre(*goal) - centre(c)).norm() * price_of(kFar));
  };
  using Entry = std::pair<float, std::size_t>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  std::vector<float> cost(clearance_.size(), std::numeric_limits<float>::infinity());
  std::vector<std::uint32_t> previous(clearance_.size());
  std::vector<bool> done(clearance_.size(), false);
  const auto cell_of = [&](std::size_t i) {
    return Cell{static_cast<int>(i % cells_[0]), static_cast<int>(i / cells_[0] % cells_[1]),
                static_cast<int>(i / cells_[0] / cells_[1])};
  };
  cost[index(*start)] = 0;
  open.push({remaining_lower_bound(*start), index(*start)});
  while (!open.empty()) {
    const std::size_t here = open.top().second;
    open.pop();
    if (here == index(*goal)) break;
    if (done[here]) continue;
    done[here] = true;
    const Cell c = cell_of(here);
    const Point<Patient> p = centre(c);
    for_each_neighbour(c, [&](const Cell& n) {
      if (!contains(n)) return;
      const std::size_t there = index(n);
      if (clearance_[there] < needed_) return;
      const float total =
          cost[here] + static_cast<float>((centre(n) - p).norm() * price_of(clearance_[there]));
      if (total >= cost[there]) return;
      cost[there] = total;
      previous[there] = static_cast<std::uint32_t>(here);
      open.push({total + remaining_lower_bound(n), there});
    });
  }
  if (!std::isfinite(cost[index(*goal)])) return {};

  std::vector<Point<Patient>> corners{to};
  for (std::size_t i = index(*goal); i != index(*start); i = previous[i])
    corners.push_back(centre(cell_of(i)));
  corners.push_back(from);
  std::reverse(corners.begin(), corners.end());
  return corners;
}

}  // namespace palpate
