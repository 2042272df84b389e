#pragma once

#include <string>

#include "palpate/rendering/rendering.h"

/// Annotations burned into sections and volume pictures.
namespace palpate::section_marks {

/// Content of the annotations that does not follow from plane and model.
struct Caption {
  std::string plane;                   ///< "coronal"; omitted without orientation
  std::array<double, 2> window{0, 0};  ///< Display window of the scan; equal values: omitted
  std::vector<LabelId> structures;     ///< Structures to be named, as many as fit
  bool has_direction = false;  ///< Whether the plane contains a direction, which points down the picture
  bool has_point = true;       ///< Whether a cross marks the centre
  bool has_scale = true;       ///< Whether the scale is uniform over the picture
};

/// Draws the annotations over a section or a volume picture.
void draw_marks(Image& image, const SectionPlane& plane, const Model& model, const Caption& caption);
/// Draws a frame along the border of an image.
void draw_frame(Image& image, const Rgb& colour);

}  // namespace palpate::section_marks
