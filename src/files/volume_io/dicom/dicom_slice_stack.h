#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "volume_io/dicom/dicom_fault.h"
#include "volume_io/dicom/dicom_volumes.h"

/// Slice positions of a DICOM volume. Plain data, as dicom_volumes.h.
namespace palpate::volume_io {

/// Remedy for a volume that lacks slices or is a part of one.
inline constexpr const char* kWholeSeries = "export the complete series again, and give its folder";

/// Slices of a volume as a grid, which requires even spacing along the normal and at most a regular shift in
/// the plane.
class SliceStack {
 public:
  /// @param frames  placed images in the order of their positions along the normal, of one orientation and
  ///                spacing; not empty; must outlive this object
  explicit SliceStack(const std::vector<DicomFrame>& frames);

  /// Why the slices form no grid, naming a slice: an unusable image, a single slice, a duplicated, missing,
  /// unevenly spaced or irregularly shifted one, or an implausible tilt.
  std::optional<Fault> find_fault() const;
  /// Resolved contradictions between the files, one sentence each.
  /// @pre find_fault() returns nullopt
  std::vector<std::string> find_notes() const;
  /// Grid of the slices, sheared if the gantry was tilted.
  /// @pre find_fault() returns nullopt
  GridGeometry geometry() const;

 private:
  std::string slice(std::size_t n) const;
  double gap_mm(std::size_t n) const;  // between slices n and n + 1
  double mean_gap_mm() const;
  std::optional<Fault> find_duplicate() const;
  std::optional<Fault> find_uneven_spacing() const;
  std::optional<Fault> find_lateral_shift() const;
  // in-plane offset from the normal through the first slice; mm
  Eigen::Vector3d lateral(std::size_t n) const;
  // in-plane shift per distance along the normal; its length is the tangent of the gantry tilt
  Eigen::Vector3d tilt() const;

  const std::vector<DicomFrame>& frames_;
  Eigen::Vector3d normal_;
  std::vector<double> positions_mm_;
};

}  // namespace palpate::volume_io
