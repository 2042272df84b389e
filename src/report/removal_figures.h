#pragma once

#include <array>
#include <cstddef>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/recording/recording.h"
#include "palpate/tissue/nearest.h"
#include "palpate/tissue/removed_volume.h"
#include "report/decimate.h"
#include "report/timed_ticks.h"

/// What a burr took away in a run: how much of each structure, when, and how deep.
namespace palpate::report {

/// What a burr took of a structure. Something counts as gone from the tick on that first felt the surfaces
/// without it, which is some 10 to 40 ms after the burr swept it.
struct StructureRemoval {
  LabelId label = 0;
  double volume_mm3 = 0;           ///< RemovedVolume; without what was undone, alone of all these
  double part = 0;                 ///< likewise, of what the structure was when the run began, 0 ... 1
  double first_s = 0, last_s = 0;  ///< on the run's clock: the first and the last tick in which more was gone
  /// mm: how deep the far side of the burr's ball got below the surface of the structure as it was prepared,
  /// while it took something of the structure: the greatest of radius - signed distance over places of the
  /// sweeps' axes at most 0.1 mm apart, where the sweep took what none before it had taken. The surface is
  /// the structure's own, or, where it has none, the one that it has in common with structures that it
  /// touches. In a structure that is thinner than the ball the far side may lie beyond the structure. NaN:
  /// the model has no surface of it.
  double depth_mm = kGap;
};

/// What is gone from a tick on.
struct RemovalStep {
  double time_s = 0;
  /// Of RemovalFigures::structures, as many of them as had been cut by then.
  std::vector<double> volumes_mm3;
};

/// What a burr was to spare.
struct StructureSpared {
  LabelId label = 0;
  bool kept = false;         ///< the burr was held out of it; otherwise it is cut like others
  double nearest_mm = kGap;  ///< NearestMeter; NaN: the burr came nowhere near
};

/// What became gone at a time, or back.
struct RemovalChange {
  double time_s = 0;
  std::vector<Cut> cuts;               ///< of a stroke that was undone or done again none
  std::optional<StrokeAction> stroke;  ///< what became of it
};

struct RemovalFigures {
  std::vector<StructureSpared> spared;       ///< in the model's order
  std::vector<StructureRemoval> structures;  ///< in the order in which they were first cut
  std::vector<RemovalStep> steps;            ///< rising in time
  std::vector<RemovalChange> changes;        ///< likewise
  std::size_t strokes = 0;  ///< from the motor's start to its stop, in which something was cut
  std::size_t undone = 0;   ///< of them, when the run ended
  /// How long the motor was asked to run, by its switch or by the pedal that the model names. It stands
  /// still, and counts all the same, while the hand gets no force.
  double motor_s = 0;

  /// mm3, of all structures.
  double volume_mm3() const;
  /// mm3 of a structure that were gone at each of some rising times.
  std::vector<double> gone_mm3(std::size_t structure, std::span<const double> times_s) const;
};

/// Needs memory for the voxels that were swept and for each version of the model that was cut.
class RemovalMeter {
 public:
  /// @param model  with nothing taken from it, outlives the meter; with the proxy's surfaces
  ///               (ready_for), where depths are to be told
  explicit RemovalMeter(const Model& model);
  /// Events, in their order, before the tick that had heard of them. Of a model without labels none counts.
  void hear(std::span<const RecordingEvent> events);
  void see(const TimedTick& now);
  /// After the last tick. Sweeps that no tick's model was cut by are left out.
  RemovalFigures finish();

 private:
  struct Structure {
    std::size_t voxels = 0;
    std::array<int, 3> first{};  // of its voxels
  };
  void hear(const RecordingEvent& event, double time_s);
  void change_stroke(const ModelChange& change);
  void take_away(double time_s);
  void take_away(const Cut& cut, double time_s);
  void count_voxels();
  double all_mm3(LabelId label) const;
  void add_step(double time_s);

  const Model& model_;
  RemovedVolume removed_;
  NearestMeter nearest_;
  StrokeHistory<std::size_t> strokes_;     // their numbers in their order
  std::map<LabelId, double> volumes_mm3_;  // so far
  std::deque<RecordingEvent> heard_;       // sweeps and cuts that no tick has felt yet
  std::vector<Cut> waiting_;               // of the next version that is cut
  std::vector<Structure> structure_;       // by label; empty until something is cut
  std::vector<const Surface*> surface_;    // of figures_.structures; null: it has none
  RemovalFigures figures_;
};

/// The model with the labels that were left at a time, for pictures: with nothing to be felt. Null: nothing
/// was taken by then.
/// @param changes  RemovalFigures::changes
std::shared_ptr<const Model> model_left(const Model& model, std::span<const RemovalChange> changes,
                                        double time_s);

/// mm that a place lies below a surface, negative above it, also beyond the reach of its distance: there by
/// the shortest of 256 straight ways out, which is never too little, and at most 2 % too much below a flat
/// surface.
double depth_below_mm(const Surface& surface, const Point<Patient>& x);

}  // namespace palpate::report
