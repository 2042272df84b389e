#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/tissue/carving.h"
#include "palpate/tissue/tissue_settings.h"
#include "tissue/swept_voxels.h"

/// Distance field of a surface around the material that sweeps remove, in a box of the field's grid.
namespace palpate::internal {

using Steps = std::int16_t;
using Index = Eigen::Array3i;

/// Range of voxels of a grid.
class Box {
 public:
  Box(const Index& low, const Index& high) : low_(low), size_((high - low).max(0)) {}

  const Index& low() const { return low_; }
  Index high() const { return low_ + size_; }
  const Index& size() const { return size_; }
  bool empty() const { return (size_ == 0).any(); }
  std::size_t count() const { return empty() ? 0 : static_cast<std::size_t>(size_.cast<long>().prod()); }
  Box grown(const Index& by) const { return {low_ - by, high() + by}; }
  Box clipped(const Box& to) const { return {low_.max(to.low_), high().min(to.high())}; }
  std::size_t offset(int i, int j, int k) const {
    return (static_cast<std::size_t>(k - low_[2]) * static_cast<std::size_t>(size_[1]) +
            static_cast<std::size_t>(j - low_[1])) *
               static_cast<std::size_t>(size_[0]) +
           static_cast<std::size_t>(i - low_[0]);
  }
  VoxelBox voxels() const { return {{low_[0], low_[1], low_[2]}, {size_[0], size_[1], size_[2]}}; }

 private:
  Index low_, size_;
};

inline Box whole(const GridGeometry& grid) {
  return {Index::Zero(), Index(grid.dims[0], grid.dims[1], grid.dims[2])};
}

inline std::vector<Steps> read(const Bricks<Steps>& bricks, const Box& box) {
  std::vector<Steps> values(box.count());
  if (box.empty()) return values;
  for (int k = box.low()[2]; k < box.high()[2]; ++k)
    for (int j = box.low()[1]; j < box.high()[1]; ++j)
      bricks.copy_row(box.low()[0], j, k, box.size()[0], &values[box.offset(box.low()[0], j, k)]);
  return values;
}

// voxels within `within_mm` of the centres of a sweep's balls
inline Box around(const Sweep& sweep, double within_mm, const GridGeometry& grid,
                  const Transform<Voxel, Patient>& X_VoxelPatient) {
  const auto [least, greatest] = centre_bounds(sweep, X_VoxelPatient);
  const Eigen::Array3d reach = within_mm / grid.spacing_mm.array();
  // clamped: a sweep far outside the grid has the same effect as one just outside
  const Eigen::Array3d most = Eigen::Array3d(grid.dims[0], grid.dims[1], grid.dims[2]) + 1;
  const Eigen::Array3d low = (least - reach).floor().max(-1).min(most);
  const Eigen::Array3d high = (greatest + reach).ceil().max(-1).min(most) + 1;
  return {low.cast<int>(), high.cast<int>()};
}

/// Voxels near a surface, with their signed distances (negative inside).
class NearSurfaceVoxels {
  // Eigen expression; bit-identical for any SIMD width, because roots and sums are rounded exactly.
  auto distances_mm(const Eigen::Array3f& at_mm) const {
    return ((voxels_.col(0) - at_mm[0]).square() + (voxels_.col(1) - at_mm[1]).square() +
            (voxels_.col(2) - at_mm[2]).square())
               .sqrt() +
           voxels_.col(3);
  }

 public:
  /// Least sum of a stored voxel's distance from `at_mm` and its own distance to the surface.
  float distance_mm(const Eigen::Array3f& at_mm) const {
    return size() == 0 ? std::numeric_limits<float>::infinity() : distances_mm(at_mm).minCoeff();
  }
  /// Subset that can contain the minimum for any point within `radius_mm` of `at_mm`, if the minimum is below
  /// `max_mm` there.
  NearSurfaceVoxels near(const Eigen::Array3f& at_mm, float radius_mm, float max_mm) const {
    NearSurfaceVoxels nearest;
    if (size() == 0) return nearest;
    const Eigen::ArrayXf paths = distances_mm(at_mm);
    // margin for rounding
    const float largest = std::min(max_mm + radius_mm, paths.minCoeff() + 2 * radius_mm) + 1e-3f;
    const Eigen::Index count = (paths <= largest).count();
    nearest.voxels_.resize(count, 4);
    for (Eigen::Index n = 0, to = 0; to < count; ++n)
      if (paths[n] <= largest) nearest.voxels_.row(to++) = voxels_.row(n);
    return nearest;
  }
  Eigen::Index size() const { return voxels_.rows(); }

