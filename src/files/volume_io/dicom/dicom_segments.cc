#include "volume_io/dicom/dicom_segments.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>
#include <string_view>
#include <tuple>

#include "volume_io/labels/label_text.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

using Vector = Eigen::Vector3d;

constexpr const char* kSegSlicer =
    "load it with its images in 3D Slicer and save the segmentation as .seg.nrrd";

// Segment types for which there are presets, by SNOMED CT code and, if older files use one, by SRT code
// (DICOM PS3.16, CID 4031, 7151 and the groups that they include). The names are those by which presets are
// looked up.
struct KnownType {
  std::string_view sct, srt, name;
};
constexpr KnownType kKnownTypes[] = {
    // bones
    {"71341001", "T-12710", "femur"},
    {"12611008", "T-12740", "tibia"},
    {"87342007", "T-12750", "fibula"},
    {"64234005", "T-12730", "patella"},
    {"29836001", "", "hip"},
    {"", "T-12340", "ilium"},
    {"54735007", "T-11AD0", "sacrum"},
    {"", "T-11BF0", "coccyx"},
    {"85050009", "T-12410", "humerus"},
    {"23416004", "", "ulna"},
    {"62413002", "T-12420", "radius"},
    {"79601000", "T-12280", "scapula"},
    {"51299004", "T-12310", "clavicle"},
    {"56873002", "T-11210", "sternum"},
    {"89546000", "T-11100", "skull"},
    {"", "T-11180", "mandible"},
    {"", "T-11170", "maxilla"},
    {"", "T-11166", "zygoma"},
    {"", "T-12770", "calcaneus"},
    {"108371006", "", "tarsal bones"},
    {"53884002", "", "metatarsal"},
    {"28641004", "", "phalanx"},
    {"83936004", "", "carpus"},
    {"36455000", "", "metacarpal bones"},
    {"", "T-11300", "rib"},
    {"48535007", "", "rib 1"},
    {"78247007", "", "rib 2"},
    {"25888004", "", "rib 3"},
    {"25523003", "", "rib 4"},
    {"15339008", "", "rib 5"},
    {"59558009", "", "rib 6"},
    {"24915002", "", "rib 7"},
    {"5953002", "", "rib 8"},
    {"22565002", "", "rib 9"},
    {"77644006", "", "rib 10"},
    {"58830002", "", "rib 11"},
    {"43993008", "", "rib 12"},
    {"14806007", "", "vertebra C1"},
    {"39976000", "", "vertebra C2"},
    {"113205007", "", "vertebra C3"},
    {"5329002", "", "vertebra C4"},
    {"36978003", "", "vertebra C5"},
    {"36054005", "", "vertebra C6"},
    {"87391001", "", "vertebra C7"},
    {"64864005", "", "vertebra T1"},
    {"53733008", "", "vertebra T2"},
    {"1626008", "", "vertebra T3"},
    {"73071006", "", "vertebra T4"},
    {"56401006", "", "vertebra T5"},
    {"45296009", "", "vertebra T6"},
    {"62487009", "", "vertebra T7"},
    {"11068009", "", "vertebra T8"},
    {"82687006", "", "vertebra T9"},
    {"7610001", "", "vertebra T10"},
    {"12989004", "", "vertebra T11"},
    {"23215003", "", "vertebra T12"},
    {"66794005", "", "vertebra L1"},
    {"14293000", "", "vertebra L2"},
    {"36470004", "", "vertebra L3"},
    {"11994002", "", "vertebra L4"},
    {"49668003", "", "vertebra L5"},
    {"65985001", "", "vertebra S1"},
    // muscle and fat
    {"127954009", "", "skeletal muscle"},
    {"181674001", "", "gluteus maximus"},
    {"78333006", "", "gluteus medius"},
    {"75297007", "", "gluteus minimus"},
    {"68455001", "", "iliopsoas"},
    {"67769002", "", "subcutaneous fat"},
    {"55603005", "", "fat"},
    // vessels
    {"15825003", "T-42000", "aorta"},
    {"12691009", "", "brachiocephalic trunk"},
    {"29700009", "", "subclavian artery"},
    {"32062004", "", "common carotid artery"},
    {"73634005", "", "common iliac artery"},
    {"81040000", "", "pulmonary artery"},
    {"41801008", "", "coronary artery"},
    {"46027005", "", "common iliac vein"},
    {"8887007", "", "brachiocephalic vein"},
    {"110765007", "", "portal vein and splenic vein"},
    {"122972007", "", "pulmonary vein"},
    {"64131007", "", "inferior vena cava"},
    {"48345005", "", "superior vena cava"},
    // organs
    {"10200004", "T-62000", "liver"},
    {"64033007", "T-71000", "kidney"},
    {"78961009", "T-C3000", "spleen"},
    {"39607008", "T-28000", "lung"},
    {"45653009", "", "lung upper lobe"},
    {"72481006", "", "lung middle lobe"},
    {"90572001", "", "lung lower lobe"},
    {"80891009", "T-32000", "heart"},
    {"74281007", "", "myocardium"},
    {"82471001", "", "heart atrium left"},
    {"73829009", "", "heart atrium right"},
    {"87878005", "", "heart ventricle left"},
    {"53085002", "", "heart ventricle right"},
    {"12738006", "T-A0100", "brain"},
    {"", "T-A6000", "cerebellum"},
    {"15776009", "T-65000", "pancreas"},
    {"23451007", "T-B3000", "adrenal gland"},
    {"69748006", "", "thyroid gland"},
    {"45289007", "T-61100", "parotid gland"},
    {"", "T-61300", "submandibular gland"},
    {"41216001", "T-9200B", "prostate"},
    {"76752008", "T-04000", "breast"},
    {"", "T-C4000", "lymph node"},
};

