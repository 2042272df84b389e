#include "palpate/rendering/volume_renderer.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "palpate/base/for_each_index.h"
#include "palpate/contact/colours.h"
#include "rendering/shear_warp.h"
#include "rendering/volume_encoding.h"

namespace palpate {

using internal::volume_picture::AccumulatedLine;
using internal::volume_picture::CubesView;
using internal::volume_picture::LitBlockCache;
using internal::volume_picture::MixingBuffers;
using internal::volume_picture::PixelRun;
using internal::volume_picture::Rays;
using internal::volume_picture::Region;
using internal::volume_picture::RowsView;
using internal::volume_picture::ShearWarp;
using internal::volume_picture::TracedRay;
using internal::volume_picture::VolumeEncoding;

namespace internal::volume_picture {

/// Line of intermediate pixels.
struct Line {
  std::vector<float> floats;
  std::vector<std::uint64_t> unfinished;
};
/// Buffers reused from picture to picture.
struct Scratch {
  std::vector<Line> lines;                   ///< kMaxLines per thread
  std::vector<std::vector<float>> mixing;    ///< Per thread
  std::vector<LitBlockCache> lit;            ///< Per thread
  std::vector<std::vector<TracedRay>> rays;  ///< Per thread
  std::vector<std::vector<std::int32_t>> edges;
  std::vector<std::uint32_t> pixels, marked;
  std::vector<float> half_plane, first_filled;
  std::vector<std::vector<float>> row_half_planes;  ///< Per thread
};

}  // namespace internal::volume_picture

namespace {

/// Maximum distance between samples along a ray, in units of the grid's shortest spacing; smaller if a clip
/// plane cuts between two of them.
constexpr double kMaxApart = 1, kMaxApartClipped = 0.5;
using internal::volume_picture::kMaxLines;
using internal::volume_picture::kNoPlane;
using internal::volume_picture::Scratch;
/// Number of rays of a row that are traced together.
constexpr std::size_t kMaxRays = 64;

/// Per intermediate pixel: visible range of planes under clipping, and distance between planes along its ray.
class RayRanges {
 public:
  RayRanges(const GridGeometry& grid, const Rays& rays, const ShearWarp& view,
            const std::optional<ClipPlane>& clip)
      : rays_(rays), view_(view), linear_(grid.X_PatientVoxel().linear()), h_(grid.min_spacing_mm()) {
    if (!clip) return;
    is_clipped_ = true;
    normal_ = linear_.transpose() * clip->away.eigen();
    offset_ = clip->away.dot(clip->at - grid.origin);
  }
  bool is_clipped() const { return is_clipped_; }

  /// Step of an intermediate pixel's ray from plane to plane; voxels.
  Eigen::Vector3d step_per_plane(const Eigen::Vector3d& at) const {
    const Eigen::Vector3d direction = rays_.is_parallel ? rays_.direction : Eigen::Vector3d(at - rays_.from);
    return direction * (view_.z_step / direction[view_.z]);
  }
  float step(const Eigen::Vector3d& step_per_plane) const {
    return static_cast<float>((linear_ * step_per_plane).norm() / h_);
  }
  /// Range of visible planes.
  std::array<float, 2> visible_planes(const Eigen::Vector3d& at,
                                      const Eigen::Vector3d& step_per_plane) const {
    if (!is_clipped_) return {-kNoPlane, kNoPlane};
    const double rise = normal_.dot(step_per_plane), here = normal_.dot(at) - offset_;
    if (rise == 0) return {here > 0 ? kNoPlane : -kNoPlane, kNoPlane};
    const double plane = (view_.z_ref - view_.z_first) / view_.z_step - here / rise;
    const auto bounded = static_cast<float>(std::clamp(plane, -double{kNoPlane}, double{kNoPlane}));
    return {rise < 0 ? bounded : -kNoPlane, rise > 0 ? bounded : kNoPlane};
  }

  void find(int v, const AccumulatedLine& line) const {
    Eigen::Vector3d at;
    at[view_.z] = view_.z_ref;
    at[view_.y] = view_.y_ref_0 + view_.y_ref_per_v * v;
    for (int u = 0; u < view_.width; ++u) {
      if (u > 0 && rays_.is_parallel && !is_clipped_) {
        line.step[u] = line.step[0];
        continue;
      }
      at[view_.x] = view_.x_ref_0 + view_.x_ref_per_u * u;
      const Eigen::Vector3d further = step_per_plane(at);
      line.step[u] = step(further);
      if (!is_clipped_) continue;
      const auto planes = visible_planes(at, further);
      line.first[u] = planes[0];
      line.last[u] = planes[1];
    }
  }

