#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "palpate/device/telemetry.h"
#include "palpate/haptics/haptics.h"
#include "palpate/tissue/elastic_grid.h"

/// Tissue that moves as a chain mail does, for what it looks like. It knows no forces: those are the layers'.
namespace palpate {

/// Where a tool leans on a surface, and its dent in that at rest.
struct Dent {
  Point<Patient> at;        ///< place on the surface
  Vector<Patient> outward;  ///< of the surface there, unit
  double depth_mm = 0;      ///< of the tool's foremost point below it; not above 0: it moves nothing
  double radius_mm = 0;     ///< of the tool's sphere
};
/// Of a device's tool in what moves (Model::moves), as a tick tells it; false where it leans on nothing of
/// that.
bool find_dent(const Model& model, const TickRecord& felt, std::size_t device, Dent& dent);

/// 3D ChainMail (S. Gibson, "3D ChainMail: a fast algorithm for deforming volumetric objects", Symposium on
/// Interactive 3D Graphics 1997). Nodes of cells are links: of two neighbours along an axis
///
///     kLeast <= way along the axis <= kMost,     |way along the others| <= kShear       (edges of a cell)
///
/// A node that the tool moves pulls its neighbours as little as puts that right, these theirs, first in,
/// first out, each at most once; then the tool moves the next one, the deepest first. Then each node goes to
/// where its neighbours would have it (the mean of their displacements), as far as all of these bounds let
/// it: the published relaxation, by which tissue spreads what moved it and comes back when it is let go.
///
/// Nodes that the grid holds (bone) and those of the box's faces stay, and bounds that lead from them to what
/// the tool moves break where there is no room. All soft tissue is alike to it, however stiff. The same bits
/// everywhere; for one thread.
class ChainMail {
 public:
  static constexpr double kLeast = 0.5, kMost = 1.5, kShear = 0.5;

  /// At rest.
  explicit ChainMail(const ElasticGrid& grid);

  /// The tool makes a dent: nodes beside the surface go below the tool, the others follow. The nodes that the
  /// tool moved are held until the next dent.
  void press(const Dent& dent);
  void let_go();
  /// So many times over all nodes.
  void relax(int passes);
  /// Where another mail's nodes are these nodes too, they are moved as there.
  /// @param offset  from the number of one of these nodes to that of the other
  void take_over(const ChainMail& other, const std::array<int, 3>& offset);

  /// Displacements of all nodes, along the box's axes.
  const ElasticField& moved_mm() const { return moved_mm_; }
  const ElasticBox& box() const { return box_; }
  const ElasticLayout& layout() const { return layout_; }
  double most_moved_mm() const;

 private:
  struct Bounds;
  struct Link {
    std::int16_t i, j, k, by;  ///< by: the neighbour that pulls, 0 ... 5
  };
  enum State : std::uint8_t { kFree, kFixed, kByTool, kNone };

  std::size_t number(int i, int j, int k) const;
  Bounds bounds_of(int i, int j, int k, int neighbour) const;
  void pull();
  void queue_neighbours(int i, int j, int k);

  ElasticBox box_;
  ElasticLayout layout_;
  ElasticField moved_mm_;
  std::vector<State> state_;         ///< by node
  std::vector<std::uint32_t> seen_;  ///< by node: in which move it was pulled last
  std::uint32_t move_ = 0;
  std::vector<Link> queue_;
};

/// A chain mail around each device's tool, which follows it.
class ChainMailTissue {
 public:
  ChainMailTissue();
  ~ChainMailTissue();

  /// A frame after a tick. @param model  with labels, tissues and surfaces
  void advance(const Model& model, const TickRecord& felt);
  /// The mail around a device's tool; null: all is at rest.
  const ChainMail* of(std::size_t device) const;

 private:
  struct Region;
  std::array<std::unique_ptr<Region>, kMaxDevices> regions_;
};

}  // namespace palpate
