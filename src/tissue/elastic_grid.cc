#include "palpate/tissue/elastic_grid.h"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double kN_per_mm2_of_kPa = 1e-3;
/// Less of a cell is nothing: its nodes would hang on next to no stiffness.
constexpr double kLeastFill = 0.02;
/// What yields is so little of a cell's solid matter that the cell does not.
constexpr double kLeastSoftPart = 0.05;
/// So many nodes hold a part of the tissue, in each direction.
constexpr int kHoldingNodes = 3;

template <class Visit>
void for_each_cell(const std::array<int, 3>& cells, const Visit& visit) {
  for (int k = 0; k < cells[2]; ++k)
    for (int j = 0; j < cells[1]; ++j)
      for (int i = 0; i < cells[0]; ++i) visit(i, j, k);
}

template <class Visit>
void for_each_corner(int i, int j, int k, const Visit& visit) {
  for (int c = 0; c < 8; ++c) visit(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2 & 1));
}

}  // namespace

/// What the samples of a cell say.
class ElasticGrid::Mixture {
 public:
  void add(const ElasticMaterial& material, int times = 1) {
    samples_ += times;
    if (material.matter == Matter::kRigid) rigid_ += times;
    if (material.matter != Matter::kSoft) return;
    soft_ += times;
    const double e = material.youngs_modulus_kPa * kN_per_mm2_of_kPa, nu = material.poissons_ratio;
    const double mu = e / (2 * (1 + nu));
    per_mu_ += times / mu;
    per_confined_ += times * (1 - 2 * nu) / (2 * mu * (1 - nu));
  }

  double fill() const { return static_cast<double>(soft_ + rigid_) / samples_; }
  bool rigid() const {
    return soft_ == 0 ? 2 * rigid_ >= samples_ : soft_ < kLeastSoftPart * (soft_ + rigid_);
  }
  bool soft() const { return soft_ > 0 && !rigid() && fill() >= kLeastFill; }
  double mu() const { return fill() * (soft_ + rigid_) / per_mu_; }
  double lambda() const { return fill() * (soft_ + rigid_) / per_confined_ - 2 * mu(); }

 private:
  int samples_ = 0, rigid_ = 0, soft_ = 0;
  double per_mu_ = 0, per_confined_ = 0;
};

Result<void> check_elastic_material(const ElasticMaterial& material) {
  if (material.matter != Matter::kSoft) return {};
  const double e = material.youngs_modulus_kPa, nu = material.poissons_ratio;
  if (!(e >= kElasticModulusRange.min_kPa && e <= kElasticModulusRange.max_kPa))
    return Error{ErrorKind::kBadInput, "a Young's modulus of " + std::to_string(e) + " kPa", "",
                 "give 0.1 to 100000 kPa, or call the tissue rigid"};
  if (!(nu >= 0 && nu <= kMostPoissonsRatio))
    return Error{ErrorKind::kBadInput, "a Poisson's ratio of " + std::to_string(nu), "", "give 0 to 0.495"};
  return {};
}

ElasticGrid::ElasticGrid(const ElasticBox& box)
    : box_(box),
      layout_(box.cells),
      mu_(layout_.cell_values() + ElasticLayout::kSpare, 0.0f),
      lambda_(mu_.size(), 0.0f),
      fill_(mu_.size(), 0.0f),
      springs_(layout_.node_values() + ElasticLayout::kSpare, 0.0f),
      held_(layout_.node_values() / 3 + ElasticLayout::kSpare, kNoNode) {
  PALPATE_CHECK(box.cell_mm > 0 && *std::min_element(box.cells.begin(), box.cells.end()) >= 1);
}

void ElasticGrid::set_cell(int i, int j, int k, const Mixture& mixture) {
  const std::size_t cell = layout_.cell(i, j, k);
  const auto change_corners = [&](auto change) {
    for_each_corner(i, j, k, [&](int a, int b, int c) { change(held_[node_number(a, b, c)]); });
  };
  if (mixture.soft()) {
    fill_[cell] = static_cast<float>(mixture.fill());
    mu_[cell] = static_cast<float>(mixture.mu());
    lambda_[cell] = static_cast<float>(mixture.lambda());
    change_corners([](std::uint8_t& bits) { bits &= static_cast<std::uint8_t>(~kNoNode); });
  } else if (mixture.rigid()) {
    fill_[cell] = static_cast<float>(mixture.fill());
    change_corners([](std::uint8_t& bits) { bits |= kHeld; });
  }
}

