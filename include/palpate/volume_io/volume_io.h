#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/volume/volume.h"

/// Reads untrusted files as volumes in LPS millimetres. Supported are NRRD (.nrrd, .nhdr, Slicer's
/// .seg.nrrd), NIfTI (.nii, .nii.gz, .hdr/.img), MetaImage (.mha, .mhd) and DICOM images (CT, MR and others
/// with a position in the patient; a file or a folder of them, recognised by their content; a segmentation or
/// a structure set, one file); image stacks (PNG, TIFF, JPEG; a folder of them, or a multi-page TIFF), in
/// grey as scans and in colour as labels; surfaces as labels (STL, OBJ, PLY, VTK polydata; a file, or a
/// folder with one per structure); and a folder with one mask per structure (volumes on one grid) as labels.
/// Every error names the file, what is wrong and how to correct it; truncated data are an error and never
/// filled with zeros. Text fields other than segment names and colours are dropped on reading, because they
/// may identify a patient.
///
/// Each read starts a process of its own, a confined copy of the program that can only read this file; it
/// ends with the read and with the calling thread. The copy takes 1 ms plus about 50 ms for each GiB of the
/// program's memory, and causes a page fault for each page that the program modifies afterwards: read before
/// a servo loop starts, or in another program. In addition to the errors listed below: kUnavailable if no
/// process can be started.
namespace palpate {

/// Kind of values that a file declares.
enum class ValueMeaning {
  kUnspecified,  ///< Not declared.
  kLabels,       ///< NIfTI's intent LABEL.
  kMeasured,     ///< NIfTI's intents of statistics, estimates and vectors; DICOM images.
};

/// Contents of a file's header.
struct VolumeHeader {
  std::string format;  ///< "NRRD", "Slicer segmentation (NRRD)", "NIfTI", "MetaImage", "DICOM ..."
  /// Component type in the file: "uint8", "int16", "float32", ...; for DICOM float32 if its slices have
  /// individual scales or padding.
  std::string component_type;
  GridGeometry geometry;
  int layers = 1;             ///< Number of layers; more than 1 for overlapping segments.
  bool has_geometry = true;   ///< False: the file does not specify its position in the patient, and LPS is
                              ///< assumed.
  bool has_segments = false;  ///< The file itself names segments.
  ValueMeaning meaning = ValueMeaning::kUnspecified;
  /// For a NIfTI whose qform and sform differ by a mirror or by more than a voxel: both readings, and which
  /// one is used by default; otherwise empty.
  std::string placement_doubt = {};
};

struct ScanFile {
  VolumeHeader header;
  Volume<float> scan;  ///< Integers up to 24 bits are represented exactly.
  /// Why read_volume() classified it as a scan: "its 205 values change from voxel to voxel".
  std::string evidence = {};
};

/// Source of the names of a label map.
enum class NameSource {
  kNone,
  kFile,           ///< The file itself.
  kFileName,       ///< Anatomical words of the file name, or of each file name in a folder.
  kSuppliedTable,  ///< A table given by the caller.
  kOwnTable,       ///< A table in the same folder with the label map's own name.
  /// The only table in the folder, provided that no other label map is there and the table names nine in ten
  /// values.
  kOnlyTable,
};
/// Text for the user, such as "a table next to it with the same name"; without file names, which may contain
/// a patient's name.
std::string_view description_of(NameSource source);

struct LabelFile {
  VolumeHeader header;
  LabelMap labels;
  std::vector<LabelId> unnamed;  ///< Labels that occur in the voxels and have no name.
  NameSource name_source = NameSource::kNone;
  std::optional<std::filesystem::path> names_table = {};  ///< File of the table, if the names come from one.
  std::string evidence = {};  ///< Why read_volume() classified it as labels: "its 3 values lie in patches".
};
/// Text for the user: "2 of 3 labels have their names from knee.tsv, a table next to it with the same name".
std::string origin_of_names(const LabelFile& labels);

/// Use of the cache of decompressed voxels (palpate/cache/cache.h), for voxels that are slow to decompress.
/// kOn reads from and writes to the cache. Header, names and warnings come from the files in either case.
enum class VoxelCaching { kOff, kOn };

/// Coordinate system of a surface file.
enum class MeshSpace { kLps, kRas };

/// Coordinate system and unit of surfaces, which their files do not specify. A value that is not given here
/// is taken from the file (3D Slicer's "SPACE=LPS"), otherwise inferred from the scan: the one of LPS and
/// RAS, and of mm, cm and m, for which the points lie within the scan; if several fit, an error asks the
/// user. Without a scan LPS, with sides unconfirmed, and mm.
struct MeshPlacementOptions {
  std::optional<MeshSpace> space;
  std::optional<double> unit_mm;  ///< Length of a unit of the file; mm, > 0.
};

/// The two transforms that a NIfTI may contain.
enum class NiftiForm { kQform, kSform };

/// Position of volumes in the patient where their files leave it open or contradict themselves.
struct PlacementOptions {
  MeshPlacementOptions mesh = {};
  /// Spacing of columns, rows and slices of an image stack (PNG, TIFF, JPEG); > 0.
  std::optional<Eigen::Vector3d> image_spacing_mm = {};
  /// Transform to use for a NIfTI that has both; unset: the sform.
  std::optional<NiftiForm> nifti_form = {};
  /// Accept labels of which more than half lie outside the scan, because the scan shows only a part of the
  /// anatomy.
  bool scan_is_cropped = false;
};
/// Sets the placement for the whole process, as palpate/base/reading.h does for limits; settings of a scene
/// take precedence.
void set_placement_options(const PlacementOptions& placement_options);
const PlacementOptions& placement_options();

/// Patient directions of a grid's axes, such as "LPS": the assignment of directions to axes that fits best.
std::string axis_codes(const Eigen::Matrix3d& direction);

/// Reads only the header. Errors: those of reading the whole file except truncated voxel data.
/// @param volume  for DICOM, which can contain several volumes, the number that list_volumes() assigns;
///                required if several can be used. kUsage with any other format. The same applies to the
///                functions below.
Result<VolumeHeader> read_header(const std::filesystem::path& file, std::optional<int> volume = {});
/// True for images that are slices of a volume: a TIFF file, or a folder that contains PNG, TIFF or JPEG
/// files but neither DICOM nor other volumes nor surfaces. They need a spacing
/// (PlacementOptions::image_spacing_mm).
bool is_image_stack(const std::filesystem::path& file);

/// True for a file that is one of these volumes by its name or its first bytes, or for a folder of DICOM;
/// false if it cannot be read.
bool is_volume(const std::filesystem::path& file);
/// True for a DICOM image, whatever its name, or a folder with one in it or below it.
bool is_dicom(const std::filesystem::path& file);

/// Whether it is a DICOM structure set (RTSTRUCT), which is a label map only with the grid of its scan.
bool is_structure_set(const std::filesystem::path& file);

/// Volumes in a DICOM file or in a folder of DICOM files. Contains no text from the files: no name, no date,
/// no identifier.
struct VolumeList {
  struct Item {
    std::string what;         ///< Description: "series 1: CT, axial, 512 x 512 x 90, 0.7 x 0.7 x 1.25 mm".
    std::string fault;        ///< Why it cannot be used, naming the slice; empty if it can.
    std::string remedy = {};  ///< Remedy, as an imperative.
  };
  std::vector<Item> volumes;       ///< Numbered from 1.
  std::vector<std::string> notes;  ///< Other contents, and files that were left out.
};
/// Lists the volumes of a DICOM file or folder.
/// @pre is_dicom(file)
/// Errors: no readable image; interrupted.
Result<VolumeList> list_volumes(const std::filesystem::path& file, const Progress& progress = {});

/// A scan and the labels that were made on it.
struct Study {
  std::filesystem::path scan;
  std::optional<int> volume;                    ///< Number of the scan's volume, if it is DICOM.
  std::optional<std::filesystem::path> labels;  ///< Unset: a scan without labels.
  std::vector<std::string> notes;               ///< Relation of the two, and what is unknown about it.
  /// True if DICOM labels reference images, series or frame of reference of the scan, or if the labels are in
  /// a format that cannot reference a scan.
  bool is_declared = true;
};
/// Finds the volume among DICOM images on which a DICOM segmentation was made, by the images, the series and
/// the frame of reference that it references; identifiers are compared in the reader process. Files of other
/// formats are returned as given.
/// @param scan    any volume
/// @param labels  unset: if `scan` is a DICOM folder, the only segmentation in it or below it
/// @param volume  number of the scan's volume, which overrides the search
/// Errors: a folder with several segmentations; a segmentation of other images, of a volume that cannot be
/// used or of several equally related ones; interrupted.
Result<Study> find_study(const std::filesystem::path& scan,
                         const std::optional<std::filesystem::path>& labels, std::optional<int> volume,
                         const Progress& progress = {});

/// A scan and its segmentation.
struct ScanAndLabels {
  std::filesystem::path scan, labels;
};
/// Identifies the scan and the segmentation among two volumes, named in either order. DICOM images are a
/// scan; surfaces, folders of masks, DICOM segmentations and structure sets are segmentations. Other files
/// are classified by their header, else by the first 2^20 voxel values that are not 0, with the criteria of
/// read_volume(). Where both remain unclear, and where read_as() is set, `first` is the scan.
/// @param names  a table for the labels; whole numbers are then enough, as for read_volume()
/// Errors: kUsage, one file given twice; kBadInput, a file that is missing or no volume, two scans, two label
/// maps.
Result<ScanAndLabels> identify_scan_and_labels(const std::filesystem::path& first,
                                               const std::filesystem::path& second,
                                               const std::optional<std::filesystem::path>& names = {});

/// Error that describes a file or folder that is no volume, with a remedy: DICOM, a surface, a picture, an
/// archive, a folder, ...; empty for a volume, a text and an unknown format.
std::optional<Error> describe_non_volume(const std::filesystem::path& file);

/// Classification that read_volume() uses regardless of the values.
enum class ReadAs { kByContent, kLabels, kScan };
/// Sets the classification for the whole process, as set_placement_options().
void set_read_as(ReadAs kind);
ReadAs read_as();

/// Reads a volume as scan or labels. Unless read_as() decides, it is labels if its header or a table in its
/// folder says so, or if its values are non-negative integers in contiguous patches.
/// @param names  as for read_labels; if given, integer values suffice
/// Errors: those of reading; also if the values leave the classification open.
Result<std::variant<ScanFile, LabelFile>> read_volume(const std::filesystem::path& file,
                                                      const std::optional<std::filesystem::path>& names = {},
                                                      const Progress& progress = {}, const Warn& warn = {},
                                                      VoxelCaching caching = VoxelCaching::kOff,
                                                      std::optional<int> volume = {});

/// Reads a 3-D (or 2-D, as one slice) scalar volume as a scan.
Result<ScanFile> read_scan(const std::filesystem::path& file, const Progress& progress = {},
                           const Warn& warn = {}, VoxelCaching caching = VoxelCaching::kOff,
                           std::optional<int> volume = {}, const PlacementOptions& placement_options = {});

/// True if a scan's values look like labels: by the meaning that its file declares, otherwise integers in
/// contiguous patches.
bool resembles_labels(const ScanFile& file);
/// True if labels look like a scan's values: more than 64 values that change from voxel to voxel, that mostly
/// occur in single voxels, or that change by small steps at every third voxel or more often.
bool resembles_scan(const LabelMap& labels);

/// Treatment of labels that look like a scan (resembles_scan) and that neither the file nor a table that
/// names more than half of them declares to be labels.
enum class AmbiguousLabels { kReject, kWarn };

/// Reads a segmentation. Voxel values must be integers in 0 ... 65535. DICOM images are rejected.
/// @param names              a table of label names, see read_label_names. If unset, and if the file itself
///                           contains no names: a table with the file's own name, otherwise a single .ctbl or
///                           .tsv in the same folder, provided that no other label map is there and it names
///                           nine in ten values. A single label without a name is named by the words of its
///                           file name that are known to be anatomy (structure_in_name). A given table that
///                           names none of the labels is an error.
/// @param scan_grid          grid of the scan, on which the contours of a DICOM structure set are rasterised;
///                           required for such a file. Surfaces are rasterised on it too, or on a grid of
///                           their own if null. Other label maps have their own grid.
/// @param placement_options  values that it leaves unset are those of placement_options()
/// @param scan               file of the scan, which does not count as another label map in the folder
Result<LabelFile> read_labels(const std::filesystem::path& file,
                              const std::optional<std::filesystem::path>& names = {},
                              const Progress& progress = {}, const Warn& warn = {},
                              AmbiguousLabels ambiguous = AmbiguousLabels::kReject,
                              VoxelCaching caching = VoxelCaching::kOff,
                              const GridGeometry* scan_grid = nullptr,
                              const PlacementOptions& placement_options = {},
                              const std::optional<std::filesystem::path>& scan = {});

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

/// Writes a volume in the format of the file's extension, compressed; NRRD and MetaImage in LPS, NIfTI in RAS
/// as its standard requires, so that other software obtains the same geometry. The file appears complete or
/// not at all (a temporary is renamed). Errors: kOutput.
Result<void> write_volume(const std::filesystem::path& file, const Volume<float>& volume);
Result<void> write_volume(const std::filesystem::path& file, const Volume<std::uint8_t>& volume);
Result<void> write_volume(const std::filesystem::path& file, const Volume<std::uint16_t>& volume);
Result<void> write_volume(const std::filesystem::path& file, const Volume<std::int16_t>& volume);
/// Writes labels; the extension .seg.nrrd stores names, colours and layers in Slicer's fields. Errors:
/// several layers in any other format.
Result<void> write_labels(const std::filesystem::path& file, const LabelMap& labels);

}  // namespace palpate
