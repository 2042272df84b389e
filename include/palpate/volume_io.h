#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "palpate/progress.h"
#include "palpate/volume.h"

/// Untrusted bytes become volumes in LPS millimetres. NRRD (.nrrd, .nhdr, Slicer's .seg.nrrd), NIfTI
/// (.nii, .nii.gz, .hdr/.img) and MetaImage (.mha, .mhd). Every error names the file, what is wrong
/// and how to mend it; short data are an error, never zeros. Text fields of a file other than
/// segment names and colours are dropped on reading: they may name a patient.
namespace palpate {

/// What a file's header says.
struct VolumeHeader {
  std::string format;          ///< "NRRD", "Slicer segmentation (NRRD)", "NIfTI", "MetaImage"
  std::string component_type;  ///< of the file: "uint8", "int16", "float32", ...
  GridGeometry geometry;
  int layers = 1;             ///< > 1 for overlapping segments
  bool has_geometry = true;   ///< false: the file does not say how it lies in the patient, LPS is assumed
  bool has_segments = false;  ///< the file itself names segments
};

struct ScanFile {
  VolumeHeader header;
  Volume<float> scan;  ///< integers up to 24 bits are exact
};

struct LabelFile {
  VolumeHeader header;
  LabelMap labels;
  std::vector<LabelId> unnamed;  ///< labels present in the voxels and named nowhere
};

/// Reads only the header. Same errors as reading the file, short voxel data excepted.
Result<VolumeHeader> read_header(const std::filesystem::path& file);

/// Reads any 3-D (or 2-D, as one slice) scalar volume as a scan.
Result<ScanFile> read_scan(const std::filesystem::path& file, const Progress& progress = {},
                           const Warn& warn = {});

/// Reads a segmentation. Voxel values must be whole and in 0 ... 65535.
/// @param names  a colour table (.ctbl) or table (.tsv) that names the labels; without one, and when
///               the file itself names none, a single table standing in the same folder is used.
Result<LabelFile> read_labels(const std::filesystem::path& file,
                              const std::optional<std::filesystem::path>& names = {},
                              const Progress& progress = {}, const Warn& warn = {});

/// One line of a colour table.
struct NamedLabel {
  LabelId value = 0;
  std::string name;
  std::optional<Rgb> colour;
};

/// Parses Slicer's colour table: "value name r g b a", '#' comments, underscores for spaces kept as
/// they stand. `source` names the text in errors, which carry the line.
Result<std::vector<NamedLabel>> parse_colour_table(std::string_view text, const std::string& source);
/// Parses a tab-separated table with a header line that has "value" (or "index", "label", "id") and
/// "name", and optionally "r","g","b" or "color" (#rrggbb) columns, as BIDS dseg.tsv.
Result<std::vector<NamedLabel>> parse_label_tsv(std::string_view text, const std::string& source);
/// Reads either by its ending (.ctbl, .txt; .tsv).
Result<std::vector<NamedLabel>> read_label_names(const std::filesystem::path& file);

/// Slicer's SegmentN_* fields (key, value pairs of an NRRD header) become segments.
/// Keys of other software are ignored. `source` names the file in errors.
Result<std::vector<Segment>> parse_segment_fields(
    const std::vector<std::pair<std::string, std::string>>& fields, int layers, const std::string& source);

/// Writes by the file's ending; NRRD and MetaImage in LPS, NIfTI in RAS as its standard asks, so that
/// other software sees the same geometry. The file appears whole or not at all (written beside and
/// renamed). Compressed. Errors are kOutput.
Result<void> write_volume(const std::filesystem::path& file, const Volume<float>& volume);
Result<void> write_volume(const std::filesystem::path& file, const Volume<std::uint8_t>& volume);
Result<void> write_volume(const std::filesystem::path& file, const Volume<std::uint16_t>& volume);
Result<void> write_volume(const std::filesystem::path& file, const Volume<std::int16_t>& volume);
/// Labels; a name that ends in .seg.nrrd keeps names, colours and layers in Slicer's fields. Several
/// layers into any other format is an error.
Result<void> write_labels(const std::filesystem::path& file, const LabelMap& labels);

}  // namespace palpate
