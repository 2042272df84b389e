#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "palpate/rendering/rendering.h"
#include "palpate/rendering/volume_marks.h"
#include "palpate/rendering/volume_renderer.h"

/// Pictures of a model in three dimensions, to look at on their own.
namespace palpate {

/// Where the viewer stands.
enum class ViewFrom { kAnterior, kPosterior, kLeft, kRight, kSuperior, kInferior };
/// Away from the patient, towards that viewer; unit.
Vector<Patient> direction_to(ViewFrom from);

struct VolumePictureRequest {
  ViewFrom from = ViewFrom::kAnterior;
  double turn_deg = 0;  ///< the viewer goes so far around superior: from anterior over left to posterior
  double tilt_deg = 0;  ///< and then so far up, -90 ... 90
  std::optional<Point<Patient>> focus;  ///< in the middle of the picture; none: the volume's centre
  double size_mm = 0;                   ///< width and height, at the focus; 0: whole_picture_mm()
  int pixels = 768;                     ///< width and height; kLeastSectionPixels ... kMostSectionPixels
  bool perspective = false;             ///< from an eye kEyeDistance pictures off, instead of parallel rays
  std::optional<ViewFrom> cut;          ///< what lies on this side of the focus is taken away
};
inline constexpr double kEyeDistance = 2.2;

VolumeCamera camera_of(const GridGeometry& grid, const VolumePictureRequest& request);
/// So large that all of the volume's box is seen, from any of the requests; their own size does not count.
double whole_picture_mm(const GridGeometry& grid, std::span<const VolumePictureRequest> requests);

/// The structures, orientation letters on the edges, the side of the patient or that nobody knows it, whence
/// one looks, a scale bar where rays are parallel, names of the largest structures, and that it is for
/// research and education. No title and no path.
/// @param renderer  of the model's labels, with these looks
/// @param marks     drawn among the structures
Image volume_picture(VolumeRenderer& renderer, const Model& model, std::span<const StructureLook> looks,
                     const VolumePictureRequest& request, std::span<const VolumeMark> marks = {});

/// A PNG of a model as it looks from the front, for lists and tables. Errors: kInterrupted.
/// @param model  with labels
Result<std::vector<std::uint8_t>> volume_thumbnail(const Model& model, int pixels,
                                                   const Progress& progress = {});

}  // namespace palpate
