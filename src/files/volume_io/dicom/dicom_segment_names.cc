#include "volume_io/dicom/dicom_segment_names.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <string_view>

#include "volume_io/labels/label_text.h"

namespace palpate::volume_io {
namespace {

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

}  // namespace

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

bool is_background(const DicomSegment& segment) {
  return segment.scheme == "DCM" && segment.code == "125040";
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

}  // namespace palpate::volume_io
