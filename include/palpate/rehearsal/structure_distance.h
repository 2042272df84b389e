#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/sampling/surface.h"

namespace palpate {

/// Signed distance to a structure's surface at any range. Near the surface it is the surface's own distance
/// (Surface::distance_mm). Beyond the reach of its distance field it is the distance to the nearest
/// intersection of the surface with a grid edge, which overestimates by at most sqrt(d^2 + s^2 / 2) - d for a
/// flat surface, with the distance d and the longest edge s: 0.03 mm at 4 mm with voxels of 0.7 mm.
/// Immutable; queries do not allocate.
class StructureDistance {
 public:
  StructureDistance(LabelId label, std::shared_ptr<const Surface> surface);

  LabelId label() const { return label_; }
  /// Signed distance in mm, positive outside.
  /// @param at  finite
  double distance_mm(const Point<Patient>& at) const;
  /// Absolute distance up to which the surface's own distance field is used. Beyond it the result is
  /// Lipschitz continuous with constant 1.
  double near_mm() const { return near_mm_; }

 private:
  // adjacent intersection points with their bounding box
  struct Block {
    Eigen::Array3d low, high;
    std::uint32_t first = 0, count = 0;
    double squared_mm2(const Eigen::Array3d& at) const;
  };
  double to_edge_cuts_mm(const Eigen::Vector3d& at) const;

  LabelId label_;
  std::shared_ptr<const Surface> surface_;
  double near_mm_;
  std::vector<Block> blocks_;
  std::vector<Eigen::Vector3f> edge_points_;
};

/// Distances of every structure that has a voxel, in the order of Model::segments, before any removal. Uses
/// the model's surface if present, and otherwise prepares one.
/// @param model  a model with labels
/// @param only   structures by LabelId; empty: all
/// Errors: those of prepare_surfaces.
Result<std::vector<StructureDistance>> structure_distances(const Model& model, const Progress& progress = {},
                                                           const std::vector<bool>& only = {});

}  // namespace palpate
