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

/// Range of slices in front of the eye, from one before the first to one behind the last.
Bounds slices_before_eye(const GridGeometry& grid, const Rays& rays, const ShearWarp& warp) {
  const double eye_z = rays.from[warp.z];
  const double slice_count = grid.dims[static_cast<std::size_t>(warp.z)];
  return {rays.is_parallel || !warp.is_ascending ? -1.0 : std::max(-1.0, eye_z),
          rays.is_parallel || warp.is_ascending ? slice_count : std::min(slice_count, eye_z)};
}

/// Projects pixels along their rays onto the slice warp.z_ref: (x, y) = (U, V) / W.
/// @param one  1 for a point, 0 for the difference of two points
Eigen::Vector3d projected_onto_slice(const Rays& rays, const ShearWarp& warp, const Eigen::Vector3d& start,
                                     const Eigen::Vector3d& direction, double one) {
  const int x = warp.x, y = warp.y, z = warp.z;
  if (rays.is_parallel) {
    const double beyond = one * warp.z_ref - start[z];
    return {start[x] + beyond * rays.direction[x] / rays.direction[z],
            start[y] + beyond * rays.direction[y] / rays.direction[z], one};
  }
  const Eigen::Vector3d& eye = rays.from;
  const double off = warp.z_ref - eye[z];
  return {eye[x] * direction[z] + off * direction[x], eye[y] * direction[z] + off * direction[y],
          direction[z]};
}

/// Intersection of the rays of a region with the slice warp.z_ref.
struct Footprint {
  Bounds x, y;
  double pixel_mm = std::numeric_limits<double>::infinity();  ///< Smallest pixel size in that slice
  double separation_mm = 0;  ///< Largest distance between consecutive slices along a ray
};
Footprint footprint_of(const GridGeometry& grid, const VolumeCamera& camera, const Rays& rays,
                       const Region& region, const ShearWarp& warp) {
  const int z = warp.z;
  Footprint footprint;
  for (const PixelRun& run : region.runs)
    for (const int column : {run.begin, run.end - 1}) {
      const Eigen::Vector3d at = warp.warp_start + warp.warp_step * column + warp.warp_line * run.row;
      footprint.x.add(at[0] / at[2]);
      footprint.y.add(at[1] / at[2]);
      const Eigen::Vector3d direction = rays.along(column, run.row);
      const double nearer = rays.is_parallel ? 1 : (warp.z_ref - rays.from[z]) / direction[z];
      footprint.pixel_mm = std::min(footprint.pixel_mm, camera.mm_per_px() * nearer);
      footprint.separation_mm =
          std::max(footprint.separation_mm,
                   (grid.X_PatientVoxel().linear() * direction).norm() / std::abs(direction[z]));
    }
  return footprint;
}

/// Reduces the footprint to the projection of the grid's slices `slices`.
void clip_to_grid(const GridGeometry& grid, const Rays& rays, const Bounds& slices, const ShearWarp& warp,
                  Footprint& footprint) {
  const int x = warp.x, y = warp.y, z = warp.z;
  const Eigen::Vector3d& eye = rays.from;
  Bounds all_x, all_y;
  for (int corner = 0; corner < 8; ++corner) {
    Eigen::Vector3d at;
    for (int a = 0; a < 3; ++a)
      at[a] = (corner >> a & 1) != 0 ? grid.dims[static_cast<std::size_t>(a)] : -1.0;
    at[z] = (corner >> z & 1) != 0 ? slices.high : slices.low;
    const double off = at[z] - warp.z_ref;
    if (rays.is_parallel) {
      all_x.add(at[x] - off * rays.direction[x] / rays.direction[z]);
      all_y.add(at[y] - off * rays.direction[y] / rays.direction[z]);
    } else if (const double farther = (at[z] - eye[z]) / (warp.z_ref - eye[z]); farther > kMinDepth) {
      all_x.add(eye[x] + (at[x] - eye[x]) / farther);
      all_y.add(eye[y] + (at[y] - eye[y]) / farther);
    } else {
      // the projection of a corner next to the eye is unbounded
      all_x = all_y = {-1e12, 1e12};
      break;
    }
  }
  footprint.x.intersect(all_x);
  footprint.y.intersect(all_y);
}

