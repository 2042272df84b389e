#include "palpate/tissue/yielded_tissue.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "palpate/base/cube_root.h"
#include "palpate/tissue/chain_mail.h"
#include "palpate/tissue/elastic_contact.h"
#include "palpate/tissue/elastic_solver.h"
#include "tissue/yield_cells.h"

namespace palpate {
namespace {

// a stiff nodule takes longest (docs/decisions/0034)
constexpr int kMostIterations = 60;
constexpr double kConverged = 1e-4;

// Empty nodes go along so far from tissue: a slope of a third at most, by which nothing is folded.
constexpr double kCarriedPerMoved = 3;
constexpr int kLeastCarried = 4, kMostCarried = 24;

// The cell that a place lies in, in steps of cells, and the part of the way to the next.
struct Within {
  int low[3];
  double part[3];

  /// @param last  of nodes, or of cells by their middles
  Within(const Eigen::Vector3d& at, const std::array<int, 3>& last) {
    for (int axis = 0; axis < 3; ++axis) {
      const double within = std::clamp(at[axis], 0.0, static_cast<double>(last[axis]));
      low[axis] = std::min(static_cast<int>(within), std::max(last[axis] - 1, 0));
      part[axis] = within - low[axis];
    }
  }
  template <class Visit>
  void corners(Visit&& visit) const {
    for (int c = 0; c < 8; ++c) {
      double weight = 1;
      int at[3];
      for (int axis = 0; axis < 3; ++axis) {
        const int up = (c >> axis) & 1;
        at[axis] = low[axis] + up;
        weight *= up != 0 ? part[axis] : 1 - part[axis];
      }
      if (weight > 0) visit(at[0], at[1], at[2], weight);
    }
  }
};

}  // namespace

YieldedTissue::YieldedTissue(const Model& model, const TickRecord& felt) {
  if (model.labels == nullptr) return;
  if (is_elastic(model.tissue_law)) solve(model, felt);
  if (model.tissue_law == TissueLaw::kChainMail) move(model, felt);
}

void YieldedTissue::move(const Model& model, const TickRecord& felt) {
  constexpr int kPasses = 64;  // as a second of frames
  const std::vector<ElasticMaterial> by_label = materials_of(model);
  for (std::size_t d = 0; d < kMaxDevices; ++d) {
    Dent dent;
    if (!find_dent(model, felt, d, dent)) continue;
    const std::array<int, 3> first = first_cell_around(model, middle_below(model, dent.at, dent.outward));
    const CarvedCells cells = yield_cells(model, by_label, {first, dent.at});
    ChainMail mail(cells.grid());
    mail.press(dent);
    mail.relax(kPasses);
    parts_.emplace_back(cells.grid(), mail.moved_mm(), 1);
  }
}

void YieldedTissue::solve(const Model& model, const TickRecord& felt) {
  const std::vector<ElasticMaterial> by_label = materials_of(model);
  for (std::size_t d = 0; d < kMaxDevices; ++d) {
    Dent press;
    const double pressed_N = felt.device[d].contact_N[0];  // its tissue's patch alone
    if (!find_dent(model, felt, d, press) || !(pressed_N > 0 && std::isfinite(pressed_N))) continue;
    const std::array<int, 3> first = first_cell_around(model, middle_below(model, press.at, press.outward));
    const CarvedCells cells = yield_cells(model, by_label, {first, press.at});
    const ElasticGrid& grid = cells.grid();
    const double cell_mm = grid.box().cell_mm, least_mm = kSolvingFeel.least_patch_cells * cell_mm;
    const double modulus = PressurePatch(grid, press.at, press.outward, least_mm).contact_modulus();
    if (!(modulus > 0)) continue;
    const double touched_mm = cube_root(0.75 * pressed_N * press.radius_mm / modulus);
    const double rho_mm = std::clamp(touched_mm, least_mm, kMostPatchPart * grid.box().cells[1] * cell_mm);
    const PressurePatch patch(grid, press.at, press.outward, rho_mm);
    if (!patch.touches()) continue;
    ElasticField unit_mm(grid.layout()), load_N(grid.layout());
    patch.add(1, load_N);
    ElasticSolver(grid).solve(load_N, unit_mm, kMostIterations, kConverged);
    double force_N = pressed_N;
    if (model.relaxation_times.any()) {
      YieldSpot spot;
      spot.compliance_mm_per_N = patch.displacement(unit_mm);
      spot.modulus_N_per_mm2 = patch.contact_modulus();
      spot.patch_radius_mm = rho_mm;
      force_N = displacing_at_once_N(felt.device[d], tissue_at(spot), press.radius_mm);
    }
    parts_.emplace_back(grid, unit_mm, force_N);
  }
}

Vector<Patient> YieldedTissue::moved_mm(const Point<Patient>& at_rest) const {
  Vector<Patient> moved;
  for (const Part& part : parts_) part.add_moved(at_rest, moved);
  return moved;
}

double YieldedTissue::strain(const Point<Patient>& at_rest) const {
  Eigen::Matrix3d slope = Eigen::Matrix3d::Zero();
  bool known = false;
  for (const Part& part : parts_) known = part.add_slope(at_rest, slope) || known;
  if (!known) return std::numeric_limits<double>::quiet_NaN();
  const Eigen::Matrix3d gradient = Eigen::Matrix3d::Identity() + slope;
  // turned inside out is more than anything
  if (!(gradient.determinant() > 0)) return std::numeric_limits<double>::infinity();
  const Eigen::Matrix3d back = gradient.inverse();
  Eigen::Matrix3d e = 0.5 * (Eigen::Matrix3d::Identity() - back.transpose() * back);
  e -= Eigen::Matrix3d::Identity() * (e.trace() / 3);
  return std::sqrt(e.squaredNorm() / 1.5);
}

YieldedTissue::Part::Part(const ElasticGrid& grid, const ElasticField& unit_mm, double force_N)
    : box_(grid.box()) {
  const auto& cells = box_.cells;
  moved_mm_.resize(node(0, 0, cells[2] + 1));
  for (int k = 0; k <= cells[2]; ++k)
    for (int j = 0; j <= cells[1]; ++j)
      for (int i = 0; i <= cells[0]; ++i)
        for (int c = 0; c < 3; ++c)
          moved_mm_[node(i, j, k)][c] =
              static_cast<float>(force_N * unit_mm.values[grid.layout().node(i, j, k, c)]);
  continue_into_what_is_empty(grid);
  find_slopes(grid);
}

// A layer of empty nodes after the other takes the mean of its neighbours, less from layer to layer.
void YieldedTissue::Part::continue_into_what_is_empty(const ElasticGrid& grid) {
  const auto& cells = box_.cells;
  float most_mm = 0;
  for (const Eigen::Vector3f& moved : moved_mm_) most_mm = std::max(most_mm, moved.norm());
  const int layers = std::clamp(static_cast<int>(std::ceil(kCarriedPerMoved * most_mm / box_.cell_mm)),
                                kLeastCarried, kMostCarried);
  struct Node {
    int i, j, k;
  };
  std::vector<bool> known(moved_mm_.size());
  std::vector<Node> edge;
  for (int k = 0; k <= cells[2]; ++k)
    for (int j = 0; j <= cells[1]; ++j)
      for (int i = 0; i <= cells[0]; ++i) {
        if ((grid.held(i, j, k) & ElasticGrid::kNoNode) != 0) continue;
        known[node(i, j, k)] = true;
        edge.push_back({i, j, k});
      }
  std::vector<Eigen::Vector3f> whole_mm = moved_mm_;
  std::vector<int> neighbours(moved_mm_.size());
  for (int layer = 0; layer < layers && !edge.empty(); ++layer) {
    std::vector<Node> next;
    for (const Node& from : edge)
      for (int c = 0; c < 27; ++c) {
        const Node to{from.i + c % 3 - 1, from.j + c / 3 % 3 - 1, from.k + c / 9 - 1};
        if (to.i < 0 || to.j < 0 || to.k < 0 || to.i > cells[0] || to.j > cells[1] || to.k > cells[2])
          continue;
        const std::size_t n = node(to.i, to.j, to.k);
        if (known[n]) continue;
        if (neighbours[n]++ == 0) next.push_back(to);
        whole_mm[n] += whole_mm[node(from.i, from.j, from.k)];
      }
    const float share = 1 - static_cast<float>(layer + 1) / static_cast<float>(layers + 1);
    for (const Node& at : next) {
      const std::size_t n = node(at.i, at.j, at.k);
      known[n] = true;
      whole_mm[n] /= static_cast<float>(neighbours[n]);
      moved_mm_[n] = share * whole_mm[n];
    }
    edge = std::move(next);
  }
}

// As the solver's cells have it: from the differences of their corners (tissue.md, "What is solved").
void YieldedTissue::Part::find_slopes(const ElasticGrid& grid) {
  const auto& cells = box_.cells;
  slope_.resize(cell(0, 0, cells[2]), Eigen::Matrix3f::Zero());
  is_tissue_.resize(slope_.size());
  const float per_mm = static_cast<float>(0.25 / box_.cell_mm);
  for (int k = 0; k < cells[2]; ++k)
    for (int j = 0; j < cells[1]; ++j)
      for (int i = 0; i < cells[0]; ++i) {
        if (!(grid.fill()[grid.layout().cell(i, j, k)] > 0)) continue;
        const std::size_t n = cell(i, j, k);
        is_tissue_[n] = true;
        for (int c = 0; c < 8; ++c) {
          const int up[3] = {c & 1, (c >> 1) & 1, c >> 2};
          const Eigen::Vector3f& moved = moved_mm_[node(i + up[0], j + up[1], k + up[2])];
          for (int axis = 0; axis < 3; ++axis)
            slope_[n].col(axis) += (up[axis] != 0 ? per_mm : -per_mm) * moved;
        }
      }
}

void YieldedTissue::Part::add_moved(const Point<Patient>& at_rest, Vector<Patient>& to_mm) const {
  const Eigen::Vector3d in_cells = box_.local_mm(at_rest) / box_.cell_mm;
  double share = 1;
  for (int axis = 0; axis < 3; ++axis) {
    const double beyond = std::max({-in_cells[axis], in_cells[axis] - box_.cells[axis], 0.0}) / kFadeCells;
    // what is not finite, too
    if (!(beyond < 1)) return;
    share *= 1 - beyond;
  }
  Eigen::Vector3d moved = Eigen::Vector3d::Zero();
  Within(in_cells, box_.cells).corners([&](int i, int j, int k, double weight) {
    moved += weight * moved_mm_[node(i, j, k)].cast<double>();
  });
  to_mm += Vector<Patient>(box_.axes * moved) * share;
}

bool YieldedTissue::Part::add_slope(const Point<Patient>& at_rest, Eigen::Matrix3d& to) const {
  const Eigen::Vector3d in_cells = box_.local_mm(at_rest) / box_.cell_mm;
  for (int axis = 0; axis < 3; ++axis)
    if (!(in_cells[axis] > 0 && in_cells[axis] < box_.cells[axis])) return false;
  const std::array<int, 3> last{box_.cells[0] - 1, box_.cells[1] - 1, box_.cells[2] - 1};
  Eigen::Matrix3d slope = Eigen::Matrix3d::Zero();
  double known = 0;
  Within(in_cells - Eigen::Vector3d::Constant(0.5), last).corners([&](int i, int j, int k, double weight) {
    if (!is_tissue_[cell(i, j, k)]) return;
    slope += weight * slope_[cell(i, j, k)].cast<double>();
    known += weight;
  });
  if (!(known > 0)) return false;
  to += box_.axes * slope * box_.axes.transpose() / known;
  return true;
}

}  // namespace palpate
