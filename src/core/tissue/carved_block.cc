#include "tissue/carved_block.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tissue/swept_voxels.h"

namespace palpate::internal {
namespace {

// voxels within `within_mm` of the centres of a sweep's balls
Box around(const Sweep& sweep, double within_mm, const GridGeometry& grid,
           const Transform<Voxel, Patient>& X_VoxelPatient) {
  const auto [least, greatest] = centre_bounds(sweep, X_VoxelPatient);
  const Eigen::Array3d reach = within_mm / grid.spacing_mm.array();
  // clamped: a sweep far outside the grid has the same effect as one just outside
  const Eigen::Array3d most = Eigen::Array3d(grid.dims[0], grid.dims[1], grid.dims[2]) + 1;
  const Eigen::Array3d low = (least - reach).floor().max(-1).min(most);
  const Eigen::Array3d high = (greatest + reach).ceil().max(-1).min(most) + 1;
  return {low.cast<int>(), high.cast<int>()};
}

}  // namespace

CarvedBlock::CarvedBlock(const SignedField& original, const Bricks<Steps>& now, const Bricks<Steps>& cut,
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

PatchOf<Steps> CarvedBlock::cut() const {
  PatchOf<Steps> patch{changing_.voxels(), {}};
  patch.values.reserve(changing_.count());
  for_voxels(changing_, [&](int i, int j, int k) { patch.values.push_back(cut_[read_.offset(i, j, k)]); });
  return patch;
}

PatchOf<Steps> CarvedBlock::position() {
  for_voxels(changing_, [&](int i, int j, int k) {
    const std::size_t n = read_.offset(i, j, k);
    if (surface_band_[n] != 0) position_[changing_.offset(i, j, k)] = current_[n];
  });
  const std::vector<char> original_band = dilate(original_, [](Steps value) { return value < 0; });
  const Surroundings all{nearby(original_, original_band), nearby(current_, surface_band_),
                         removed_material()};
  fill_blocks(changing_, 0, all);
  return {changing_.voxels(), std::move(position_)};
}

Box CarvedBlock::reached(const SignedField& original, std::span<const Sweep> sweeps) const {
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

std::vector<Steps> CarvedBlock::combined_depth() const {
  std::vector<Steps> values(original_.size());
  std::transform(original_.begin(), original_.end(), cut_.begin(), values.begin(),
                 [](Steps original, Steps cut) { return std::max(original, cut); });
  return values;
}

void CarvedBlock::apply_sweep(const Sweep& sweep, const Transform<Voxel, Patient>& X_VoxelPatient) {
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

void CarvedBlock::exclude_protected(const Surface& protected_surface) {
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

template <class F>
std::vector<char> CarvedBlock::dilate(const std::vector<Steps>& values, const F& is_so) const {
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

NearSurfaceVoxels CarvedBlock::nearby(const std::vector<Steps>& values,
                                      const std::vector<char>& selected) const {
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

NearSurfaceVoxels CarvedBlock::removed_material() const {
  std::vector<Steps> more(current_.size());
  std::transform(current_.begin(), current_.end(), previous_.begin(), more.begin(),
                 [](Steps is, Steps was) { return static_cast<Steps>(is != was); });
  return nearby(previous_, dilate(more, [](Steps changed) { return changed != 0; }));
}

bool CarvedBlock::select_surroundings(const Surroundings& all, const Box& block,
                                      Surroundings& selected) const {
  int greatest = -1;
  bool was_inside = false;
  for_voxels(block, [&](int i, int j, int k) {
    if (surface_band_[read_.offset(i, j, k)] != 0) return;
    const Steps value = position_[changing_.offset(i, j, k)];
    was_inside = was_inside || value < 0;
    if (value < far_) greatest = std::max<int>(greatest, value);
  });
  if (greatest < 0 && !was_inside) return false;
  const Eigen::Array3d low = block.low().cast<double>() * grid_.spacing_mm.array();
  const Eigen::Array3d high = (block.high() - 1).cast<double>() * grid_.spacing_mm.array();
  const Eigen::Array3f middle = (0.5 * (low + high)).cast<float>();
  const auto radius = static_cast<float>(0.5 * (high - low).matrix().norm());
  // Removed material was nearest only if its distance was no larger than the stored one, which is at most a
  // cell larger when found from voxels.
  const auto least = static_cast<float>(greatest * step_mm_ + grid_.spacing_mm.norm());
  selected.removed.select(all.removed, middle, radius, least);
  if (selected.removed.size() == 0 && !was_inside) return false;
  const auto reach = static_cast<float>(reach_mm());
  selected.original.select(all.original, middle, radius, reach);
  selected.current.select(all.current, middle, radius, reach);
  return true;
}

void CarvedBlock::fill_blocks(const Box& box, std::size_t level, const Surroundings& around) {
  for_blocks(box, kEdges[level], [&](const Box& block) {
    Surroundings& selected = surroundings_[level];
    if (!select_surroundings(around, block, selected)) return;
    level + 1 < kEdges.size() ? fill_blocks(block, level + 1, selected) : fill(block, selected);
  });
}

void CarvedBlock::fill(const Box& block, const Surroundings& around) {
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

template <class F>
void CarvedBlock::for_blocks(const Box& box, int size, const F& run) {
  for (int k = box.low()[2]; k < box.high()[2]; k += size)
    for (int j = box.low()[1]; j < box.high()[1]; j += size)
      for (int i = box.low()[0]; i < box.high()[0]; i += size) {
        const Index low(i, j, k);
        run(Box(low, (low + size).min(box.high())));
      }
}

}  // namespace palpate::internal
