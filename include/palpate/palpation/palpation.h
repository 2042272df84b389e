#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/haptics/haptics.h"
#include "palpate/loading/loading.h"
#include "palpate/recording/recording.h"
#include "palpate/scene/scene.h"

/// A script becomes a run, and a recording is run again.
namespace palpate {

/// A point on a structure that a hand can reach and press: with the most free space in front, among
/// flat places, found from labels and field.
struct SurfacePoint {
  /// Where a smoothed field is half of the structure's own level, and ramps what they are half a voxel below
  /// their beginning.
  Point<Patient> point;
  Vector<Patient> normal;   ///< outward, unit
  double clearance_mm = 0;  ///< free way along the normal
};
Result<SurfacePoint> find_surface_point(const Model& model, LabelId structure, double clearance_mm);

/// The text of a script that suits a model: every bone and cartilage of a knee, else the largest felt
/// structures.
std::string default_script_text(const Model& model);

struct SimulationOptions {
  std::optional<double> max_force_N;  ///< user limit; default the lesser of continuous rating and 3 N
  std::optional<std::uint64_t> seed;
  std::optional<double> rate_hz;
  std::optional<ForceMethod> method;  ///< at first; default the scene's
  RecordedTask task = {};             ///< that the recording says it is a run of
};

/// A force counts as held within this part of what was asked for.
inline constexpr double kHeldWithin = 0.2;

/// How one structure of the script was held.
struct HoldFigure {
  std::string structure;
  LabelId label = 0;
  /// Longest time without a break in which that structure was touched with a force within kHeldWithin of one
  /// that a press of the script asks for there; where none does, with any force.
  double held_s = 0;
  double mean_force_N = 0;
  double peak_force_N = 0;
};

class NearestMeter;
class RemovedVolume;

/// What a burr took of a structure.
struct RemovedFigure {
  std::string structure;
  LabelId label = 0;
  double volume_mm3 = 0;  ///< RemovedVolume
};

/// How near a burr came to a structure that the scene protects.
struct ProtectedFigure {
  std::string structure;
  LabelId label = 0;
  bool kept = false;
  /// Of the ball from the structure as prepared (NearestMeter). Empty: it came nowhere near.
  std::optional<double> nearest_mm;
  double removed_mm3 = 0;
};
/// By label.
std::vector<RemovedFigure> removed_figures(const Model& model, const RemovedVolume& removed);
std::vector<ProtectedFigure> protected_figures(const Model& model, const RemovedVolume& removed,
                                               const NearestMeter& meter);

/// Where an approach touched the structure that it asked for.
struct TouchFigure {
  int line = 0;           ///< of the script
  std::string structure;  ///< its name, and the segments in which it is nested
  LabelId label = 0;
  Point<Patient> point;
};

struct SimulationResult {
  RecordingSummary summary;
  std::vector<TouchFigure> touches;  ///< in the order of the approaches that touched
  std::vector<HoldFigure> holds;
  std::vector<RemovedFigure> removed;
  std::vector<ProtectedFigure> spared;  ///< of every structure that the scene protects
  std::size_t failed_steps = 0;
  double max_force_N = 0;  ///< largest force sent
  double limit_N = 0;
  std::vector<std::string>
      trouble;  ///< what is known not to be reached, and steps that failed, in words without a file's name
};

/// Runs a script against a model with the simulated hand on the virtual clock, into a recording file
/// (may be empty: none). A step that fails is no error: the run goes on with the next approach. Interrupted,
/// the recording is finished and reopens.
Result<SimulationResult> simulate(const LoadedScene& loaded, const Script& script,
                                  const SimulationOptions& options, const std::filesystem::path& recording,
                                  const Progress& progress = {});

/// What burrs have left at the end of a recording.
struct LabelsLeft {
  LabelMap labels;  ///< on the model's grid; felt voxels are gone where their centres were swept
  std::vector<RemovedFigure> removed;
};
/// @param model   as the recording began with
/// @param layers  labels that the model was made from, on its grid, of which overlapping segments stay whole;
///                null: the labels left have one layer, the model's
/// Errors: those of replay.
Result<LabelsLeft> labels_left(const RecordingSource& recording, const Model& model,
                               const LabelMap* layers = nullptr, const Progress& progress = {});

struct ReplayResult {
  std::uint64_t ticks = 0;
  std::uint64_t run_hash = 0;
  bool identical = false;
  std::optional<std::uint64_t> first_difference;  ///< tick
  std::string difference;                         ///< in words
};
/// Runs every recorded input again through the tick and compares every output, bit for bit, and the state
/// hash.
/// @param model  is prepared for the methods that were felt where it is not
/// Errors: kBadInput for another scene's recording, or of a model or method that is not known here; those of
/// reading it.
Result<ReplayResult> replay(const RecordingSource& recording, std::shared_ptr<const Model> model,
                            const Progress& progress = {});

}  // namespace palpate
