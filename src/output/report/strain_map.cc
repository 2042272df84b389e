#include "report/strain_map.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "report/html.h"

namespace palpate::report {
namespace {

// colour map "inferno" of matplotlib: monotonic in lightness
constexpr Rgb kColours[] = {{0, 0, 4}, {87, 16, 110}, {188, 55, 84}, {249, 142, 9}, {252, 255, 164}};
constexpr double kCover = 0.85;
// few enough for a paletted PNG
constexpr int kLevels = 250;

std::array<std::uint8_t, 4> paint_of(double strain) {
  const int level = static_cast<int>(std::lround(kLevels * std::clamp(strain / kMaxStrain, 0.0, 1.0)));
  const double part = static_cast<double>(level) / kLevels, at = part * (std::size(kColours) - 1);
  const std::size_t low = std::min(static_cast<std::size_t>(at), std::size(kColours) - 2);
  const double t = at - static_cast<double>(low);
  const auto mixed = [&](std::uint8_t a, std::uint8_t b) {
    return static_cast<std::uint8_t>(std::lround(a + t * (b - a)));
  };
  const Rgb &a = kColours[low], &b = kColours[low + 1];
  const double in = std::clamp(part * kMaxStrain / kMinStrain, 0.0, 1.0);
  const double cover = kCover * in * in * (3 - 2 * in);
  const auto alpha = static_cast<std::uint8_t>(std::lround(255 * cover));
  // a single transparent colour
  if (alpha == 0) return {};
  return {mixed(a.r, b.r), mixed(a.g, b.g), mixed(a.b, b.b), alpha};
}

}  // namespace

StrainMap strain_map(const Model& model, const DisplacedTissue& deformed, const TissueDisplacement& moved,
                     const SectionPlane& plane, std::span<const LabelId> labels) {
  StrainMap map;
  map.picture = {plane.width_px, plane.height_px, std::vector<std::uint8_t>(4 * plane.pixel_count())};
  for (std::size_t n = 0; n < labels.size(); ++n) {
    const Tissue* tissue = labels[n] != 0 ? model.tissue_of(labels[n]) : nullptr;
    if (tissue == nullptr || !model.moves_visibly(*tissue)) continue;
    const auto width = static_cast<std::size_t>(plane.width_px);
    const Point<Patient> displayed = plane.at(static_cast<double>(n % width), static_cast<double>(n / width));
    const double strain = deformed.strain(rest_position(displayed, moved));
    if (std::isnan(strain)) continue;
    map.most = std::max(map.most, strain);
    std::ranges::copy(paint_of(strain), map.picture.rgba.begin() + static_cast<std::ptrdiff_t>(4 * n));
  }
  return map;
}

std::string strain_scale_svg() {
  std::string stops;
  for (std::size_t n = 0; n < std::size(kColours); ++n)
    stops += "<stop offset=\"" + number(100.0 * static_cast<double>(n) / (std::size(kColours) - 1), 0) +
             "%\" stop-color=\"" + css_colour(kColours[n]) + "\"/>";
  return "<svg class=\"strain-scale\" viewBox=\"0 0 130 12\" role=\"img\" aria-label=\"Colours from 0 to " +
         number(100 * kMaxStrain, 0) + " % and more\"><defs><linearGradient id=\"strain-colours\">" + stops +
         "</linearGradient></defs><rect width=\"130\" height=\"12\" fill=\"url(#strain-colours)\"/></svg>";
}

}  // namespace palpate::report