 private:
  const Rays& rays_;
  const ShearWarp& view_;
  Eigen::Matrix3d linear_;
  double h_;
  bool is_clipped_ = false;
  Eigen::Vector3d normal_ = Eigen::Vector3d::Zero();  ///< Per voxel
  double offset_ = 0;
};

RowsView rows_of(RowsView rows, const GridGeometry& grid, const ShearWarp& view) {
  const int axes[3] = {view.x, view.y, view.z};
  // distances between rows: first across the rows, then along k
  const std::ptrdiff_t across = 1, along_k = grid.dims[view.x == 0 ? 1 : 0];
  for (int a = 0; a < 3; ++a) {
    rows.count[a] = grid.dims[static_cast<std::size_t>(axes[a])];
    rows.row[a] = axes[a] == 2 ? along_k : across;
  }
  return rows;
}

AccumulatedLine line_of(internal::volume_picture::Line& line, int width, bool is_clipped, bool has_depth) {
  constexpr int kChunk = internal::volume_picture::kChunk;
  const auto stride = static_cast<std::size_t>((width + kChunk - 1) / kChunk * kChunk);
  line.floats.resize(9 * stride);
  const std::size_t chunks = stride / kChunk;
  line.unfinished.assign((chunks + 63) / 64, ~std::uint64_t{0});
  if (chunks % 64 != 0) line.unfinished.back() = (std::uint64_t{1} << chunks % 64) - 1;
  const auto part = [&](std::size_t n) { return line.floats.data() + n * stride; };
  AccumulatedLine gathered{};
  for (std::size_t n = 0; n < 3; ++n) gathered.channel[n] = part(n);
  gathered.transmittance = part(3);
  gathered.half_plane = has_depth ? part(4) : nullptr;
  gathered.step = part(5);
  if (is_clipped) gathered.first = part(6), gathered.last = part(7);
  gathered.first_filled = part(8);
  gathered.unfinished = line.unfinished.data();
  std::fill(part(0), part(3), 0.0f);
  std::fill(part(3), part(4), 1.0f);
  std::fill(part(4), part(5), -1.0f);
  std::fill(part(5), part(8), 0.0f);
  std::fill(part(8), part(9), kNoPlane);
  return gathered;
}

MixingBuffers mixing_buffers(std::vector<float>& floats, LitBlockCache& lit, int row_voxels) {
  const std::size_t row_floats = static_cast<std::size_t>(row_voxels) +
                                 2 * static_cast<std::size_t>(internal::volume_picture::kRowPadding);
  floats.resize(4 * internal::volume_picture::kMaxRows * row_floats);
  MixingBuffers rows{};
  rows.lit = &lit;
  float* next = floats.data();
  for (auto& pair : rows.pair)
    for (float*& channel : pair) channel = next, next += row_floats;
  return rows;
}

/// Initialisation of a picture's rays.
struct RayStart {
  const RayRanges& ranges;
  const ShearWarp& view;
  const float* first_filled;  ///< First non-empty plane of the intermediate pixels, `stride` per line
  std::ptrdiff_t stride;

