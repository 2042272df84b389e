#include <algorithm>
#include <cmath>
#include <cstdio>

#include "palpate/contact/colours.h"
#include "palpate/rendering/force_arrows_svg.h"
#include "rendering/marks.h"

namespace palpate::force_arrows {
namespace {

constexpr double kWidth_px = 700, kHeight_px = 722;
constexpr Pixel kSectionCorner{32, 78};
constexpr double kRight_px = kSectionCorner[0] + kSection_px, kBottom_px = kSectionCorner[1] + kSection_px;

// fraction of the full force below which a force is not drawn
constexpr double kMinFraction = 0.01;
// the lengths below are in units of the arrow spacing, limited by the space of the scale beside the section
constexpr double kMaxUnit_px = 28;
constexpr double kMaxArrow = 0.95;  // at full force
constexpr double kMinArrow = 0.11;  // below this, no direction is discernible
constexpr double kRing = 0.14, kLostRing = 0.08, kStroke = 0.05;
constexpr double kMaxRing_px = 3, kMaxLostRing_px = 1.6, kMaxStroke_px = 1.1, kMaxHead_px = 7;

constexpr const char* kStyle =
    "<style>\n"
    "text{font-family:Helvetica,Arial,sans-serif;font-size:13px;fill:#222}\n"
    ".name{font-size:18px;font-weight:bold}.small{font-size:12px}.end{text-anchor:end}\n"
    ".letter{font-size:16px;font-weight:bold;text-anchor:middle}\n"
    ".page{fill:#fff}.section{opacity:.55}.frame{fill:none;stroke:#555}\n"
    ".arrow,.dot{fill:currentColor;stroke:currentColor;stroke-linejoin:round}\n"
    ".hollow{fill:#fff}.end-on{fill:none;stroke:currentColor}.lost{fill:#fff;stroke:#555}\n"
    ".contour{fill:none;stroke:#111;stroke-width:.7;stroke-dasharray:3 2;stroke-opacity:.75}\n"
    ".half{stroke-width:1.3;stroke-dasharray:none}.scale{fill:none;stroke:#222;stroke-width:1.5}\n"
    ".swatch{stroke:#555;stroke-width:.7}.bar{fill:url(#forces);stroke:#555}\n"
    "</style>\n";

Pixel on_page(const Pixel& section) {
  // the first pixel's centre is half a pixel inside the corner
  return {kSectionCorner[0] + section[0] + 0.5, kSectionCorner[1] + section[1] + 0.5};
}

std::string format(const char* pattern, double value) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, pattern, value);
  return buffer;
}

// dark blue for a weak force, orange for a full one: the lower part of Matplotlib's "plasma", which contrasts
// with a pale section and is monotonic in luminance, for colour-blind readers and print
constexpr Rgb kColours[] = {{13, 8, 135}, {106, 0, 168}, {177, 42, 144}, {221, 81, 97}, {240, 128, 36}};
constexpr int kColourSteps = std::size(kColours) - 1;

std::string colour_of(double fraction) {
  const double at = std::clamp(fraction, 0.0, 1.0) * kColourSteps;
  const int below = std::min(static_cast<int>(at), kColourSteps - 1);
  const auto mix = [&](std::uint8_t a, std::uint8_t b) {
    return static_cast<std::uint8_t>(std::lround(a + (b - a) * (at - below)));
  };
  const Rgb &a = kColours[below], &b = kColours[below + 1];
  return css_colour({mix(a.r, b.r), mix(a.g, b.g), mix(a.b, b.b)});
}

std::string colour_attribute(double fraction) {
  return "color=\"" + colour_of(fraction) + "\"";
}

double unit_px(const Picture& p) {
  return std::min(p.spacing_mm / p.section.mm_per_px(), kMaxUnit_px);
}

