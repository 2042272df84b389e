#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"
#include "palpate/volume_io/label_tables.h"
#include "palpate/volume_io/placement_options.h"
#include "palpate/volume_io/studies.h"
#include "palpate/volume_io/write_volume.h"

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

}  // namespace palpate
