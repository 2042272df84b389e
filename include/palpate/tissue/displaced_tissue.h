#pragma once

#include <vector>

#include "palpate/contact/model.h"
#include "palpate/device/telemetry.h"
#include "palpate/tissue/displacement_field.h"
#include "palpate/tissue/elastic_grid.h"

namespace palpate {

/// Displacement and strain of soft tissue under the tools in one tick, for display: each device's contact and
/// force in the tick, linear elasticity solved to convergence, summed over the tools. It ignores earlier
/// ticks, friction along the surface, and tissue outside the box of cells (SolverSettings::cells_along).
/// Under TissueLaw::kChainMail it is a chain mail that is dented once and relaxed for a second. Immutable;
/// any thread.
class DisplacedTissue {
 public:
  /// Everything at rest.
  DisplacedTissue() = default;
  /// @param model  labels, tissues and tools; surfaces are not needed. Without deformable tissue everything
  ///               is at rest
  DisplacedTissue(const Model& model, const TickRecord& tick);

  bool is_at_rest() const { return parts_.empty(); }
  /// Displacement of the material that rests at a point, patient mm; linear between nodes. Empty space
  /// follows adjacent tissue with decreasing magnitude, so that a dent appears as a dent in an image; beyond
  /// the box it fades out over kFadeCells.
  Vector<Patient> displacement_mm(const Point<Patient>& at_rest) const;
  /// Equivalent strain at the rest position of the material: the deviatoric part of Almansi's strain e = (1 -
  /// F^-T F^-1) / 2 as sqrt(2/3 e':e'), as displayed by the page. NaN where it is unknown: in empty space and
  /// beyond the box.
  double strain(const Point<Patient>& at_rest) const;

  static constexpr int kFadeCells = 6;

 private:
  void solve(const Model& model, const TickRecord& tick);
  void move(const Model& model, const TickRecord& tick);

  /// Displacement by one device's tool.
  class Part {
   public:
    /// @param unit_mm  displacements of the grid's nodes under 1 N, or of a chain mail with force_N 1
    Part(const ElasticGrid& grid, const ElasticField& unit_mm, double force_N);
    const DisplacementField& moved() const { return moved_; }
    /// Adds du / dx in the patient. @returns whether it is known
    bool add_slope(const Point<Patient>& at_rest, Eigen::Matrix3d& to) const;

   private:
    std::size_t cell(int i, int j, int k) const {
      return (static_cast<std::size_t>(k) * moved_.box().cells[1] + j) * moved_.box().cells[0] + i;
    }
    void compute_gradients(const ElasticGrid& grid);

    DisplacementField moved_;
    std::vector<Eigen::Matrix3f> slope_;  ///< At the cells' centres, along the box's axes
    std::vector<bool> is_tissue_;         ///< By cell
  };
  std::vector<Part> parts_;
};

}  // namespace palpate