std::string_view known_name(const DicomSegment& segment) {
  if (segment.code.empty()) return {};
  const bool older = segment.scheme == "SRT" || segment.scheme == "SNM3" || segment.scheme == "99SDM";
  for (const KnownType& type : kKnownTypes)
    if ((segment.scheme == "SCT" && segment.code == type.sct) || (older && segment.code == type.srt))
      return type.name;
  return {};
}

// the trimmed text if it is valid as a name, otherwise empty
std::string as_name(const std::string& text) {
  const std::string name(trimmed(text));
  return name.empty() || name_fault(name) ? std::string() : name;
}

bool contains_word(const std::string& name, std::string_view word) {
  return lower_case(name).find(word) != std::string::npos;
}

// true for a label without information: "Segment_1", "ROI-2", "3", "label"
bool is_uninformative(const std::string& label) {
  std::string letters;
  for (const char c : lower_case(label))
    if (c >= 'a' && c <= 'z')
      letters += c;
    else if (static_cast<unsigned char>(c) >= 0x80)
      return false;
  for (const std::string_view word :
       {"", "segment", "seg", "roi", "label", "structure", "contour", "object", "mask", "unnamed"})
    if (letters == word) return true;
  return false;
}

bool holds_labels(const DicomSegmentation& segmentation, const DicomFrame& frame) {
  return segmentation.codings[frame.file].kind == SegmentCoding::Kind::kLabels;
}

