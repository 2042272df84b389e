#include "volume_io/dicom/dicom_segment_grid.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <set>
#include <tuple>
#include <utility>

#include "volume_io/dicom/dicom_descriptions.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

using Vector = Eigen::Vector3d;

constexpr const char* kSegSlicer =
    "load it with its images in 3D Slicer and save the segmentation as .seg.nrrd";

bool holds_labels(const DicomSegmentation& segmentation, const DicomFrame& frame) {
  return segmentation.codings[frame.file].kind == SegmentCoding::Kind::kLabels;
}

// positions of slices along the normal
struct SliceSteps {
  double step_mm = 0;   // 0: no slice distance explains the positions
  double first_mm = 0;  // position of slice 0
  std::string note = {};
};

constexpr double kSameSlice_mm = 5e-3;
// tolerance for rounding in the file's texts, relative to the slice distance
constexpr double kMaxOffSlice = 0.02;

// Slice distance close to `step_mm` for which all positions are multiples of it from the first; 0: none.
double even_step(const std::vector<double>& positions_mm, double step_mm) {
  const double length_mm = positions_mm.back() - positions_mm.front();
  constexpr double kMaxSlices = 1e5, kRounding_mm = 2e-3;
  if (!(step_mm > kSameSlice_mm) || length_mm / step_mm > kMaxSlices) return 0;
  // the mean over the whole length removes rounding errors of the distance, which would accumulate
  const double even_mm = length_mm / std::max(1.0, std::round(length_mm / step_mm));
  const bool fits = std::abs(even_mm - step_mm) <= kMaxOffSlice * step_mm &&
                    std::ranges::all_of(positions_mm, [&](double position_mm) {
                      const double slices = (position_mm - positions_mm.front()) / even_mm;
                      return std::abs(slices - std::round(slices)) * even_mm <=
                             std::max(kRounding_mm, kMaxOffSlice * even_mm);
                    });
  return fits ? even_mm : 0;
}

// Slices at the stated distance, if the positions are those rounded to 0.1 mm or 1 mm, as printed by some
// writers.
std::optional<SliceSteps> rounded_steps(const std::vector<double>& positions_mm, double step_mm) {
  constexpr double kExact = 1e-6;
  for (const double quantum_mm : {0.1, 1.0}) {
    const bool printed_so = std::ranges::all_of(positions_mm, [&](double position_mm) {
      return std::abs(position_mm - quantum_mm * std::round(position_mm / quantum_mm)) < kExact;
    });
    if (!printed_so || quantum_mm >= step_mm) continue;
    // the first slice lies within half a quantum of its printed position
    constexpr int kTries = 20;
    double first_mm = 0, min_off_mm = step_mm;
    for (int n = 0; n <= kTries; ++n) {
      const double from_mm = positions_mm.front() + quantum_mm * (static_cast<double>(n) / kTries - 0.5);
      double max_off_mm = 0;
      bool apart = true;  // distinct positions are distinct slices
      for (std::size_t p = 0; p < positions_mm.size(); ++p) {
        const auto slice_of = [&](double position_mm) {
          return std::lround((position_mm - from_mm) / step_mm);
        };
        max_off_mm = std::max(max_off_mm, std::abs(std::remainder(positions_mm[p] - from_mm, step_mm)));
        apart = apart && (p == 0 || positions_mm[p] - positions_mm[p - 1] < kSameSlice_mm ||
                          slice_of(positions_mm[p]) != slice_of(positions_mm[p - 1]));
      }
      if (apart && max_off_mm < min_off_mm) {
        min_off_mm = max_off_mm;
        first_mm = from_mm;
      }
    }
    if (min_off_mm <= quantum_mm / 2 + kExact)
      return SliceSteps{step_mm, first_mm,
                        "has positions that are rounded to " + in_mm(quantum_mm) +
                            " mm: its slices are placed " + in_mm(step_mm) +
                            " mm apart, as in SpacingBetweenSlices (0018,0088)"};
  }
  return std::nullopt;
}

/// Determines the slice distance.
/// @param positions_mm  positions in ascending order
SliceSteps steps_of(const std::vector<double>& positions_mm, std::optional<double> declared_mm) {
  std::vector<double> gaps_mm;
  for (std::size_t n = 1; n < positions_mm.size(); ++n)
    if (const double gap_mm = positions_mm[n] - positions_mm[n - 1]; gap_mm > kSameSlice_mm)
      gaps_mm.push_back(gap_mm);
  if (gaps_mm.empty()) return {declared_mm.value_or(0), positions_mm.front()};
  const auto [least, most] = std::ranges::minmax(gaps_mm);
  const bool regular = gaps_mm.size() > 1 && most - least <= kMaxOffSlice * most;
  const double declared_step_mm = declared_mm ? even_step(positions_mm, *declared_mm) : 0,
               min_step_mm = even_step(positions_mm, least);
  // if all frames are at every second slice of the stated grid, they are the slices of a coarser one
  constexpr double kNextSlice = 1.5;
  if (declared_step_mm > 0 && !(regular && least > kNextSlice * declared_step_mm))
    return {declared_step_mm, positions_mm.front()};
  if (declared_mm && !regular)
    if (auto rounded = rounded_steps(positions_mm, *declared_mm)) return *std::move(rounded);
  SliceSteps steps{min_step_mm, positions_mm.front()};
  if (declared_mm && min_step_mm > 0)
    steps.note =
        "states that slices are " + in_mm(*declared_mm) +
        " mm apart (SpacingBetweenSlices (0018,0088), or SliceThickness (0018,0050)), but its frames are " +
        in_mm(min_step_mm) + " mm apart: the positions are used";
  return steps;
}

