#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/loading/loading.h"
#include "palpate/recording/recording.h"
#include "palpate/recording/recording_source.h"
#include "palpate/scene/script.h"
#include "palpate/volume/label_map.h"

/// Runs scripts, and replays recordings.
namespace palpate {

/// Surface point that a hand can reach and press: at a flat place with much free space in front, determined
/// from labels and field.
struct SurfacePoint {
  /// Point at which a smoothed field equals half of the structure's level, or a ramp its value half a voxel
  /// inside its beginning.
  Point<Patient> point;
  Vector<Patient> normal;   ///< Outward unit normal
  double clearance_mm = 0;  ///< Free distance along the normal
};
/// Best surface point of a structure.
/// @param clearance_mm  desired free distance along the normal
/// Errors: kBadInput for a structure without contact, and if no surface of it can be touched.
Result<SurfacePoint> find_surface_point(const Model& model, LabelId structure, double clearance_mm);

/// Options of a run; empty values: the script's or the scene's.
struct SimulationOptions {
  /// The user's force limit; default: the lesser of continuous rating and 3 N
  std::optional<double> max_force_N;
  std::optional<std::uint64_t> seed;
  std::optional<double> rate_hz;
  std::optional<ForceMethod> method;                    ///< Initial method; default: the scene's
  RecordedTask task = {};                               ///< Task that the recording declares
  std::function<void(const TickRecord&)> on_tick = {};  ///< Called with every tick in order; may be empty
};

/// Relative tolerance within which a force counts as held.
inline constexpr double kHoldTolerance = 0.2;

/// How one structure of the script was held.
struct HoldFigure {
  std::string structure;
  LabelId label = 0;
  /// Longest uninterrupted contact with that structure at a force within kHoldTolerance of one that a press
  /// step requests there; if none does, at any force.
  double held_s = 0;
  double mean_force_N = 0;
  double peak_force_N = 0;
};

class ProtectedDistanceMeter;
class RemovedVolume;

/// Volume that burrs removed from a structure.
struct RemovedFigure {
  std::string structure;
  LabelId label = 0;
  double volume_mm3 = 0;  ///< Removed volume, as RemovedVolume computes it
};

/// Smallest distance between a burr and a protected structure.
struct ProtectedFigure {
  std::string structure;
  LabelId label = 0;
  bool within_limit = false;
  /// Distance of the burr's head from the structure as prepared (ProtectedDistanceMeter). Empty: never near.
  std::optional<double> nearest_mm;
  double removed_mm3 = 0;
};
/// Figures, ascending by label.
std::vector<RemovedFigure> removed_figures(const Model& model, const RemovedVolume& removed);
std::vector<ProtectedFigure> protected_figures(const Model& model, const RemovedVolume& removed,
                                               const ProtectedDistanceMeter& meter);

/// Contact point of an approach with its structure.
struct TouchFigure {
  int line = 0;           ///< Line of the script
  std::string structure;  ///< Its name, followed by the structures that enclose it
  LabelId label = 0;
  Point<Patient> point;
};

/// Result of simulate().
struct SimulationResult {
  RecordingSummary summary;
  std::vector<TouchFigure> touches;  ///< In the order of the approaches that made contact
  std::vector<HoldFigure> holds;
  std::vector<RemovedFigure> removed;
  double broken_off_mm3 = 0;                          ///< RemovedVolume::broken_off_mm3
  std::vector<ProtectedFigure> protected_structures;  ///< For every structure that the scene protects
  std::size_t failed_steps = 0;
  double max_force_N = 0;  ///< Largest commanded force
  double limit_N = 0;
  /// Limits known to be unreachable, and failed steps, in words without file names
  std::vector<std::string> problems;
};

/// Runs a script with the simulated hand on the virtual clock and writes a recording (empty path: none).
/// Without a script it runs the default one (set_up_run). A failed step is not an error: the run continues
/// with the next approach. If interrupted, the recording is closed and stays readable.
Result<SimulationResult> simulate(const LoadedScene& loaded, const std::optional<Script>& script,
                                  const SimulationOptions& options, const std::filesystem::path& recording,
                                  const Progress& progress = {});

/// Labels at the end of a recording.
struct RemainingLabels {
  LabelMap labels;  ///< On the model's grid; a voxel with contact is removed if its centre was swept
  std::vector<RemovedFigure> removed;
};
/// Applies the burrs' cuts of a recording to labels.
/// @param model   at the beginning of the recording
/// @param layers  labels from which the model was made, on its grid, so that overlapping segments are
///                preserved; null: the result has one layer, the model's
/// Errors: those of replay.
Result<RemainingLabels> remaining_labels(const RecordingSource& recording, const Model& model,
                                         const LabelMap* layers = nullptr, const Progress& progress = {});

/// Result of replay().
struct ReplayResult {
  std::uint64_t ticks = 0;
  std::uint64_t run_hash = 0;
  bool identical = false;
  std::optional<std::uint64_t> first_difference;  ///< Tick
  std::string difference;                         ///< Description
};
/// Runs every recorded input through the tick again and compares every output bitwise, and the state hash.
/// @param model  is prepared for the methods used, if necessary
/// Errors: kBadInput for a recording of another scene, or of an unknown model version or method; those of
/// reading it.
Result<ReplayResult> replay(const RecordingSource& recording, std::shared_ptr<const Model> model,
                            const Progress& progress = {});

}  // namespace palpate
