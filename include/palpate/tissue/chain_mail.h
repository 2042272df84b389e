#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/device/telemetry.h"
#include "palpate/tissue/elastic_grid.h"

/// Deformation of tissue by 3D ChainMail, for display only. It computes no forces; the force is that of
/// TissueLaw::kLayers.
namespace palpate {

/// Contact of a tool with a surface, and the dent that it makes.
struct Dent {
  Point<Patient> at;        ///< Contact point on the surface
  Vector<Patient> outward;  ///< Unit outward normal of the surface there
  double depth_mm = 0;      ///< Depth of the tool's deepest point below it; 0 or less: no dent
  double radius_mm = 0;     ///< Radius of the tool's sphere
};
/// Dent of a device's tool in deformable tissue (Model::moves_visibly), from a tick. Returns false without
/// such a contact.
bool find_dent(const Model& model, const TickRecord& tick, std::size_t device, Dent& dent);

/// 3D ChainMail (S. Gibson, "3D ChainMail: a fast algorithm for deforming volumetric objects", Symposium on
/// Interactive 3D Graphics 1997). The nodes of cells are links. Two neighbours along an axis satisfy,
/// in cell edges,
///
///     kMinStretch <= spacing along the axis <= kMaxStretch,     |offset along the others| <= kShear
///
/// The tool moves its nodes, the deepest first. Each moved node pulls its neighbours by the least
/// displacement that restores the bounds, these pull theirs, first in, first out, each at most once per move.
/// Then every node moves to the mean displacement of its neighbours, as far as the bounds allow: the
/// published relaxation, which spreads a deformation and restores the rest state after release.
///
/// Nodes fixed by the grid (bone) and on the box's faces do not move; bounds between them and the tool are
/// violated if there is not enough space. All soft tissue behaves alike, regardless of stiffness.
/// Bit-identical on all machines; not thread-safe.
class ChainMail {
 public:
  static constexpr double kMinStretch = 0.5, kMaxStretch = 1.5, kShear = 0.5;

  /// Starts at rest.
  explicit ChainMail(const ElasticGrid& grid);

  /// Makes a dent: nodes near the surface move below the tool, the others follow. The nodes that the tool
  /// moved stay constrained until the next dent.
  void press(const Dent& dent);
  /// Releases the nodes constrained by the tool.
  void release();
  /// Relaxes all nodes `passes` times.
  void relax(int passes);
  /// Copies the displacements of nodes shared with another instance.
  /// @param offset  added to a node's index here gives its index in `other`
  void copy_overlap(const ChainMail& other, const std::array<int, 3>& offset);

  /// Displacements of all nodes along the box's axes, mm.
  const ElasticField& displacement_mm() const { return displacement_mm_; }
  const ElasticBox& box() const { return box_; }
  const ElasticLayout& layout() const { return layout_; }
  double max_displacement_mm() const;

 private:
  struct Bounds;
  struct Link {
    std::int16_t i, j, k, by;  ///< Node, and the neighbour that pulls it, 0 ... 5
  };
  enum State : std::uint8_t { kFree, kFixed, kByTool, kNone };

  std::size_t number(int i, int j, int k) const;
  Bounds bounds_of(int i, int j, int k, int neighbour) const;
  void pull();
  void queue_neighbours(int i, int j, int k);

  ElasticBox box_;
  ElasticLayout layout_;
  ElasticField displacement_mm_;
  std::vector<State> state_;            ///< By node
  std::vector<std::uint32_t> visited_;  ///< By node: number of the last move that pulled it
  std::uint32_t move_ = 0;
  std::vector<Link> queue_;
};

/// A ChainMail box around each device's tool, which follows the tool.
class ChainMailTissue {
 public:
  ChainMailTissue();
  ~ChainMailTissue();

  /// Advances by one frame after a tick.
  /// @param model  with labels, tissues and surfaces
  void advance(const Model& model, const TickRecord& tick);
  /// Deformation around a device's tool; null: everything is at rest.
  const ChainMail* of(std::size_t device) const;

 private:
  struct Region;
  std::array<std::unique_ptr<Region>, kMaxDevices> regions_;
};

}  // namespace palpate
