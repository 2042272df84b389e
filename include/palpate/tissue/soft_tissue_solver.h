#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "palpate/contact/model.h"
#include "palpate/contact/soft_contact.h"
#include "palpate/device/telemetry.h"
#include "palpate/tissue/elastic_grid.h"
#include "palpate/tissue/tissue_settings.h"

/// Solver for soft tissue around the tools, which runs concurrently with the servo. Each frame takes the
/// tools' state in one tick and yields the local compliances that later ticks use.
namespace palpate {

/// Period of the solver's frames, s.
inline constexpr double kSolverFrame_s = kSoftTissueSettings.blend_s;
/// Number of ticks per solver frame, rounded; at least 1.
std::uint64_t ticks_of_solver_frame(double rate_hz);

/// Default edge length of the cells on which soft tissue is solved, mm: the smallest that the time budget of
/// a frame permits (SolverSettings::box_radii). For a finite-strain law, whose box has fewer cells,
/// max_cell_voxels voxels.
/// @param voxel_mm  smallest voxel spacing; above 0
/// @param tools     all tools of the model; the largest radius of any part is used
double default_solver_cell_mm(TissueLaw law, double voxel_mm, std::span<const Tool> tools);
/// Edge length of a model's cells, mm: Model::tissue_cell_mm or, if that is 0, the default; multiplied by
/// Model::tissue_cell_factor.
double solver_cell_mm(const Model& model);
/// Minimum diameter, in cells, at which a stiff nodule is resolved; smaller nodules are rendered with reduced
/// contrast.
inline constexpr double kResolvedNoduleCells = 5;

/// Displacement field of soft tissue around a tool, mm per N of the tool's force.
struct UnitDisplacementField {
  const ElasticBox* box;
  const ElasticLayout* layout;
  const ElasticField* unit_mm;
};

/// Position of a device's box of cells: index of its first cell in the lattice over the whole volume, and the
/// surface point for which it was placed.
struct SolverBox {
  std::array<int, 3> first_cell{0, 0, 0};
  Point<Patient> about;
  bool operator==(const SolverBox&) const = default;
};
/// Box that the solver will use for a device after a tick, without solving: the current one, or a new one if
/// the predicted contact is too far from its middle (SolverSettings::max_offset_cells). If no contact is
/// predicted, the current one.
/// @param device  tick from which the contact is predicted
/// @param before  current box; empty: none, or one made from other labels
std::optional<SolverBox> next_solver_box(const Model& model, const DeviceTick& device,
                                         const std::optional<SolverBox>& before);

/// Solves a box of cells around each device's current or predicted contact point: by linear elasticity
/// (ElasticSolver) and, under a neo-Hookean law, also as a neo-Hookean body. Deterministic: the result
/// depends only on the sequence of models and ticks passed to it, not on timing, threads or the machine. Not
/// thread-safe.
class SoftTissueSolver {
 public:
  SoftTissueSolver();
  ~SoftTissueSolver();

  /// Solves the next frame; the first is number 1. A device's LocalCompliance is unknown if its position or
  /// velocity is not finite, no surface is within SolverSettings::reach_mm of its tool, or there is no soft
  /// tissue at the predicted contact.
  /// @param model  with deformable tissues (Model::tissue_law) and surfaces for the proxy. Boxes are reused
  ///               as long as labels, materials, tissue law and relaxation stay the same
  /// @param tick   most recent tick
  const ComplianceFrame& solve(const Model& model, const TickRecord& tick);
  /// Begins the next frame, which step() solves with the result of solve(). The previous one is complete.
  /// frame() has the new frame's number at once, and its local compliances once the frame is complete.
  /// @param model  outlives the frame
  void begin_frame(const Model& model, const TickRecord& tick);
  /// Advances the frame begun last by one step, which takes about as long as one iteration of its linear
  /// solution (ElasticSolver::iterate()) at most; under a neo-Hookean law, the last step of a device is the
  /// whole finite-strain solution.
  /// @returns whether the frame is complete
  bool step();
  /// Last frame solved; number 0: none yet.
  const ComplianceFrame& frame() const { return frame_; }

  /// Resumes as if `frame` frames had been solved, the last of them in these boxes: seeks in a recording
  /// without solving all earlier frames. The next solve treats the boxes as new. Three frames after it,
  /// displacements differ from those of the original sequence by at most 0.07 % of the largest one, as
  /// measured (docs/concepts/tissue.md, "Playback").
  /// @param boxes  boxes of the devices, from device 0 on; an empty entry: no box
  void resume(const Model& model, std::uint32_t frame, std::span<const std::optional<SolverBox>> boxes);

  /// Resumes as if `frame` frames had been solved, without boxes and with every local compliance
  /// unknown. For use after solve() or resume() has thrown, which leaves the solver in an unspecified state.
  void restart(std::uint32_t frame) noexcept;

  /// Displacement field of the linear solution in the last frame. Valid until the next frame.
  /// @returns false if the device has no box or its local compliance is unknown; `field` is then unchanged
  bool field_of(std::size_t device, UnitDisplacementField& field) const;
  /// Force by which the displacement field is scaled in a tick, N: the contact force or, in relaxing tissue,
  /// the instantaneous (unrelaxed) force at the tool's depth, because the force decays while the displacement
  /// persists.
  double displacing_force_N(std::size_t device, const DeviceTick& device_tick) const;

 private:
  struct NeoHookeanBody;
  struct Region;
  struct FrameInProgress;
  bool place_region(FrameInProgress& now);
  bool begin_patch_solve(FrameInProgress& now);
  void finish_patch_solve(FrameInProgress& now);

  ComplianceFrame frame_;
  std::unique_ptr<FrameInProgress> in_progress_;
  std::array<std::unique_ptr<Region>, kMaxDevices> regions_;
};

/// Solver on a virtual clock, with the latency of the solver thread: a solution is computed from the tick at
/// which a frame begins and published at the beginning of the next frame.
class VirtualClockSoftTissueSolver {
 public:
  explicit VirtualClockSoftTissueSolver(double rate_hz) : ticks_(ticks_of_solver_frame(rate_hz)) {}
  /// Call before every tick; while no tissue is deformable, call publish_pending() instead.
  /// @param before  previous tick; null if there was none
  /// @returns whether frame() has changed
  bool advance(const Model& model, const TickRecord* before);
  /// Replaces advance() while no tissue is deformable. Publishes a pending solution immediately, so that no
  /// stale one is published when tissue becomes deformable again.
  /// @returns whether frame() has changed
  bool publish_pending();
  /// Last frame published: input of the next tick.
  const ComplianceFrame& frame() const { return frame_; }
  std::uint64_t input_tick() const { return input_tick_; }  ///< Tick from which frame() was solved

 private:
  const std::uint64_t ticks_;
  SoftTissueSolver solver_;
  ComplianceFrame frame_;
  std::uint64_t solved_from_ = 0, input_tick_ = 0;
};

}  // namespace palpate
