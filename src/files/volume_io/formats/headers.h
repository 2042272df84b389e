#pragma once

#include <Eigen/Core>
#include <array>
#include <string_view>

#include "volume_io/voxel_source.h"

/// Parsers of the headers of NRRD, MetaImage and NIfTI, without ITK: sizes, type and location of the voxels,
/// and their place in the patient, which equals to the last bit what ITK 5.2 reads (header_geometry_test.cc).
/// The bytes are untrusted. `source` names them in errors.
namespace palpate::volume_io {

/// Maximum size of a header at the beginning of a file; bytes.
constexpr std::size_t kMaxHeaderBytes = std::size_t{1} << 24;

/// Key and text of 3D Slicer's segment fields, such as "Segment0_Name".
using SegmentFieldPairs = std::vector<std::pair<std::string, std::string>>;

/// Place of a volume's first three axes in the patient, LPS; axes that it lacks keep these values.
struct HeaderGeometry {
  Eigen::Vector3d spacing_mm = Eigen::Vector3d::Ones(), origin_mm = Eigen::Vector3d::Zero();
  Eigen::Matrix3d direction = Eigen::Matrix3d::Identity();  ///< Column a: direction of axis a.
};
/// Grid of a header's geometry, validated by checked().
Result<GridGeometry> grid_of(const HeaderGeometry& geometry, const std::array<int, 3>& dims,
                             const std::string& source);

/// See http://teem.sourceforge.net/nrrd/format.html.
struct NrrdHeader {
  std::vector<std::int64_t> axes;  ///< Sizes, without the layer axis.
  int layers = 1;
  bool layers_first = true;
  bool has_layer_axis = false;  ///< There is a layer axis, possibly of a single layer.
  std::string data_file;        ///< Empty: the voxels follow the header.
  int line_skip = 0;
  bool has_geometry = false;
  HeaderGeometry geometry;
  VoxelSource voxels;  ///< Without the file; its offset is the end of the header.
  SegmentFieldPairs segment_fields;
};
Result<NrrdHeader> parse_nrrd_header(std::string_view bytes, const std::string& source);

/// See https://itk.org/Wiki/ITK/MetaIO/Documentation.
struct MetaImageHeader {
  std::vector<std::int64_t> axes;
  std::string data_file;  ///< Empty: the voxels follow the header.
  bool has_geometry = false;
  HeaderGeometry geometry;
  VoxelSource voxels;  ///< Without the file; its offset is the end of the header.
};
Result<MetaImageHeader> parse_metaimage_header(std::string_view bytes, const std::string& source);

/// NIfTI-1 and NIfTI-2, see https://nifti.nimh.nih.gov.
struct NiftiHeader {
  std::vector<std::int64_t> axes;
  bool has_geometry = false;
  bool has_detached_data = false;  ///< The voxels are in a file of their own (.img).
  /// Voxel index to RAS mm: the sform, or the qform if that is requested; in a NIfTI-2 without an sform, from
  /// its qform or voxel sizes. Unset: a NIfTI-1 without an sform, whose place is `geometry`.
  std::optional<Eigen::Matrix<double, 3, 4>> affine;
  HeaderGeometry geometry;  ///< If there is no `affine`: by the qform or the voxel sizes, in 32 bits as ITK.
  /// The transform that is not used, if the file has both and none was requested.
  std::optional<Eigen::Matrix<double, 3, 4>> other_affine;
  ValueMeaning meaning = ValueMeaning::kUnspecified;  ///< By its intent code.
  VoxelSource voxels;                                 ///< Its `skip` is the offset of the voxels.
  std::size_t header_bytes = 0;                       ///< Size without the extensions; bytes.
  bool swapped = false;                               ///< Byte order differs from that of this machine.
};
constexpr std::size_t kMaxNiftiHeaderBytes = 540;
/// @param form  transform to use if there are both; unset: the sform
Result<NiftiHeader> parse_nifti_header(std::string_view bytes, const std::string& source,
                                       std::optional<NiftiForm> form = {});

/// CaretExtension of Connectome Workbench among the extensions that follow a NIfTI header; empty if there is
/// none.
/// @param bytes  the file from its beginning to the voxels
std::string_view find_caret_extension(std::string_view bytes, std::size_t header_bytes, bool swap);
/// Label names of a CaretExtension (TotalSegmentator writes one with --ml) as Slicer's segment fields; empty
/// without a label table. See https://www.nitrc.org/projects/cifti, section "LabelTable".
Result<SegmentFieldPairs> parse_caret_labels(std::string_view xml, const std::string& source);

}  // namespace palpate::volume_io