ElasticGrid::ElasticGrid(const ElasticBox& box, const MaterialAt& material, int samples) : ElasticGrid(box) {
  PALPATE_CHECK(samples >= 1 && samples <= 16);
  for_each_cell(box.cells, [&](int i, int j, int k) {
    Mixture mixture;
    const auto at = [&](double x, double y, double z) {
      return material(box.patient((Eigen::Vector3d(i, j, k) + Eigen::Vector3d(x, y, z)) * box.cell_mm));
    };
    const ElasticMaterial middle = at(0.5, 0.5, 0.5);
    bool alike = true;
    for (int corner = 0; corner < 8 && alike; ++corner) {
      // within the cell, not on its border
      const auto end = [corner](int axis) { return (corner >> axis & 1) != 0 ? 0.999 : 0.001; };
      alike = at(end(0), end(1), end(2)) == middle;
    }
    const int along = alike ? 1 : samples;
    for_each_cell({along, along, along}, [&](int a, int b, int c) {
      const ElasticMaterial here =
          alike ? middle : at((a + 0.5) / along, (b + 0.5) / along, (c + 0.5) / along);
      PALPATE_CHECK(check_elastic_material(here).ok());
      mixture.add(here);
    });
    set_cell(i, j, k, mixture);
  });
}

ElasticBox elastic_box_of(const GridGeometry& grid, const VoxelBox& region, double cell_mm) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(grid.direction, Eigen::ComputeFullU | Eigen::ComputeFullV);
  ElasticBox box;
  box.axes = svd.matrixU() * svd.matrixV().transpose();
  box.cell_mm = cell_mm;
  Point<Voxel> corner;
  for (int a = 0; a < 3; ++a) {
    corner[a] = region.first[a] - 0.5;
    // a last sliver that no voxel's middle lies in is none
    if (cell_mm > 0)
      box.cells[a] = static_cast<int>(std::ceil(region.size[a] * grid.spacing_mm[a] / cell_mm - 1e-6));
  }
  box.corner = grid.X_PatientVoxel() * corner;
  return box;
}

Result<ElasticGrid> ElasticGrid::of_labels(const Bricks<LabelId>& labels,
                                           std::span<const ElasticMaterial> by_label, const ElasticBox& box) {
  if (!(box.cell_mm > 0) || !std::isfinite(box.cell_mm))
    return Error{ErrorKind::kBadInput, "cells of " + std::to_string(box.cell_mm) + " mm", "",
                 "give more than 0"};
  if (*std::min_element(box.cells.begin(), box.cells.end()) < 1)
    return Error{ErrorKind::kBadInput, "a box without cells", "", ""};
  for (const ElasticMaterial& material : by_label)
    if (const auto right = check_elastic_material(material); !right.ok()) return right.error();

  const GridGeometry& grid = labels.geometry();
  // two samples in each voxel at least, so that cells of whole voxels are known exactly
  const int samples =
      std::clamp(2 * static_cast<int>(std::ceil(box.cell_mm / grid.min_spacing_mm() - 1e-6)), 2, 16);
  // the voxel of a place is a sum of three parts, one for each axis of the box
  const Transform<Voxel, Patient> X_VoxelPatient = grid.X_PatientVoxel().inverse();
  const Point<Voxel> corner = X_VoxelPatient * box.corner;
  const Eigen::Matrix3d voxels_per_mm = X_VoxelPatient.linear() * box.axes;
  std::array<std::vector<Eigen::Vector3d>, 3> part;
  for (int a = 0; a < 3; ++a)
    for (int n = 0; n < box.cells[a] * samples; ++n)
      part[a].push_back(voxels_per_mm.col(a) * ((n + 0.5) * box.cell_mm / samples));

  ElasticGrid made(box);
  std::array<int, 3> voxel;
  for_each_cell(box.cells, [&](int i, int j, int k) {
    Mixture mixture;
    LabelId label = 0;
    int times = 0;
    const auto add = [&] {
      if (times > 0)
        mixture.add(label < by_label.size() && label > 0 ? by_label[label] : ElasticMaterial{}, times);
    };
    for (int c = 0; c < samples; ++c)
      for (int b = 0; b < samples; ++b) {
        const Eigen::Vector3d row = corner.eigen() + part[1][j * samples + b] + part[2][k * samples + c];
        for (int a = 0; a < samples; ++a) {
          const Eigen::Vector3d at = row + part[0][i * samples + a];
          for (int axis = 0; axis < 3; ++axis) voxel[axis] = static_cast<int>(std::floor(at[axis] + 0.5));
          const LabelId here = labels.anywhere(voxel[0], voxel[1], voxel[2]);
          if (here != label) {
            add();
            label = here;
            times = 0;
          }
          ++times;
        }
      }
    add();
    made.set_cell(i, j, k, mixture);
  });
  return made;
}

