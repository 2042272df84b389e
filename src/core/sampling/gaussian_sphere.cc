#include <cmath>
#include <numbers>

#include "sampling/label_sphere_query.h"

namespace palpate {

namespace {

using internal::label_sphere::GaussianTable;

constexpr int kHalfWindow = 2;
/// Entries per voxel^2 of the literal form's table, and its end beyond 3 * 2.5^2.
constexpr int kPerSquaredVoxel = 256;
constexpr int kLastSquaredDistance = 19;

std::vector<double> tabulate_over_squared_distance(double sigma) {
  const double scale = std::pow(2 * std::numbers::pi * sigma * sigma, -1.5);
  std::vector<double> table;
  for (int n = 0; n <= kLastSquaredDistance * kPerSquaredVoxel + 1; ++n) {
    table.push_back(scale * std::exp(-n / (2 * sigma * sigma * kPerSquaredVoxel)));
  }
  return table;
}

double interpolate_table(const std::vector<double>& table, double squared_distance) {
  const double table_position = squared_distance * kPerSquaredVoxel;
  const auto entry = static_cast<std::size_t>(table_position);
  return table[entry] + (table_position - static_cast<double>(entry)) * (table[entry + 1] - table[entry]);
}

/// I over the 125 voxels around `centre`, with x at an offset of `fraction` from it.
template <class T>
double evaluate(const Bricks<T>& labels, const std::vector<LabelRange>& ranges,
                const std::vector<double>& table, const std::array<int, 3>& centre,
                const Eigen::Vector3d& fraction) {
  double sum = 0;
  for (int k = -kHalfWindow; k <= kHalfWindow; ++k) {
    const double dz2 = (k - fraction[2]) * (k - fraction[2]);
    for (int j = -kHalfWindow; j <= kHalfWindow; ++j) {
      const double dyz2 = (j - fraction[1]) * (j - fraction[1]) + dz2;
      for (int i = -kHalfWindow; i <= kHalfWindow; ++i) {
        const T label = labels.anywhere(centre[0] + i, centre[1] + j, centre[2] + k);
        const bool member = std::any_of(ranges.begin(), ranges.end(), [label](const LabelRange& range) {
          return label >= range.first && label <= range.last;
        });
        if (member) sum += interpolate_table(table, (i - fraction[0]) * (i - fraction[0]) + dyz2);
      }
    }
  }
  return sum;
}

std::vector<float> tabulate_over_fraction(double sigma) {
  const double scale = 1 / (sigma * std::sqrt(2 * std::numbers::pi));
  std::vector<float> table((GaussianTable::kIntervals + 1) * GaussianTable::kStride, 0.0f);
  for (int row = 0; row <= GaussianTable::kIntervals; ++row) {
    const double fraction = static_cast<double>(row) / GaussianTable::kIntervals - 0.5;
    for (int n = -kHalfWindow; n <= kHalfWindow; ++n) {
      const double d = n - fraction;
      // after two zeros
      table[row * GaussianTable::kStride + n + kHalfWindow + 2] =
          static_cast<float>(scale * std::exp(-d * d / (2 * sigma * sigma)));
    }
  }
  return table;
}

}  // namespace

GaussianSphere::GaussianSphere(LabelVoxels voxels, double sigma_voxels)
    : voxels_(std::move(voxels)),
      sigma_voxels_(sigma_voxels),
      over_squared_distance_(tabulate_over_squared_distance(sigma_voxels)),
      over_fraction_(tabulate_over_fraction(sigma_voxels)) {}

Result<GaussianSphere> GaussianSphere::make(LabelVoxels voxels, double sigma_voxels) {
  if (!(sigma_voxels >= kMinSigmaVoxels && sigma_voxels <= kMaxSigmaVoxels)) {
    return Error{ErrorKind::kBadInput,
                 "the Gaussian sphere's sigma of " + std::to_string(sigma_voxels) +
                     " voxels does not fit its 5x5x5 voxels",
                 "", "choose a sigma of 0.5 to 2 voxels, or use the smooth sphere for a wider one"};
  }
  return GaussianSphere(std::move(voxels), sigma_voxels);
}

FieldSample GaussianSphere::sample(const Point<Patient>& x) const {
  FieldSample found;
  sample({&x, 1}, {&found, 1});
  return found;
}

void GaussianSphere::sample(std::span<const Point<Patient>> points, std::span<FieldSample> samples) const {
  internal::label_sphere::sample_sphere_at(voxels_, GaussianTable{over_fraction_.data()}, points, samples);
}

FieldSample GaussianSphere::sample_literal(const Point<Patient>& x) const {
  const Eigen::Vector3d voxel = (voxels_.X_VoxelPatient() * x).eigen();
  std::array<int, 3> centre{};
  Eigen::Vector3d fraction;
  for (int axis = 0; axis < 3; ++axis) {
    const double reach = kHalfWindow + 2;
    if (!(voxel[axis] > -reach && voxel[axis] < voxels_.geometry().dims[axis] - 1 + reach)) return {};
    centre[axis] = static_cast<int>(std::floor(voxel[axis] + 0.5));
    fraction[axis] = voxel[axis] - centre[axis];
  }

  const auto value_at = [&](const std::array<int, 3>& at) {
    return std::visit(
        [&](const auto& bricks) {
          return evaluate(*bricks, voxels_.ranges(), over_squared_distance_, at, fraction);
        },
        voxels_.storage());
  };
  // at an offset of one voxel the nearest voxel is the next one, with the same fraction
  Eigen::Vector3d gradient;
  for (int axis = 0; axis < 3; ++axis) {
    std::array<int, 3> before = centre, after = centre;
    --before[axis];
    ++after[axis];
    gradient[axis] = (value_at(after) - value_at(before)) / 2;
  }
  return {value_at(centre), Vector<Patient>(voxels_.X_VoxelPatient().linear().transpose() * gradient)};
}

}  // namespace palpate