// length of an arrow for a force in the plane, in units; square root, so that weak forces have a visible
// direction
double length_of(double fraction) {
  return kMaxArrow * std::sqrt(std::clamp(fraction, 0.0, 1.0));
}

// shaft and head; the arrow is centred on the sampled point
std::string arrow_path(const Pixel& middle, const Pixel& along, double length, bool hollow, double fraction) {
  const double head = std::min(0.5 * length, kMaxHead_px), half = 0.42 * head;
  const auto pixel_at = [&](double forward, double lateral) {
    return Pixel{middle[0] + along[0] * forward - along[1] * lateral,
                 middle[1] + along[1] * forward + along[0] * lateral};
  };
  const Pixel base = pixel_at(0.5 * length - head, 0);
  return path(hollow ? "arrow hollow" : "arrow",
              "M" + pair(pixel_at(-0.5 * length, 0)) + "L" + pair(base) + "M" +
                  pair(pixel_at(0.5 * length - head, half)) + "L" + pair(pixel_at(0.5 * length, 0)) + "L" +
                  pair(pixel_at(0.5 * length - head, -half)) + "Z",
              colour_attribute(fraction));
}

std::string circle(std::string_view css_class, const Pixel& at, double radius, std::string_view attributes) {
  return path(css_class,
              "M" + pair({at[0] - radius, at[1]}) + "a" + pair({radius, radius}) + " 0 1 0 " +
                  pair({2 * radius, 0}) + "a" + pair({radius, radius}) + " 0 1 0 " + pair({-2 * radius, 0}) +
                  "Z",
              attributes);
}

// ring with a dot towards the viewer or a cross away, the convention for currents
std::string end_on(const Pixel& at, double radius, bool away, double fraction) {
  const std::string colour = colour_attribute(fraction);
  const std::string ring = circle("end-on", at, radius, colour);
  if (!away) return ring + circle("dot", at, 0.13 * radius, colour);
  const double arm = 0.7 * radius;
  return ring + path("end-on",
                     "M" + pair({at[0] - arm, at[1] - arm}) + "l" + pair({2 * arm, 2 * arm}) + "M" +
                         pair({at[0] + arm, at[1] - arm}) + "l" + pair({-2 * arm, 2 * arm}),
                     colour);
}

std::string draw_arrow(const Arrow& arrow, double full_force_N, double unit) {
  const double force_N = arrow.force_N(), fraction = force_N / full_force_N;
  const Pixel at = on_page(arrow.at);
  if (!(fraction >= kMinFraction)) {
    const bool lost = arrow.value >= kMinFraction && force_N == 0;
    return lost ? circle("lost", at, std::min(kLostRing * unit, kMaxLostRing_px), "") : "";
  }
  const double in_plane_N = arrow.in_plane_N(), length = length_of(fraction) * in_plane_N / force_N;
  const bool mostly_out = std::abs(arrow.away_N) > 0.5 * force_N;
  if (length >= kMinArrow)
    return arrow_path(at, {arrow.right_N / in_plane_N, arrow.down_N / in_plane_N}, length * unit, mostly_out,
                      fraction);
  if (length_of(fraction) >= kMinArrow)
    return end_on(at, std::min(kRing * unit, kMaxRing_px), arrow.away_N > 0, fraction);
  return circle("dot", at, 0.013 * unit, colour_attribute(fraction));
}

std::string draw_arrows(const Picture& p, const Progress& progress) {
  const double unit = unit_px(p);
  std::string svg = "<g stroke-width=\"" + number(std::min(kStroke * unit, kMaxStroke_px)) + "\">\n";
  for (const Arrow& arrow : sample_arrows(p.field, p.section, p.spacing_mm, progress))
    svg += draw_arrow(arrow, p.field.full_force_N(), unit);
  return svg + "</g>\n";
}