  /// Allocates `count` entries for set().
  explicit NearSurfaceVoxels(std::size_t count = 0) : voxels_(static_cast<Eigen::Index>(count), 4) {}
  /// @param at_mm  position from the grid's first voxel, along its axes
  void set(std::size_t n, const Eigen::Array3f& at_mm, float distance_mm) {
    voxels_.row(static_cast<Eigen::Index>(n)) << at_mm[0], at_mm[1], at_mm[2], distance_mm;
  }

 private:
  Eigen::Array<float, Eigen::Dynamic, 4> voxels_;  // position and distance
};

template <class F>
void for_voxels(const Box& box, const F& run_at) {
  F run = run_at;
  for (int k = box.low()[2]; k < box.high()[2]; ++k)
    for (int j = box.low()[1]; j < box.high()[1]; ++j)
      for (int i = box.low()[0]; i < box.high()[0]; ++i) run(i, j, k);
}

/// New position values of a surface in a box of its grid.
class CarvedBlock {
 public:
  /// @param now  position after earlier sweeps
  /// @param cut  depth within the earlier sweeps
  CarvedBlock(const SignedField& original, const Bricks<Steps>& now, const Bricks<Steps>& cut,
              std::span<const Sweep> sweeps,
              std::span<const std::shared_ptr<const Surface>> protected_surfaces)
      : grid_(original.geometry()),
        X_PatientVoxel_(grid_.X_PatientVoxel()),
        step_mm_(original.steps().scale),
        far_(original.steps().outside),
        // width of the band around a surface that contains at least one of any two neighbouring voxels on
        // opposite sides of it
        band_mm_(grid_.spacing_mm.norm()),
        changing_(reached(original, sweeps)),
        read_(changing_.grown(voxels_in(reach_mm() + band_mm_)).clipped(whole(grid_))) {
    if (changing_.empty()) return;
    original_ = read(original.bricks(), read_);
    cut_ = read(cut, read_);
    previous_ = combined_depth();
    for (const Sweep& sweep : sweeps) apply_sweep(sweep, original.X_VoxelPatient());
    for (const auto& one : protected_surfaces) exclude_protected(*one);
    current_ = combined_depth();
    surface_band_ = dilate(current_, [](Steps value) { return value < 0; });
    position_ = read(now, changing_);
  }

  bool empty() const { return changing_.empty(); }

  PatchOf<Steps> cut() const {
    PatchOf<Steps> patch{changing_.voxels(), {}};
    patch.values.reserve(changing_.count());
    for_voxels(changing_, [&](int i, int j, int k) { patch.values.push_back(cut_[read_.offset(i, j, k)]); });
    return patch;
  }

  /// Position values of all voxels that may have changed.
  PatchOf<Steps> position() {
    for_voxels(changing_, [&](int i, int j, int k) {
      const std::size_t n = read_.offset(i, j, k);
      if (surface_band_[n] != 0) position_[changing_.offset(i, j, k)] = current_[n];
    });
    const std::vector<char> original_band = dilate(original_, [](Steps value) { return value < 0; });
    const Surroundings all{nearby(original_, original_band), nearby(current_, surface_band_),
                           removed_material()};
    constexpr int kLargest = 16;
    fill_blocks(changing_, kLargest, all);
    return {changing_.voxels(), std::move(position_)};
  }

 private:
  double reach_mm() const { return far_ * step_mm_; }
  Index voxels_in(double mm) const { return (mm / grid_.spacing_mm.array()).ceil().cast<int>() + 1; }

  // voxels that the sweeps can change: within the range of the distance field around the removed material
  Box reached(const SignedField& original, std::span<const Sweep> sweeps) const {
    Index low = Index::Constant(std::numeric_limits<int>::max()), high = -low;
    for (const Sweep& sweep : sweeps) {
      const double within_mm = sweep.max_radius_mm() + reach_mm() + band_mm_;
      const Box box = around(sweep, within_mm, grid_, original.X_VoxelPatient());
      low = low.min(box.low());
      high = high.max(box.high());
    }
    if ((low > high).any()) return {Index::Zero(), Index::Zero()};
    return Box(low, high).grown(Index::Constant(1)).clipped(whole(grid_));
  }

