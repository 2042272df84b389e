#pragma once

#include <string_view>

#include "volume_io/voxel_source.h"

/// The headers of the three formats, parsed without ITK: sizes, type and place of the voxels, and
/// whatever of the geometry must be checked before a library that trusts its input looks at it. The bytes are
/// untrusted. `source` names them in errors.
namespace palpate::volume_io {

/// The most bytes at the front of a file that can be its header.
constexpr std::size_t kMostHeaderBytes = std::size_t{1} << 24;

/// Keys and texts of 3D Slicer's fields of segments, "Segment0_Name".
using SegmentFieldPairs = std::vector<std::pair<std::string, std::string>>;

/// http://teem.sourceforge.net/nrrd/format.html
struct NrrdHeader {
  std::vector<std::int64_t> axes;  ///< without the layer axis
  int layers = 1;
  bool layers_first = true;
  bool list_axis = false;  ///< there is a layer axis, be it of one layer
  std::string data_file;   ///< empty: the voxels follow the header
  int line_skip = 0;
  bool has_geometry = false;
  VoxelSource voxels;  ///< without its file; offset is where the header ends
  SegmentFieldPairs segment_fields;
};
Result<NrrdHeader> parse_nrrd_header(std::string_view bytes, const std::string& source);

/// https://itk.org/Wiki/ITK/MetaIO/Documentation
struct MetaImageHeader {
  std::vector<std::int64_t> axes;
  std::string data_file;  ///< empty: the voxels follow the header
  bool has_geometry = false;
  VoxelSource voxels;  ///< as above
};
Result<MetaImageHeader> parse_metaimage_header(std::string_view bytes, const std::string& source);

/// NIfTI-1 and NIfTI-2: https://nifti.nimh.nih.gov
struct NiftiHeader {
  std::vector<std::int64_t> axes;
  bool has_geometry = false;
  bool separate = false;  ///< the voxels stand in a file of their own (.img)
  /// Voxel index to RAS mm: the sform, or the qform where that is asked for; without one, of NIfTI-2, what
  /// qform or voxel sizes give.
  std::optional<Eigen::Matrix<double, 3, 4>> affine;
  /// The placement that was not taken, where the file has both and none was asked for.
  std::optional<Eigen::Matrix<double, 3, 4>> other_affine;
  ValueMeaning meaning = ValueMeaning::kUnsaid;  ///< by its intent code
  VoxelSource voxels;                            ///< skip is the place of the voxels
  std::size_t header_bytes = 0;                  ///< before the extensions
  bool swapped = false;                          ///< in the other byte order than this machine's
};
constexpr std::size_t kMostNiftiHeaderBytes = 540;
/// @param form  which placement counts where there are both; none: the sform
Result<NiftiHeader> parse_nifti_header(std::string_view bytes, const std::string& source,
                                       std::optional<NiftiForm> form = {});

/// The CaretExtension of Connectome Workbench among the extensions behind a NIfTI header; empty: there is
/// none.
/// @param bytes  of the file from its beginning, up to the voxels
std::string_view find_caret_extension(std::string_view bytes, std::size_t header_bytes, bool swap);
/// Names of labels in a CaretExtension (TotalSegmentator writes one with --ml) as fields of Slicer's
/// segments; none where it has no label table. https://www.nitrc.org/projects/cifti, section "LabelTable"
Result<SegmentFieldPairs> parse_caret_labels(std::string_view xml, const std::string& source);

}  // namespace palpate::volume_io
