#include "palpate/tissue/elastic_grid.h"

#include <algorithm>
#include <cmath>

#include "palpate/tissue/label_cells.h"
#include "tissue/each_cell.h"

namespace palpate {
namespace {

/// Number of constrained nodes, per direction, that fix a component of the tissue.
constexpr int kConstrainingNodes = 3;

template <class Visit>
void for_each_corner(int i, int j, int k, const Visit& visit) {
  for (int c = 0; c < 8; ++c) visit(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2 & 1));
}

}  // namespace

Result<void> check_elastic_material(const ElasticMaterial& material) {
  if (material.matter != Matter::kSoft) return {};
  const double e = material.youngs_modulus_kPa, nu = material.poissons_ratio;
  if (!(e >= kElasticModulusRange.min_kPa && e <= kElasticModulusRange.max_kPa))
    return Error{ErrorKind::kBadInput, "a Young's modulus of " + std::to_string(e) + " kPa", "",
                 "give 0.1 to 100000 kPa, or call the tissue rigid"};
  if (!(nu >= 0 && nu <= kMaxPoissonsRatio))
    return Error{ErrorKind::kBadInput, "a Poisson's ratio of " + std::to_string(nu), "", "give 0 to 0.495"};
  if (!(material.stiffening >= 0 && material.stiffening <= kMaxStiffening))
    return Error{ErrorKind::kBadInput, "a stiffening of " + std::to_string(material.stiffening), "",
                 "give 0 to 100; 0: none"};
  return {};
}

ElasticCell step_towards(const ElasticCell& from, const ElasticCell& to, double max_change) {
  if (from.matter == Matter::kRigid || to.matter == Matter::kRigid) return to;
  const double distance = static_cast<double>(to.fill) - from.fill;
  if (std::abs(distance) <= max_change) return to;
  const double fill = std::max(from.fill + (distance > 0 ? max_change : -max_change), kMinFill);
  // if the remaining change is larger, at least one of the two is soft
  const ElasticCell& solid = to.matter == Matter::kSoft ? to : from;
  const double fraction = fill / solid.fill;
  return {Matter::kSoft, static_cast<float>(fill), static_cast<float>(fraction * solid.mu),
          static_cast<float>(fraction * solid.lambda), solid.stiffening};
}

ElasticGrid::ElasticGrid(const ElasticBox& box)
    : box_(box),
      layout_(box.cells),
      mu_(layout_.cell_values() + ElasticLayout::kSpare, 0.0f),
      lambda_(mu_.size(), 0.0f),
      stiffening_(mu_.size(), 0.0f),
      fill_(mu_.size(), 0.0f),
      springs_(layout_.node_values() + ElasticLayout::kSpare, 0.0f),
      constraints_(layout_.node_values() / 3 + ElasticLayout::kSpare, kNoNode) {
  PALPATE_CHECK(box.cell_mm > 0 && *std::min_element(box.cells.begin(), box.cells.end()) >= 1);
}

ElasticCell ElasticGrid::cell(int i, int j, int k) const {
  const std::size_t n = layout_.cell(i, j, k);
  const Matter matter = mu_[n] > 0 ? Matter::kSoft : fill_[n] > 0 ? Matter::kRigid : Matter::kNone;
  return {matter, fill_[n], mu_[n], lambda_[n], stiffening_[n]};
}

bool ElasticGrid::set_cells(const CellBox& cells, const std::function<ElasticCell(int, int, int)>& made) {
  bool topology_changed = false;
  for_each_cell(cells, [&](int i, int j, int k) {
    const ElasticCell cell = made(i, j, k);
    const std::size_t n = layout_.cell(i, j, k);
    topology_changed = topology_changed || (cell.mu > 0) != (mu_[n] > 0);
    fill_[n] = cell.fill;
    mu_[n] = cell.mu;
    lambda_[n] = cell.lambda;
    stiffening_[n] = cell.stiffening;
  });
  set_springs(cells);
  return set_nodes(cells) || topology_changed;
}

