#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/haptics/haptics.h"
#include "palpate/sampling/surface.h"

namespace palpate {

/// How far a place is from a structure's surface, however far that is. Near the surface it is the surface's
/// own distance (Surface::distance_mm). Beyond its reach it is the distance to the nearest of the places in
/// which the surface cuts the edges of its grid, which is at most sqrt(d^2 + s^2 / 2) - d too much where
/// the surface is flat, d the distance and s the greatest edge: 0.03 mm for 4 mm and voxels of 0.7 mm.
/// Immutable; a query allocates nothing.
class StructureDistance {
 public:
  StructureDistance(LabelId label, std::shared_ptr<const Surface> surface);

  LabelId label() const { return label_; }
  /// mm, positive outside, negative inside. @param at  finite
  double distance_mm(const Point<Patient>& at) const;
  /// Up to here, on either side, it is the surface's own. Farther out it changes by no more than the place
  /// moves.
  double near_mm() const { return near_mm_; }

 private:
  // places that lie together, with the least box around them
  struct Block {
    Eigen::Array3d low, high;
    std::uint32_t first = 0, count = 0;
    double squared_mm2(const Eigen::Array3d& at) const;
  };
  double to_places_mm(const Eigen::Vector3d& at) const;

  LabelId label_;
  std::shared_ptr<const Surface> surface_;
  double near_mm_;
  std::vector<Block> blocks_;
  std::vector<Eigen::Vector3f> places_;
};

/// Of every structure that has a voxel, in the order of Model::segments, as it is when nothing was taken from
/// it: the surface that the model has of it, else one that is prepared here.
/// @param model  with its labels
/// Errors: those of prepare_surfaces.
Result<std::vector<StructureDistance>> structure_distances(const Model& model, const Progress& progress = {});

}  // namespace palpate
