#pragma once

#include <optional>

#include "palpate/geometry/geometry.h"

/// Position of volumes and surfaces in the patient where their files leave it open or contradict themselves.
namespace palpate {

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

}  // namespace palpate