  std::vector<Steps> combined_depth() const {
    std::vector<Steps> values(original_.size());
    std::transform(original_.begin(), original_.end(), cut_.begin(), values.begin(),
                   [](Steps original, Steps cut) { return std::max(original, cut); });
    return values;
  }

  void apply_sweep(const Sweep& sweep, const Transform<Voxel, Patient>& X_VoxelPatient) {
    const Box box = around(sweep, sweep.max_radius_mm() + reach_mm(), grid_, X_VoxelPatient).clipped(read_);
    const SweptShape shape(sweep);
    const double reach = far_;
    for (int k = box.low()[2]; k < box.high()[2]; ++k) {
      for (int j = box.low()[1]; j < box.high()[1]; ++j) {
        Steps* const row = &cut_[read_.offset(box.low()[0], j, k)];
        for (int i = box.low()[0]; i < box.high()[0]; ++i) {
          const Point<Patient> at = X_PatientVoxel_ * Point<Voxel>(i, j, k);
          const double steps = shape.depth_mm(at) / step_mm_;
          Steps& depth = row[i - box.low()[0]];
          depth = std::max(depth, static_cast<Steps>(std::lround(std::clamp(steps, -reach, reach))));
        }
      }
    }
  }

  // excludes a protected structure from the cuts
  void exclude_protected(const Surface& protected_surface) {
    Eigen::Array3d low = Eigen::Array3d::Constant(std::numeric_limits<double>::infinity()), high = -low;
    for (unsigned at = 0; at < 8; ++at) {
      Index voxel;
      for (int axis = 0; axis < 3; ++axis)
        voxel[axis] = (at >> axis & 1) != 0 ? read_.high()[axis] : read_.low()[axis];
      const Point<Patient> position = X_PatientVoxel_ * Point<Voxel>(voxel[0], voxel[1], voxel[2]);
      low = low.min(position.eigen().array());
      high = high.max(position.eigen().array());
    }
    if (protected_surface.is_farther_than(low, high, 0)) return;
    for_voxels(read_, [&, n = std::size_t{0}](int i, int j, int k) mutable {
      Steps& depth = cut_[n++];
      if (depth <= -far_) return;
      const double steps = protected_surface.distance_mm(X_PatientVoxel_ * Point<Voxel>(i, j, k)) / step_mm_;
      depth = std::min(depth, static_cast<Steps>(std::lround(std::clamp<double>(steps, -far_, far_))));
    });
  }

  // dilation: whether the predicate holds for a voxel or one of its 26 neighbours
  template <class F>
  std::vector<char> dilate(const std::vector<Steps>& values, const F& is_so) const {
    std::vector<char> dilated(values.size());
    std::transform(values.begin(), values.end(), dilated.begin(), is_so);
    std::ptrdiff_t stride = 1;
    for (int axis = 0; axis < 3; ++axis) {
      const std::vector<char> was = dilated;
      for_voxels(read_, [&, n = std::size_t{0}](int i, int j, int k) mutable {
        const int at = axis == 0 ? i : axis == 1 ? j : k;
        const char* const here = &was[n];
        if (at > read_.low()[axis] && here[-stride] != 0) dilated[n] = 1;
        if (at + 1 < read_.high()[axis] && here[stride] != 0) dilated[n] = 1;
        ++n;
      });
      stride *= read_.size()[axis];
    }
    return dilated;
  }

  // the selected voxels that are near the surface
  NearSurfaceVoxels nearby(const std::vector<Steps>& values, const std::vector<char>& selected) const {
    const double deepest = -std::min(band_mm_, reach_mm()) / step_mm_;
    const auto counts = [&](std::size_t n) { return selected[n] != 0 && values[n] >= deepest; };
    std::size_t count = 0;
    for (std::size_t n = 0; n < values.size(); ++n) count += counts(n) ? 1 : 0;
    NearSurfaceVoxels nearby(count);
    for_voxels(read_, [&, n = std::size_t{0}, to = std::size_t{0}](int i, int j, int k) mutable {
      if (counts(n)) nearby.set(to++, position_mm(i, j, k), static_cast<float>(values[n] * step_mm_));
      ++n;
    });
    return nearby;
  }
  // voxels that have changed since the last version, with their neighbours
  NearSurfaceVoxels removed_material() const {
    std::vector<Steps> more(current_.size());
    std::transform(current_.begin(), current_.end(), previous_.begin(), more.begin(),
                   [](Steps is, Steps was) { return static_cast<Steps>(is != was); });
    return nearby(previous_, dilate(more, [](Steps changed) { return changed != 0; }));
  }