  /// Ray at intermediate position (u, v), starting at the first non-empty plane of the four pixels around it.
  TracedRay at(double u, double v) const {
    Eigen::Vector3d at;
    at[view.x] = view.x_ref_0 + view.x_ref_per_u * u;
    at[view.y] = view.y_ref_0 + view.y_ref_per_v * v;
    at[view.z] = view.z_ref;
    const Eigen::Vector3d step_per_plane = ranges.step_per_plane(at),
                          start = at - step_per_plane * ((view.z_ref - view.z_first) / view.z_step);
    const auto visible = ranges.visible_planes(at, step_per_plane);
    TracedRay ray{};
    ray.x = static_cast<float>(start[view.x]);
    ray.y = static_cast<float>(start[view.y]);
    ray.x_per_plane = static_cast<float>(step_per_plane[view.x]);
    ray.y_per_plane = static_cast<float>(step_per_plane[view.y]);
    ray.step = ranges.step(step_per_plane);
    ray.first = visible[0];
    ray.last = visible[1];
    const int column = std::clamp(static_cast<int>(u), 0, view.width - 2),
              row = std::clamp(static_cast<int>(v), 0, view.height - 2);
    const float* near = first_filled + stride * row + column;
    ray.first_filled = std::min({near[0], near[1], near[stride], near[stride + 1]});
    return ray;
  }
};

/// Traces individual rays for some pixels of a row, through the same planes.
void trace(const RowsView& rows, const CubesView& cubes, const RayStart& starts, int row,
           std::span<const std::int32_t> columns, const float* background, std::vector<TracedRay>& rays,
           LitBlockCache& lit, std::uint8_t* rgb, float* half_planes) {
  const ShearWarp& view = starts.view;
  rays.resize(kMaxRays);
  for (std::size_t from = 0; from < columns.size(); from += kMaxRays) {
    const std::size_t count = std::min(kMaxRays, columns.size() - from);
    for (std::size_t n = 0; n < count; ++n) {
      const Eigen::Vector3d pixel =
          view.warp_start + view.warp_line * row + view.warp_step * columns[from + n];
      rays[n] = starts.at(pixel[0] / pixel[2], pixel[1] / pixel[2]);
    }
    trace_rays(rows, cubes, view.planes.data(), static_cast<int>(view.planes.size()),
               static_cast<float>(view.z_step), half_planes != nullptr, static_cast<int>(count), rays.data(),
               lit);
    for (std::size_t n = 0; n < count; ++n) {
      const std::int32_t column = columns[from + n];
      for (int c = 0; c < 3; ++c) {
        const float value = rays[n].channel[c] + rays[n].transmittance * background[c];
        rgb[3 * column + c] = static_cast<std::uint8_t>(std::min(255.0f, value * 255 + 0.5f));
      }
      if (half_planes != nullptr) half_planes[column] = rays[n].half_plane;
    }
  }
}

void fill(const PixelRun& run, int width, const Rgb& colour, std::span<std::uint8_t> rgb) {
  for (int x = run.begin; x < run.end; ++x) {
    std::uint8_t* pixel = &rgb[3 * (static_cast<std::size_t>(run.row) * static_cast<std::size_t>(width) +
                                    static_cast<std::size_t>(x))];
    pixel[0] = colour.r;
    pixel[1] = colour.g;
    pixel[2] = colour.b;
  }
}

/// Region of a picture, and the picture.
struct RegionTarget {
  const Region& region;
  const ShearWarp& view;
  const Rays& rays;
  const GridGeometry& grid;
  std::size_t width;  ///< Pixels of the picture's rows
  std::span<std::uint8_t> rgb;
  std::span<float> depth_mm;  ///< Empty: not required
};

/// Draws a region of a picture: accumulate(), mark_edges(), warp(), each parallel over rows.
class RegionPass {
 public:
  RegionPass(const RegionTarget& target, const RowsView& rows, const VolumeStyle& style, int threads,
             Scratch& scratch)
      : target_(target),
        view_(target.view),
        rows_(rows),
        ranges_(target.grid, target.rays, target.view, style.clip),
        background_{style.background.r / 255.0f, style.background.g / 255.0f, style.background.b / 255.0f},
        stride_((static_cast<std::size_t>(view_.width) + internal::volume_picture::kChunk - 1) /
                internal::volume_picture::kChunk * internal::volume_picture::kChunk),
        groups_((view_.height + kMaxLines - 1) / kMaxLines),
        runs_(static_cast<int>(target.region.runs.size())),
        workers_(worker_count(threads, groups_)),
        warpers_(worker_count(threads, runs_)),
        scratch_(scratch) {
    const std::size_t all = stride_ * static_cast<std::size_t>(view_.height);
    // one more at either end, read beside the first and the last pixel
    scratch_.pixels.resize(all + 2);
    scratch_.pixels.front() = scratch_.pixels.back() = 0;
    scratch_.marked.resize(all);
    scratch_.first_filled.resize(all);
    if (has_depth()) scratch_.half_plane.resize(all);
    const auto grow = [](auto& per_thread, std::size_t count) {
      per_thread.resize(std::max(per_thread.size(), count));
    };
    const auto workers = static_cast<std::size_t>(workers_), warpers = static_cast<std::size_t>(warpers_);
    grow(scratch_.lines, workers * std::size_t{kMaxLines});
    grow(scratch_.mixing, workers);
    grow(scratch_.lit, std::max(workers, warpers));
    for (LitBlockCache& lit : scratch_.lit) lit.forget();
    grow(scratch_.rays, warpers);
    scratch_.edges.resize(scratch_.rays.size());
    scratch_.row_half_planes.resize(scratch_.rays.size());
  }

