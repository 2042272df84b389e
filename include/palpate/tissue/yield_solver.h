#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "palpate/device/telemetry.h"
#include "palpate/haptics/haptics.h"
#include "palpate/haptics/yield.h"
#include "palpate/tissue/elastic_grid.h"
#include "palpate/tissue/feel.h"

/// Soft tissue around the tools, solved beside the servo: from what a tick told of the tools to what the next
/// ticks are told of the tissue under them.
namespace palpate {

/// Seconds from one solution to the next.
inline constexpr double kYieldFrame_s = kYieldFeel.blend_s;
/// Ticks from one solution to the next at a rate; at least 1.
std::uint64_t ticks_of_yield_frame(double rate_hz);

/// Edge of the cells that a model's soft tissue is solved on, mm: its own, or two of the smallest voxel
/// spacing, within 0.8 to 3 mm; times Model::tissue_coarsened.
double yield_cell_mm(const Model& model);

/// How soft tissue is displaced around a tool, mm for 1 N of it.
struct YieldField {
  const ElasticBox* box;
  const ElasticLayout* layout;
  const ElasticField* unit_mm;
};

/// Where a device's box of cells lies: its first cell, in cells of one lattice over the whole volume, and the
/// place on the surface for which it was laid.
struct YieldBox {
  std::array<int, 3> first_cell{0, 0, 0};
  Point<Patient> about;
  bool operator==(const YieldBox&) const = default;
};
/// The box in which a solver solves for a device after a tick, without solving: the one that it has, a new
/// one where the tool will press too far off its middle.
/// @param before  that it has; nothing: none, or one of other labels
std::optional<YieldBox> next_yield_box(const Model& model, const DeviceTick& felt,
                                       const std::optional<YieldBox>& before);

/// For every device a box of cells around the place that it presses or is about to (linear elasticity,
/// ElasticSolver), under the neo-Hookean law also as such a body. What it gives depends on the models and
/// ticks that it was given, in their order, and on nothing else: not on time, threads or the machine. For one
/// thread.
class YieldSolver {
 public:
  YieldSolver();
  ~YieldSolver();

  /// The next frame, numbered from 1. A device's spot is not known where its tool is far from all surfaces,
  /// leans on nothing soft, or its pose is none.
  /// @param model  whose tissues yield (Model::tissue_law), with surfaces for the proxy. With the labels and
  ///               materials of the one before, what was laid is kept
  /// @param felt   a tick, the latest that is known
  const YieldFrame& solve(const Model& model, const TickRecord& felt);
  const YieldFrame& frame() const { return frame_; }

  /// Goes on as a solver that has given so many frames and has these boxes, for who wants a frame without all
  /// those before it. What is solved next is solved as in boxes that have just been laid; so a frame or two
  /// later it is what it would have been (docs/concepts/tissue.md, "Looked at again").
  /// @param boxes  of the devices from 0 on; nothing: none
  void go_on(const Model& model, std::uint32_t frame, std::span<const std::optional<YieldBox>> boxes);

  /// Of the last frame; nothing where there is no box. Valid until the next.
  bool field_of(std::size_t device, YieldField& field) const;
  /// By so many newtons that is displaced as a tick had it: its contact's force; where tissue relaxes, what
  /// its depth takes at once, for the dent stays while the force falls.
  double displacing_N(std::size_t device, const DeviceTick& felt) const;

 private:
  struct Finite;
  struct Region;

  YieldFrame frame_;
  std::array<std::unique_ptr<Region>, kMaxDevices> regions_;
};

/// Solves on a virtual clock as a thread does on a real one: from the tick with which a frame begins, for the
/// ticks from the next frame on.
class YieldsOnVirtualClock {
 public:
  explicit YieldsOnVirtualClock(double rate_hz) : ticks_(ticks_of_yield_frame(rate_hz)) {}
  /// To be called before every tick. @param before  the tick before; nothing where there was none
  /// @returns whether frame() is a new one
  bool advance(const Model& model, const TickRecord* before);
  /// In place of advance() where nothing yields: what was solved last is told, so that nothing of it is left
  /// for when something yields again.
  bool rest();
  /// That the next tick is to be told.
  const YieldFrame& frame() const { return frame_; }
  std::uint64_t input_tick() const { return input_tick_; }  ///< that it was solved from

 private:
  const std::uint64_t ticks_;
  YieldSolver solver_;
  YieldFrame frame_;
  std::uint64_t solved_from_ = 0, input_tick_ = 0;
};

}  // namespace palpate
