#include "volume_io/dicom/dicom_slice_stack.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "volume_io/dicom/dicom_descriptions.h"
#include "volume_io/dicom/dicom_grouping.h"

namespace palpate::volume_io {
namespace {

using Vector = Eigen::Vector3d;

// tolerance for rounding in the scanner's texts
constexpr double kRounding_mm = 2e-3;
// tolerance of a slice position, relative to the slice distance
constexpr double kMaxUneven = 0.01;
// tangent of a tilt explained by rounding of the orientation: 0.11 degrees
constexpr double kRoundedTilt = 2e-3;
// tangent of the largest tilt accepted: gantries tilt by 30 degrees
constexpr double kMaxTilt = 1;

constexpr const char* kConvert = "load the series in 3D Slicer, which can resample it, and save it as NRRD";

std::string degrees(double tangent) {
  return short_number(std::atan(tangent) * 180 / std::numbers::pi);
}

}  // namespace

SliceStack::SliceStack(const std::vector<DicomFrame>& frames)
    : frames_(frames), normal_(normal_of(frames.front())) {
  for (const DicomFrame& frame : frames) positions_mm_.push_back(frame.position.dot(normal_));
}

std::optional<Fault> SliceStack::find_fault() const {
  for (std::size_t n = 0; n < frames_.size(); ++n)
    if (!frames_[n].fault.empty()) return Fault{slice(n) + ", " + frames_[n].fault, frames_[n].remedy};
  if (frames_.size() == 1)
    return Fault{"a single slice is not a volume", "give the folder with all slices of its series"};
  for (const auto& look :
       {&SliceStack::find_duplicate, &SliceStack::find_uneven_spacing, &SliceStack::find_lateral_shift})
    if (auto fault = (this->*look)()) return fault;
  return std::nullopt;
}

std::vector<std::string> SliceStack::find_notes() const {
  std::vector<std::string> notes;
  if (has_reference_per_position(frames_))
    notes.push_back(
        "gives its slices different frames of reference (FrameOfReferenceUID (0020,0052)), as some "
        "anonymising software does: their positions are consistent, and they are read as one volume");
  const double step_mm = mean_gap_mm();
  if (const double tangent = tilt().norm(); tangent > kRoundedTilt)
    notes.push_back("was scanned with a gantry tilted by " + degrees(tangent) +
                    " degrees: its grid is sheared, each slice " + in_mm(tangent * step_mm) +
                    " mm to the side of the one before, so that every voxel is where it was measured");
  constexpr double kRounding = 0.02, kMin_mm = 0.01;
  const auto contradicts = [&](const DicomFrame& frame) {
    return frame.slice_spacing_mm &&
           std::abs(std::abs(*frame.slice_spacing_mm) - step_mm) > std::max(kMin_mm, kRounding * step_mm);
  };
  if (const auto frame = std::ranges::find_if(frames_, contradicts); frame != frames_.end())
    notes.push_back("states that slices are " + in_mm(*frame->slice_spacing_mm) +
                    " mm apart (SpacingBetweenSlices (0018,0088)), but their positions are " +
                    in_mm(step_mm) + " mm apart: the positions are used");
  return notes;
}

GridGeometry SliceStack::geometry() const {
  const DicomFrame& first = frames_.front();
  // from the first slice to the last one, which includes a gantry tilt
  const Vector step = (frames_.back().position - first.position) / static_cast<double>(frames_.size() - 1);
  GridGeometry grid;
  grid.dims = {first.columns, first.rows, static_cast<int>(frames_.size())};
  grid.spacing_mm = {first.column_spacing_mm, first.row_spacing_mm, step.norm()};
  grid.direction << first.along_row, first.along_column, step.normalized();
  grid.origin = Point<Patient>(first.position);
  return grid;
}

std::string SliceStack::slice(std::size_t n) const {
  return slice_in_words(frames_, n);
}

double SliceStack::gap_mm(std::size_t n) const {
  return positions_mm_[n + 1] - positions_mm_[n];
}

double SliceStack::mean_gap_mm() const {
  return (positions_mm_.back() - positions_mm_.front()) / static_cast<double>(frames_.size() - 1);
}

std::optional<Fault> SliceStack::find_duplicate() const {
  for (std::size_t n = 0; n + 1 < frames_.size(); ++n)
    if (gap_mm(n) < kSamePosition_mm)
      return Fault{
          "two slices are at the same position: " + slice(n) + ", and the next",
          "keep the right one: they differ in their values or in their SOPInstanceUID (0008,0018); if the "
          "series holds several volumes that cannot be distinguished, export them as separate series"};
  return std::nullopt;
}

std::optional<Fault> SliceStack::find_uneven_spacing() const {
  std::vector<double> gaps_mm;
  for (std::size_t n = 0; n + 1 < frames_.size(); ++n) gaps_mm.push_back(gap_mm(n));
  // the median distance, which a few missing slices do not change; the smaller one of two
  std::vector<double> sorted = gaps_mm;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>((sorted.size() - 1) / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  const double usual_mm = *middle, allowed_mm = std::max(kRounding_mm, kMaxUneven * usual_mm);
  for (std::size_t n = 0; n < gaps_mm.size(); ++n) {
    const double off_mm = std::abs(gaps_mm[n] - usual_mm);
    if (off_mm <= 2 * allowed_mm) continue;
    const double times = std::round(gaps_mm[n] / usual_mm);
    const std::string between = slice(n) + ", and the next at " + in_mm(positions_mm_[n + 1]) + " mm";
    if (times >= 2 && std::abs(gaps_mm[n] - times * usual_mm) <= 2 * times * allowed_mm) {
      const auto missing = static_cast<long long>(times) - 1;
      return Fault{(missing == 1 ? "a slice is" : std::to_string(missing) + " slices are") +
                       " missing between " + between + ": slices are " + in_mm(usual_mm) + " mm apart",
                   kWholeSeries};
    }
    return Fault{"its slices are unevenly spaced: " + between + ", others " + in_mm(usual_mm) + " mm apart",
                 kConvert};
  }
  // small differences that accumulate
  const double even_mm = (positions_mm_.back() - positions_mm_.front()) / static_cast<double>(gaps_mm.size());
  for (std::size_t n = 0; n < positions_mm_.size(); ++n) {
    const double off_mm = positions_mm_[n] - positions_mm_.front() - static_cast<double>(n) * even_mm;
    if (std::abs(off_mm) > allowed_mm)
      return Fault{"its slices are unevenly spaced: " + slice(n) + ", is " + in_mm(std::abs(off_mm)) +
                       " mm off its position between the first and the last",
                   kConvert};
  }
  return std::nullopt;
}

Vector SliceStack::lateral(std::size_t n) const {
  const Vector displacement = frames_[n].position - frames_.front().position;
  return displacement - displacement.dot(normal_) * normal_;
}

Vector SliceStack::tilt() const {
  return lateral(frames_.size() - 1) / (positions_mm_.back() - positions_mm_.front());
}

std::optional<Fault> SliceStack::find_lateral_shift() const {
  const double usual_mm = mean_gap_mm(), allowed_mm = std::max(kRounding_mm, kMaxUneven * usual_mm);
  const Vector shift = tilt();
  for (std::size_t n = 0; n < frames_.size(); ++n) {
    const double off_mm = (lateral(n) - (positions_mm_[n] - positions_mm_.front()) * shift).norm();
    if (off_mm > allowed_mm)
      return Fault{slice(n) + ", lies " + in_mm(off_mm) + " mm off the line from the first to the last",
                   kConvert};
  }
  if (shift.norm() > kMaxTilt)
    return Fault{"its slices are shifted as by a gantry tilted by " + degrees(shift.norm()) +
                     " degrees, which no scanner has: each is " + in_mm(shift.norm() * usual_mm) +
                     " mm to the side of the one before, from " + slice(1),
                 kConvert};
  return std::nullopt;
}

}  // namespace palpate::volume_io
