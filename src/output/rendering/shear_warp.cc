#include "rendering/shear_warp.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace palpate::internal::volume_picture {
namespace {

/// Limits of the pixel size of the intermediate picture, in units of the grid's shortest spacing; within them
/// it equals the final pixel size. Finer pixels show no more detail, coarser ones would skip voxels. Along a
/// line, samples less than 1 apart can be looked up by vector permutation, which outweighs a lower number of
/// samples; the distance between lines may be larger.
constexpr double kFinestPixel = 0.75, kCoarsestPixel = 0.995, kMinLine = 0.95, kMaxLine = 1.25;
/// Planes nearer to the eye than this fraction of the distance to the intermediate picture are not sampled.
constexpr double kMinDepth = 1e-3;
/// Empty margin of the intermediate picture; pixels.
constexpr int kRim = 2;

/// Principal axis of a ray, by its length in mm along each axis, and its sign: 2 * axis, plus 1 if ascending.
int axis_class(const Eigen::Vector3d& direction, const Eigen::Vector3d& spacing) {
  int axis = 0;
  for (int a = 1; a < 3; ++a)
    if (std::abs(direction[a] * spacing[a]) > std::abs(direction[axis] * spacing[axis])) axis = a;
  return 2 * axis + (direction[axis] > 0 ? 1 : 0);
}

struct Bounds {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  void add(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  void intersect(const Bounds& other) {
    low = std::max(low, other.low);
    high = std::min(high, other.high);
  }
};

}  // namespace

Rays::Rays(const GridGeometry& grid, const VolumeCamera& camera) : is_parallel(camera.is_parallel()) {
  const auto X_VoxelPatient = grid.X_PatientVoxel().inverse();
  const Eigen::Vector3d corner = (X_VoxelPatient * camera.at(0, 0)).eigen();
  const Eigen::Vector3d step = (X_VoxelPatient * (camera.right * camera.mm_per_px())).eigen(),
                        line = (X_VoxelPatient * (camera.down * camera.mm_per_px())).eigen();
  if (is_parallel) {
    from = corner;
    from_step = step;
    from_line = line;
    direction = (X_VoxelPatient * camera.into()).eigen();
  } else {
    from = (X_VoxelPatient * (camera.focus - camera.into() * camera.eye_mm)).eigen();
    direction = corner - from;
    ray_step = step;
    ray_line = line;
  }
}

std::vector<Region> regions_of(const GridGeometry& grid, const VolumeCamera& camera, const Rays& rays) {
  const auto class_at = [&](int column, int row) {
    return axis_class(rays.along(column, row), grid.spacing_mm);
  };
  // the rays with a common principal axis form a convex cone: if all corners belong to it, all pixels do
  const int right = camera.width_px - 1, bottom = camera.height_px - 1, first = class_at(0, 0);
  const bool is_one =
      class_at(right, 0) == first && class_at(0, bottom) == first && class_at(right, bottom) == first;
  std::array<std::vector<PixelRun>, 6> runs;
  for (int row = 0; row < camera.height_px; ++row) {
    if (is_one) {
      runs[static_cast<std::size_t>(first)].push_back({row, 0, camera.width_px});
      continue;
    }
    for (int begin = 0; begin < camera.width_px;) {
      const int here = class_at(begin, row);
      int end = begin + 1;
      while (end < camera.width_px && class_at(end, row) == here) ++end;
      runs[static_cast<std::size_t>(here)].push_back({row, begin, end});
      begin = end;
    }
  }
  std::vector<Region> regions;
  for (int n = 0; n < 6; ++n)
    if (auto& these = runs[static_cast<std::size_t>(n)]; !these.empty())
      regions.push_back({n / 2, n % 2 == 1, std::move(these)});
  return regions;
}

std::optional<ShearWarp> ShearWarp::of(const GridGeometry& grid, const VolumeCamera& camera, const Rays& rays,
                                       const Region& region, double max_apart) {
  ShearWarp f;
  f.z = region.axis;
  f.x = region.axis == 0 ? 1 : 0;
  f.y = region.axis == 2 ? 1 : 2;
  f.is_ascending = region.is_ascending;
  const double sign = region.is_ascending ? 1 : -1;
  const Eigen::Vector3d& eye = rays.from;
  const double h = grid.min_spacing_mm();
  const int x = f.x, y = f.y, z = f.z;

  // slice of the intermediate picture: the middle of the part in front of the eye
  const Bounds slices{rays.is_parallel || !region.is_ascending ? -1.0 : std::max(-1.0, eye[z]),
                      rays.is_parallel || region.is_ascending
                          ? static_cast<double>(grid.dims[static_cast<std::size_t>(z)])
                          : std::min(static_cast<double>(grid.dims[static_cast<std::size_t>(z)]), eye[z])};
  if (!(slices.low < slices.high)) return {};
  f.z_ref = 0.5 * (slices.low + slices.high);

  // projects pixels onto that slice, (x, y) = (U, V) / W
  const auto to_slice = [&](const Eigen::Vector3d& start, const Eigen::Vector3d& direction, double one) {
    if (rays.is_parallel) {
      const double beyond = one * f.z_ref - start[z];
      return Eigen::Vector3d(start[x] + beyond * rays.direction[x] / rays.direction[z],
                             start[y] + beyond * rays.direction[y] / rays.direction[z], one);
    }
    const double off = f.z_ref - eye[z];
    return Eigen::Vector3d(eye[x] * direction[z] + off * direction[x],
                           eye[y] * direction[z] + off * direction[y], direction[z]);
  };
  f.warp_start = to_slice(rays.from, rays.direction, 1);
  f.warp_step = to_slice(rays.from_step, rays.ray_step, 0);
  f.warp_line = to_slice(rays.from_line, rays.ray_line, 0);

  // visible extent in that slice, pixel size there, and distance between slices along the rays
  Bounds xs, ys;
  double pixel_mm = std::numeric_limits<double>::infinity(), separation_mm = 0;
  for (const PixelRun& run : region.runs)
    for (const int column : {run.begin, run.end - 1}) {
      const Eigen::Vector3d at = f.warp_start + f.warp_step * column + f.warp_line * run.row;
      xs.add(at[0] / at[2]);
      ys.add(at[1] / at[2]);
      const Eigen::Vector3d direction = rays.along(column, run.row);
      const double nearer = rays.is_parallel ? 1 : (f.z_ref - eye[z]) / direction[z];
      pixel_mm = std::min(pixel_mm, camera.mm_per_px() * nearer);
      separation_mm = std::max(separation_mm,
                               (grid.X_PatientVoxel().linear() * direction).norm() / std::abs(direction[z]));
    }
  Bounds all_x, all_y;
  for (int corner = 0; corner < 8; ++corner) {
    Eigen::Vector3d at;
    for (int a = 0; a < 3; ++a)
      at[a] = (corner >> a & 1) != 0 ? grid.dims[static_cast<std::size_t>(a)] : -1.0;
    at[z] = (corner >> z & 1) != 0 ? slices.high : slices.low;
    const double off = at[z] - f.z_ref;
    if (rays.is_parallel) {
      all_x.add(at[x] - off * rays.direction[x] / rays.direction[z]);
      all_y.add(at[y] - off * rays.direction[y] / rays.direction[z]);
    } else if (const double farther = (at[z] - eye[z]) / (f.z_ref - eye[z]); farther > kMinDepth) {
      all_x.add(eye[x] + (at[x] - eye[x]) / farther);
      all_y.add(eye[y] + (at[y] - eye[y]) / farther);
    } else {
      all_x = all_y = {-1e12, 1e12};
      break;
    }
  }
  xs.intersect(all_x);
  ys.intersect(all_y);
  if (!(xs.low <= xs.high) || !(ys.low <= ys.high)) return {};

  f.x_ref_per_u = std::clamp(pixel_mm, kFinestPixel * h, kCoarsestPixel * h) / grid.spacing_mm[x];
  f.y_ref_per_v = std::clamp(pixel_mm, kMinLine * h, kMaxLine * h) / grid.spacing_mm[y];
  f.x_ref_0 = xs.low - kRim * f.x_ref_per_u;
  f.y_ref_0 = ys.low - kRim * f.y_ref_per_v;
  f.width = static_cast<int>(std::ceil((xs.high - xs.low) / f.x_ref_per_u)) + 2 * kRim + 1;
  f.height = static_cast<int>(std::ceil((ys.high - ys.low) / f.y_ref_per_v)) + 2 * kRim + 1;
  Eigen::Matrix3d to_pixels = Eigen::Matrix3d::Identity();
  to_pixels.row(0) << 1 / f.x_ref_per_u, 0, -f.x_ref_0 / f.x_ref_per_u;
  to_pixels.row(1) << 0, 1 / f.y_ref_per_v, -f.y_ref_0 / f.y_ref_per_v;
  for (Eigen::Vector3d* part : {&f.warp_start, &f.warp_step, &f.warp_line}) *part = to_pixels * *part;

  // sampling planes: the slices, subdivided if their distance along a ray is too large
  const double separation = std::min(1.0, max_apart * h / separation_mm),
               slice_count = grid.dims[static_cast<std::size_t>(z)];
  f.z_step = sign * separation;
  const int count = static_cast<int>(std::ceil((slice_count + 1) / separation - 1e-6)) - 1;
  bool is_first = true;
  for (int n = 0; n < count; ++n) {
    const double at = region.is_ascending ? (n + 1) * separation - 1 : slice_count - (n + 1) * separation;
    const double farther = rays.is_parallel ? 1 : (at - eye[z]) / (f.z_ref - eye[z]);
    if (farther <= kMinDepth) continue;
    if (is_first) f.z_first = at;
    is_first = false;
    SamplePlane plane{};
    plane.slice = static_cast<int>(std::floor(at));
    plane.beyond = static_cast<float>(at - plane.slice);
    plane.x_per_u = f.x_ref_per_u * farther;
    plane.u_per_x = 1 / plane.x_per_u;
    plane.y_per_v = f.y_ref_per_v * farther;
    if (rays.is_parallel) {
      plane.x_0 = f.x_ref_0 + (at - f.z_ref) * rays.direction[x] / rays.direction[z];
      plane.y_0 = f.y_ref_0 + (at - f.z_ref) * rays.direction[y] / rays.direction[z];
    } else {
      plane.x_0 = eye[x] + (f.x_ref_0 - eye[x]) * farther;
      plane.y_0 = eye[y] + (f.y_ref_0 - eye[y]) * farther;
    }
    f.planes.push_back(plane);
  }
  if (f.planes.empty()) return {};
  return f;
}

}  // namespace palpate::internal::volume_picture
