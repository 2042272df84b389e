#include <cmath>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "c/model.h"
#include "palpate/rendering/rendering.h"
#include "palpate/rendering/volume_renderer.h"

namespace palpate::c {
namespace {

constexpr int kMaxPixels = 4096;
constexpr double kMinPixel_mm = 1e-3, kMaxPixel_mm = 1e3, kMaxPosition_mm = 1e6;
// pictures address voxels by 32 bits
constexpr std::size_t kMaxVoxelsDrawn = std::size_t{1} << 31;

Error bad_picture(const char* member, const char* remedy) {
  return {ErrorKind::kBadInput, "a picture that cannot be drawn", member, remedy};
}

/// Members that a section and a camera have in common.
struct Window {
  const double* centre_mm;
  const double *right, *down;
  double width_mm;
  std::int32_t width_px, height_px;
};

Result<void> check_window(const plp_model& model, const Window& window) {
  const auto is_length = [](std::int32_t pixels) { return pixels >= 1 && pixels <= kMaxPixels; };
  if (!is_length(window.width_px) || !is_length(window.height_px))
    return bad_picture("width_px", "give 1 to 4096 pixels in both directions");
  const Eigen::Map<const Eigen::Vector3d> centre(window.centre_mm), right(window.right), down(window.down);
  if (!centre.allFinite() || centre.cwiseAbs().maxCoeff() > kMaxPosition_mm)
    return bad_picture("centre_mm", "give a position in mm");
  if (!(std::abs(right.norm() - 1) < 1e-3 && std::abs(down.norm() - 1) < 1e-3 &&
        std::abs(right.dot(down)) < 1e-3))
    return bad_picture("right", "give two orthogonal unit vectors as `right` and `down`");
  const double pixel_mm = window.width_mm / window.width_px;
  if (!(pixel_mm >= kMinPixel_mm && pixel_mm <= kMaxPixel_mm))
    return bad_picture("width_mm", "give a width of 0.001 to 1000 mm for each pixel");
  if (model.current().labels->geometry().voxel_count() >= kMaxVoxelsDrawn)
    return bad_picture("model", "only volumes of less than 2^31 voxels are drawn");
  return {};
}

std::size_t pixels_of(const Window& window) {
  return static_cast<std::size_t>(window.width_px) * static_cast<std::size_t>(window.height_px);
}

Window window_of(const plp_section& section) {
  return {section.centre_mm, section.right,    section.down,
          section.width_mm,  section.width_px, section.height_px};
}
Window window_of(const plp_camera& camera) {
  return {camera.focus_mm, camera.right, camera.down, camera.width_mm, camera.width_px, camera.height_px};
}

SectionPlane plane_of(const plp_section& section) {
  return {Point<Patient>(Eigen::Vector3d(section.centre_mm)),
          Vector<Patient>(Eigen::Vector3d(section.right)),
          Vector<Patient>(Eigen::Vector3d(section.down)),
          section.width_mm,
          section.width_px,
          section.height_px};
}

Result<SectionStyle> style_of(const plp_section& section) {
  if (!std::isfinite(section.window_low) || !std::isfinite(section.window_high) ||
      section.window_low > section.window_high)
    return bad_picture("window_low", "give finite values, low and high");
  if (!(section.label_opacity >= 0 && section.label_opacity <= 1))
    return bad_picture("label_opacity", "give 0 to 1");
  SectionStyle style;
  style.window_low = section.window_low;
  style.window_high = section.window_high;
  style.label_opacity = section.label_opacity;
  style.outlines = section.outlines != 0;
  return style;
}

plp_status room_is_missing(std::size_t needed) {
  return fail(PLP_BAD_INPUT, "the picture takes " + std::to_string(needed) + " elements: give room for them");
}

// section with its style, drawn or looked up by `draw(plane, style)`
template <class Draw>
plp_status draw_section(const plp_model* model, const plp_section* section, const Draw& draw) {
  plp_section section_input;
  if (!is_handle(model) || !read(section, section_input)) return PLP_BAD_INPUT;
  if (auto fine = check_window(*model, window_of(section_input)); !fine) return fail(fine.error());
  const auto style = style_of(section_input);
  if (!style) return fail(style.error());
  return draw(section_input, *style);
}

plp_status draw_picture(const plp_model& model, const plp_camera& from, std::span<std::uint8_t> rgb,
                        std::span<float> depth_mm) {
  const auto appearances = structure_appearances(model.current());
  auto renderer = VolumeRenderer::make(*model.current().labels, appearances);
  if (!renderer) return fail(renderer.error());
  VolumeCamera camera;
  camera.focus = Point<Patient>(Eigen::Vector3d(from.focus_mm));
  camera.right = Vector<Patient>(Eigen::Vector3d(from.right));
  camera.down = Vector<Patient>(Eigen::Vector3d(from.down));
  camera.width_mm = from.width_mm;
  camera.width_px = from.width_px;
  camera.height_px = from.height_px;
  camera.eye_mm = from.eye_mm;
  renderer->render(camera, {}, rgb, depth_mm);
  return PLP_OK;
}

}  // namespace
}  // namespace palpate::c

using palpate::c::fail;
using palpate::c::guarded;
using palpate::c::is_handle;

plp_status plp_model_section(const plp_model* model, const plp_section* section, uint8_t* rgb, size_t bytes) {
  return guarded([&] {
    return palpate::c::draw_section(
        model, section, [&](const plp_section& section_input, const palpate::SectionStyle& style) {
          const std::size_t needed = 3 * palpate::c::pixels_of(palpate::c::window_of(section_input));
          if (rgb == nullptr || bytes != needed) return palpate::c::room_is_missing(needed);
          const auto image =
              palpate::render_section(model->current(), palpate::c::plane_of(section_input), style);
          std::memcpy(rgb, image.rgb.data(), needed);
          return PLP_OK;
        });
  });
}

plp_status plp_model_section_labels(const plp_model* model, const plp_section* section, uint16_t* labels,
                                    size_t count) {
  return guarded([&] {
    return palpate::c::draw_section(
        model, section, [&](const plp_section& section_input, const palpate::SectionStyle& style) {
          const std::size_t needed = palpate::c::pixels_of(palpate::c::window_of(section_input));
          if (labels == nullptr || count != needed) return palpate::c::room_is_missing(needed);
          const auto found =
              palpate::section_labels(model->current(), palpate::c::plane_of(section_input), style);
          std::memcpy(labels, found.data(), needed * sizeof *labels);
          return PLP_OK;
        });
  });
}

plp_status plp_model_picture(const plp_model* model, const plp_camera* camera, uint8_t* rgb, size_t bytes,
                             float* depth_mm) {
  return guarded([&] {
    plp_camera input;
    if (!is_handle(model) || !palpate::c::read(camera, input)) return PLP_BAD_INPUT;
    if (auto fine = palpate::c::check_window(*model, palpate::c::window_of(input)); !fine)
      return fail(fine.error());
    if (!(input.eye_mm >= 1))
      return fail(PLP_BAD_INPUT, "eye_mm: give a distance of at least 1 mm, or infinity");
    const std::size_t pixels = palpate::c::pixels_of(palpate::c::window_of(input));
    if (rgb == nullptr || bytes != 3 * pixels) return palpate::c::room_is_missing(3 * pixels);
    return palpate::c::draw_picture(*model, input, {rgb, bytes},
                                    depth_mm == nullptr ? std::span<float>() : std::span(depth_mm, pixels));
  });
}