  /// Accumulates the planes into the intermediate picture, by groups of lines.
  void accumulate() {
    for_each_index(groups_, workers_, [&](int worker, int group) {
      const int first = group * kMaxLines, count = std::min(kMaxLines, view_.height - first);
      std::array<AccumulatedLine, kMaxLines> lines{};
      for (int n = 0; n < count; ++n) {
        auto& line_buffers = scratch_.lines[static_cast<std::size_t>(worker * kMaxLines + n)];
        lines[static_cast<std::size_t>(n)] =
            line_of(line_buffers, view_.width, ranges_.is_clipped(), has_depth());
        ranges_.find(first + n, lines[static_cast<std::size_t>(n)]);
      }
      accumulate_lines(rows_, view_.planes.data(), static_cast<int>(view_.planes.size()), first, count,
                       view_.width, lines.data(),
                       mixing_buffers(scratch_.mixing[static_cast<std::size_t>(worker)],
                                      scratch_.lit[static_cast<std::size_t>(worker)],
                                      rows_.blocks * internal::volume_picture::kBlock));
      for (int n = 0; n < count; ++n) {
        const AccumulatedLine& line = lines[static_cast<std::size_t>(n)];
        const std::size_t at = stride_ * static_cast<std::size_t>(first + n);
        pack_line(line, view_.width, background_.data(), &scratch_.pixels[1 + at]);
        std::copy_n(line.first_filled, view_.width, &scratch_.first_filled[at]);
        if (has_depth()) std::copy_n(line.half_plane, view_.width, &scratch_.half_plane[at]);
      }
      return true;
    });
  }

  /// Marks the intermediate pixels with a large second difference, from which nothing is interpolated.
  void mark_edges() {
    for_each_index(view_.height, workers_, [&](int, int v) {
      const auto line = [&](int n) {
        return &scratch_.pixels[1 + stride_ * static_cast<std::size_t>(std::clamp(n, 0, view_.height - 1))];
      };
      internal::volume_picture::mark_line(line(v - 1), line(v), line(v + 1), view_.width,
                                          &scratch_.marked[stride_ * static_cast<std::size_t>(v)]);
      return true;
    });
  }

  /// Interpolates the picture's pixels from the intermediate ones, and traces rays for those near marked
  /// ones.
  void warp(const CubesView& cubes) {
    const RayStart starts{ranges_, view_, scratch_.first_filled.data(), static_cast<std::ptrdiff_t>(stride_)};
    for_each_index(runs_, warpers_, [&](int worker, int n) {
      const PixelRun& run = target_.region.runs[static_cast<std::size_t>(n)];
      const Eigen::Vector3d start = view_.warp_start + view_.warp_line * run.row;
      std::vector<std::int32_t>& edges = scratch_.edges[static_cast<std::size_t>(worker)];
      std::vector<float>& half_planes = scratch_.row_half_planes[static_cast<std::size_t>(worker)];
      edges.resize(target_.width);
      std::uint8_t* row = &target_.rgb[3 * target_.width * static_cast<std::size_t>(run.row)];
      const int edge_count = internal::volume_picture::warp_row(
          {scratch_.marked.data(), static_cast<std::ptrdiff_t>(stride_), view_.width, view_.height, start[0],
           view_.warp_step[0], start[1], view_.warp_step[1], start[2], view_.warp_step[2]},
          run.begin, run.end, row, edges.data());
      if (has_depth()) warp_half_planes(run, start, half_planes);
      trace(rows_, cubes, starts, run.row, {edges.data(), static_cast<std::size_t>(edge_count)},
            background_.data(), scratch_.rays[static_cast<std::size_t>(worker)],
            scratch_.lit[static_cast<std::size_t>(worker)], row, has_depth() ? half_planes.data() : nullptr);
      if (has_depth()) write_depths(run, half_planes);
      return true;
    });
  }

 private:
  bool has_depth() const { return !target_.depth_mm.empty(); }

  /// Half planes of a row's pixels, each that of the nearest intermediate pixel; -1 outside.
  void warp_half_planes(const PixelRun& run, const Eigen::Vector3d& start,
                        std::vector<float>& half_planes) const {
    half_planes.resize(target_.width);
    for (int x = run.begin; x < run.end; ++x) {
      const Eigen::Vector3d at = start + view_.warp_step * x;
      const long u = std::lround(at[0] / at[2]), v = std::lround(at[1] / at[2]);
      const bool is_in = u >= 0 && v >= 0 && u < view_.width && v < view_.height;
      half_planes[static_cast<std::size_t>(x)] =
          is_in ? scratch_.half_plane[stride_ * static_cast<std::size_t>(v) + static_cast<std::size_t>(u)]
                : -1;
    }
  }