// a node is constrained if any of its cells is rigid, and exists if any is soft
bool ElasticGrid::set_nodes(const CellBox& cells) {
  bool topology_changed = false;
  for_each_node(cells, [&](int i, int j, int k) {
    std::uint8_t bits = kNoNode;
    for_each_corner(i - 1, j - 1, k - 1, [&](int a, int b, int c) {
      if (!layout_.contains_cell(a, b, c)) return;
      const std::size_t n = layout_.cell(a, b, c);
      if (mu_[n] > 0) bits &= static_cast<std::uint8_t>(~kNoNode);
      if (mu_[n] == 0 && fill_[n] > 0) bits |= kFixed;
    });
    std::uint8_t& constraints = constraints_[node_number(i, j, k)];
    topology_changed = topology_changed || constraints != bits;
    constraints = bits;
  });
  return topology_changed;
}

ElasticGrid::ElasticGrid(const ElasticBox& box, const MaterialAt& material, int samples) : ElasticGrid(box) {
  PALPATE_CHECK(samples >= 1 && samples <= 16);
  set_cells(all_cells(), [&](int i, int j, int k) {
    ElasticMixture mixture;
    const auto at = [&](double x, double y, double z) {
      return material(box.patient((Eigen::Vector3d(i, j, k) + Eigen::Vector3d(x, y, z)) * box.cell_mm));
    };
    const ElasticMaterial middle = at(0.5, 0.5, 0.5);
    bool is_uniform = true;
    for (int corner = 0; corner < 8 && is_uniform; ++corner) {
      // inside the cell, not on its boundary
      const auto end = [corner](int axis) { return (corner >> axis & 1) != 0 ? 0.999 : 0.001; };
      is_uniform = at(end(0), end(1), end(2)) == middle;
    }
    const int samples_per_axis = is_uniform ? 1 : samples;
    for_each_cell({{0, 0, 0}, {samples_per_axis, samples_per_axis, samples_per_axis}}, [&](int a, int b,
                                                                                           int c) {
      const ElasticMaterial here = is_uniform ? middle
                                              : at((a + 0.5) / samples_per_axis, (b + 0.5) / samples_per_axis,
                                                   (c + 0.5) / samples_per_axis);
      PALPATE_CHECK(check_elastic_material(here).ok());
      mixture.add(here);
    });
    return mixture.cell();
  });
}

Result<ElasticGrid> ElasticGrid::of_labels(const Bricks<LabelId>& labels,
                                           std::span<const ElasticMaterial> by_label, const ElasticBox& box,
                                           const Bricks<std::uint8_t>* removed) {
  if (!(box.cell_mm > 0) || !std::isfinite(box.cell_mm))
    return Error{ErrorKind::kBadInput, "the cell size is " + std::to_string(box.cell_mm) + " mm", "",
                 "set a cell size above 0"};
  if (*std::min_element(box.cells.begin(), box.cells.end()) < 1)
    return Error{ErrorKind::kBadInput, "the box has no cells", "", "give at least one cell per axis"};
  for (const ElasticMaterial& material : by_label)
    if (const auto valid = check_elastic_material(material); !valid.ok()) return valid.error();

  const LabelCells cells(labels.geometry(), by_label, box);
  ElasticGrid made(box);
  made.set_cells(made.all_cells(), [&](int i, int j, int k) { return cells.cell(labels, removed, i, j, k); });
  return made;
}

std::size_t ElasticGrid::soft_cells() const {
  return static_cast<std::size_t>(std::count_if(mu_.begin(), mu_.end(), [](float mu) { return mu > 0; }));
}

void ElasticGrid::set_boundary_springs(const std::array<bool, 6>& faces, const Point<Patient>& about) {
  spring_faces_ = faces;
  load_point_mm_ = box_.local_mm(about);
  set_springs(all_cells());
}

