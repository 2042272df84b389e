#pragma once

#include <vector>

#include "palpate/device/telemetry.h"
#include "palpate/haptics/haptics.h"
#include "palpate/tissue/elastic_grid.h"
#include "palpate/tissue/moved_nodes.h"

namespace palpate {

/// Where soft tissue has gone under the tools of one tick, and how it is strained there, for pictures: each
/// device's own place and force as the tick tells them, linear elasticity solved to its end, and what several
/// tools do added up. It knows nothing of ticks before, of friction along the surface, and of tissue farther
/// away than a box of cells (SolvingFeel::cells_along). By TissueLaw::kChainMail a chain mail that is dented
/// once and has relaxed for a second. Immutable; any thread.
class YieldedTissue {
 public:
  /// At rest.
  YieldedTissue() = default;
  /// @param model  labels, tissues and tools; surfaces are not needed. Where no tissue yields, all is at rest
  YieldedTissue(const Model& model, const TickRecord& felt);

  bool rests() const { return parts_.empty(); }
  /// How far what lies at a place at rest has gone, patient, mm: between nodes linear. What is empty goes
  /// along with the tissue beside it, less and less, so that a dent is a dent in a picture; beyond the box it
  /// fades out over kFadeCells.
  Vector<Patient> moved_mm(const Point<Patient>& at_rest) const;
  /// Equivalent strain of what lies at a place at rest: of Almansi's strain e = (1 - F^-T F^-1) / 2 what is
  /// left without the change of volume, sqrt(2/3 e':e'), as the page shows it. Not a number where it is not
  /// known: in what is empty and beyond the box.
  double strain(const Point<Patient>& at_rest) const;

  static constexpr int kFadeCells = 6;

 private:
  void solve(const Model& model, const TickRecord& felt);
  void move(const Model& model, const TickRecord& felt);

  /// What one device's tool moves.
  class Part {
   public:
    /// @param unit_mm  of the grid's nodes under 1 N, or of a chain mail with 1 for the force
    Part(const ElasticGrid& grid, const ElasticField& unit_mm, double force_N);
    const MovedNodes& moved() const { return moved_; }
    /// du / dx in the patient. @returns whether it is known
    bool add_slope(const Point<Patient>& at_rest, Eigen::Matrix3d& to) const;

   private:
    std::size_t cell(int i, int j, int k) const {
      return (static_cast<std::size_t>(k) * moved_.box().cells[1] + j) * moved_.box().cells[0] + i;
    }
    void find_slopes(const ElasticGrid& grid);

    MovedNodes moved_;
    std::vector<Eigen::Matrix3f> slope_;  ///< in the middle of cells, along the box's axes
    std::vector<bool> is_tissue_;         ///< of cells
  };
  std::vector<Part> parts_;
};

}  // namespace palpate
