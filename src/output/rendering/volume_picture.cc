#include "palpate/rendering/volume_picture.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "rendering/section_marks.h"

namespace palpate {
namespace {

/// Right and down directions of the picture before rotation and tilt.
std::array<Vector<Patient>, 2> right_and_down(ViewFrom from) {
  const Vector<Patient> inferior(0, 0, -1), posterior(0, 1, 0);
  const bool along_body = from == ViewFrom::kSuperior || from == ViewFrom::kInferior;
  const Vector<Patient> down = along_body ? posterior : inferior;
  // right x down points away from the viewer
  return {down.cross(-direction_to(from)), down};
}

const char* name_of(ViewFrom from) {
  switch (from) {
    case ViewFrom::kAnterior:
      return "anterior";
    case ViewFrom::kPosterior:
      return "posterior";
    case ViewFrom::kLeft:
      return "left";
    case ViewFrom::kRight:
      return "right";
    case ViewFrom::kSuperior:
      return "superior";
    case ViewFrom::kInferior:
      return "inferior";
  }
  return "";
}

std::string view_text(const VolumePictureRequest& request) {
  std::string text = std::string("from ") + name_of(request.from);
  const auto add = [&](const char* what, double degrees) {
    if (degrees != 0) text += std::string(", ") + what + " " + std::to_string(std::lround(degrees));
  };
  add("turned", request.turn_deg);
  add("tilted", request.tilt_deg);
  return text;
}

/// Visible structures by descending volume.
std::vector<LabelId> drawn_structures(const Model& model, std::span<const StructureAppearance> appearances) {
  const std::vector<std::size_t> counts = label_counts(*model.labels);
  std::vector<LabelId> drawn;
  for (std::size_t label = 1; label < std::min(counts.size(), appearances.size()); ++label)
    if (counts[label] > 0 && appearances[label].opacity > 0) drawn.push_back(static_cast<LabelId>(label));
  std::stable_sort(drawn.begin(), drawn.end(), [&](LabelId a, LabelId b) { return counts[a] > counts[b]; });
  return drawn;
}

}  // namespace

Vector<Patient> direction_to(ViewFrom from) {
  switch (from) {
    case ViewFrom::kAnterior:
      return {0, -1, 0};
    case ViewFrom::kPosterior:
      return {0, 1, 0};
    case ViewFrom::kLeft:
      return {1, 0, 0};
    case ViewFrom::kRight:
      return {-1, 0, 0};
    case ViewFrom::kSuperior:
      return {0, 0, 1};
    case ViewFrom::kInferior:
      return {0, 0, -1};
  }
  return {};
}

VolumeCamera camera_of(const GridGeometry& grid, const VolumePictureRequest& request) {
  const auto [right, down] = right_and_down(request.from);
  const double turn = request.turn_deg * std::numbers::pi / 180,
               tilt = request.tilt_deg * std::numbers::pi / 180;
  const Rotation<Patient, Patient> turning =
      Rotation<Patient, Patient>::about(Eigen::Vector3d::UnitZ(), turn);
  const Vector<Patient> turned_down = turning * down;
  VolumeCamera camera;
  camera.right = turning * right;
  const Vector<Patient> into = camera.right.cross(turned_down);
  camera.down = turned_down * std::cos(tilt) - into * std::sin(tilt);
  camera.focus = request.focus.value_or(grid.centre());
  camera.width_mm = request.size_mm > 0 ? request.size_mm : whole_picture_mm(grid, {&request, 1});
  camera.width_px = camera.height_px = request.pixels;
  if (request.perspective) camera.eye_mm = kEyeDistance * camera.width_mm;
  return camera;
}

double whole_picture_mm(const GridGeometry& grid, std::span<const VolumePictureRequest> requests) {
  constexpr double kRim = 1.04;
  double largest = 0;
  for (VolumePictureRequest request : requests) {
    request.size_mm = 1;
    const VolumeCamera camera = camera_of(grid, request);
    for (int corner = 0; corner < 8; ++corner) {
      const auto end = [&](int axis) {
        return (corner >> axis & 1) != 0 ? grid.dims[static_cast<std::size_t>(axis)] - 0.5 : -0.5;
      };
      const Vector<Patient> off = grid.X_PatientVoxel() * Point<Voxel>(end(0), end(1), end(2)) - camera.focus;
      const double lateral = std::max(std::abs(off.dot(camera.right)), std::abs(off.dot(camera.down)));
      // width needed in perspective with the eye at kEyeDistance times the width: nearer points appear larger
      const double nearer = request.perspective ? std::max(0.0, -off.dot(camera.into())) / kEyeDistance : 0;
      largest = std::max(largest, kRim * (2 * lateral + nearer));
    }
  }
  return largest;
}

Image volume_picture(VolumeRenderer& renderer, const Model& model,
                     std::span<const StructureAppearance> appearances, const VolumePictureRequest& request,
                     std::span<const VolumeMark> marks) {
  PALPATE_CHECK(model.labels != nullptr && request.pixels > 0);
  const VolumeCamera camera = camera_of(model.labels->geometry(), request);
  VolumeStyle style;
  if (request.cut) style.clip = ClipPlane{camera.focus, direction_to(*request.cut)};
  Image image{camera.width_px, camera.height_px,
              std::vector<std::uint8_t>(3 * static_cast<std::size_t>(camera.width_px) * camera.height_px)};
  std::vector<float> depth_mm(marks.empty() ? 0 : image.rgb.size() / 3);
  renderer.render(camera, style, image.rgb, depth_mm);
  if (!marks.empty()) draw_volume_marks(image, depth_mm, camera, marks);
  section_marks::Caption caption;
  caption.plane = view_text(request);
  caption.structures = drawn_structures(model, appearances);
  caption.has_point = false;
  caption.has_scale = camera.is_parallel();
  section_marks::draw_marks(
      image, {camera.focus, camera.right, camera.down, camera.width_mm, camera.width_px, camera.height_px},
      model, caption);
  return image;
}

Result<std::vector<std::uint8_t>> volume_thumbnail(const Model& model, int pixels, const Progress& progress) {
  const auto appearances = structure_appearances(model);
  auto renderer = VolumeRenderer::make(*model.labels, appearances, 0, progress);
  if (!renderer) return renderer.error();
  VolumePictureRequest request;
  request.pixels = pixels;
  return encode_png(volume_picture(*renderer, model, appearances, request));
}

}  // namespace palpate
