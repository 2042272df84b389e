#include <algorithm>
#include <array>
#include <vector>

#include "palpate/rendering/rendering.h"
#include "rendering/marks.h"
#include "rendering/section_marks.h"

namespace palpate {
namespace {

// colours of 3D Slicer
constexpr Rgb kAxialFrame{243, 74, 51}, kCoronalFrame{110, 176, 75}, kSagittalFrame{237, 213, 76};

Image side_by_side(const std::vector<Image>& images) {
  Image all;
  for (const Image& image : images) all.width += image.width;
  all.height = images.front().height;
  for (int y = 0; y < all.height; ++y) {
    for (const Image& image : images) {
      const auto row = image.rgb.begin() + std::ptrdiff_t{3} * image.width * y;
      all.rgb.insert(all.rgb.end(), row, row + std::ptrdiff_t{3} * image.width);
    }
  }
  return all;
}

/// Longest side of the volume.
double whole_mm(const GridGeometry& grid) {
  double longest = 0;
  for (int a = 0; a < 3; ++a) longest = std::max(longest, grid.dims[a] * grid.spacing_mm[a]);
  return longest;
}

struct View {
  const char* name;
  SectionPlane plane;
  bool has_direction = false;
};

Image draw_view(SectionRenderer& renderer, const Model& model, const View& view,
                const std::array<double, 2>& window) {
  const SectionPlane& plane = view.plane;
  const std::size_t pixels = static_cast<std::size_t>(plane.width_px) * plane.height_px;
  Image image{plane.width_px, plane.height_px, std::vector<std::uint8_t>(3 * pixels)};
  std::vector<LabelId> labels(pixels);
  renderer.render(plane, image.rgb);
  renderer.labels(plane, labels);
  section_marks::draw_marks(image, plane, model,
                            {view.name, window, marks::largest_first(labels), view.has_direction});
  return image;
}

}  // namespace

Result<Image> section_picture(const Model& model, const SectionRequest& request) {
  PALPATE_CHECK(request.pixels >= kMinSectionPixels && request.pixels <= kMaxSectionPixels);
  PALPATE_CHECK(request.size_mm >= 0 && (model.scan != nullptr || model.labels != nullptr));
  const GridGeometry& grid = model.labels != nullptr ? model.labels->geometry() : model.scan->geometry();
  if (!marks::contains(grid, request.centre)) return marks::outside_error(grid, request.centre);

  const double size_mm = request.size_mm > 0 ? request.size_mm : whole_mm(grid);
  const auto anatomical = [&](const char* name, AnatomicalPlane plane) {
    return View{name, anatomical_section(plane, request.centre, size_mm, request.pixels, request.pixels)};
  };
  const View axial = anatomical("axial", AnatomicalPlane::kAxial),
             coronal = anatomical("coronal", AnatomicalPlane::kCoronal),
             sagittal = anatomical("sagittal", AnatomicalPlane::kSagittal);
  SectionStyle style = request.style;
  if (!(style.window_low < style.window_high) && model.scan != nullptr) {
    const auto window = scan_window(*model.scan);
    style.window_low = window[0];
    style.window_high = window[1];
  }
  const std::array window{style.window_low, style.window_high};
  SectionRenderer renderer(model, style, SectionStorage::kModel);
  switch (request.kind) {
    case SectionKind::kAxial:
      return draw_view(renderer, model, axial, window);
    case SectionKind::kCoronal:
      return draw_view(renderer, model, coronal, window);
    case SectionKind::kSagittal:
      return draw_view(renderer, model, sagittal, window);
    case SectionKind::kOblique:
      break;
    case SectionKind::kThree: {
      std::vector<Image> images{draw_view(renderer, model, axial, window),
                                draw_view(renderer, model, coronal, window),
                                draw_view(renderer, model, sagittal, window)};
      section_marks::draw_frame(images[0], kAxialFrame);
      section_marks::draw_frame(images[1], kCoronalFrame);
      section_marks::draw_frame(images[2], kSagittalFrame);
      return side_by_side(images);
    }
  }
  const SectionPlane oblique = oblique_section(request.centre, request.direction, request.view, size_mm,
                                               request.pixels, request.pixels);
  return draw_view(renderer, model, {"oblique", oblique, request.view == ObliqueView::kAlong}, window);
}

}  // namespace palpate