  Eigen::Array3f position_mm(int i, int j, int k) const {
    return (Eigen::Array3d(i, j, k) * grid_.spacing_mm.array()).cast<float>();
  }

  /// Candidates for the values of a block: near the prepared surface, near the current one, and near material
  /// removed since the last version.
  struct Surroundings {
    NearSurfaceVoxels original, current, removed;
  };
  // empty if no distance in the block can have changed
  std::optional<Surroundings> surroundings(const Surroundings& all, const Box& block) const {
    int greatest = -1;
    bool was_inside = false;
    for_voxels(block, [&](int i, int j, int k) {
      if (surface_band_[read_.offset(i, j, k)] != 0) return;
      const Steps value = position_[changing_.offset(i, j, k)];
      was_inside = was_inside || value < 0;
      if (value < far_) greatest = std::max<int>(greatest, value);
    });
    if (greatest < 0 && !was_inside) return std::nullopt;
    const Eigen::Array3d low = block.low().cast<double>() * grid_.spacing_mm.array();
    const Eigen::Array3d high = (block.high() - 1).cast<double>() * grid_.spacing_mm.array();
    const Eigen::Array3f middle = (0.5 * (low + high)).cast<float>();
    const auto radius = static_cast<float>(0.5 * (high - low).matrix().norm());
    // Removed material was nearest only if its distance was no larger than the stored one, which is at most a
    // cell larger when found from voxels.
    const auto least = static_cast<float>(greatest * step_mm_ + grid_.spacing_mm.norm());
    NearSurfaceVoxels removed = all.removed.near(middle, radius, least);
    if (removed.size() == 0 && !was_inside) return std::nullopt;
    const auto reach = static_cast<float>(reach_mm());
    return Surroundings{all.original.near(middle, radius, reach), all.current.near(middle, radius, reach),
                        std::move(removed)};
  }

  // Fills a box by blocks of an edge length. Candidates are narrowed down for large blocks first, then for
  // those of half the edge inside.
  void fill_blocks(const Box& box, int edge, const Surroundings& around) {
    constexpr int kSmallest = 2;
    for_blocks(box, edge, [&](const Box& block) {
      const std::optional<Surroundings> near = surroundings(around, block);
      if (!near) return;
      edge > kSmallest ? fill_blocks(block, edge / 2, *near) : fill(block, *near);
    });
  }

  void fill(const Box& block, const Surroundings& around) {
    for_voxels(block, [&](int i, int j, int k) {
      const std::size_t n = read_.offset(i, j, k);
      if (surface_band_[n] != 0) return;
      Steps& value = position_[changing_.offset(i, j, k)];
      if (value >= far_) return;
      const Eigen::Array3f at = position_mm(i, j, k);
      int steps = in_steps(around.current.distance_mm(at));
      if (original_[n] >= 0 && steps > original_[n])
        steps = original_[n] + std::max(0, steps - in_steps(around.original.distance_mm(at)));
      value = static_cast<Steps>(std::clamp<int>(steps, current_[n], far_));
    });
  }
  int in_steps(float mm) const {
    return static_cast<int>(std::lround(std::min(static_cast<double>(mm), reach_mm()) / step_mm_));
  }

  template <class F>
  static void for_blocks(const Box& box, int size, const F& run) {
    for (int k = box.low()[2]; k < box.high()[2]; k += size)
      for (int j = box.low()[1]; j < box.high()[1]; j += size)
        for (int i = box.low()[0]; i < box.high()[0]; i += size) {
          const Index low(i, j, k);
          run(Box(low, (low + size).min(box.high())));
        }
  }
  GridGeometry grid_;
  Transform<Patient, Voxel> X_PatientVoxel_;
  double step_mm_;
  Steps far_;
  double band_mm_;
  Box changing_, read_;
  // in the box that is read: prepared position, depth in the sweeps, and their union before and after
  std::vector<Steps> original_, cut_, previous_, current_;
  std::vector<char> surface_band_;  // voxels that are inside now, or have a neighbour that is
  std::vector<Steps> position_;     // in the box that changes
};

}  // namespace palpate::internal
