#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "palpate/contact/haptics.h"
#include "palpate/contact/yield.h"
#include "palpate/device/telemetry.h"
#include "palpate/tissue/elastic_grid.h"
#include "palpate/tissue/feel.h"

/// Solver for soft tissue around the tools, which runs concurrently with the servo: from the tools' state in
/// one tick to the tissue parameters of later ticks.
namespace palpate {

/// Time between two solutions, s.
inline constexpr double kYieldFrame_s = kYieldFeel.blend_s;
/// Number of ticks between two solutions at a tick rate; at least 1.
std::uint64_t ticks_of_yield_frame(double rate_hz);

/// Edge of the cells on which a model's soft tissue is solved, mm: Model::tissue_cell_mm, or twice the
/// smallest voxel spacing within 0.8 ... 3 mm; times Model::tissue_coarsened.
double yield_cell_mm(const Model& model);

/// Displacement of soft tissue around a tool, mm per N of its force.
struct YieldField {
  const ElasticBox* box;
  const ElasticLayout* layout;
  const ElasticField* unit_mm;
};

/// Position of a device's box of cells: its first cell, in the lattice over the whole volume, and the surface
/// point for which it was placed.
struct YieldBox {
  std::array<int, 3> first_cell{0, 0, 0};
  Point<Patient> about;
  bool operator==(const YieldBox&) const = default;
};
/// Box in which a solver will solve for a device after a tick, without solving: the current one, or a new one
/// if the tool will press too far from its middle.
/// @param before  current box; empty: none, or one of other labels
std::optional<YieldBox> next_yield_box(const Model& model, const DeviceTick& felt,
                                       const std::optional<YieldBox>& before);

/// Solves a box of cells around each device's contact point, present or expected, by linear elasticity
/// (ElasticSolver) and, under the neo-Hookean law, also as a neo-Hookean body. The result depends only on the
/// sequence of models and ticks passed to it: not on time, threads or the machine. Not thread-safe.
class YieldSolver {
 public:
  YieldSolver();
  ~YieldSolver();

  /// Solves the next frame, numbered from 1. A device's spot is unknown if its tool is far from all surfaces
  /// or not in contact with soft tissue, or its pose is invalid.
  /// @param model  with deformable tissues (Model::tissue_law) and surfaces for the proxy. Boxes are reused
  ///               while labels and materials stay the same
  /// @param felt   the latest known tick
  const ComplianceFrame& solve(const Model& model, const TickRecord& felt);
  const ComplianceFrame& frame() const { return frame_; }

  /// Continues as a solver that has produced `frame` frames and has these boxes, to obtain a frame without
  /// all those before it. The next solve treats the boxes as new; within one or two frames the result equals
  /// that of the original (docs/concepts/tissue.md, "Playback").
  /// @param boxes  of the devices from 0 on; empty: none
  void go_on(const Model& model, std::uint32_t frame, std::span<const std::optional<YieldBox>> boxes);

  /// Continues as a solver that has produced `frame` frames, the last of which knows no spot, and has no
  /// boxes: after an exception, which leaves the solver in no particular state.
  void restart(std::uint32_t frame) noexcept;

  /// Displacement field of the last frame; returns false if there is no box. Valid until the next frame.
  bool field_of(std::size_t device, YieldField& field) const;
  /// Force that displaces the tissue in a tick, N: the contact force or, for relaxing tissue, the
  /// instantaneous force for its depth, because the dent persists while the force decays.
  double displacing_force_N(std::size_t device, const DeviceTick& felt) const;

 private:
  struct NeoHookeanBody;
  struct Region;

  ComplianceFrame frame_;
  std::array<std::unique_ptr<Region>, kMaxDevices> regions_;
};

/// Solves on a virtual clock with the timing of a thread on the real one: from the tick with which a frame
/// begins, for the ticks from the next frame on.
class VirtualClockYieldSolver {
 public:
  explicit VirtualClockYieldSolver(double rate_hz) : ticks_(ticks_of_yield_frame(rate_hz)) {}
  /// Must be called before every tick.
  /// @param before  the previous tick; null if there was none
  /// @returns whether frame() is new
  bool advance(const Model& model, const TickRecord* before);
  /// Replaces advance() while no tissue is deformable: publishes the last solution, so that none is pending
  /// when tissue becomes deformable again.
  bool rest();
  /// Input of the next tick.
  const ComplianceFrame& frame() const { return frame_; }
  std::uint64_t input_tick() const { return input_tick_; }  ///< Tick that frame() was solved from

 private:
  const std::uint64_t ticks_;
  YieldSolver solver_;
  ComplianceFrame frame_;
  std::uint64_t solved_from_ = 0, input_tick_ = 0;
};

}  // namespace palpate
