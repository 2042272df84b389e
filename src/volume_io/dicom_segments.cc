#include "volume_io/dicom_segments.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>
#include <string_view>

#include "volume_io/label_text.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

using Vector = Eigen::Vector3d;

constexpr const char* kSegSlicer =
    "load it with its images in 3D Slicer and save the segmentation as .seg.nrrd";

// types that have presets, by SNOMED CT and by the SRT codes of older files
struct KnownType {
  std::string_view sct, srt, name;
};
constexpr std::array<KnownType, 5> kKnownTypes{{{"71341001", "T-12710", "femur"},
                                                {"12611008", "T-12740", "tibia"},
                                                {"87342007", "T-12750", "fibula"},
                                                {"64234005", "T-12730", "patella"},
                                                {"10200004", "T-62000", "liver"}}};

std::string_view known_name(const DicomSegment& segment) {
  for (const KnownType& type : kKnownTypes)
    if ((segment.scheme == "SCT" && segment.code == type.sct) ||
        ((segment.scheme == "SRT" || segment.scheme == "SNM3") && segment.code == type.srt))
      return type.name;
  return {};
}

// a text that may stand as a name, else nothing
std::string as_name(const std::string& text) {
  const std::string name(trimmed(text));
  return name.empty() || name_fault(name) ? std::string() : name;
}

bool says(const std::string& name, std::string_view word) {
  return lower_case(name).find(word) != std::string::npos;
}

std::string_view kind_in_words(const DicomSegmentation& segmentation) {
  return segmentation.kind == DicomSegmentation::Kind::kLabels ? "labels" : "segments";
}

std::string segment_mm(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.2f", value);
  return text;
}

// the distance between slices by which each place is a whole number of them from the first; 0: none
double step_of(const std::vector<double>& places_mm, std::optional<double> said_mm) {
  const double length_mm = places_mm.back() - places_mm.front();
  double least_mm = length_mm;
  constexpr double kSamePlace_mm = 5e-3;
  for (std::size_t n = 1; n < places_mm.size(); ++n)
    if (const double gap_mm = places_mm[n] - places_mm[n - 1]; gap_mm > kSamePlace_mm)
      least_mm = std::min(least_mm, gap_mm);
  if (length_mm <= kSamePlace_mm) return said_mm.value_or(0);
  for (const double step_mm : {said_mm.value_or(0), least_mm}) {
    constexpr double kMostSlices = 1e5;
    if (!(step_mm > kSamePlace_mm) || length_mm / step_mm > kMostSlices) continue;
    // rounding of the distance, which adds up, is taken out by the whole length
    const double even_mm = length_mm / std::max(1.0, std::round(length_mm / step_mm));
    constexpr double kMostOff = 0.02, kRounding_mm = 2e-3;
    const bool fits = std::abs(even_mm - step_mm) <= kMostOff * step_mm &&
                      std::ranges::all_of(places_mm, [&](double place_mm) {
                        const double slices = (place_mm - places_mm.front()) / even_mm;
                        return std::abs(slices - std::round(slices)) * even_mm <=
                               std::max(kRounding_mm, kMostOff * even_mm);
                      });
    if (fits) return even_mm;
  }
  return 0;
}

}  // namespace

bool is_background(const DicomSegment& segment) {
  return segment.scheme == "DCM" && segment.code == "125040";
}

