#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/contact/elastic_constants.h"
#include "palpate/geometry/geometry.h"
#include "palpate/tissue/elastic_layout.h"
#include "palpate/volume/bricks.h"

/// Soft tissue as cubic cells: their material and the constraints of their nodes. docs/concepts/tissue.md has
/// the equations.
namespace palpate {

/// Kind of material.
enum class Matter : std::uint8_t {
  kNone,   ///< Air, or other matter without stiffness
  kSoft,   ///< Deformable
  kRigid,  ///< Bone; soft tissue is bonded to it
};

/// Material at a point.
struct ElasticMaterial {
  Matter matter = Matter::kNone;
  double youngs_modulus_kPa = 0;  ///< If soft: in kElasticModulusRange
  double poissons_ratio = 0.45;   ///< If soft: 0 ... kMaxPoissonsRatio
  double stiffening = 0;          ///< If soft: ElasticConstants::stiffening, 0 ... kMaxStiffening
  bool operator==(const ElasticMaterial&) const = default;
};
/// Errors: kBadInput, with the remedy, if a property is out of range.
Result<void> check_elastic_material(const ElasticMaterial& material);

/// Homogenised material of a cell.
struct ElasticCell {
  Matter matter = Matter::kNone;
  float fill = 0;            ///< Solid fraction; 0 if empty
  float mu = 0, lambda = 0;  ///< Lame's moduli of the whole cell, N/mm2; 0 unless it is soft
  float stiffening = 0;  ///< ElasticConstants::stiffening, mean over the soft samples; 0 unless it is soft
  bool operator==(const ElasticCell&) const = default;
};
/// Intermediate state of a cell between two materials: its fill changes by at most `max_change`, while its
/// solid matter has the moduli of `from`, or of `to` if that is soft. Changes to and from rigid material are
/// immediate.
ElasticCell step_towards(const ElasticCell& from, const ElasticCell& to, double max_change);

/// Cells, their material, and the constraints of their nodes.
///
/// A cell's moduli are those of its solid matter laid in layers: 1/mu and 1/(lambda + 2 mu) are averaged over
/// the solid samples, with 0 for rigid matter, and both moduli are scaled by the solid fraction. This is
/// exact for layers compressed normally, even with an interface inside a cell (Backus 1962). Air enters only
/// through the fraction.
///
/// Nodes of a rigid cell are constrained. Nodes adjacent to no solid cell are excluded from the system and
/// have no displacement. A floating component of the tissue (whose cells share no faces with a cell whose
/// nodes are constrained or rest on springs) is constrained in place.
class ElasticGrid {
 public:
  /// Material at a point; called from one thread, in a fixed order.
  using MaterialAt = std::function<ElasticMaterial(const Point<Patient>&)>;

  /// Samples each cell. A cell whose corners and centre have the same material is assumed to be uniform, so
  /// smaller features may be missed.
  /// @param samples  samples of any other cell along each axis, evenly spaced, 1 ... 16
  ElasticGrid(const ElasticBox& box, const MaterialAt& material, int samples);

  /// Cells over labels, along the labels' own axes. A cell has the materials of the voxels that it covers,
  /// weighted by volume; beyond the grid it is empty.
  /// @param by_label  material per label; label 0 and labels beyond its end are air
  /// @param box       from elastic_box_of() or elsewhere; intended for cells of 1 to 3 times the smallest
  ///                  voxel spacing
  /// @param removed   removed fraction of every voxel, 0 ... 255 (Carving::removed_fraction); null: none
  /// Errors: kBadInput for an invalid material, a cell size not above 0, or a box without cells.
  static Result<ElasticGrid> of_labels(const Bricks<LabelId>& labels,
                                       std::span<const ElasticMaterial> by_label, const ElasticBox& box,
                                       const Bricks<std::uint8_t>* removed = nullptr);