void ElasticGrid::set_springs(const CellBox& cells) {
  constexpr double kAlongNormal = 2;
  bool any = false;
  for (int face = 0; face < 6; ++face)
    any = any || (spring_faces_[face] && (face % 2 == 0 ? cells.low[face / 2] == 0
                                                        : cells.high[face / 2] == layout_.cells[face / 2]));
  if (!any) return;
  for_each_node(cells, [&](int i, int j, int k) {
    for (int component = 0; component < 3; ++component) springs_[layout_.node(i, j, k, component)] = 0;
  });
  const double h = box_.cell_mm;
  for_each_cell(cells.grown(1).clipped(layout_.cells), [&](int i, int j, int k) {
    const double mu = mu_[layout_.cell(i, j, k)];
    if (mu == 0) return;
    const double nu = 0.5 - mu / (2 * (lambda_[layout_.cell(i, j, k)] + mu));
    const std::array<int, 3> cell{i, j, k};
    for (int face = 0; face < 6; ++face) {
      const int axis = face / 2, end = face % 2;
      if (!spring_faces_[face] || cell[axis] != (end == 0 ? 0 : layout_.cells[axis] - 1)) continue;
      for_each_corner(i, j, k, [&](int a, int b, int c) {
        const std::array<int, 3> node{a, b, c};
        if (node[axis] != cell[axis] + end || !cells.contains_node(a, b, c)) return;
        const Eigen::Vector3d displacement_mm = Eigen::Vector3d(a, b, c) * h - load_point_mm_;
        // closer than a cell the load's field is unknown
        const double r = std::max(displacement_mm.norm(), h);
        const double spring = 3 / (3 - 2 * nu) * mu * (h * h / 4) * std::abs(displacement_mm[axis]) / (r * r);
        for (int component = 0; component < 3; ++component)
          springs_[layout_.node(a, b, c, component)] +=
              static_cast<float>(component == axis ? kAlongNormal * spring : spring);
      });
    }
  });
}

std::size_t ElasticGrid::constrain_floating_components() {
  return FloatingComponents().constrain(*this, constraints_);
}

std::size_t ElasticGrid::FloatingComponents::constrain(const ElasticGrid& grid,
                                                       std::vector<std::uint8_t>& constraints) {
  const ElasticLayout& layout = grid.layout();
  visited_.assign(grid.mu().size(), false);
  std::size_t floating_cells = 0;
  for_each_cell(grid.all_cells(), [&](int i, int j, int k) {
    if (grid.mu()[layout.cell(i, j, k)] == 0 || visited_[layout.cell(i, j, k)]) return;
    // flood fill over cells that share faces, counting constrained nodes in each direction
    component_.assign(1, {i, j, k});
    visited_[layout.cell(i, j, k)] = true;
    std::array<int, 3> constrained_nodes{0, 0, 0};
    const auto is_constrained = [&] {
      return *std::min_element(constrained_nodes.begin(), constrained_nodes.end()) >= kConstrainingNodes;
    };
    for (std::size_t n = 0; n < component_.size(); ++n) {
      const auto [x, y, z] = component_[n];
      if (!is_constrained())
        for_each_corner(x, y, z, [&](int a, int b, int c) {
          for (int component = 0; component < 3; ++component)
            constrained_nodes[component] += (constraints[grid.node_number(a, b, c)] >> component & 1) != 0 ||
                                            grid.springs()[layout.node(a, b, c, component)] > 0;
        });
      for (int axis = 0; axis < 3; ++axis) {
        for (const int step : {-1, 1}) {
          std::array<int, 3> next = component_[n];
          next[axis] += step;
          if (!layout.contains_cell(next[0], next[1], next[2])) continue;
          const std::size_t cell = layout.cell(next[0], next[1], next[2]);
          if (grid.mu()[cell] == 0 || visited_[cell]) continue;
          visited_[cell] = true;
          component_.push_back(next);
        }
      }
    }
    if (is_constrained()) return;
    floating_cells += component_.size();
    for (const auto& [x, y, z] : component_)
      for_each_corner(x, y, z,
                      [&](int a, int b, int c) { constraints[grid.node_number(a, b, c)] |= kFixed; });
  });
  return floating_cells;
}

}  // namespace palpate