std::string segment_mm(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.2f", value);
  return text;
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
                        "has positions that are rounded to " + segment_mm(quantum_mm) +
                            " mm: its slices are placed " + segment_mm(step_mm) +
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
        "states that slices are " + segment_mm(*declared_mm) +
        " mm apart (SpacingBetweenSlices (0018,0088), or SliceThickness (0018,0050)), but its frames are " +
        segment_mm(min_step_mm) + " mm apart: the positions are used";
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

bool is_background(const DicomSegment& segment) {
  return segment.scheme == "DCM" && segment.code == "125040";
}

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
  const Vector normal = first.along_row.cross(first.along_column).normalized();
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
      return refused("frame " + std::to_string(n + 1) + " lies " + segment_mm(lateral_mm) +
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

std::string name_of_segment(const DicomSegment& segment) {
  std::string name = as_name(segment.label);
  const std::string_view known = known_name(segment);
  if (!known.empty() && !contains_word(name, known)) {
    name = std::string(known);
  } else if (is_uninformative(name)) {
    const std::string meaning = as_name(segment.meaning);
    if (!meaning.empty() && !is_uninformative(meaning)) name = meaning;
  }
  if (name.empty()) return "segment " + std::to_string(segment.number);
  if (!segment.side.empty() && !contains_word(name, segment.side)) name += " " + segment.side;
  return name;
}

DicomSegment segment_from_name(const std::string& name) {
  DicomSegment segment;
  std::string words;
  std::string spaced = lower_case(name);
  std::ranges::replace(spaced, '_', ' ');
  for (const std::string_view word : split_spaces(spaced)) {
    if (word == "left" || word == "right")
      segment.side = std::string(word);
    else
      words += (words.empty() ? "" : " ") + std::string(word);
  }
  for (const KnownType& type : kKnownTypes) {
    if (type.sct.empty() || lower_case(type.name) != words) continue;
    segment.code = std::string(type.sct);
    segment.scheme = "SCT";
    segment.meaning = std::string(type.name);
    segment.meaning[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(segment.meaning[0])));
  }
  return segment;
}

DicomSegmentation join_segmentations(std::vector<DicomSegmentation> files) {
  DicomSegmentation all = std::move(files.front());
  std::map<std::string, int> offset_of_concatenation;
  if (!all.concatenation_uid.empty()) offset_of_concatenation.emplace(all.concatenation_uid, 0);
  const auto highest = [](const std::vector<DicomSegment>& segments) {
    int number = 0;
    for (const DicomSegment& segment : segments) number = std::max(number, segment.number);
    return number;
  };
  for (std::size_t n = 1; n < files.size(); ++n) {
    DicomSegmentation& file = files[n];
    const auto known = offset_of_concatenation.find(file.concatenation_uid);
    const bool continues = known != offset_of_concatenation.end();
    const bool repeats = std::ranges::any_of(file.segments, [&](const DicomSegment& segment) {
      return std::ranges::any_of(all.segments,
                                 [&](const DicomSegment& other) { return other.number == segment.number; });
    });
    const int offset = continues ? known->second : repeats ? highest(all.segments) : 0;
    if (!file.concatenation_uid.empty()) offset_of_concatenation.emplace(file.concatenation_uid, offset);
    for (DicomSegment& segment : file.segments) {
      if (continues) break;
      segment.number += offset;
      all.segments.push_back(std::move(segment));
    }
    for (std::size_t f = 0; f < file.frames.size(); ++f) {
      file.frames[f].file = static_cast<std::uint32_t>(n);
      const bool labels = file.codings.front().kind == SegmentCoding::Kind::kLabels;
      all.segment_of_frame.push_back(labels ? 0 : file.segment_of_frame[f] + offset);
      all.frames.push_back(std::move(file.frames[f]));
    }
    file.codings.front().number_offset = offset;
    all.codings.push_back(file.codings.front());
    if (!all.slice_spacing_mm) all.slice_spacing_mm = file.slice_spacing_mm;
  }
  return all;
}

std::string colour_of_segment(const DicomSegment& segment) {
  if (!segment.lab) {
    if (!segment.rgb) return "";
    char text[64];
    const auto& [r, g, b] = *segment.rgb;
    std::snprintf(text, sizeof text, "%.4f %.4f %.4f", r / 255.0, g / 255.0, b / 255.0);
    return text;
  }
  const std::array<std::uint16_t, 3>& lab = *segment.lab;
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
    std::set<int> used;
    for (const auto& [one, other] : overlaps) {
      if (one == static_cast<int>(n)) used.insert(layers[static_cast<std::size_t>(other)]);
      if (other == static_cast<int>(n)) used.insert(layers[static_cast<std::size_t>(one)]);
    }
    int layer = 0;
    while (used.contains(layer)) ++layer;
    layers[n] = layer;
  }
  return layers;
}

}  // namespace palpate::volume_io