  /// Replaces some cells in place, with the constraints of their nodes and the springs there; the result is
  /// the same as constructing all of them. Constraints that constrain() added to their nodes are removed.
  /// Does not allocate.
  /// @param made  returns the new material of a cell; called once for each in a fixed order
  /// @returns whether the set of soft cells or of constrained nodes has changed
  bool set_cells(const CellBox& cells, const std::function<ElasticCell(int, int, int)>& made);

  const ElasticBox& box() const { return box_; }
  const ElasticLayout& layout() const { return layout_; }
  CellBox all_cells() const { return {{0, 0, 0}, layout_.cells}; }
  ElasticCell cell(int i, int j, int k) const;
  /// Lame's moduli by the layout's cells, N/mm2.
  const ElasticValues& mu() const { return mu_; }
  const ElasticValues& lambda() const { return lambda_; }
  /// ElasticConstants::stiffening by the layout's cells. Only finite deformation depends on it.
  const ElasticValues& stiffening() const { return stiffening_; }
  /// Solid fraction of each cell, 0 ... 1.
  const ElasticValues& fill() const { return fill_; }
  /// Number of soft cells.
  std::size_t soft_cells() const;

  /// Bits for the constrained components of a node, along the box's axes.
  static constexpr std::uint8_t kFixedX = 1, kFixedY = 2, kFixedZ = 4, kFixed = 7;
  /// The node touches no solid cell.
  static constexpr std::uint8_t kNoNode = 8;
  std::uint8_t constraint(int i, int j, int k) const { return constraints_[node_number(i, j, k)]; }
  /// Constrains components of a node; their displacement is prescribed by the caller of the solver.
  void constrain(int i, int j, int k, std::uint8_t components) {
    constraints_[node_number(i, j, k)] |= components;
  }
  /// Releases components of a node.
  void release(int i, int j, int k, std::uint8_t components) {
    constraints_[node_number(i, j, k)] &= static_cast<std::uint8_t>(~components);
  }

  /// Declares on which faces of the box (low x, high x, low y, ...) tissue continues beyond it. Nodes there
  /// rest on springs k = 3 / (3 - 2 nu) mu A cos(theta) / r for the node's area A, with r and theta the
  /// distance and the angle to the face's normal of the vector from the expected load at `about`; along the
  /// face's normal, twice that. This reproduces the ratio of stress to displacement directly below a load on
  /// a half space (Boussinesq 1885), and approximates it elsewhere.
  void set_boundary_springs(const std::array<bool, 6>& faces, const Point<Patient>& about);
  /// Spring constants by nodal value of the layout, N/mm.
  const ElasticValues& springs() const { return springs_; }

  /// Constrains, in place, every component that is not connected to a constrained node or a spring. Returns
  /// the number of its cells. Called by the constructors of the solvers.
  std::size_t constrain_floating_components();
  /// Same as constrain_floating_components(), applied to a copy of the constraints, by node_number().
  class FloatingComponents {
   public:
    std::size_t constrain(const ElasticGrid& grid, std::vector<std::uint8_t>& constraints);

   private:
    std::vector<bool> visited_;
    std::vector<std::array<int, 3>> component_;
  };
  const std::vector<std::uint8_t>& constraints() const { return constraints_; }

  std::size_t node_number(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * (layout_.cells[1] + 1) + j) * layout_.row + i;
  }

 private:
  explicit ElasticGrid(const ElasticBox& box);
  bool set_nodes(const CellBox& cells);
  void set_springs(const CellBox& cells);

  ElasticBox box_;
  ElasticLayout layout_;
  ElasticValues mu_, lambda_, stiffening_, fill_, springs_;
  std::vector<std::uint8_t> constraints_;  ///< By node_number()
  std::array<bool, 6> spring_faces_{};     ///< Faces given to set_boundary_springs()
  Eigen::Vector3d load_point_mm_ = Eigen::Vector3d::Zero();
};

}  // namespace palpate