std::size_t ElasticGrid::soft_cells() const {
  return static_cast<std::size_t>(std::count_if(mu_.begin(), mu_.end(), [](float mu) { return mu > 0; }));
}

void ElasticGrid::continue_beyond(const std::array<bool, 6>& faces, const Point<Patient>& about) {
  constexpr double kAlongNormal = 2;
  const double h = box_.cell_mm;
  const Eigen::Vector3d about_mm = box_.local_mm(about);
  for_each_cell(layout_.cells, [&](int i, int j, int k) {
    const double mu = mu_[layout_.cell(i, j, k)];
    if (mu == 0) return;
    const double nu = 0.5 - mu / (2 * (lambda_[layout_.cell(i, j, k)] + mu));
    const std::array<int, 3> cell{i, j, k};
    for (int face = 0; face < 6; ++face) {
      const int axis = face / 2, end = face % 2;
      if (!faces[face] || cell[axis] != (end == 0 ? 0 : layout_.cells[axis] - 1)) continue;
      for_each_corner(i, j, k, [&](int a, int b, int c) {
        const std::array<int, 3> node{a, b, c};
        if (node[axis] != cell[axis] + end) return;
        const Eigen::Vector3d way_mm = Eigen::Vector3d(a, b, c) * h - about_mm;
        // nearer than a cell no field of a load is known
        const double r = std::max(way_mm.norm(), h);
        const double spring = 3 / (3 - 2 * nu) * mu * (h * h / 4) * std::abs(way_mm[axis]) / (r * r);
        for (int component = 0; component < 3; ++component)
          springs_[layout_.node(a, b, c, component)] +=
              static_cast<float>(component == axis ? kAlongNormal * spring : spring);
      });
    }
  });
}

std::size_t ElasticGrid::hold_loose_parts() {
  std::vector<bool> seen(mu_.size(), false);
  std::vector<std::array<int, 3>> part;
  std::size_t loose = 0;
  for_each_cell(layout_.cells, [&](int i, int j, int k) {
    if (mu_[layout_.cell(i, j, k)] == 0 || seen[layout_.cell(i, j, k)]) return;
    // the cells that hang together by faces, and how often a node of them is held in each direction
    part.assign(1, {i, j, k});
    seen[layout_.cell(i, j, k)] = true;
    std::array<int, 3> held{0, 0, 0};
    for (std::size_t n = 0; n < part.size(); ++n) {
      const auto [x, y, z] = part[n];
      for_each_corner(x, y, z, [&](int a, int b, int c) {
        for (int component = 0; component < 3; ++component)
          held[component] += (held_[node_number(a, b, c)] >> component & 1) != 0 ||
                             springs_[layout_.node(a, b, c, component)] > 0;
      });
      for (int axis = 0; axis < 3; ++axis) {
        for (const int step : {-1, 1}) {
          std::array<int, 3> next = part[n];
          next[axis] += step;
          if (!layout_.contains_cell(next[0], next[1], next[2])) continue;
          const std::size_t cell = layout_.cell(next[0], next[1], next[2]);
          if (mu_[cell] == 0 || seen[cell]) continue;
          seen[cell] = true;
          part.push_back(next);
        }
      }
    }
    if (*std::min_element(held.begin(), held.end()) >= kHoldingNodes) return;
    loose += part.size();
    for (const auto& [x, y, z] : part)
      for_each_corner(x, y, z, [&](int a, int b, int c) { held_[node_number(a, b, c)] |= kHeld; });
  });
  return loose;
}

}  // namespace palpate
