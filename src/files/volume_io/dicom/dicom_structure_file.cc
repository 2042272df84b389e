#include <dcmtk/config/osconfig.h>

#include <dcmtk/dcmdata/dcdeftag.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>

#include "volume_io/dicom/dicom_elements.h"
#include "volume_io/dicom/dicom_readers.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

// Numbers of a long text, separated by backslashes; nullopt if one is invalid or exceeds 1e6 mm.
std::optional<std::vector<double>> long_numbers_of(DcmItem& item, const DcmTagKey& tag) {
  constexpr Uint32 kMaxText_bytes = 1 << 26;
  DcmElement* element = nullptr;
  char* text = nullptr;
  Uint32 length = 0;
  if (item.findAndGetElement(tag, element).bad() || !element || element->getLengthField() > kMaxText_bytes ||
      element->getString(text, length).bad())
    return std::nullopt;
  std::vector<double> numbers;
  const char *at = text, *end = text ? text + length : text;
  while (at != end) {
    const char* next = std::find(at, end, '\\');
    const auto is_blank = [](char c) { return c == ' ' || c == '\0' || c == '+'; };
    while (at != next && is_blank(*at)) ++at;
    double number = 0;
    const auto [last, failed] = std::from_chars(at, next, number);
    constexpr double kMax_mm = 1e6;
    if (failed != std::errc() || !std::all_of(last, next, is_blank) || !(std::abs(number) < kMax_mm))
      return std::nullopt;
    numbers.push_back(number);
    at = next == end ? end : next + 1;
  }
  return numbers;
}

// points of a contour, without a repetition of the first at the end; nullopt if they are invalid
std::optional<std::vector<Eigen::Vector3d>> points_of(DcmItem& contour) {
  const auto numbers = long_numbers_of(contour, DCM_ContourData);
  const auto declared = number_of(contour, DCM_NumberOfContourPoints);
  if (!numbers || numbers->size() % 3 != 0 ||
      (declared && *declared != static_cast<double>(numbers->size() / 3)))
    return std::nullopt;
  std::vector<Eigen::Vector3d> points;
  for (std::size_t n = 0; n < numbers->size(); n += 3) points.emplace_back(numbers->data() + n);
  while (points.size() > 1 && points.back() == points.front()) points.pop_back();
  return points;
}

// Adds the closed contours of an item of ROIContourSequence; returns false if the data are damaged.
bool add_contours(DcmItem& item, std::size_t& points_left, DicomStructure& structure) {
  if (const auto colour = numbers_of<3>(item, DCM_ROIDisplayColor)) {
    structure.colour.emplace();
    for (std::size_t c = 0; c < 3; ++c)
      (*structure.colour)[c] = static_cast<std::uint8_t>(std::clamp((*colour)[c], 0.0, 255.0));
  }
  for (DcmItem* contour : items_of(item, DCM_ContourSequence)) {
    const std::string type = text_of(*contour, DCM_ContourGeometricType);
    if (type != "CLOSED_PLANAR" && type != "CLOSEDPLANAR_XOR") {
      ++structure.left_out;
      continue;
    }
    auto points = points_of(*contour);
    if (!points || points->size() > points_left) return false;
    points_left -= points->size();
    if (points->size() < 3)
      ++structure.left_out;
    else
      structure.contours.push_back(*std::move(points));
  }
  return true;
}

}  // namespace

Result<std::vector<DicomStructure>> read_structure_set(const std::filesystem::path& name) {
  const auto damaged = [] { return bad_input("", kDamagedStructures, "copy it again"); };
  DcmFileFormat file;
  if (const Loaded loaded = load(file, name); loaded != Loaded::kWhole)
    return bad_input("", in_words(loaded, "DICOM structure set"), "copy it again");
  DcmDataset& root = *file.getDataset();
  const std::string set = text_of(root, DCM_SpecificCharacterSet);
  std::vector<DicomStructure> structures;
  std::map<double, std::size_t> index_of_number;
  for (DcmItem* item : items_of(root, DCM_StructureSetROISequence)) {
    const auto number = number_of(*item, DCM_ROINumber);
    if (!number || !index_of_number.emplace(*number, structures.size()).second)
      return bad_input("", "has a structure without an ROINumber (3006,0022), or a repeated one",
                       "export it again");
    DicomStructure& structure = structures.emplace_back();
    structure.segment.number = static_cast<int>(structures.size());
    structure.segment.label = name_text_of(*item, DCM_ROIName, set);
  }
  const auto referenced = [&](DcmItem& item) -> DicomStructure* {
    const auto number = number_of(item, DCM_ReferencedROINumber);
    const auto found = number ? index_of_number.find(*number) : index_of_number.end();
    return found == index_of_number.end() ? nullptr : &structures[found->second];
  };
  for (DcmItem* item : items_of(root, DCM_RTROIObservationsSequence))
    if (DicomStructure* structure = referenced(*item)) {
      const Code code = code_of(*item, DCM_RTROIIdentificationCodeSequence, set);
      structure->segment.code = code.value;
      structure->segment.scheme = code.scheme;
      structure->segment.meaning = code.meaning;
    }
  // the outline of a body in 1000 slices has some hundred thousand points
  std::size_t points_left = 10'000'000;
  for (DcmItem* item : items_of(root, DCM_ROIContourSequence)) {
    DicomStructure* structure = referenced(*item);
    if (!structure || !add_contours(*item, points_left, *structure)) return damaged();
  }
  if (std::ranges::all_of(structures, [](const DicomStructure& each) { return each.contours.empty(); }))
    return bad_input("", "holds no closed contour (ContourSequence (3006,0040))",
                     "export its structures again");
  return structures;
}

}  // namespace palpate::volume_io
