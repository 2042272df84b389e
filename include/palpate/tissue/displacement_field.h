#pragma once

#include <vector>

#include "palpate/geometry/geometry.h"
#include "palpate/tissue/elastic_layout.h"

namespace palpate {

/// Displacement field of tissue from the nodes of a box of cells, for display. Immutable; any thread.
class DisplacementField {
 public:
  /// @param displacement_mm  displacements of the box's nodes, i fastest, patient mm along the box's axes
  /// @param empty            nodes without tissue around them: the field is continued into them from adjacent
  ///                         tissue with decreasing magnitude, so that a dent appears as a dent in an image
  /// @param fade_cells       distance in cells over which displacements at the box's border fade out beyond
  ///                         it; above 0
  DisplacementField(const ElasticBox& box, std::vector<Eigen::Vector3f> displacement_mm,
                    const std::vector<bool>& empty, double fade_cells);

  const ElasticBox& box() const { return box_; }
  /// Index of a node, and its displacement along the box's axes.
  static std::size_t node(const ElasticBox& box, int i, int j, int k) {
    return (static_cast<std::size_t>(k) * (box.cells[1] + 1) + j) * (box.cells[0] + 1) + i;
  }
  const Eigen::Vector3f& at(int i, int j, int k) const { return displacement_mm_[node(box_, i, j, k)]; }
  /// Adds the displacement of the material that rests at `at_rest`, patient mm; linear between nodes.
  void add_displacement(const Point<Patient>& at_rest, Vector<Patient>& to_mm) const;

 private:
  void extrapolate_into_empty_nodes(const std::vector<bool>& empty);

  ElasticBox box_;
  double fade_cells_;
  std::vector<Eigen::Vector3f> displacement_mm_;
};

}  // namespace palpate
