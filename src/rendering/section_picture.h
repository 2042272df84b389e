#pragma once

#include <string>

#include "palpate/rendering/rendering.h"

/// What is burned into a section, and into a picture of the volume.
namespace palpate::section_marks {

/// What the marks say besides what follows from plane and model.
struct Caption {
  std::string plane;                   ///< "coronal"; not shown without orientation
  std::array<double, 2> window{0, 0};  ///< of the scan; both equal: none is shown
  std::vector<LabelId> structures;     ///< named, as many as there is room for
  bool along = false;                  ///< the picture's vertical is a direction
  bool has_point = true;               ///< a cross marks the middle
  bool has_scale = true;               ///< lengths are the same all over the picture
};

void draw_marks(Image& image, const SectionPlane& plane, const Model& model, const Caption& caption);

}  // namespace palpate::section_marks