// In-plane shift per distance along the normal, caused by a tilted gantry. Two positions may belong to
// different grids; three or more on a line indicate a shift.
Vector shift_of_tilt(const std::vector<DicomFrame>& frames, const std::vector<double>& positions_mm,
                     const Vector& normal) {
  const auto [lowest, highest] = std::ranges::minmax_element(positions_mm);
  const double low_mm = *lowest, high_mm = *highest;
  const double length_mm = high_mm - low_mm;
  const bool between = std::ranges::any_of(positions_mm, [&](double position_mm) {
    return position_mm - low_mm > kSameSlice_mm && high_mm - position_mm > kSameSlice_mm;
  });
  if (!between) return Vector::Zero();
  const auto frame_at = [&](auto frame) -> const DicomFrame& {
    return frames[static_cast<std::size_t>(frame - positions_mm.begin())];
  };
  const Vector displacement = frame_at(highest).position - frame_at(lowest).position;
  return (displacement - displacement.dot(normal) * normal) / length_mm;
}

}  // namespace

Result<SegmentGrid> segment_grid_of(const DicomSegmentation& segmentation) {
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
  const Vector normal = normal_of(first);
  constexpr double kSame_mm = 0.02;
  std::vector<double> positions_mm;
  for (std::size_t n = 0; n < frames.size(); ++n) {
    if (corner_off_mm(first, frames[n]) > kSame_mm)
      return refused("has frames of several orientations or spacings: 1 and " + std::to_string(n + 1));
    positions_mm.push_back((frames[n].position - first.position).dot(normal));
  }
  std::vector<double> sorted = positions_mm;
  std::sort(sorted.begin(), sorted.end());
  SliceSteps steps = steps_of(sorted, segmentation.slice_spacing_mm);
  const double step_mm = steps.step_mm;
  if (!(step_mm > 0))
    return refused(frames.size() == 1 || sorted.back() - sorted.front() <= 0
                       ? "does not state the thickness of its one slice: SpacingBetweenSlices (0018,0088)"
                       : "has frames that are not a whole number of slices apart");

  SegmentGrid grid;
  if (!steps.note.empty()) grid.notes.push_back(std::move(steps.note));
  const Vector shift = shift_of_tilt(frames, positions_mm, normal);
  std::set<std::tuple<std::uint32_t, int, int>> visited;
  int last = 0;
  for (std::size_t n = 0; n < frames.size(); ++n) {
    const Vector displacement = frames[n].position - first.position;
    const double lateral_mm = (displacement - positions_mm[n] * (normal + shift)).norm();
    if (lateral_mm > std::max(2e-3, 0.01 * std::min(first.row_spacing_mm, first.column_spacing_mm)))
      return refused("frame " + std::to_string(n + 1) + " lies " + in_mm(lateral_mm) +
                     " mm to the side of the first one");
    const int slice = static_cast<int>(std::lround((positions_mm[n] - steps.first_mm) / step_mm));
    const int segment = segmentation.segment_of_frame[n];
    const bool labels = holds_labels(segmentation, frames[n]);
    if (!visited.insert({labels ? frames[n].file : 0, segment, slice}).second)
      return refused(
          (labels ? "has two frames of labels" : "has two frames of segment " + std::to_string(segment)) +
          " at the same position, frame " + std::to_string(n + 1) + " and an earlier one");
    if (!labels && std::ranges::none_of(segmentation.segments,
                                        [&](const DicomSegment& s) { return s.number == segment; }))
      return refused("has a frame of a segment " + std::to_string(segment) + " that it does not define");
    grid.slice_of_frame.push_back(slice);
    last = std::max(last, slice);
  }
  GridGeometry& geometry = grid.geometry;
  geometry.dims = {first.columns, first.rows, last + 1};
  const Vector step = step_mm * (normal + shift);
  geometry.spacing_mm = {first.column_spacing_mm, first.row_spacing_mm, step.norm()};
  geometry.direction << first.along_row, first.along_column, step.normalized();
  geometry.origin = Point<Patient>(Vector(first.position + steps.first_mm * (normal + shift)));
  if (const auto possible = checked(geometry, ""); !possible) return refused(possible.error().what);
  return grid;
}

}  // namespace palpate::volume_io
