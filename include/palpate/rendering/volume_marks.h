#pragma once

#include <span>
#include <vector>

#include "palpate/rendering/rendering.h"
#include "palpate/rendering/volume_renderer.h"

/// Geometry drawn together with the structures of a volume picture: tip, tool, force, path.
namespace palpate {

/// Convex hull of two spheres: a sphere, a capsule or a truncated cone.
struct VolumeMark {
  Point<Patient> from, to;
  double from_mm = 0, to_mm = 0;  ///< Radii
  Rgb colour;
  double behind = 0;  ///< Visibility through structures in front of it, 0 ... 1
};

/// Adds a polyline whose width is given in pixels at the focus. Points less than half a pixel apart, and
/// points that are not finite, are omitted.
void add_path(std::vector<VolumeMark>& marks, std::span<const Point<Patient>> points, double width_px,
              const Rgb& colour, double behind, const VolumeCamera& camera);
/// Adds an arrow from its tail to its head, which is a cone.
void add_arrow(std::vector<VolumeMark>& marks, const Point<Patient>& tail,
               const Vector<Patient>& displacement, double radius_mm, const Rgb& colour);

/// Draws marks into a picture with depth testing and four samples per pixel, lit from the viewer.
/// Bit-identical on every machine.
/// @param depth_mm  depth buffer of VolumeRenderer::render for the same camera
void draw_volume_marks(Image& image, std::span<const float> depth_mm, const VolumeCamera& camera,
                       std::span<const VolumeMark> marks);

}  // namespace palpate
