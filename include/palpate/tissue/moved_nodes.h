#pragma once

#include <vector>

#include "palpate/geometry/geometry.h"
#include "palpate/tissue/elastic_grid.h"

namespace palpate {

/// How far tissue has gone that lay at the nodes of a box of cells, as a field over the patient, for
/// pictures. Immutable; any thread.
class MovedNodes {
 public:
  /// @param moved_mm  of the box's nodes, i fastest, patient, mm, along the box's axes
  /// @param empty     nodes around which nothing is: they go along with the tissue beside them, less and
  ///                  less, so that a dent is a dent in a picture
  /// @param fade_cells  beyond the box what moved at its border fades out over so many cells; above 0
  MovedNodes(const ElasticBox& box, std::vector<Eigen::Vector3f> moved_mm, const std::vector<bool>& empty,
             double fade_cells);

  const ElasticBox& box() const { return box_; }
  /// The number of a node, and how far it has gone, along the box's axes.
  static std::size_t node(const ElasticBox& box, int i, int j, int k) {
    return (static_cast<std::size_t>(k) * (box.cells[1] + 1) + j) * (box.cells[0] + 1) + i;
  }
  const Eigen::Vector3f& at(int i, int j, int k) const { return moved_mm_[node(box_, i, j, k)]; }
  /// Adds how far what lies at a place at rest has gone, patient, mm: between nodes linear.
  void add_moved(const Point<Patient>& at_rest, Vector<Patient>& to_mm) const;

 private:
  void continue_into_what_is_empty(const std::vector<bool>& empty);

  ElasticBox box_;
  double fade_cells_;
  std::vector<Eigen::Vector3f> moved_mm_;
};

}  // namespace palpate
