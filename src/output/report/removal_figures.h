#pragma once

#include <array>
#include <cstddef>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/device/model_change.h"
#include "palpate/recording/recording.h"
#include "palpate/tissue/protected_distance.h"
#include "palpate/tissue/removed_volume.h"
#include "report/decimate.h"
#include "report/timed_ticks.h"

/// Tissue removed by burrs in a run: volume of each structure, time and depth.
namespace palpate::report {

/// Removal of one structure. Tissue counts as removed from the first tick that used the surfaces without it,
/// some 10 to 40 ms after the sweep of the burr.
struct StructureRemoval {
  LabelId label = 0;
  /// Volume by RemovedVolume; the only figure here that excludes undone strokes
  double volume_mm3 = 0;
  double fraction = 0;  ///< Fraction of the structure at the start of the run, 0 ... 1
  /// On the run's clock: first and last tick in which the removed volume increased
  double first_s = 0, last_s = 0;
  /// Maximum cutting depth, mm: how far the far side of the burr's ball got below the structure's surface as
  /// prepared while removing tissue of the structure. It is the maximum of radius - signed distance over
  /// points of the sweeps' axes at most 0.1 mm apart, for sweeps that removed new tissue. The surface is the
  /// structure's own or, if it has none, the common surface with structures that it touches. In a structure
  /// thinner than the ball the far side may be beyond the structure. NaN: the model has no such surface.
  double depth_mm = kGap;
};

/// Removed volumes from a tick on.
struct RemovalStep {
  double time_s = 0;
  /// In the order of RemovalFigures::structures; only those cut so far.
  std::vector<double> volumes_mm3;
};

/// A structure that burrs should spare.
struct SparedStructure {
  LabelId label = 0;
  bool is_protected = false;  ///< Whether burrs were blocked from it; otherwise it can be cut
  double nearest_mm = kGap;   ///< Closest approach (ProtectedDistanceMeter); NaN: not within its range
};

/// A change of the removed tissue.
struct RemovalChange {
  double time_s = 0;
  std::vector<Cut> cuts;               ///< Cuts; empty if a stroke was undone or redone
  std::optional<StrokeAction> stroke;  ///< Undo or redo of a stroke
};

struct RemovalFigures {
  std::vector<SparedStructure> spared;       ///< In the model's order
  std::vector<StructureRemoval> structures;  ///< In the order of the first cut
  std::vector<RemovalStep> steps;            ///< Ascending in time
  std::vector<RemovalChange> changes;        ///< Ascending in time
  std::size_t strokes = 0;  ///< Number of strokes, i.e. motor runs in which something was cut
  std::size_t undone = 0;   ///< Number of strokes undone at the end of the run
  /// Duration for which the motor was requested, by its switch or the pedal that the model names. It includes
  /// times without force, while the motor stands still.
  double motor_s = 0;

  /// Total volume of all structures, mm3.
  double volume_mm3() const;
  /// Volume of a structure removed at each of some ascending times, mm3.
  std::vector<double> removed_mm3(std::size_t structure, std::span<const double> times_s) const;
};

/// Computes RemovalFigures from a recording. Memory is proportional to the swept voxels and the number of cut
/// model versions.
class RemovalMeter {
 public:
  /// @param model  model before any removal; has to outlive the meter. Depths require the surfaces of the
  ///               proxy (prepared_with_cache)
  explicit RemovalMeter(const Model& model);
  /// Events in their order, before the first tick that follows them. Ignored for a model without labels.
  void on_event(std::span<const RecordingEvent> events);
  void observe(const TimedTick& now);
  /// Call after the last tick. Sweeps without a cut model version are ignored.
  RemovalFigures finish();

 private:
  struct Structure {
    std::size_t voxels = 0;
    std::array<int, 3> first{};  // indices of its first voxel
  };
  void on_event(const RecordingEvent& event, double time_s);
  void change_stroke(const ModelChange& change);
  void remove_voxels(double time_s);
  void remove_voxels(const Cut& cut, double time_s);
  void count_voxels();
  double all_mm3(LabelId label) const;
  void add_step(double time_s);

  const Model& model_;
  RemovedVolume removed_;
  ProtectedDistanceMeter nearest_;
  StrokeHistory<std::size_t> strokes_;         // stroke numbers in their order
  std::map<LabelId, double> volumes_mm3_;      // current
  std::deque<RecordingEvent> pending_events_;  // sweeps and cuts that precede the next tick
  std::vector<Cut> pending_cuts_;              // sweeps for the next cut version
  std::vector<Structure> structure_;           // by label; empty until something is cut
  std::vector<const Surface*> surface_;        // in the order of figures_.structures; null: none
  RemovalFigures figures_;
};

/// The model with the remaining labels at a time, for pictures; without surfaces. Null: nothing was removed
/// by then.
/// @param changes  RemovalFigures::changes
std::shared_ptr<const Model> model_after_removal(const Model& model, std::span<const RemovalChange> changes,
                                                 double time_s);

/// Depth of a point below a surface, mm; negative above it. Within reach of the distance field it is the
/// negated signed distance. Deeper it is the shortest of 256 straight paths out, which is never too small,
/// and at most 2 % too large below a flat surface.
double depth_below_mm(const Surface& surface, const Point<Patient>& x);

}  // namespace palpate::report
