#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "palpate/rendering/rendering.h"
#include "palpate/rendering/volume_marks.h"
#include "palpate/rendering/volume_renderer.h"

/// Annotated three-dimensional pictures of a model for standalone use.
namespace palpate {

/// Viewing side.
enum class ViewFrom { kAnterior, kPosterior, kLeft, kRight, kSuperior, kInferior };
/// Unit vector from the patient towards that viewer.
Vector<Patient> direction_to(ViewFrom from);

/// Request for volume_picture().
struct VolumePictureRequest {
  ViewFrom from = ViewFrom::kAnterior;
  double turn_deg = 0;  ///< Azimuth of the viewer about superior: from anterior over left to posterior
  double tilt_deg = 0;  ///< Elevation of the viewer, -90 ... 90, applied after turn_deg
  std::optional<Point<Patient>> focus;  ///< Centre of the picture; none: the volume's centre
  double size_mm = 0;                   ///< Width and height at the focus; 0: whole_picture_mm()
  int pixels = 768;                     ///< Width and height; kMinSectionPixels ... kMaxSectionPixels
  /// Perspective with the eye at kEyeDistance picture widths, instead of parallel rays
  bool perspective = false;
  std::optional<ViewFrom> cut;  ///< Side of the focus that is cut away
};
inline constexpr double kEyeDistance = 2.2;

/// Camera for a request.
VolumeCamera camera_of(const GridGeometry& grid, const VolumePictureRequest& request);
/// Picture size at which the volume's bounding box is visible in all requests; their own sizes are ignored.
double whole_picture_mm(const GridGeometry& grid, std::span<const VolumePictureRequest> requests);

/// Renders the structures with orientation letters at the edges, the side of the patient or that it is
/// unknown, the viewing side, a scale bar for parallel rays, names of the largest structures, and the note
/// that it is for research and education. No title and no path.
/// @param renderer  prepared for the model's labels with these appearances
/// @param marks     drawn among the structures
Image volume_picture(VolumeRenderer& renderer, const Model& model,
                     std::span<const StructureAppearance> appearances, const VolumePictureRequest& request,
                     std::span<const VolumeMark> marks = {});

/// PNG of a model from the front, for lists and tables. Errors: kInterrupted.
/// @param model  with labels
Result<std::vector<std::uint8_t>> volume_thumbnail(const Model& model, int pixels,
                                                   const Progress& progress = {});

}  // namespace palpate
