#include "palpate/tissue/label_cells.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "palpate/tissue/carving.h"

namespace palpate {
namespace {

constexpr double kN_per_mm2_of_kPa = 1e-3;
/// A cell counts as rigid if less than this fraction of its solid matter is soft.
constexpr double kMinSoftPart = 0.05;

// bounding box of the images of a box's corners under a map
template <class Map>
std::pair<Eigen::Array3d, Eigen::Array3d> bounds_of(const Eigen::Array3d& low, const Eigen::Array3d& high,
                                                    const Map& map) {
  Eigen::Array3d least = Eigen::Array3d::Constant(std::numeric_limits<double>::infinity()), most = -least;
  for (unsigned corner = 0; corner < 8; ++corner) {
    Eigen::Vector3d at;
    for (int axis = 0; axis < 3; ++axis) at[axis] = (corner >> axis & 1) != 0 ? high[axis] : low[axis];
    const Eigen::Array3d there = map(at).array();
    least = least.min(there);
    most = most.max(there);
  }
  return {least, most};
}

}  // namespace

void ElasticMixture::add(const ElasticMaterial& material, int samples, double solid) {
  samples_ += samples;
  const double fraction = samples * solid;
  if (material.matter == Matter::kRigid) rigid_ += fraction;
  if (material.matter != Matter::kSoft) return;
  soft_ += fraction;
  const double e = material.youngs_modulus_kPa * kN_per_mm2_of_kPa, nu = material.poissons_ratio;
  const double mu = e / (2 * (1 + nu));
  per_mu_ += fraction / mu;
  stiffening_ += fraction * material.stiffening;
  per_confined_ += fraction * (1 - 2 * nu) / (2 * mu * (1 - nu));
}

ElasticCell ElasticMixture::cell() const {
  const double solid = soft_ + rigid_, fill = solid / samples_;
  const bool is_rigid = soft_ == 0 ? 2 * rigid_ >= samples_ : soft_ < kMinSoftPart * solid;
  if (is_rigid) return {Matter::kRigid, static_cast<float>(fill), 0, 0};
  if (!(soft_ > 0) || fill < kMinFill) return {};
  const double mu = fill * solid / per_mu_;
  const double lambda = fill * solid / per_confined_ - 2 * mu;
  return {Matter::kSoft, static_cast<float>(fill), static_cast<float>(mu), static_cast<float>(lambda),
          static_cast<float>(stiffening_ / soft_)};
}

LabelCells::LabelCells(const GridGeometry& labels, std::span<const ElasticMaterial> by_label,
                       const ElasticBox& box)
    : grid_(labels),
      by_label_(by_label.begin(), by_label.end()),
      box_(box),
      // at least two samples per voxel, so that cells of whole voxels are sampled exactly
      samples_(
          std::clamp(2 * static_cast<int>(std::ceil(box.cell_mm / labels.min_spacing_mm() - 1e-6)), 2, 16)) {
  const Transform<Voxel, Patient> X_VoxelPatient = labels.X_PatientVoxel().inverse();
  corner_ = (X_VoxelPatient * box.corner).eigen();
  const Eigen::Matrix3d voxels_per_mm = X_VoxelPatient.linear() * box.axes;
  for (int a = 0; a < 3; ++a)
    for (int n = 0; n < box.cells[a] * samples_; ++n)
      part_[a].push_back(voxels_per_mm.col(a) * ((n + 0.5) * box.cell_mm / samples_));
}

ElasticCell LabelCells::cell(const Bricks<LabelId>& labels, const Bricks<std::uint8_t>* removed, int i, int j,
                             int k) const {
  ElasticMixture mixture;
  LabelId label_of_run = 0;
  std::uint8_t removed_of_run = 0;
  int run_length = 0;
  const auto add = [&] {
    if (run_length == 0) return;
    const bool is_air = label_of_run == 0 || label_of_run >= by_label_.size();
    mixture.add(is_air ? ElasticMaterial{} : by_label_[label_of_run], run_length,
                1 - removed_of_run / kFullyRemoved);
  };
  std::array<int, 3> voxel;
  for (int c = 0; c < samples_; ++c)
    for (int b = 0; b < samples_; ++b) {
      const Eigen::Vector3d row = corner_ + part_[1][j * samples_ + b] + part_[2][k * samples_ + c];
      for (int a = 0; a < samples_; ++a) {
        const Eigen::Vector3d at = row + part_[0][i * samples_ + a];
        for (int axis = 0; axis < 3; ++axis) voxel[axis] = static_cast<int>(std::floor(at[axis] + 0.5));
        const LabelId here = labels.anywhere(voxel[0], voxel[1], voxel[2]);
        const std::uint8_t removed_here =
            removed != nullptr ? removed->anywhere(voxel[0], voxel[1], voxel[2]) : std::uint8_t{0};
        if (here != label_of_run || removed_here != removed_of_run) {
          add();
          label_of_run = here;
          removed_of_run = removed_here;
          run_length = 0;
        }
        ++run_length;
      }
    }
  add();
  return mixture.cell();
}

VoxelBox LabelCells::voxels() const {
  const auto X_VoxelPatient = grid_.X_PatientVoxel().inverse();
  const Eigen::Array3d cells(box_.cells[0], box_.cells[1], box_.cells[2]);
  const auto [low, high] =
      bounds_of(Eigen::Array3d::Zero(), cells, [&](const Eigen::Vector3d& at) -> Eigen::Vector3d {
        return (X_VoxelPatient * box_.patient(at * box_.cell_mm)).eigen();
      });
  VoxelBox box;
  for (std::size_t a = 0; a < 3; ++a) {
    const int axis = static_cast<int>(a);
    const double dim = grid_.dims[a];
    box.first[a] = static_cast<int>(std::clamp(std::floor(low[axis]), 0.0, dim));
    box.size[a] = static_cast<int>(std::clamp(std::ceil(high[axis]) + 1, 0.0, dim)) - box.first[a];
    box.size[a] = std::max(0, box.size[a]);
  }
  return box;
}

CellBox LabelCells::cells_of(const VoxelBox& voxels) const {
  const auto X_PatientVoxel = grid_.X_PatientVoxel();
  Eigen::Array3d first, end;
  for (std::size_t a = 0; a < 3; ++a) {
    first[static_cast<int>(a)] = voxels.first[a] - 0.5;
    end[static_cast<int>(a)] = voxels.first[a] + voxels.size[a] - 0.5;
  }
  const auto [low, high] = bounds_of(first, end, [&](const Eigen::Vector3d& at) -> Eigen::Vector3d {
    return box_.local_mm(X_PatientVoxel * Point<Voxel>(at)) / box_.cell_mm;
  });
  CellBox cells;
  for (int axis = 0; axis < 3; ++axis) {
    // tolerance for boundaries that rounding moves into the next cell
    constexpr double kRounding = 1e-9;
    const double largest = box_.cells[axis];
    cells.low[axis] = static_cast<int>(std::clamp(std::floor(low[axis] - kRounding), 0.0, largest));
    cells.high[axis] = static_cast<int>(std::clamp(std::ceil(high[axis] + kRounding), 0.0, largest));
  }
  return cells;
}

}  // namespace palpate
