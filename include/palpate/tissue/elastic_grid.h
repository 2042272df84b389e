#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <new>
#include <span>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/geometry/geometry.h"
#include "palpate/haptics/elastic_constants.h"
#include "palpate/volume/bricks.h"

/// Soft tissue as cubes that yield: what they are made of, what holds them. docs/concepts/tissue.md has the
/// equations.
namespace palpate {

enum class Matter : std::uint8_t {
  kNone,   ///< air, or whatever gives no resistance
  kSoft,   ///< yields
  kRigid,  ///< bone: what is soft holds fast to it
};

/// What a place is made of.
struct ElasticMaterial {
  Matter matter = Matter::kNone;
  double youngs_modulus_kPa = 0;  ///< of what is soft, in kElasticModulusRange
  double poissons_ratio = 0.45;   ///< 0 ... kMostPoissonsRatio
  bool operator==(const ElasticMaterial&) const = default;
};
/// What is wrong with it, and how to mend it; nothing where it is right.
Result<void> check_elastic_material(const ElasticMaterial& material);

/// A box of cubic cells in the patient.
struct ElasticBox {
  Point<Patient> corner;                               ///< of the first cell, its outermost
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  ///< columns: its axes, orthonormal; may be left-handed
  double cell_mm = 1;
  std::array<int, 3> cells{0, 0, 0};

  /// Its own coordinates: mm from the corner along its axes.
  Eigen::Vector3d local_mm(const Point<Patient>& p) const { return axes.transpose() * (p - corner).eigen(); }
  Point<Patient> patient(const Eigen::Vector3d& local_mm) const {
    return corner + Vector<Patient>(axes * local_mm);
  }
};

/// The box over a region of voxels: its axes are the grid's, where those are not at right angles the nearest
/// that are.
ElasticBox elastic_box_of(const GridGeometry& grid, const VoxelBox& region, double cell_mm);

/// Some of a box's cells: low ... high - 1 along each axis. Its nodes are low ... high.
struct CellBox {
  std::array<int, 3> low{0, 0, 0}, high{0, 0, 0};

  bool empty() const { return low[0] >= high[0] || low[1] >= high[1] || low[2] >= high[2]; }
  bool contains_node(int i, int j, int k) const {
    return i >= low[0] && j >= low[1] && k >= low[2] && i <= high[0] && j <= high[1] && k <= high[2];
  }
  /// The least box that holds both.
  CellBox joined(const CellBox& other) const;
  CellBox grown(int by) const;
  /// What of it lies in a box of so many cells.
  CellBox clipped(const std::array<int, 3>& cells) const;
};

/// What a cell is made of.
struct ElasticCell {
  Matter matter = Matter::kNone;
  float fill = 0;            ///< part of it that is solid; 0 of what is none
  float mu = 0, lambda = 0;  ///< Lame's moduli of all of it, N/mm2; 0 unless it is soft
  bool operator==(const ElasticCell&) const = default;
};
/// On the way from what a cell is to what it is to be: its fill changes by no more than `most_change`, its
/// solid matter keeps the moduli that it has, or is to have where it is to be soft. To and from what is rigid
/// there is no way.
ElasticCell toward(const ElasticCell& from, const ElasticCell& to, double most_change);

/// Floats at a multiple of 64 bytes, so that a whole vector is one line of the cache.
template <class T>
struct CacheLineAllocator {
  using value_type = T;
  CacheLineAllocator() = default;
  template <class U>
  CacheLineAllocator(const CacheLineAllocator<U>&) {}
  T* allocate(std::size_t n) { return static_cast<T*>(::operator new(n * sizeof(T), std::align_val_t(64))); }
  void deallocate(T* p, std::size_t) { ::operator delete(p, std::align_val_t(64)); }
  bool operator==(const CacheLineAllocator&) const { return true; }
};
using ElasticValues = std::vector<float, CacheLineAllocator<float>>;

/// Where the values of nodes and cells stand. Nodes are the cells' corners, one more than cells along an
/// axis:
///
///     node row (j, k)    x x x ...  y y y ...  z z z ...      3 * row floats, row = cells[0] + 1 and more
///     cell row (j, k)    c c c ...                            row floats
///
/// A row is as long as a whole number of the longest vectors. What stands in it beyond the last node or cell
/// is 0, as are kSpare floats after the last row.
struct ElasticLayout {
  static constexpr int kLanes = 16;
  static constexpr std::size_t kSpare = kLanes;

  ElasticLayout() = default;
  explicit ElasticLayout(const std::array<int, 3>& cells_along)
      : cells(cells_along), row((cells_along[0] + kLanes) / kLanes * kLanes) {}

  std::size_t node(int i, int j, int k, int component) const {
    return (3 * (static_cast<std::size_t>(k) * (cells[1] + 1) + j) + component) * row + i;
  }
  std::size_t cell(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * cells[1] + j) * row + i;
  }
  std::size_t node_values() const { return node(0, 0, cells[2] + 1, 0); }
  std::size_t cell_values() const { return cell(0, 0, cells[2]); }
  bool contains_cell(int i, int j, int k) const {
    return i >= 0 && j >= 0 && k >= 0 && i < cells[0] && j < cells[1] && k < cells[2];
  }

  std::array<int, 3> cells{0, 0, 0};
  int row = 0;
};

/// Displacements (mm) or forces (N) of all nodes, along the box's axes.
struct ElasticField {
  ElasticField() = default;
  explicit ElasticField(const ElasticLayout& layout)
      : values(layout.node_values() + ElasticLayout::kSpare, 0.0f) {}
  ElasticValues values;
};