Result<SegmentGrid> lay_segments(const DicomSegmentation& segmentation) {
  const auto refused = [](const std::string& what) { return bad_input("", what, kSegSlicer); };
  const auto& frames = segmentation.frames;
  if (frames.empty()) return refused("holds no frame");
  for (std::size_t n = 0; n < frames.size(); ++n)
    if (!frames[n].fault.empty())
      return bad_input(
          "",
          "frame " + std::to_string(n + 1) + " of " + std::to_string(frames.size()) + " " + frames[n].fault,
          frames[n].remedy);

  // one orientation and one spacing
  const DicomFrame& first = frames.front();
  const Vector normal = first.along_row.cross(first.along_column).normalized();
  constexpr double kSame_mm = 0.02;
  std::vector<double> places_mm;
  for (std::size_t n = 0; n < frames.size(); ++n) {
    if (corner_off_mm(first, frames[n]) > kSame_mm)
      return refused("has frames of several orientations or spacings: 1 and " + std::to_string(n + 1));
    places_mm.push_back((frames[n].position - first.position).dot(normal));
  }
  std::vector<double> sorted = places_mm;
  std::sort(sorted.begin(), sorted.end());
  const double step_mm = step_of(sorted, segmentation.slice_spacing_mm);
  if (!(step_mm > 0))
    return refused(frames.size() == 1 || sorted.back() - sorted.front() <= 0
                       ? "does not say how thick its one slice is: SpacingBetweenSlices (0018,0088)"
                       : "has frames that do not lie a whole number of slices apart");

  SegmentGrid grid;
  std::set<std::pair<int, int>> seen;
  int last = 0;
  for (std::size_t n = 0; n < frames.size(); ++n) {
    const Vector way = frames[n].position - first.position;
    const double aside_mm = (way - places_mm[n] * normal).norm();
    if (aside_mm > std::max(2e-3, 0.01 * std::min(first.row_spacing_mm, first.column_spacing_mm)))
      return refused("frame " + std::to_string(n + 1) + " lies " + segment_mm(aside_mm) +
                     " mm beside the first one");
    const int slice = static_cast<int>(std::lround((places_mm[n] - sorted.front()) / step_mm));
    const int segment = segmentation.segment_of_frame[n];
    if (!seen.insert({segment, slice}).second)
      return refused("has two frames of " + std::string(kind_in_words(segmentation)) + " " +
                     std::to_string(segment) + " at one place, frame " + std::to_string(n + 1) +
                     " and one before");
    if (segmentation.kind != DicomSegmentation::Kind::kLabels &&
        std::ranges::none_of(segmentation.segments,
                             [&](const DicomSegment& s) { return s.number == segment; }))
      return refused("has a frame of a segment " + std::to_string(segment) + " that it does not describe");
    grid.slice_of_frame.push_back(slice);
    last = std::max(last, slice);
  }
  GridGeometry& geometry = grid.geometry;
  geometry.dims = {first.columns, first.rows, last + 1};
  geometry.spacing_mm = {first.column_spacing_mm, first.row_spacing_mm, step_mm};
  geometry.direction << first.along_row, first.along_column, normal;
  geometry.origin = Point<Patient>(Vector(first.position + sorted.front() * normal));
  if (const auto possible = checked(geometry, ""); !possible) return refused(possible.error().what);
  return grid;
}

std::string name_of_segment(const DicomSegment& segment) {
  std::string name = as_name(segment.label);
  const std::string_view known = known_name(segment);
  if (!known.empty() && !says(name, known)) name = std::string(known);
  if (name.empty()) name = as_name(segment.meaning);
  if (name.empty()) return "segment " + std::to_string(segment.number);
  if (!segment.side.empty() && !says(name, segment.side)) name += " " + segment.side;
  return name;
}

std::string colour_of_segment(const std::array<std::uint16_t, 3>& lab) {
  const double L = lab[0] / 65535.0 * 100, a = lab[1] / 65535.0 * 255 - 128, b = lab[2] / 65535.0 * 255 - 128;
  const auto cube = [](double t) {
    constexpr double kDelta = 6.0 / 29;
    return t > kDelta ? t * t * t : 3 * kDelta * kDelta * (t - 4.0 / 29);
  };
  const double f = (L + 16) / 116, X = 0.95047 * cube(f + a / 500), Y = cube(f),
               Z = 1.08883 * cube(f - b / 200);
  const std::array<double, 3> linear{3.2406 * X - 1.5372 * Y - 0.4986 * Z,
                                     -0.9689 * X + 1.8758 * Y + 0.0415 * Z,
                                     0.0557 * X - 0.2040 * Y + 1.0570 * Z};
  std::string text;
  for (const double value : linear) {
    const double bounded = std::clamp(value, 0.0, 1.0);
    char part[20];
    std::snprintf(part, sizeof part, "%s%.4f", text.empty() ? "" : " ",
                  bounded <= 0.0031308 ? 12.92 * bounded : 1.055 * std::pow(bounded, 1 / 2.4) - 0.055);
    text += part;
  }
  return text;
}

std::vector<int> layers_of_segments(std::size_t segments, const std::vector<std::pair<int, int>>& overlaps) {
  std::vector<int> layers(segments, -1);
  for (std::size_t n = 0; n < segments; ++n) {
    std::set<int> taken;
    for (const auto& [one, other] : overlaps) {
      if (one == static_cast<int>(n)) taken.insert(layers[static_cast<std::size_t>(other)]);
      if (other == static_cast<int>(n)) taken.insert(layers[static_cast<std::size_t>(one)]);
    }
    int layer = 0;
    while (taken.contains(layer)) ++layer;
    layers[n] = layer;
  }
  return layers;
}

}  // namespace palpate::volume_io