/// Sets the size of the intermediate picture and its mapping to voxels, and makes the warp of final pixels
/// refer to its pixels.
void lay_out_picture(const GridGeometry& grid, const Footprint& footprint, ShearWarp& warp) {
  const double h = grid.min_spacing_mm();
  const Bounds &x = footprint.x, &y = footprint.y;
  warp.x_ref_per_u =
      std::clamp(footprint.pixel_mm, kFinestPixel * h, kCoarsestPixel * h) / grid.spacing_mm[warp.x];
  warp.y_ref_per_v = std::clamp(footprint.pixel_mm, kMinLine * h, kMaxLine * h) / grid.spacing_mm[warp.y];
  warp.x_ref_0 = x.low - kRim * warp.x_ref_per_u;
  warp.y_ref_0 = y.low - kRim * warp.y_ref_per_v;
  warp.width = static_cast<int>(std::ceil((x.high - x.low) / warp.x_ref_per_u)) + 2 * kRim + 1;
  warp.height = static_cast<int>(std::ceil((y.high - y.low) / warp.y_ref_per_v)) + 2 * kRim + 1;
  Eigen::Matrix3d to_pixels = Eigen::Matrix3d::Identity();
  to_pixels.row(0) << 1 / warp.x_ref_per_u, 0, -warp.x_ref_0 / warp.x_ref_per_u;
  to_pixels.row(1) << 0, 1 / warp.y_ref_per_v, -warp.y_ref_0 / warp.y_ref_per_v;
  for (Eigen::Vector3d* point : {&warp.warp_start, &warp.warp_step, &warp.warp_line})
    *point = to_pixels * *point;
}

/// Adds the sampling planes in front of the eye: the slices, subdivided if their distance along a ray is too
/// large. Sets z_first and z_step as well.
/// @param separation  distance of the planes, at most 1; slices
void add_sampling_planes(const GridGeometry& grid, const Rays& rays, double separation, ShearWarp& warp) {
  const int x = warp.x, y = warp.y, z = warp.z;
  const Eigen::Vector3d& eye = rays.from;
  const double slice_count = grid.dims[static_cast<std::size_t>(z)];
  warp.z_step = warp.is_ascending ? separation : -separation;
  const int count = static_cast<int>(std::ceil((slice_count + 1) / separation - 1e-6)) - 1;
  for (int n = 0; n < count; ++n) {
    const double at = warp.is_ascending ? (n + 1) * separation - 1 : slice_count - (n + 1) * separation;
    const double farther = rays.is_parallel ? 1 : (at - eye[z]) / (warp.z_ref - eye[z]);
    if (farther <= kMinDepth) continue;
    if (warp.planes.empty()) warp.z_first = at;
    SamplePlane plane{};
    plane.slice = static_cast<int>(std::floor(at));
    plane.beyond = static_cast<float>(at - plane.slice);
    plane.x_per_u = warp.x_ref_per_u * farther;
    plane.u_per_x = 1 / plane.x_per_u;
    plane.y_per_v = warp.y_ref_per_v * farther;
    if (rays.is_parallel) {
      plane.x_0 = warp.x_ref_0 + (at - warp.z_ref) * rays.direction[x] / rays.direction[z];
      plane.y_0 = warp.y_ref_0 + (at - warp.z_ref) * rays.direction[y] / rays.direction[z];
    } else {
      plane.x_0 = eye[x] + (warp.x_ref_0 - eye[x]) * farther;
      plane.y_0 = eye[y] + (warp.y_ref_0 - eye[y]) * farther;
    }
    warp.planes.push_back(plane);
  }
}

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

std::optional<ShearWarp> ShearWarp::for_region(const GridGeometry& grid, const VolumeCamera& camera,
                                               const Rays& rays, const Region& region, double max_apart) {
  ShearWarp warp;
  warp.z = region.axis;
  warp.x = region.axis == 0 ? 1 : 0;
  warp.y = region.axis == 2 ? 1 : 2;
  warp.is_ascending = region.is_ascending;

  // the intermediate picture lies in the middle of the slices in front of the eye
  const Bounds slices = slices_before_eye(grid, rays, warp);
  if (!(slices.low < slices.high)) return {};
  warp.z_ref = 0.5 * (slices.low + slices.high);
  warp.warp_start = projected_onto_slice(rays, warp, rays.from, rays.direction, 1);
  warp.warp_step = projected_onto_slice(rays, warp, rays.from_step, rays.ray_step, 0);
  warp.warp_line = projected_onto_slice(rays, warp, rays.from_line, rays.ray_line, 0);

  Footprint footprint = footprint_of(grid, camera, rays, region, warp);
  clip_to_grid(grid, rays, slices, warp, footprint);
  if (!(footprint.x.low <= footprint.x.high) || !(footprint.y.low <= footprint.y.high)) return {};
  lay_out_picture(grid, footprint, warp);
  add_sampling_planes(grid, rays, std::min(1.0, max_apart * grid.min_spacing_mm() / footprint.separation_mm),
                      warp);
  if (warp.planes.empty()) return {};
  return warp;
}

}  // namespace palpate::internal::volume_picture