/// Cells, what they are made of, and what holds their nodes.
///
/// A cell's moduli are those of its matter laid in layers: 1/mu and 1/(lambda + 2 mu) are means over what is
/// solid in it, rigid matter yielding nothing, and both moduli count by the part that is solid. That is exact
/// for layers pressed across, also with a seam inside a cell (Backus 1962). Air counts by its part alone.
///
/// Nodes of a cell that is rigid are held. Nodes that touch nothing solid are none, and never move. A part of
/// the tissue that nothing holds (its cells share faces with no cell whose nodes are held or rest on springs)
/// is held where it is.
class ElasticGrid {
 public:
  /// What stands at a place; called from one thread, in a fixed order.
  using MaterialAt = std::function<ElasticMaterial(const Point<Patient>&)>;

  /// A cell whose corners and middle are of one material is of that; what is smaller than a cell may so be
  /// missed.
  /// @param samples  along each axis of any other cell, evenly, by whose places it is known: 1 ... 16
  ElasticGrid(const ElasticBox& box, const MaterialAt& material, int samples);

  /// Cells over labels, along the labels' own axes. A cell is made of what the voxels are that it covers, by
  /// their share of its volume; beyond the grid there is nothing.
  /// @param by_label  label 0 and those beyond its end are air
  /// @param box       as elastic_box_of() makes it, or elsewhere; cells of 1 to 3 of the smallest voxel
  /// spacing
  ///                  are meant
  /// @param taken     of every voxel what part is gone, of 255 (Carving::taken); null: nothing
  /// Errors: kBadInput for a material that none can be, a cell that is not above 0, or a box without cells.
  static Result<ElasticGrid> of_labels(const Bricks<LabelId>& labels,
                                       std::span<const ElasticMaterial> by_label, const ElasticBox& box,
                                       const Bricks<std::uint8_t>* taken = nullptr);

  /// Makes some cells anew, in place: what they are, what holds their nodes, and the springs there, as if all
  /// had been laid so. What hold() has held of their nodes is forgotten. Allocates nothing.
  /// @param made  what a cell is to be, asked once for each in one order
  /// @returns whether other cells yield than before, or something is held that was not, or no more
  bool set_cells(const CellBox& cells, const std::function<ElasticCell(int, int, int)>& made);

  const ElasticBox& box() const { return box_; }
  const ElasticLayout& layout() const { return layout_; }
  CellBox all_cells() const { return {{0, 0, 0}, layout_.cells}; }
  ElasticCell cell(int i, int j, int k) const;
  /// Lame's moduli by the layout's cells, N/mm2.
  const ElasticValues& mu() const { return mu_; }
  const ElasticValues& lambda() const { return lambda_; }
  /// Part of each cell that is solid, 0 ... 1.
  const ElasticValues& fill() const { return fill_; }
  /// Cells of which something yields.
  std::size_t soft_cells() const;

  /// Bits of what holds a node: its components along the box's axes.
  static constexpr std::uint8_t kHeldX = 1, kHeldY = 2, kHeldZ = 4, kHeld = 7;
  /// It touches nothing solid.
  static constexpr std::uint8_t kNoNode = 8;
  std::uint8_t held(int i, int j, int k) const { return held_[node_number(i, j, k)]; }
  /// Holds components of a node, which then have the displacement that a solver is given for them.
  void hold(int i, int j, int k, std::uint8_t components) { held_[node_number(i, j, k)] |= components; }
  /// Lets them go again.
  void release(int i, int j, int k, std::uint8_t components) {
    held_[node_number(i, j, k)] &= static_cast<std::uint8_t>(~components);
  }

  /// The faces of the box where tissue goes on beyond it: low x, high x, low y, ... There nodes rest on
  /// springs, k = 3 / (3 - 2 nu) mu A cos(theta) / r for the node's area A, with r and theta of the way from
  /// the load that is expected at `about`, and twice that along the face's normal. So stress and displacement
  /// stand to each other straight below a load on a half space (Boussinesq 1885); elsewhere it is near
  /// enough.
  void continue_beyond(const std::array<bool, 6>& faces, const Point<Patient>& about);
  /// Of the layout's nodes, N/mm.
  const ElasticValues& springs() const { return springs_; }

  /// Holds what is connected to nothing that holds it; the number of its cells. A solver does it.
  std::size_t hold_loose_parts();
  /// The same in a copy of what is held, by node_number.
  class LooseParts {
   public:
    std::size_t hold(const ElasticGrid& grid, std::vector<std::uint8_t>& held);

   private:
    std::vector<bool> seen_;
    std::vector<std::array<int, 3>> part_;
  };
  const std::vector<std::uint8_t>& held() const { return held_; }

  std::size_t node_number(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * (layout_.cells[1] + 1) + j) * layout_.row + i;
  }

 private:
  explicit ElasticGrid(const ElasticBox& box);
  bool set_nodes(const CellBox& cells);
  void set_springs(const CellBox& cells);

  ElasticBox box_;
  ElasticLayout layout_;
  ElasticValues mu_, lambda_, fill_, springs_;
  std::vector<std::uint8_t> held_;  ///< by node_number
  std::array<bool, 6> beyond_{};    ///< continue_beyond
  Eigen::Vector3d about_mm_ = Eigen::Vector3d::Zero();
};

}  // namespace palpate
