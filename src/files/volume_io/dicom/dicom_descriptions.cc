#include "volume_io/dicom/dicom_descriptions.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

#include "volume_io/dicom/dicom_grouping.h"

namespace palpate::volume_io {
namespace {

std::string plane_of(const Eigen::Vector3d& normal) {
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

}  // namespace

std::string in_mm(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.2f", std::abs(value) < 0.005 ? 0.0 : value);
  return text;
}

std::string short_number(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

std::string images_in_words(std::size_t count) {
  return count == 1 ? "1 image" : std::to_string(count) + " images";
}

std::string description_of(const std::vector<DicomFrame>& frames, const GridGeometry& geometry) {
  const DicomFrame& own = frames.front();
  std::string text =
      "series " + std::to_string(own.series + 1) + ": " + (own.modality.empty() ? "" : own.modality + ", ");
  if (!own.placed) return text + images_in_words(frames.size()) + " without a position";
  text += plane_of(normal_of(own)) + ", " + std::to_string(own.columns) + " x " + std::to_string(own.rows) +
          " x " + std::to_string(frames.size()) + ", " + short_number(own.column_spacing_mm) + " x " +
          short_number(own.row_spacing_mm);
  if (geometry.dims[2] > 1) text += " x " + short_number(geometry.spacing_mm[2]);
  return text + " mm";
}

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
    if (differs(member) && own.*member) text += ", " + before + short_number(*(own.*member)) + after;
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

}  // namespace palpate::volume_io
