#include "volume_io/dicom/dicom_volumes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>
#include <numbers>
#include <set>
#include <tuple>

#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

using Vector = Eigen::Vector3d;

// tolerance for rounding in the scanner's texts
constexpr double kRounding_mm = 2e-3;
// tolerance of a slice position, relative to the slice distance
constexpr double kMaxUneven = 0.01;
// slices closer than this share a position
constexpr double kSamePosition_mm = 5e-3;
// tangent of a tilt explained by rounding of the orientation: 0.11 degrees
constexpr double kRoundedTilt = 2e-3;
// tangent of the largest tilt accepted: gantries tilt by 30 degrees
constexpr double kMaxTilt = 1;

std::string in_mm(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.2f", std::abs(value) < 0.005 ? 0.0 : value);
  return text;
}

std::string shortly(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

Vector normal_of(const DicomFrame& frame) {
  return frame.along_row.cross(frame.along_column).normalized();
}

// ---- grouping -----------------------------------------------------------------------------------

using VolumeKey = std::tuple<int, bool, int, int, std::optional<double>, std::optional<double>, bool,
                             std::optional<double>, std::string, std::string, std::string, std::string>;

// key of attributes that are equal in all images of a volume, except those compared with a tolerance
VolumeKey volume_key(const DicomFrame& frame) {
  // images without a position are distinguished only by what they lack
  if (!frame.placed)
    return {frame.series, true, 0, 0, {}, {}, false, {}, "", frame.modality, "", frame.fault};
  return {frame.series,
          false,
          frame.rows,
          frame.columns,
          frame.echo_time_ms,
          frame.b_value,
          frame.gradient.has_value(),
          frame.temporal_position,
          frame.stack,
          frame.modality,
          frame.image_type,
          ""};
}

// diffusion directions equal except for rounding
bool same_gradient(const DicomFrame& a, const DicomFrame& b) {
  constexpr double kSame = 1e-2;
  return !a.gradient || !b.gradient ||
         (Vector(a.gradient->data()) - Vector(b.gradient->data())).norm() <= kSame;
}

// True if there are several frames of reference and each contains a single position. In LIDC-IDRI every slice
// has its own: the anonymiser replaced the identifier in every file by a new one.
bool has_reference_per_position(const std::vector<DicomFrame>& frames) {
  std::map<std::string, const DicomFrame*> first_of_reference;
  for (const DicomFrame& frame : frames) {
    const auto [first, is_new] = first_of_reference.emplace(frame.frame_of_reference, &frame);
    if (!is_new && (frame.position - first->second->position).norm() >= kSamePosition_mm) return false;
  }
  return first_of_reference.size() > 1;
}

std::vector<std::vector<DicomFrame>> split_by_frame_of_reference(std::vector<DicomFrame> frames) {
  std::map<std::string, std::vector<DicomFrame>> parts;
  const bool one_volume = !frames.front().placed || has_reference_per_position(frames);
  for (DicomFrame& frame : frames)
    parts[one_volume ? std::string() : frame.frame_of_reference].push_back(std::move(frame));
  std::vector<std::vector<DicomFrame>> all;
  for (auto& [reference, part] : parts) all.push_back(std::move(part));
  return all;
}

std::vector<std::vector<DicomFrame>> grouped(std::vector<DicomFrame> frames) {
  // a group with one key is split by orientation, pixel spacing and diffusion direction
  std::map<VolumeKey, std::vector<std::vector<DicomFrame>>> groups;
  for (DicomFrame& frame : frames) {
    auto& parts = groups[volume_key(frame)];
    const auto fits = [&](const std::vector<DicomFrame>& part) {
      constexpr double kSame_mm = 0.02;
      return !frame.placed ||
             (corner_off_mm(part.front(), frame) <= kSame_mm && same_gradient(part.front(), frame));
    };
    // images of one scan are usually consecutive
    auto part = std::find_if(parts.rbegin(), parts.rend(), fits);
    (part != parts.rend() ? *part : parts.emplace_back()).push_back(std::move(frame));
  }
  std::vector<std::vector<DicomFrame>> all;
  for (auto& [key, parts] : groups)
    for (auto& part : parts)
      for (auto& volume : split_by_frame_of_reference(std::move(part))) all.push_back(std::move(volume));
  return all;
}

// ---- several images at one position -------------------------------------------------------------

using Frames = std::vector<DicomFrame>;

void sort_by_position(Frames& frames) {
  const Vector normal = normal_of(frames.front());
  std::stable_sort(frames.begin(), frames.end(), [&](const DicomFrame& a, const DicomFrame& b) {
    return a.position.dot(normal) < b.position.dot(normal);
  });
}

// number of sorted frames at each position
std::vector<std::size_t> counts_at_positions(const Frames& frames) {
  const Vector normal = normal_of(frames.front());
  std::vector<std::size_t> counts{1};
  for (std::size_t n = 1; n < frames.size(); ++n) {
    const double gap_mm = (frames[n].position - frames[n - 1].position).dot(normal);
    gap_mm < kSamePosition_mm ? void(++counts.back()) : counts.push_back(1);
  }
  return counts;
}

bool has_doubles(const Frames& frames) {
  return counts_at_positions(frames).size() < frames.size();
}

// Cardiac images are taken at several phases for each position. Trigger times vary with the heart rate from
// position to position, so their order is used.
std::vector<Frames> split_by_trigger_time(const Frames& sorted) {
  const auto counts = counts_at_positions(sorted);
  const std::size_t each = counts.front();
  const auto has_trigger_time = [](const DicomFrame& frame) { return frame.trigger_time_ms.has_value(); };
  if (std::ranges::any_of(counts, [&](std::size_t count) { return count != each; }) ||
      !std::ranges::all_of(sorted, has_trigger_time))
    return {};
  std::vector<Frames> parts(each);
  for (std::size_t first = 0; first < sorted.size(); first += each) {
    Frames here(sorted.begin() + static_cast<std::ptrdiff_t>(first),
                sorted.begin() + static_cast<std::ptrdiff_t>(first + each));
    std::ranges::stable_sort(here, {}, [](const DicomFrame& frame) { return *frame.trigger_time_ms; });
    for (std::size_t n = 0; n < each; ++n) {
      if (n > 0 && here[n].trigger_time_ms == here[n - 1].trigger_time_ms) return {};
      parts[n].push_back(std::move(here[n]));
    }
  }
  return parts;
}

// Returns nothing if every part would be a single slice, as for repeated acquisitions of one position.
std::vector<Frames> split_by_acquisition(const Frames& sorted) {
  std::map<int, Frames> parts;
  for (const DicomFrame& frame : sorted) {
    if (!frame.acquisition) return {};
    parts[*frame.acquisition].push_back(frame);
  }
  if (parts.size() == sorted.size()) return {};
  std::vector<Frames> all;
  for (auto& [number, part] : parts) {
    if (has_doubles(part)) return {};
    all.push_back(std::move(part));
  }
  return all;
}

// splits a group with several images per position into volumes without, if possible
std::vector<Frames> split_duplicates(Frames frames) {
  const auto forget = [](Frames& part, bool times, bool acquisitions) {
    for (DicomFrame& frame : part) {
      if (times) frame.trigger_time_ms.reset();
      if (acquisitions) frame.acquisition.reset();
    }
  };
  if (frames.front().placed) {
    sort_by_position(frames);
    if (has_doubles(frames)) {
      const bool by_time = std::ranges::any_of(
          frames, [](const DicomFrame& frame) { return frame.trigger_time_ms.has_value(); });
      auto parts = by_time ? split_by_trigger_time(frames) : std::vector<Frames>();
      const bool by_acquisition = parts.empty();
      if (by_acquisition) parts = split_by_acquisition(frames);
      for (Frames& part : parts) forget(part, by_acquisition, !by_acquisition);
      if (!parts.empty()) return parts;
    }
  }
  forget(frames, true, true);
  std::vector<Frames> whole;
  whole.push_back(std::move(frames));
  return whole;
}

// ---- descriptions -------------------------------------------------------------------------------

std::string plane_of(const Vector& normal) {
  int axis = 0;
  normal.cwiseAbs().maxCoeff(&axis);
  static constexpr std::array kPlanes{"sagittal", "coronal", "axial"};
  constexpr double kStraight = 0.9998;  // cosine of 1 degree
  return (std::abs(normal[axis]) < kStraight ? "oblique, nearly " : "") +
         std::string(kPlanes[static_cast<std::size_t>(axis)]);
}

// terms of the standard that inform the user; other values could contain any text
constexpr std::array<std::pair<std::string_view, std::string_view>, 26> kTypeTerms{{
    {"DERIVED", "derived"},
    {"LOCALIZER", "localizer"},
    {"MPR", "reformatted"},
    {"MIP", "maximum projection"},
    {"PROJECTION IMAGE", "projection"},
    {"RESAMPLED", "resampled"},
    {"M", "magnitude"},
    {"P", "phase"},
    {"R", "real part"},
    {"I", "imaginary part"},
    {"MAGNITUDE", "magnitude"},
    {"PHASE", "phase"},
    {"REAL", "real part"},
    {"IMAGINARY", "imaginary part"},
    {"M_SE", "magnitude"},
    {"M_FFE", "magnitude"},
    {"P_SE", "phase"},
    {"ADC", "ADC"},
    {"FA", "anisotropy"},
    {"TRACEW", "trace"},
    {"DIFFUSION", "diffusion"},
    {"WATER", "water"},
    {"FAT", "fat"},
    {"IN_PHASE", "in phase"},
    {"OUT_PHASE", "out of phase"},
    {"SUBTRACTION", "subtraction"},
}};

std::set<std::string> type_words(const std::string& image_type) {
  std::set<std::string> words;
  std::string_view left = image_type;
  while (!left.empty()) {
    const auto end = left.find('\\');
    const std::string_view word = left.substr(0, end);
    for (const auto& [term, meaning] : kTypeTerms)
      if (term == word) words.emplace(meaning);
    left = end == std::string_view::npos ? std::string_view() : left.substr(end + 1);
  }
  return words;
}

// attributes by which this volume differs from others of its series
std::string distinguishing_attributes(const std::vector<DicomFrame>& frames,
                                      const std::vector<const DicomFrame*>& of_series) {
  const DicomFrame& own = frames.front();
  std::string text;
  const auto differs = [&](auto member) {
    return std::any_of(of_series.begin(), of_series.end(),
                       [&](const DicomFrame* other) { return other->*member != own.*member; });
  };
  const auto number = [&](std::optional<double> DicomFrame::*member, const std::string& before,
                          const std::string& after) {
    if (differs(member) && own.*member) text += ", " + before + shortly(*(own.*member)) + after;
  };
  number(&DicomFrame::echo_time_ms, "echo time ", " ms");
  number(&DicomFrame::b_value, "b-value ", " s/mm2");
  if (differs(&DicomFrame::gradient) && own.gradient) {
    const auto& [x, y, z] = *own.gradient;
    text += ", diffusion along (" + in_mm(x) + ", " + in_mm(y) + ", " + in_mm(z) + ")";
  }
  number(&DicomFrame::temporal_position, "time point ", "");
  number(&DicomFrame::trigger_time_ms, "trigger time ", " ms");
  if (differs(&DicomFrame::acquisition) && own.acquisition)
    text += ", acquisition " + std::to_string(*own.acquisition);
  if (differs(&DicomFrame::stack)) text += ", of a separate stack";
  if (differs(&DicomFrame::image_type)) {
    const auto words = type_words(own.image_type);
    for (const std::string& word : words) text += ", " + word;
    if (words.empty()) text += ", of a separate image type";
  } else if (type_words(own.image_type).contains("localizer")) {
    text += ", localizer";
  }
  if (differs(&DicomFrame::frame_of_reference) && !has_reference_per_position(frames))
    text += ", in a separate frame of reference";
  return text;
}

std::string images(std::size_t count) {
  return count == 1 ? "1 image" : std::to_string(count) + " images";
}

std::string description_of(const std::vector<DicomFrame>& frames, const GridGeometry& geometry) {
  const DicomFrame& own = frames.front();
  std::string text =
      "series " + std::to_string(own.series + 1) + ": " + (own.modality.empty() ? "" : own.modality + ", ");
  if (!own.placed) return text + images(frames.size()) + " without a position";
  text += plane_of(normal_of(own)) + ", " + std::to_string(own.columns) + " x " + std::to_string(own.rows) +
          " x " + std::to_string(frames.size()) + ", " + shortly(own.column_spacing_mm) + " x " +
          shortly(own.row_spacing_mm);
  if (geometry.dims[2] > 1) text += " x " + shortly(geometry.spacing_mm[2]);
  return text + " mm";
}

// ---- slice positions ----------------------------------------------------------------------------

struct Fault {
  std::string what, remedy;
};

constexpr const char* kWholeSeries = "export the complete series again, and give its folder";
constexpr const char* kConvert = "load the series in 3D Slicer, which can resample it, and save it as NRRD";

// slices of a volume, sorted by position along the normal
class Stack {
 public:
  explicit Stack(const Frames& frames) : frames_(frames), normal_(normal_of(frames.front())) {
    for (const DicomFrame& frame : frames) positions_mm_.push_back(frame.position.dot(normal_));
  }

  std::optional<Fault> find_fault() const {
    for (std::size_t n = 0; n < frames_.size(); ++n)
      if (!frames_[n].fault.empty()) return Fault{slice(n) + ", " + frames_[n].fault, frames_[n].remedy};
    if (frames_.size() == 1)
      return Fault{"a single slice is not a volume", "give the folder with all slices of its series"};
    for (const auto& look : {&Stack::find_duplicate, &Stack::find_uneven_spacing, &Stack::find_lateral_shift})
      if (auto fault = (this->*look)()) return fault;
    return std::nullopt;
  }

  /// @pre find_fault() found none
  std::vector<std::string> find_notes() const {
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

  GridGeometry geometry() const {
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

 private:
  std::string slice(std::size_t n) const { return slice_in_words(frames_, n); }
  double gap_mm(std::size_t n) const { return positions_mm_[n + 1] - positions_mm_[n]; }
  double mean_gap_mm() const {
    return (positions_mm_.back() - positions_mm_.front()) / static_cast<double>(frames_.size() - 1);
  }
  static std::string degrees(double tangent) { return shortly(std::atan(tangent) * 180 / std::numbers::pi); }

  std::optional<Fault> find_duplicate() const {
    for (std::size_t n = 0; n + 1 < frames_.size(); ++n)
      if (gap_mm(n) < kSamePosition_mm)
        return Fault{
            "two slices are at the same position: " + slice(n) + ", and the next",
            "keep the right one: they differ in their values or in their SOPInstanceUID (0008,0018); if the "
            "series holds several volumes that cannot be distinguished, export them as separate series"};
    return std::nullopt;
  }

  std::optional<Fault> find_uneven_spacing() const {
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
    const double even_mm =
        (positions_mm_.back() - positions_mm_.front()) / static_cast<double>(gaps_mm.size());
    for (std::size_t n = 0; n < positions_mm_.size(); ++n) {
      const double off_mm = positions_mm_[n] - positions_mm_.front() - static_cast<double>(n) * even_mm;
      if (std::abs(off_mm) > allowed_mm)
        return Fault{"its slices are unevenly spaced: " + slice(n) + ", is " + in_mm(std::abs(off_mm)) +
                         " mm off its position between the first and the last",
                     kConvert};
    }
    return std::nullopt;
  }

  // in-plane offset from the normal through the first slice
  Vector lateral(std::size_t n) const {
    const Vector displacement = frames_[n].position - frames_.front().position;
    return displacement - displacement.dot(normal_) * normal_;
  }

  // in-plane shift per distance along the normal; its length is the tangent of the gantry tilt
  Vector tilt() const { return lateral(frames_.size() - 1) / (positions_mm_.back() - positions_mm_.front()); }

  std::optional<Fault> find_lateral_shift() const {
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

  const Frames& frames_;
  Vector normal_;
  std::vector<double> positions_mm_;
};

constexpr std::size_t kListed = 10;

std::string list_of(const std::vector<DicomVolume>& volumes, bool usable_alone) {
  std::string text;
  std::size_t listed = 0, left_out = 0;
  for (std::size_t n = 0; n < volumes.size(); ++n) {
    const DicomVolume& volume = volumes[n];
    if (usable_alone && !volume.fault.empty()) continue;
    if (listed == kListed) {
      ++left_out;
      continue;
    }
    ++listed;
    text += (listed == 1 ? " " : "; ") + std::to_string(n + 1) + ") " + volume.what +
            (volume.fault.empty() ? "" : ": " + volume.fault);
  }
  if (left_out > 0) text += "; and " + std::to_string(left_out) + " more (palpate info lists them)";
  return text;
}

}  // namespace

double corner_off_mm(const DicomFrame& a, const DicomFrame& b) {
  const auto off = [](const Vector& u, const Vector& v, int steps) { return (u - v).norm() * steps; };
  return off(a.along_row * a.column_spacing_mm, b.along_row * b.column_spacing_mm, a.columns - 1) +
         off(a.along_column * a.row_spacing_mm, b.along_column * b.row_spacing_mm, a.rows - 1);
}

bool is_lossy(const DicomVolume& volume) {
  return std::ranges::any_of(volume.frames, &DicomFrame::lossy);
}

std::string slice_in_words(const std::vector<DicomFrame>& frames, std::size_t n) {
  return "slice " + std::to_string(n + 1) + " of " + std::to_string(frames.size()) + ", at " +
         in_mm(frames[n].position.dot(normal_of(frames.front()))) + " mm along its normal";
}

std::string slice_in_words(const GridGeometry& grid, std::size_t n) {
  const Vector normal = Vector(grid.direction.col(0)).cross(Vector(grid.direction.col(1))).normalized();
  const Vector position =
      grid.origin.eigen() + static_cast<double>(n) * grid.spacing_mm[2] * Vector(grid.direction.col(2));
  return "slice " + std::to_string(n + 1) + " of " + std::to_string(grid.dims[2]) + ", at " +
         in_mm(position.dot(normal)) + " mm along its normal";
}

std::vector<DicomVolume> sort_into_volumes(std::vector<DicomFrame> frames) {
  std::vector<DicomVolume> volumes;
  std::vector<Frames> parts;
  for (Frames& group : grouped(std::move(frames)))
    for (Frames& part : split_duplicates(std::move(group))) parts.push_back(std::move(part));
  for (Frames& part : parts) {
    DicomVolume& volume = volumes.emplace_back();
    volume.frames = std::move(part);
    const DicomFrame& first = volume.frames.front();
    if (!first.placed) {
      volume.fault = images(volume.frames.size()) + ": " + first.fault;
      volume.remedy = first.remedy;
      continue;
    }
    const Stack stack(volume.frames);
    if (auto fault = stack.find_fault()) {
      volume.fault = std::move(fault->what);
      volume.remedy = std::move(fault->remedy);
      continue;
    }
    volume.geometry = stack.geometry();
    volume.notes = stack.find_notes();
    if (const auto possible = checked(volume.geometry, ""); !possible) {
      volume.fault = possible.error().what;
      volume.remedy = kWholeSeries;
    }
  }

  // descriptions relative to the other volumes of the series
  std::map<int, std::vector<const DicomFrame*>> of_series;
  for (const DicomVolume& volume : volumes)
    if (volume.frames.front().placed)
      of_series[volume.frames.front().series].push_back(&volume.frames.front());
  for (DicomVolume& volume : volumes) {
    volume.what = description_of(volume.frames, volume.geometry);
    if (volume.frames.front().placed)
      volume.what += distinguishing_attributes(volume.frames, of_series[volume.frames.front().series]);
    if (is_lossy(volume)) volume.what += ", compressed with loss";
  }
  return volumes;
}

Result<std::size_t> choose_volume(const std::vector<DicomVolume>& volumes, std::optional<int> number) {
  const auto of = [&](std::size_t n) -> Result<std::size_t> {
    if (volumes[n].fault.empty()) return n;
    const std::string which =
        volumes.size() == 1 ? "" : "volume " + std::to_string(n + 1) + " cannot be used: ";
    return bad_input("", which + volumes[n].fault, volumes[n].remedy);
  };
  if (number) {
    if (*number >= 1 && static_cast<std::size_t>(*number) <= volumes.size())
      return of(static_cast<std::size_t>(*number) - 1);
    return bad_input("", "has no volume " + std::to_string(*number) + " but these:" + list_of(volumes, false),
                     "choose one of them with --volume N");
  }
  std::vector<std::size_t> usable;
  for (std::size_t n = 0; n < volumes.size(); ++n)
    if (volumes[n].fault.empty()) usable.push_back(n);
  if (usable.size() == 1) return usable.front();
  if (volumes.size() == 1) return of(0);
  if (usable.empty())
    return bad_input("", "holds no volume that can be used:" + list_of(volumes, false),
                     volumes.front().remedy);
  return bad_input("", "holds " + std::to_string(usable.size()) + " volumes:" + list_of(volumes, true),
                   "choose one with --volume N; in a scene file: scan_volume = N");
}

}  // namespace palpate::volume_io
