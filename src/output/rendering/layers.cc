#include <algorithm>
#include <cmath>

#include "palpate/rendering/rendering.h"

namespace palpate {
namespace {

Image empty_image(const SectionPlane& plane) {
  return {plane.width_px, plane.height_px, std::vector<std::uint8_t>(3 * plane.pixel_count())};
}

SectionRenderer once(const Model& model, const SectionStyle& style) {
  return SectionRenderer(model, style, SectionStorage::kModel);
}

}  // namespace

std::array<double, 2> scan_window(const Volume<float>& scan) {
  constexpr std::size_t kSamples = 1'000'000;
  const std::vector<float>& voxels = scan.voxels();
  // an odd stride samples all columns of grids with even dimensions
  const std::size_t stride = std::max<std::size_t>(1, voxels.size() / kSamples) | 1;
  std::vector<float> samples;
  samples.reserve(voxels.size() / stride + 1);
  for (std::size_t i = 0; i < voxels.size(); i += stride) {
    if (std::isfinite(voxels[i])) samples.push_back(voxels[i]);
  }
  if (samples.empty()) return {0, 1};

  const auto percentile = [&](double fraction) {
    const auto nth =
        samples.begin() + static_cast<std::ptrdiff_t>(fraction * static_cast<double>(samples.size() - 1));
    std::nth_element(samples.begin(), nth, samples.end());
    return static_cast<double>(*nth);
  };
  const double low = percentile(0.01), high = percentile(0.99);
  return low < high ? std::array<double, 2>{low, high} : std::array<double, 2>{0, 1};
}

Image render_section(const Model& model, const SectionPlane& plane, const SectionStyle& style) {
  Image image = empty_image(plane);
  once(model, style).render(plane, image.rgb);
  return image;
}

Image render_scan_layer(const Model& model, const SectionPlane& plane, const SectionStyle& style) {
  Image image = empty_image(plane);
  once(model, style).render_scan(plane, image.rgb);
  return image;
}

Overlay render_structure_layer(const Model& model, const SectionPlane& plane, const SectionStyle& style) {
  Overlay overlay{plane.width_px, plane.height_px, std::vector<std::uint8_t>(4 * plane.pixel_count())};
  once(model, style).render_structures(plane, overlay.rgba);
  return overlay;
}

std::vector<LabelId> section_labels(const Model& model, const SectionPlane& plane,
                                    const SectionStyle& style) {
  std::vector<LabelId> labels(plane.pixel_count());
  once(model, style).labels(plane, labels);
  return labels;
}

}  // namespace palpate