  void write_depths(const PixelRun& run, const std::vector<float>& half_planes) const {
    const Rays& rays = target_.rays;
    for (int x = run.begin; x < run.end; ++x) {
      const float plane = half_planes[static_cast<std::size_t>(x)];
      // the first plane's sample extends half a plane before it
      if (plane < -0.5f) continue;
      const Eigen::Vector3d direction = rays.along(x, run.row);
      const double slice = view_.z_first + view_.z_step * plane,
                   distance_along = (slice - rays.start(x, run.row)[view_.z]) / direction[view_.z];
      target_.depth_mm[target_.width * static_cast<std::size_t>(run.row) + static_cast<std::size_t>(x)] =
          static_cast<float>(
              distance_along *
              (rays.is_parallel ? 1 : (target_.grid.X_PatientVoxel().linear() * direction).norm()));
    }
  }

  const RegionTarget target_;
  const ShearWarp& view_;
  const RowsView rows_;
  const RayRanges ranges_;
  const std::array<float, 3> background_;
  const std::size_t stride_;  ///< Distance between lines of the intermediate picture
  const int groups_, runs_;
  const int workers_, warpers_;  ///< Number of threads over lines, and over the picture's rows
  Scratch& scratch_;
};

}  // namespace

std::vector<StructureAppearance> structure_appearances(const Model& model) {
  std::vector<StructureAppearance> appearances;
  for (const Rgb& colour : colours_of_labels(model)) {
    const Tissue* tissue = model.tissue_of(static_cast<LabelId>(appearances.size()));
    appearances.push_back({colour, tissue != nullptr ? tissue->opacity : 1});
  }
  if (!appearances.empty()) appearances[0].opacity = 0;
  return appearances;
}

Point<Patient> VolumeCamera::at(double column, double row) const {
  const double mm = mm_per_px();
  return focus + right * ((column - 0.5 * (width_px - 1)) * mm) + down * ((row - 0.5 * (height_px - 1)) * mm);
}

VolumeRenderer::VolumeRenderer() = default;
VolumeRenderer::VolumeRenderer(VolumeRenderer&&) noexcept = default;
VolumeRenderer& VolumeRenderer::operator=(VolumeRenderer&&) noexcept = default;
VolumeRenderer::~VolumeRenderer() = default;

Result<VolumeRenderer> VolumeRenderer::make(const Bricks<LabelId>& labels,
                                            std::span<const StructureAppearance> appearances, int threads,
                                            const Progress& progress, ScanAppearance scan) {
  PALPATE_CHECK(scan.scan == nullptr ||
                (scan.scan->geometry().dims == labels.geometry().dims && scan.window[0] < scan.window[1]));
  VolumeRenderer renderer;
  renderer.threads_ = threads;
  renderer.encoding_ = std::make_unique<VolumeEncoding>(labels.geometry(), appearances, std::move(scan));
  renderer.scratch_ = std::make_unique<internal::volume_picture::Scratch>();
  if (const auto made =
          renderer.encoding_->encode(labels, {{0, 0, 0}, labels.geometry().dims}, threads, progress);
      !made)
    return made.error();
  return renderer;
}

void VolumeRenderer::change(const Bricks<LabelId>& labels, const VoxelBox& box) {
  const auto changed = encoding_->encode(labels, box, threads_, {});
  PALPATE_CHECK(changed);
}

std::size_t VolumeRenderer::prepared_bytes() const {
  return encoding_->bytes();
}

void VolumeRenderer::render(const VolumeCamera& camera, const VolumeStyle& style, std::span<std::uint8_t> rgb,
                            std::span<float> depth_mm) {
  const auto width = static_cast<std::size_t>(camera.width_px),
             height = static_cast<std::size_t>(camera.height_px);
  PALPATE_CHECK(rgb.size() == 3 * width * height && (depth_mm.empty() || depth_mm.size() == width * height));
  PALPATE_CHECK(camera.eye_mm > 0 && camera.width_mm > 0);
  std::fill(depth_mm.begin(), depth_mm.end(), std::numeric_limits<float>::infinity());
  const GridGeometry& grid = encoding_->grid();
  const Rays rays(grid, camera);
  const double max_apart = style.clip ? kMaxApartClipped : kMaxApart;
  for (const Region& region : regions_of(grid, camera, rays)) {
    const auto view = ShearWarp::for_region(grid, camera, rays, region, max_apart);
    if (!view) {
      for (const PixelRun& run : region.runs) fill(run, camera.width_px, style.background, rgb);
      continue;
    }
    const RowsView rows = rows_of(encoding_->rows_for(region.axis).view(camera, style.light), grid, *view);
    RegionPass pass({region, *view, rays, grid, width, rgb, depth_mm}, rows, style, threads_, *scratch_);
    pass.accumulate();
    pass.mark_edges();
    pass.warp(encoding_->skips().view(view->x, view->y, view->z));
  }
}

}  // namespace palpate
