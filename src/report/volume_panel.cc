#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "palpate/rendering/volume_picture.h"
#include "report/html.h"
#include "report/overlay.h"
#include "report/parts.h"

namespace palpate::report {
namespace {

constexpr int kVolume_px = 560, kSearch_px = 128;
/// Of larger volumes there is no picture: a solid voxel takes 32 bytes while it is made.
constexpr std::size_t kMostVoxels = std::size_t{1} << 28;
/// Of the picture's width: the least that a touched place and a force are wide.
constexpr double kPlaceShare = 0.007, kArrowShare = 0.004;
/// As in the sections; the places stand out from bone.
constexpr Rgb kFreeWay{255, 255, 255}, kTouchingWay{255, 225, 77}, kForce{79, 227, 255}, kTool{155, 227, 122},
    kPlace{255, 80, 70};
/// How much is seen of what lies behind structures.
constexpr double kWayBehind = 0.3, kPlaceBehind = 0.45;

Point<Patient> proxy_of(const ShownContact& shown) {
  const auto& at = shown.at_peak().proxy_patient_mm;
  return {at[0], at[1], at[2]};
}

/// How many of the touched places nothing is before.
int places_seen(VolumeRenderer& renderer, const Run& run, const VolumeCamera& camera) {
  std::vector<std::uint8_t> rgb(std::size_t{3} * kSearch_px * kSearch_px);
  std::vector<float> depth_mm(std::size_t{kSearch_px} * kSearch_px);
  renderer.render(camera, {}, rgb, depth_mm);
  // a place lies on its surface, give or take a voxel and what a pixel's depth changes by
  const double slack_mm = 2 * camera.mm_per_px();
  int seen = 0;
  for (const ShownContact& shown : run.shown) {
    const Vector<Patient> off = proxy_of(shown) - camera.focus;
    const auto pixel = [&](const Vector<Patient>& axis) {
      const double at = off.dot(axis) / camera.mm_per_px() + 0.5 * (kSearch_px - 1);
      return at > -0.5 && at < kSearch_px - 0.5 ? std::lround(at) : -1;
    };
    const long column = pixel(camera.right), row = pixel(camera.down);
    if (column < 0 || row < 0) continue;
    const float depth = depth_mm[static_cast<std::size_t>(row * kSearch_px + column)];
    if (off.dot(camera.into()) <= depth + slack_mm) ++seen;
  }
  return seen;
}

/// From the side whence most touched places are seen.
Result<ViewFrom> best_view(VolumeRenderer& renderer, const Run& run, const GridGeometry& grid,
                           const Progress& progress) {
  ViewFrom best = ViewFrom::kAnterior;
  int most = -1;
  for (const ViewFrom from : {ViewFrom::kAnterior, ViewFrom::kLeft, ViewFrom::kRight, ViewFrom::kPosterior,
                              ViewFrom::kSuperior, ViewFrom::kInferior}) {
    if (progress.stopped()) return Progress::interrupted();
    VolumePictureRequest request;
    request.from = from;
    request.pixels = kSearch_px;
    const int seen = places_seen(renderer, run, camera_of(grid, request));
    if (seen > most) best = from, most = seen;
  }
  return best;
}

void add_tool(std::vector<VolumeMark>& marks, const Model& model, const ShownContact& shown,
              double least_mm) {
  const int device = shown.contact.device;
  for (const ToolBall& ball : tool_balls(model, shown.peak, device)) {
    const double radius = std::max(ball.radius_mm, least_mm);
    marks.push_back({ball.middle, ball.middle, radius, radius, kTool, 0});
  }
  const auto& w = shown.at_peak().orientation_wxyz;
  const Eigen::Quaterniond held(w[0], w[1], w[2], w[3]);
  if (!held.coeffs().allFinite() || !(held.squaredNorm() > 0)) return;
  for (const ToolCapsule& capsule : model.tool_of(static_cast<std::size_t>(device)).capsules) {
    const auto end = [&](const Eigen::Vector3d& at) {
      return proxy_of(shown) + in_patient(model, shown.peak, Vector<World>(held.normalized() * at));
    };
    marks.push_back(
        {end(capsule.from_mm), end(capsule.to_mm), capsule.radius_mm, capsule.radius_mm, kTool, 0});
  }
}

std::vector<VolumeMark> marks_of(const Run& run, const VolumeCamera& camera) {
  std::vector<VolumeMark> marks;
  const double mm_per_N = arrow_mm_per_N(run.forces.highest_limit_N),
               place_mm = kPlaceShare * camera.width_mm;
  const ShownContact* hardest = nullptr;
  for (const ShownContact& shown : run.shown) {
    for (const Way& way : shown.ways)
      add_path(marks, way.points, way.touching ? 2.2 : 1.5, way.touching ? kTouchingWay : kFreeWay,
               kWayBehind, camera);
    const Point<Patient> place = proxy_of(shown);
    marks.push_back({place, place, place_mm, place_mm, kPlace, kPlaceBehind});
    add_arrow(marks, place, patient_force_N(run.model, shown.peak, shown.contact.device) * mm_per_N,
              kArrowShare * camera.width_mm, kForce);
    if (hardest == nullptr || shown.contact.peak_force_N > hardest->contact.peak_force_N) hardest = &shown;
  }
  if (hardest != nullptr) add_tool(marks, run.model, *hardest, 0);
  return marks;
}

std::string too_large_html() {
  return "<section class=\"card\" aria-labelledby=\"volume-title\"><h2 id=\"volume-title\">Where it was "
         "touched</h2>\n<p>No picture of the whole: the volume has more than " +
         std::to_string(kMostVoxels / 1'000'000) + " million voxels.</p></section>\n";
}

std::string figure_html(const Run& run, const Image& picture) {
  const std::string size = std::to_string(kVolume_px), count = std::to_string(run.shown.size());
  return "<section class=\"card\" aria-labelledby=\"volume-title\"><h2 id=\"volume-title\">Where it was "
         "touched</h2>\n<figure class=\"volume\"><img alt=\"The structures in three dimensions, with the " +
         count + " places that are shown below and the path between them\" width=\"" + size + "\" height=\"" +
         size + "\" src=\"data:image/png;base64," + base64(encode_png(picture)) +
         "\"><figcaption>Red: where each structure was pressed hardest. Yellow: the path in contact, white a "
         "second before and after. Blue: the force on the hand. Green: the tool at the largest force of all. "
         "What "
         "lies behind a structure is faint." +
         (run.removal.changes.empty() ? "" : " What a burr had taken by the end is left out.") +
         "</figcaption></figure></section>\n";
}

}  // namespace

Result<std::string> volume_html(const Run& run, const Progress& progress) {
  if (run.shown.empty() || run.model.labels == nullptr) return std::string();
  if (run.model.labels->geometry().voxel_count() > kMostVoxels) return too_large_html();
  const auto left = model_left(run.model, run.removal.changes, std::numeric_limits<double>::infinity());
  const Model& model = left != nullptr ? *left : run.model;
  const std::vector<StructureLook> looks = structure_looks(model);
  auto renderer = VolumeRenderer::make(*model.labels, looks, 0, progress);
  if (!renderer) return renderer.error();
  const GridGeometry& grid = model.labels->geometry();
  const auto from = best_view(*renderer, run, grid, progress);
  if (!from) return from.error();
  VolumePictureRequest request;
  request.from = *from;
  request.pixels = kVolume_px;
  return figure_html(
      run, volume_picture(*renderer, model, looks, request, marks_of(run, camera_of(grid, request))));
}

}  // namespace palpate::report
