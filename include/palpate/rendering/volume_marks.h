#pragma once

#include <span>
#include <vector>

#include "palpate/rendering/rendering.h"
#include "palpate/rendering/volume_renderer.h"

/// What is drawn among the structures of a volume's picture: a tip, a tool, a force, a path.
namespace palpate {

/// Two balls, and what the tangents from one to the other enclose: a ball, a capsule, a cone.
struct VolumeMark {
  Point<Patient> from, to;
  double from_mm = 0, to_mm = 0;  ///< radii
  Rgb colour;
  double behind = 0;  ///< how much of it is seen through the structures before it, 0 ... 1
};

/// Stretches of a line whose width is in pixels at the focus. Points that are less than half a pixel apart
/// are left out, and what is not finite.
void add_path(std::vector<VolumeMark>& marks, std::span<const Point<Patient>> points, double width_px,
              const Rgb& colour, double behind, const VolumeCamera& camera);
/// From its tail to its head, which is a cone.
void add_arrow(std::vector<VolumeMark>& marks, const Point<Patient>& tail, const Vector<Patient>& way,
               double radius_mm, const Rgb& colour);

/// Draws marks into a picture, each before what is deeper and behind what is less deep, by four samples a
/// pixel. Lit from the viewer. The same bits wherever it runs.
/// @param depth_mm  VolumeRenderer::render's, of the same camera
void draw_volume_marks(Image& image, std::span<const float> depth_mm, const VolumeCamera& camera,
                       std::span<const VolumeMark> marks);

}  // namespace palpate
