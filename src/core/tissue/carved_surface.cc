#include "palpate/tissue/carving.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "palpate/base/check.h"
#include "palpate/tissue/tissue_settings.h"
#include "tissue/carved_block.h"
#include "tissue/swept_voxels.h"

namespace palpate {
namespace {

using internal::Box;
using internal::CarvedBlock;
using internal::Index;
using internal::read;
using internal::Steps;
using internal::whole;

// Greatest slope in a brick's cells, per mm. The squared slope is convex along every axis, because each
// derivative is linear in the other two coordinates, so the maximum is at a corner.
double steepest_of(const Bricks<Steps>& bricks, std::size_t number, double step_mm) {
  using Layout = BrickLayout;
  if (bricks.is_uniform(number)) return 0;
  const Steps* const voxels = bricks.brick(number) + Layout::kBefore * (1 + Layout::kRow + Layout::kSlice);
  constexpr std::array<std::ptrdiff_t, 3> kStride{1, Layout::kRow, Layout::kSlice};
  const Eigen::Array3f per_step = (step_mm / bricks.geometry().spacing_mm.array()).cast<float>();
  float max_gradient = 0;
  // squared derivatives along an axis, on the four edges of a cell
  std::array<std::array<float, 4>, 3> square;
  for (int k = 0; k < Layout::kCells; ++k) {
    for (int j = 0; j < Layout::kCells; ++j) {
      for (int i = 0; i < Layout::kCells; ++i) {
        const Steps* const cell = voxels + i + j * Layout::kRow + k * Layout::kSlice;
        for (std::size_t axis = 0; axis < 3; ++axis) {
          const std::ptrdiff_t b = kStride[(axis + 1) % 3], c = kStride[(axis + 2) % 3];
          const std::array<std::ptrdiff_t, 4> edges{0, b, c, b + c};
          for (std::size_t edge = 0; edge < 4; ++edge) {
            const Steps* const end = cell + edges[edge];
            const float slope =
                static_cast<float>(end[kStride[axis]] - end[0]) * per_step[static_cast<int>(axis)];
            square[axis][edge] = slope * slope;
          }
        }
        for (std::size_t x = 0; x < 2; ++x)
          for (std::size_t y = 0; y < 2; ++y)
            for (std::size_t z = 0; z < 2; ++z)
              max_gradient =
                  std::max(max_gradient, square[0][y + 2 * z] + square[1][z + 2 * x] + square[2][x + 2 * y]);
      }
    }
  }
  // margin for rounding
  return std::sqrt(static_cast<double>(max_gradient)) * (1 + 1e-6);
}

// reduces a patch to the bounding box of the values that differ
PatchOf<Steps> cropped(const PatchOf<Steps>& patch, const Bricks<Steps>& before) {
  const Box box(Index(patch.box.first[0], patch.box.first[1], patch.box.first[2]),
                Index(patch.box.first[0], patch.box.first[1], patch.box.first[2]) +
                    Index(patch.box.size[0], patch.box.size[1], patch.box.size[2]));
  const std::vector<Steps> were = read(before, box);
  Index low = box.high(), high = box.low();
  for (int k = box.low()[2]; k < box.high()[2]; ++k)
    for (int j = box.low()[1]; j < box.high()[1]; ++j)
      for (int i = box.low()[0]; i < box.high()[0]; ++i)
        if (const std::size_t n = box.offset(i, j, k); patch.values[n] != were[n]) {
          low = low.min(Index(i, j, k));
          high = high.max(Index(i, j, k) + 1);
        }
  const Box changed(low, high);
  PatchOf<Steps> crop{changed.voxels(), {}};
  crop.values.reserve(changed.count());
  for (int k = changed.low()[2]; k < changed.high()[2]; ++k)
    for (int j = changed.low()[1]; j < changed.high()[1]; ++j)
      for (int i = changed.low()[0]; i < changed.high()[0]; ++i)
        crop.values.push_back(patch.values[box.offset(i, j, k)]);
  return crop;
}

/// Normal field where a box of the position has changed.
PatchOf<Steps> normal_of(const Surface& original, const SignedField& position, const VoxelBox& changed) {
  const SignedField& normal = original.normal_field();
  const auto X_PatientVoxel = position.geometry().X_PatientVoxel();
  Eigen::Array3d low = Eigen::Array3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (unsigned corner = 0; corner < 8; ++corner) {
    std::array<double, 3> at;
    for (unsigned axis = 0; axis < 3; ++axis)
      at[axis] =
          (corner >> axis & 1) != 0 ? changed.first[axis] + changed.size[axis] : changed.first[axis] - 1;
    const Eigen::Array3d voxel =
        (normal.X_VoxelPatient() * (X_PatientVoxel * Point<Voxel>(at[0], at[1], at[2]))).eigen().array();
    low = low.min(voxel);
    high = high.max(voxel);
  }
  const Box box = Box(low.floor().cast<int>(), high.ceil().cast<int>() + 1).clipped(whole(normal.geometry()));
  const std::vector<Steps> prepared = read(normal.bricks(), box);
  const auto X_PatientNormal = normal.geometry().X_PatientVoxel();
  PatchOf<Steps> patch{box.voxels(), {}};
  patch.values.reserve(box.count());
  std::size_t n = 0;
  for (int k = box.low()[2]; k < box.high()[2]; ++k) {
    for (int j = box.low()[1]; j < box.high()[1]; ++j) {
      for (int i = box.low()[0]; i < box.high()[0]; ++i, ++n) {
        const Point<Patient> at = X_PatientNormal * Point<Voxel>(i, j, k);
        const double now = sample_value(position, at),
                     moved = now - sample_value(original.distance_field(), at);
        const double fraction = std::min(1.0, std::abs(moved) / kCuttingSettings.stale_normal_mm);
        const double was = normal.steps().offset + normal.steps().scale * prepared[n];
        const double steps = (was + fraction * (now - was) - normal.steps().offset) / normal.steps().scale;
        patch.values.push_back(fraction == 0
                                   ? prepared[n]
                                   : static_cast<Steps>(std::lround(std::clamp(steps, -32767.0, 32767.0))));
      }
    }
  }
  return patch;
}

// maximum clearance error along a sweep, where it removed material
double sweep_clearance_error_mm(const Surface& original, const Surface& now, const Sweep& sweep) {
  double clearance_error_mm = 0;
  for_balls_of(sweep, 0.5 * original.distance_field().geometry().min_spacing_mm(),
               [&](const Point<Patient>& at, double radius_mm) {
                 if (original.distance_mm(at) < radius_mm)
                   clearance_error_mm = std::max(clearance_error_mm, radius_mm - now.distance_mm(at));
               });
  return clearance_error_mm;
}

}  // namespace

CarvedSurface::CarvedSurface(std::shared_ptr<const Surface> original,
                             std::vector<std::shared_ptr<const Surface>> protected_surfaces)
    : original_(std::move(original)),
      now_(original_),
      protected_surfaces_(std::move(protected_surfaces)),
      cut_(original_->distance_field().geometry(),
           static_cast<Steps>(-original_->distance_field().steps().outside)) {
  PALPATE_CHECK(original_->distance_field().steps().offset == 0);
  const std::array<int, 3>& bricks = cut_.counts();
  max_gradient_.resize(static_cast<std::size_t>(bricks[0]) * static_cast<std::size_t>(bricks[1]) *
                       static_cast<std::size_t>(bricks[2]));
}

CarvedSurface CarvedSurface::with(std::span<const Sweep> sweeps) const {
  CarvedSurface next = *this;
  const SignedField& position = now_->distance_field();
  CarvedBlock carved(original_->distance_field(), position.bricks(), cut_, sweeps, protected_surfaces_);
  if (carved.empty()) return next;
  next.cut_ = cut_.with(cropped(carved.cut(), cut_));
  const PatchOf<Steps> patch = cropped(carved.position(), position.bricks());
  if (patch.values.empty()) return next;

  const SignedField moved = position.with(patch);
  double max_gradient = original_->max_gradient();
  const Bricks<Steps>&was = position.bricks(), &is = moved.bricks();
  for (std::size_t brick = 0; brick < max_gradient_.size(); ++brick) {
    if (is.brick(brick) != was.brick(brick))
      next.max_gradient_[brick] = steepest_of(is, brick, moved.steps().scale);
    max_gradient = std::max(max_gradient, next.max_gradient_[brick]);
  }
  next.now_ = std::make_shared<const Surface>(
      now_->with(patch, normal_of(*original_, moved, patch.box), max_gradient));
  for (const Sweep& sweep : sweeps)
    next.clearance_error_mm_ =
        std::max(next.clearance_error_mm_, sweep_clearance_error_mm(*original_, *next.now_, sweep));
  return next;
}

}  // namespace palpate
