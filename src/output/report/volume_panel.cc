#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "palpate/rendering/volume_picture.h"
#include "report/html.h"
#include "report/overlay.h"
#include "report/page_sections.h"
#include "report/tool_marks.h"

namespace palpate::report {
namespace {

constexpr int kVolume_px = 560, kSearch_px = 128;
/// Larger volumes get no picture: a solid voxel takes 32 bytes during rendering.
constexpr std::size_t kMaxVoxels = std::size_t{1} << 28;
/// Field of view of a contact's close-up.
constexpr int kContact_px = 260;
constexpr double kContact_mm = 70;

Point<Patient> proxy_of(const ShownContact& shown) {
  return proxy_position(shown.peak, shown.contact.device);
}

/// Number of contact points that are not occluded.
int visible_points(VolumeRenderer& renderer, const Run& run, const VolumeCamera& camera) {
  std::vector<std::uint8_t> rgb(std::size_t{3} * kSearch_px * kSearch_px);
  std::vector<float> depth_mm(std::size_t{kSearch_px} * kSearch_px);
  renderer.render(camera, {}, rgb, depth_mm);
  // tolerance: a voxel, and the change of depth within a pixel
  const double slack_mm = 2 * camera.mm_per_px();
  int visible = 0;
  for (const ShownContact& shown : run.shown) {
    const Vector<Patient> off = proxy_of(shown) - camera.focus;
    const auto pixel = [&](const Vector<Patient>& axis) {
      const double at = off.dot(axis) / camera.mm_per_px() + 0.5 * (kSearch_px - 1);
      return at > -0.5 && at < kSearch_px - 0.5 ? std::lround(at) : -1;
    };
    const long column = pixel(camera.right), row = pixel(camera.down);
    if (column < 0 || row < 0) continue;
    const float depth = depth_mm[static_cast<std::size_t>(row * kSearch_px + column)];
    if (off.dot(camera.into()) <= depth + slack_mm) ++visible;
  }
  return visible;
}

/// View direction from which most contact points are visible.
Result<ViewFrom> best_view(VolumeRenderer& renderer, const Run& run, const GridGeometry& grid,
                           const Progress& progress) {
  ViewFrom best = ViewFrom::kAnterior;
  int largest = -1;
  for (const ViewFrom from : {ViewFrom::kAnterior, ViewFrom::kLeft, ViewFrom::kRight, ViewFrom::kPosterior,
                              ViewFrom::kSuperior, ViewFrom::kInferior}) {
    if (progress.stopped()) return Progress::interrupted();
    VolumePictureRequest request;
    request.from = from;
    request.pixels = kSearch_px;
    const int visible = visible_points(renderer, run, camera_of(grid, request));
    if (visible > largest) best = from, largest = visible;
  }
  return best;
}

std::vector<VolumeMark> marks_of(const Run& run, const VolumeCamera& camera) {
  std::vector<VolumeMark> marks;
  const double mm_per_N = arrow_mm_per_N(run.forces.highest_limit_N),
               position_mm = kPositionFraction * camera.width_mm;
  const ShownContact* hardest = nullptr;
  for (const ShownContact& shown : run.shown) {
    for (const PathSection& section : shown.paths)
      add_path(marks, section.points, section.touching ? 2.2 : 1.5,
               section.touching ? kTouchingPathColour : kFreePathColour, kPathBehind, camera);
    const Point<Patient> position = proxy_of(shown);
    marks.push_back({position, position, position_mm, position_mm, kPositionColour, kPositionBehind});
    add_arrow(marks, position, patient_force_N(run.model, shown.peak, shown.contact.device) * mm_per_N,
              kArrowFraction * camera.width_mm, kForceColour);
    if (hardest == nullptr || shown.contact.peak_force_N > hardest->contact.peak_force_N) hardest = &shown;
  }
  if (hardest != nullptr) add_tool(marks, run.model, hardest->peak, hardest->contact.device);
  return marks;
}

/// View from the side to which the force pushes the hand, i.e. from where it approached.
ViewFrom view_of_contact(const Run& run, const ShownContact& shown, ViewFrom otherwise) {
  const Vector<Patient> force = patient_force_N(run.model, shown.peak, shown.contact.device);
  ViewFrom best = otherwise;
  double largest = 0;
  for (const ViewFrom from : {ViewFrom::kAnterior, ViewFrom::kLeft, ViewFrom::kRight, ViewFrom::kPosterior,
                              ViewFrom::kSuperior, ViewFrom::kInferior}) {
    const double along = force.dot(direction_to(from));
    if (along > largest) best = from, largest = along;
  }
  return best;
}

/// Close-up of a contact: its point, path, force and tool only.
std::string contact_image(VolumeRenderer& renderer, const Run& run, const Model& model,
                          std::span<const StructureAppearance> appearances, const ShownContact& shown,
                          ViewFrom otherwise) {
  VolumePictureRequest request;
  request.from = view_of_contact(run, shown, otherwise);
  request.tilt_deg = 20;
  request.turn_deg = 20;
  request.focus = proxy_of(shown);
  request.size_mm = kContact_mm;
  request.pixels = kContact_px;
  const VolumeCamera camera = camera_of(model.labels->geometry(), request);
  std::vector<VolumeMark> marks;
  const double position_mm = kPositionFraction * camera.width_mm;
  for (const PathSection& section : shown.paths)
    add_path(marks, section.points, section.touching ? 2.2 : 1.5,
             section.touching ? kTouchingPathColour : kFreePathColour, kPathBehind, camera);
  const Point<Patient> position = proxy_of(shown);
  marks.push_back({position, position, position_mm, position_mm, kPositionColour, kPositionBehind});
  add_tool(marks, run.model, shown.peak, shown.contact.device);
  add_arrow(marks, position,
            patient_force_N(run.model, shown.peak, shown.contact.device) *
                arrow_mm_per_N(run.forces.highest_limit_N),
            2 * kArrowFraction * camera.width_mm, kForceColour);
  const std::string size = std::to_string(kContact_px);
  return "<img class=\"near\" alt=\"" + escape(run.name(shown.contact.label)) +
         " in three dimensions around the place where it was pressed hardest\" width=\"" + size +
         "\" height=\"" + size + "\" src=\"data:image/png;base64," +
         base64(encode_png(volume_picture(renderer, model, appearances, request, marks))) + "\">";
}

std::string too_large_html() {
  return "<section class=\"card\" aria-labelledby=\"volume-title\"><h2 id=\"volume-title\">Where it was "
         "touched</h2>\n"
         "<p>No overview picture: the volume has more than " +
         std::to_string(kMaxVoxels / 1'000'000) + " million voxels.</p></section>\n";
}

std::string figure_html(const Run& run, const Image& picture) {
  const std::string size = std::to_string(kVolume_px), count = std::to_string(run.shown.size());
  return "<section class=\"card\" aria-labelledby=\"volume-title\"><h2 id=\"volume-title\">Where it was "
         "touched</h2>\n<figure class=\"volume\"><img alt=\"The structures in three dimensions, with the " +
         count + " places that are shown below and the path between them\" width=\"" + size + "\" height=\"" +
         size + "\" src=\"data:image/png;base64," + base64(encode_png(picture)) +
         "\"><figcaption>Red: where each structure was pressed hardest. Yellow: the path in contact, white a "
         "second before and after. Blue: the force on the hand. Green: the tool at the largest force of all. "
         "Parts behind a structure are faint." +
         (run.removal.changes.empty()
              ? ""
              : " What a " + cutter_name(run.model) + " had removed by the end is left out.") +
         "</figcaption></figure></section>\n";
}

}  // namespace

Result<VolumePictures> volume_pictures(const Run& run, const Progress& progress) {
  VolumePictures pictures;
  pictures.of_contact.resize(run.shown.size());
  if (run.shown.empty() || run.model.labels == nullptr) return pictures;
  if (run.model.labels->geometry().voxel_count() > kMaxVoxels) {
    pictures.html = too_large_html();
    return pictures;
  }
  const auto after_removal =
      model_after_removal(run.model, run.removal.changes, std::numeric_limits<double>::infinity());
  const Model& model = after_removal != nullptr ? *after_removal : run.model;
  const std::vector<StructureAppearance> appearances = structure_appearances(model);
  auto renderer = VolumeRenderer::make(*model.labels, appearances, 0, progress);
  if (!renderer) return renderer.error();
  const GridGeometry& grid = model.labels->geometry();
  const auto from = best_view(*renderer, run, grid, progress);
  if (!from) return from.error();
  VolumePictureRequest request;
  request.from = *from;
  request.pixels = kVolume_px;
  pictures.html = figure_html(
      run, volume_picture(*renderer, model, appearances, request, marks_of(run, camera_of(grid, request))));
  for (std::size_t n = 0; n < run.shown.size(); ++n) {
    if (progress.stopped()) return Progress::interrupted();
    pictures.of_contact[n] = contact_image(*renderer, run, model, appearances, run.shown[n], *from);
  }
  return pictures;
}

}  // namespace palpate::report
