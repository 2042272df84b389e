#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/volume/volume.h"

/// Untrusted bytes become volumes in LPS millimetres. NRRD (.nrrd, .nhdr, Slicer's .seg.nrrd), NIfTI
/// (.nii, .nii.gz, .hdr/.img), MetaImage (.mha, .mhd) and DICOM's images (CT, MR and others with a place in
/// the patient; a file, or a folder of them, by their content; a segmentation or a structure set, one file),
/// stacks of pictures (PNG, TIFF, JPEG; a folder of them, or a TIFF of several pages), grey as scans and in
/// colours as labels, surfaces as labels (STL, OBJ, PLY, VTK polydata; a file, or a folder with one for each
/// structure), and a folder with a mask for each structure (volumes on one grid) as labels. Every error names
/// the file, what is wrong and how to mend it; short data are an error, never zeros. Text fields of a file
/// other than segment names and colours are dropped on reading: they may name a patient.
///
/// Each reading starts a process of its own, a copy of the program that can do nothing but read this file; it
/// ends with the reading, and with the thread that reads. Copying takes 1 ms and some 50 ms more for each GiB
/// that the program has taken, and leaves it a fault for each page that it then changes: read before a servo
/// ticks, or in another program. Errors further to those named below: kUnavailable, no process is to be had.
namespace palpate {

/// What a file says that its values are.
enum class ValueMeaning {
  kUnsaid,
  kLabels,    ///< NIfTI's intent LABEL
  kMeasured,  ///< NIfTI's intents of statistics, estimates and vectors; DICOM's images
};

/// What a file's header says.
struct VolumeHeader {
  std::string format;  ///< "NRRD", "Slicer segmentation (NRRD)", "NIfTI", "MetaImage", "DICOM ..."
  /// Of the file: "uint8", "int16", "float32", ...; of DICOM float32 where its slices have scales of their
  /// own or padding.
  std::string component_type;
  GridGeometry geometry;
  int layers = 1;             ///< > 1 for overlapping segments
  bool has_geometry = true;   ///< false: the file does not say how it lies in the patient, LPS is assumed
  bool has_segments = false;  ///< the file itself names segments
  ValueMeaning meaning = ValueMeaning::kUnsaid;
  /// Of a NIfTI whose qform and sform differ by a mirror or by more than a voxel: both readings, and which
  /// was taken unasked; else empty.
  std::string placement_doubt = {};
};

struct ScanFile {
  VolumeHeader header;
  Volume<float> scan;  ///< integers up to 24 bits are exact
  std::string evidence =
      {};  ///< why read_volume() took it as a scan: "its 205 values change from voxel to voxel"
};

/// Where the names of a label map are from.
enum class NameSource {
  kNone,
  kFile,        ///< the file itself
  kFileName,    ///< words of its file's name, or of each file's in a folder of them
  kGivenTable,  ///< the table that the caller named
  kOwnTable,    ///< a table beside it with its name
  /// The only table in its folder, where no other label map stands there and it names nine in ten values.
  kOnlyTable,
};
/// "a table beside it with its name"; without any file's name, which may be a patient's.
std::string_view words_of(NameSource source);

struct LabelFile {
  VolumeHeader header;
  LabelMap labels;
  std::vector<LabelId> unnamed;  ///< labels present in the voxels and named nowhere
  NameSource name_source = NameSource::kNone;
  std::optional<std::filesystem::path> names_table = {};  ///< of a table
  std::string evidence = {};  ///< why read_volume() took it as labels: "its 3 values lie in patches"
};
/// "2 of 3 labels have names from knee.tsv, a table beside it with its name"
std::string origin_of_names(const LabelFile& labels);

/// Whether voxels that take a while to unpack are kept unpacked for the next reading, and taken from there
/// (palpate/cache/cache.h). Header, names and warnings are those of the files in either case.
enum class Unpacked { kAnew, kKept };

/// The axes that the numbers of a surface's file mean.
enum class MeshSpace { kLps, kRas };

/// How surfaces are to be read, which their files do not say. What is not given here is what the file says
/// (3D Slicer's "SPACE=LPS"), else what the scan shows: of LPS and RAS, and of mm, cm and m, that in which
/// the points lie within it and otherwise do not; where several do, an error that asks. Without a scan LPS,
/// whose sides are then unknown, and mm.
struct MeshPlacing {
  std::optional<MeshSpace> space;
  std::optional<double> unit_mm;  ///< > 0
};

/// The two placements that a NIfTI may hold.
enum class NiftiForm { kQform, kSform };

/// How volumes lie in the patient where their files do not say it, or say two things.
struct Placing {
  MeshPlacing mesh = {};
  /// Between the columns, the rows and the slices of a stack of pictures (PNG, TIFF, JPEG); > 0.
  std::optional<Eigen::Vector3d> image_spacing_mm = {};
  /// Which placement of a NIfTI counts that has both; without it the sform.
  std::optional<NiftiForm> nifti_form = {};
  /// More than half of the labels may lie outside the scan, which shows a part of what they are of.
  bool scan_is_cropped = false;
};
/// For the whole process, as palpate/base/reading.h; what a scene says comes before it.
void set_placing(const Placing& placing);
const Placing& placing();

/// Where the axes of a grid point, as "LPS": the assignment of patient directions to axes that fits best.
std::string axis_codes(const Eigen::Matrix3d& direction);

/// Reads only the header. Same errors as reading the file, short voxel data excepted.
/// @param volume  of DICOM, which can hold several, the number that list_volumes() gives it; needed where
/// several
///                can be used. An error, kUsage, with any other format. The same holds below.
Result<VolumeHeader> read_header(const std::filesystem::path& file, std::optional<int> volume = {});
/// Whether it is pictures that are slices: a TIFF file, or a folder in which PNG, TIFF or JPEG files stand
/// and neither DICOM nor other volumes nor surfaces. They take a spacing (Placing::image_spacing_mm).
bool is_image_stack(const std::filesystem::path& file);

/// Whether a file is one of these volumes by its name or its first bytes, or a folder of DICOM; false where
/// it cannot be read.
bool is_volume(const std::filesystem::path& file);
/// Whether it is a DICOM image, whatever its name, or a folder with one in it or below it.
bool is_dicom(const std::filesystem::path& file);

/// What volumes a DICOM file or a folder of them holds. Nothing in it comes from a text of the files: no
/// name, no date, no identifier.
struct VolumeList {
  struct Item {
    std::string what;         ///< "series 1: CT, axial, 512 x 512 x 90, 0.7 x 0.7 x 1.25 mm"
    std::string fault;        ///< why it cannot be used, and which slice; empty: it can
    std::string remedy = {};  ///< how to mend that, in an imperative
  };
  std::vector<Item> volumes;       ///< the first has the number 1
  std::vector<std::string> notes;  ///< what else stands there, what was left out
};
/// @param file  is_dicom() holds of it
/// Errors: no image that can be read; interrupted.
Result<VolumeList> list_volumes(const std::filesystem::path& file, const Progress& progress = {});

/// A scan and the labels that belong to it.
struct Study {
  std::filesystem::path scan;
  std::optional<int> volume;                    ///< the scan's number, where it is DICOM's
  std::optional<std::filesystem::path> labels;  ///< none: the scan stands alone
  std::vector<std::string> notes;               ///< how they belong together, and what is not known of that
  /// Whether labels of DICOM say by images, series or frame of reference that they were made on the scan; of
  /// other labels nothing could, and it is true.
  bool is_said = true;
};
/// Of DICOM's images and a segmentation of DICOM the volume that the segmentation was made on, by the images,
/// the series and the frame of reference that it names; their identifiers are compared in the process that
/// reads. Other files as they are given.
/// @param scan    any volume
/// @param labels  without them, where `scan` is a folder of DICOM, the one segmentation in it or below it
/// @param volume  of the scan, the one that is meant in any case
/// Errors: a folder with several segmentations; a segmentation of other images, of a volume that cannot be
/// used or of several alike; interrupted.
Result<Study> find_study(const std::filesystem::path& scan,
                         const std::optional<std::filesystem::path>& labels, std::optional<int> volume,
                         const Progress& progress = {});

/// What a file or a folder is, and the way from there to a volume, where it is known to be something else:
/// DICOM, a surface, a picture, an archive, a folder, ...; nothing for a volume, a text and what is not
/// known.
std::optional<Error> something_else(const std::filesystem::path& file);

/// How read_volume() takes a file, whatever its values are like.
enum class ReadAs { kByContent, kLabels, kScan };
/// For the whole process, as set_placing().
void set_read_as(ReadAs kind);
ReadAs read_as();

/// What a volume holds, unless read_as() says it: labels where its header or a table beside it says so, or
/// where its values are whole, not negative and in patches.
/// @param names  as for read_labels; given, whole numbers are enough
/// Errors: also where the values leave open which it is.
Result<std::variant<ScanFile, LabelFile>> read_volume(const std::filesystem::path& file,
                                                      const std::optional<std::filesystem::path>& names = {},
                                                      const Progress& progress = {}, const Warn& warn = {},
                                                      Unpacked unpacked = Unpacked::kAnew,
                                                      std::optional<int> volume = {});

/// Reads any 3-D (or 2-D, as one slice) scalar volume as a scan.
Result<ScanFile> read_scan(const std::filesystem::path& file, const Progress& progress = {},
                           const Warn& warn = {}, Unpacked unpacked = Unpacked::kAnew,
                           std::optional<int> volume = {}, const Placing& placing = {});

/// Whether a scan's values are what labels are: by what its file says of them, else whole and in patches.
bool looks_like_labels(const ScanFile& file);
/// Whether labels are what a scan's values are: more than 64 that change from voxel to voxel, that mostly
/// stand in single voxels, or that change by small steps from every third voxel on.
bool looks_like_scan(const LabelMap& labels);

/// What becomes of labels that look like a scan (looks_like_scan) and that neither the file nor a table with
/// names for half of them says to be labels.
enum class Doubtful { kRefused, kWarnedOf };

/// Reads a segmentation. Voxel values must be whole and in 0 ... 65535. DICOM's images are none.
/// @param names  a table that names the labels, see read_label_names; without one, and when the file itself
///               names none, a table with the file's own name is used, else a single .ctbl or .tsv standing
///               in the same folder, where no other label map stands there and it names nine in ten values. A
///               single label that is named nowhere is called after the words of its file's name that are
///               known to be anatomy (structure_in_name). A given table that names none of the labels is an
///               error.
/// @param scan_grid  that of the scan, which the contours of a DICOM structure set are laid on; without one
/// such a file is
///                   an error. Surfaces are laid on it too, and without one on a grid of their own. Other
///                   label maps have theirs.
/// @param placing  what it leaves open is as placing() has it
/// @param scan     file of the scan, which is no other label map in the folder
Result<LabelFile> read_labels(const std::filesystem::path& file,
                              const std::optional<std::filesystem::path>& names = {},
                              const Progress& progress = {}, const Warn& warn = {},
                              Doubtful doubtful = Doubtful::kRefused, Unpacked unpacked = Unpacked::kAnew,
                              const GridGeometry* scan_grid = nullptr, const Placing& placing = {},
                              const std::optional<std::filesystem::path>& scan = {});

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
/// The same columns between commas or semicolons, a field perhaps in quotation marks; 3D Slicer's
/// "LabelValue" and "Color_R" mean the same.
Result<std::vector<NamedLabel>> parse_label_csv(std::string_view text, const std::string& source);
/// Parses ITK-SNAP's label descriptions: value r g b opacity visible mesh "name".
Result<std::vector<NamedLabel>> parse_snap_labels(std::string_view text, const std::string& source);
/// Parses {"1": "femur"} or {"femur": 1}, by itself, under "labels" or as the one table of a task
/// (TotalSegmentator, nnU-Net, MONAI); lists of segments as dcmqi and 3D Slicer write them; 3D Slicer's
/// terminologies where their types have numbers.
Result<std::vector<NamedLabel>> parse_label_json(std::string_view text, const std::string& source);
/// Reads any of them by its ending: .ctbl, .txt and .lut (FreeSurfer's) are colour tables or, where the first
/// line says so, ITK-SNAP's; .label is ITK-SNAP's; .tsv; .csv; .json.
Result<std::vector<NamedLabel>> read_label_names(const std::filesystem::path& file);

/// What of a file's name may name a structure without naming a patient: the words in it that are known to be
/// anatomy (those of the tissue presets, TotalSegmentator and FreeSurfer), as "femur_left" of
/// "doe_femur_left"; empty where there are none.
std::string structure_in_name(std::string_view text);

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
