#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"

/// Tables that name the values of a label map, and other sources of names. The bytes are untrusted.
namespace palpate {

/// One row of a label table.
struct NamedLabel {
  LabelId value = 0;
  std::string name;
  std::optional<Rgb> colour;
};

/// Parses Slicer's colour table: "value name r g b a", '#' comments; underscores in names are preserved.
/// `source` names the text in errors, which include the line number.
Result<std::vector<NamedLabel>> parse_colour_table(std::string_view text, const std::string& source);
/// Parses a tab-separated table with a header line that contains "value" (or "index", "label", "id") and
/// "name", and optionally "r","g","b" or "color" (#rrggbb) columns, as in BIDS dseg.tsv.
Result<std::vector<NamedLabel>> parse_label_tsv(std::string_view text, const std::string& source);
/// Parses the same columns separated by commas or semicolons, with optional quotation marks; 3D Slicer's
/// column names "LabelValue" and "Color_R" are accepted too.
Result<std::vector<NamedLabel>> parse_label_csv(std::string_view text, const std::string& source);
/// Parses ITK-SNAP's label descriptions: value r g b opacity visible mesh "name".
Result<std::vector<NamedLabel>> parse_snap_labels(std::string_view text, const std::string& source);
/// Parses {"1": "femur"} or {"femur": 1}, at top level, under "labels" or as the only table of a task
/// (TotalSegmentator, nnU-Net, MONAI); segment lists as written by dcmqi and 3D Slicer; and 3D Slicer's
/// terminologies whose types have numbers.
Result<std::vector<NamedLabel>> parse_label_json(std::string_view text, const std::string& source);
/// Reads a table by its extension: .ctbl, .txt and .lut (FreeSurfer) are colour tables or, if the first line
/// says so, ITK-SNAP's; .label is ITK-SNAP's; .tsv; .csv; .json.
Result<std::vector<NamedLabel>> read_label_names(const std::filesystem::path& file);

/// Part of a file name that may name a structure without naming a patient: the words that are known to be
/// anatomy (those of the tissue presets, TotalSegmentator and FreeSurfer), such as "femur_left" of
/// "doe_femur_left"; empty if there are none.
std::string structure_in_name(std::string_view text);

/// Parses Slicer's SegmentN_* fields (key, value pairs of an NRRD header) into segments. Keys of other
/// software are ignored. `source` names the file in errors.
Result<std::vector<Segment>> parse_segment_fields(
    const std::vector<std::pair<std::string, std::string>>& fields, int layers, const std::string& source);

}  // namespace palpate