std::string draw_contours(const Picture& p, const Progress& progress) {
  constexpr int kCells = kSection_px / 4;
  const ValueGrid grid(p.field, p.section, kCells, progress);
  std::string svg;
  for (const double level : {0.25, 0.5, 0.75}) {
    std::string data;
    for (const ContourSegment& segment : grid.contour(level))
      data += "M" + pair(on_page(segment.from)) + "L" + pair(on_page(segment.to));
    if (!data.empty()) svg += path(level == 0.5 ? "contour half" : "contour", data);
  }
  return svg;
}

// width of the filter that the method reads: the field's, or its own sphere's
std::string width_text(const Picture& p) {
  const double voxel_mm = p.model.labels->geometry().min_spacing_mm();
  if (const auto* gaussian = std::get_if<LevelledSphere<GaussianSphere>>(&p.field.source())) {
    const double sigma_voxels = gaussian->parts().front().sphere.sigma_voxels();
    return format("\u03c3 %.3g", sigma_voxels) + (sigma_voxels == 1 ? " voxel" : " voxels") +
           format(" (%.3g mm)", sigma_voxels * voxel_mm);
  }
  // the smooth sphere may be wider than the field's filter; the width shown is the one along the shortest
  // voxel edge
  const auto* smooth = std::get_if<LevelledSphere<SmoothSphere>>(&p.field.source());
  if (smooth) return format("\u03c3 %.3g mm", smooth->parts().front().sphere.min_sigma_mm());
  return p.model.ramp_width_mm > 0 ? format("ramps of %.3g mm", p.model.ramp_width_mm)
                                   : format("\u03c3 %.3g mm", p.model.sigma_mm);
}

std::string draw_heading(const Picture& p) {
  constexpr const char* kPlanes[] = {"axial", "sagittal", "coronal"};
  const ForceMethodInfo& method = kForceMethods[index_of(p.field.method())];
  const Point<Patient>& c = p.section.centre;
  char position_text[160];
  std::snprintf(position_text, sizeof position_text, "%s section, centre %.1f, %.1f, %.1f mm (LPS)",
                kPlanes[static_cast<int>(p.plane)], c.x(), c.y(), c.z());
  constexpr double kEnd_px = kWidth_px - 10;
  return text("name", {kSectionCorner[0], 24}, method.name) + text("end", {kEnd_px, 24}, method.about) +
         text("plain", {kSectionCorner[0], 46},
              width_text(p) + ", F_full " + format("%.2f N", p.field.full_force_N())) +
         text("end", {kEnd_px, 46}, position_text);
}

std::string draw_letters(const Picture& p) {
  if (!p.model.oriented) return "";
  const OrientationLetters letters = orientation_letters(p.section);
  const double middle_x = kSectionCorner[0] + 0.5 * kSection_px;
  const double middle_y = kSectionCorner[1] + 0.5 * kSection_px + 5;
  return text("letter", {0.5 * kSectionCorner[0], middle_y}, letters.left) +
         text("letter", {kRight_px + 0.5 * kSectionCorner[0], middle_y}, letters.right) +
         text("letter", {middle_x, kSectionCorner[1] - 8}, letters.top) +
         text("letter", {middle_x, kBottom_px + 18}, letters.bottom);
}

std::string draw_scale_bar(const Picture& p) {
  const double bar_mm = marks::scale_bar_mm(p.section.width_mm), length = bar_mm / p.section.mm_per_px();
  const Pixel left{kSectionCorner[0], kBottom_px + 13};
  return path("scale", "M" + pair({left[0], left[1] - 4}) + "v8m0 -4h" + number(length) + "m0 -4v8") +
         text("plain", {left[0] + length + 7, left[1] + 4.5}, format("%.3g mm", bar_mm));
}

// colour map as an SVG gradient, bottom to top
std::string gradient() {
  std::string stops;
  for (int stop = 0; stop <= kColourSteps; ++stop) {
    const double at = static_cast<double>(stop) / kColourSteps;
    stops += "<stop offset=\"" + number(at) + "\" stop-color=\"" + colour_of(at) + "\"/>";
  }
  return "<linearGradient id=\"forces\" x1=\"0\" y1=\"1\" x2=\"0\" y2=\"0\">" + stops + "</linearGradient>\n";
}

// scale for colours and lengths of forces
std::string draw_force_scale(const Picture& p) {
  constexpr double kBar_px = 14, kHeight = 300;
  const double left = kRight_px + 56, top = kSectionCorner[1] + 30, full_N = p.field.full_force_N();
  std::string svg = gradient() + text("small", {left - 27, top - 24}, "force on the tip") +
                    rectangle("bar", {left, top}, kBar_px, kHeight);
  for (const double fraction : {0.0, 0.25, 0.5, 0.75, 1.0}) {
    const double y = top + kHeight * (1 - fraction);
    svg += path("frame", "M" + pair({left + kBar_px, y}) + "h4") +
           text("small", {left + kBar_px + 7, y + 4}, format("%.2f N", fraction * full_N));
    if (fraction > 0)
      svg += arrow_path({left - 15, y}, {1, 0}, length_of(fraction) * unit_px(p), false, fraction);
  }
  return svg;
}

// names and colours of the visible structures by descending area, as many as fit
std::string draw_structures(const Picture& p) {
  std::string svg;
  Pixel at{kSectionCorner[0], kBottom_px + 34};
  for (const LabelId label : marks::largest_first(section_labels(p.model, p.section))) {
    const std::string name = marks::short_name(p.model, label);
    const double width = 16 + 7.3 * static_cast<double>(name.size());
    if (at[0] + width > kWidth_px) break;
    const std::string fill = "fill=\"" + css_colour(colour_of(p.model, label)) + "\"";
    svg += rectangle("swatch", {at[0], at[1] - 10}, 11, 11, fill) + text("small", {at[0] + 16, at[1]}, name);
    at[0] += width + 14;
  }
  return svg;
}

std::string draw_side(const Picture& p) {
  std::string marks = markup::side_mark(p.model.side, p.model.oriented);
  for (const std::string& mark : markup::doubt_marks(p.model))
    marks += (marks.empty() ? "" : " \u00b7 ") + mark;
  return text("end", {kRight_px, kBottom_px + 18}, marks);
}

std::string draw_notes(const Picture& p) {
  const double left = kSectionCorner[0], top = kBottom_px + 54;
  return draw_structures(p) +
         text("small", {left, top},
              "Arrows: direction of the force, length by the scale; hollow head: more than half is out") +
         text("small", {left, top + 16},
              "of the plane; ring: no direction. Lines: value 0.5, dashed 0.25 and 0.75.") +
         text("small", {left, top + 36}, "Research and education \u2014 not for clinical use");
}

}  // namespace

std::string draw(const Picture& p, const Progress& progress) {
  const std::string size = "width=\"" + number(kWidth_px) + "\" height=\"" + number(kHeight_px) + "\"";
  SectionStyle style;
  // few grey levels make a small PNG
  style.grey_levels = 32;
  style.label_opacity = 0.35;
  return "<svg xmlns=\"http://www.w3.org/2000/svg\" " + size + " viewBox=\"0 0 " + number(kWidth_px) + " " +
         number(kHeight_px) + "\" role=\"img\">\n<title>Force field of the method " +
         std::string(name_of(p.field.method())) + "</title>\n" + kStyle +
         rectangle("page", {0, 0}, kWidth_px, kHeight_px) +
         picture(render_section(p.model, p.section, style), kSectionCorner) + draw_contours(p, progress) +
         draw_arrows(p, progress) + rectangle("frame", kSectionCorner, kSection_px, kSection_px) +
         draw_heading(p) + draw_letters(p) + draw_scale_bar(p) + draw_side(p) + draw_force_scale(p) +
         draw_notes(p) + "</svg>\n";
}

}  // namespace palpate::force_arrows
