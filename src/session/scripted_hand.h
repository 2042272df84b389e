#pragma once

#include <optional>
#include <string>
#include <vector>

#include "palpate/device.h"
#include "palpate/session.h"
#include "palpate/telemetry.h"
#include "session/free_path.h"

namespace palpate {

/// What the person commands besides moving the hand.
struct HandCommands {
  Eigen::Quaterniond rotation_target = Eigen::Quaterniond::Identity();  ///< as it was commanded last
  std::optional<ForceMethod> method;                                    ///< to be felt from now on
};

/// The person: follows a palpation script by moving where the hand intends the tip to be, feeling what
/// a person feels (the force sent and where the tip is), with a person's slowness and tremor.
class ScriptedHand {
 public:
  /// Finds every surface point the script needs. Error with the script's line for a structure that is
  /// absent, not felt or out of reach.
  static Result<ScriptedHand> create(const Model& model, const Script& script);

  /// Where the tip rests before the first step: in the air before the patient.
  Point<World> start() const { return start_; }
  /// The next intention after a tick, `dt_s` later; nullopt when the script is done. May change the commands.
  std::optional<Point<World>> next(const TickRecord& felt, double dt_s, HandCommands& commands);
  /// Runs the script once more from its first step, from where the hand and the object are now.
  void begin_again() { step_ = 0; }
  /// 0 ... 1, by steps.
  double progress() const { return static_cast<double>(step_) / static_cast<double>(steps_.size()); }
  /// Steps that did not reach what they asked, in words.
  const std::vector<std::string>& trouble() const { return trouble_; }
  /// Structures the script approaches, in order, each once.
  const std::vector<LabelId>& structures() const { return structures_; }

 private:
  struct PlannedStep {
    ScriptStep action;
    int line = 0;
    LabelId structure = 0;  // of the last approach
    SurfacePoint surface;
  };
  ScriptedHand(const Model& model, const Script& script);

  bool run_step(const PlannedStep& step, const TickRecord& felt, double dt_s, HandCommands& commands);
  bool approach(const PlannedStep& step, const TickRecord& felt, double dt_s);
  bool press(const PlannedStep& step, const TickRecord& felt, double dt_s);
  bool slide(const SlideStep& action, const TickRecord& felt, double dt_s);
  bool rotate(const RotateStep& action, double dt_s, Eigen::Quaterniond& rotation_target);
  bool leave(const PlannedStep& step, const TickRecord& felt, double dt_s);
  void give_up(const PlannedStep& step, const TickRecord& felt, const std::string& why);
  void keep_force(double dt_s);
  void follow_surface();
  Transform<World, Patient> X_WorldPatient(const TickRecord& felt) const;
  bool walk(double speed_mm_s, double dt_s);
  void feel(const TickRecord& felt, double dt_s);
  Vector<World> tremor() const;

  const Model* model_;
  FreeSpace free_space_;
  std::vector<PlannedStep> steps_;
  std::vector<LabelId> structures_;
  std::vector<std::string> trouble_;
  Point<World> start_;

  // where it is
  std::size_t step_ = 0;
  double step_time_s_ = 0, time_s_ = 0;  // in the step; 0 in its first tick
  double left_s_ = 0;                    // since the way out was walked
  Point<World> intention_;
  std::vector<Point<World>> way_;       // corners still to walk, last one first
  std::vector<Point<Patient>> way_in_;  // corners of the last approach, in order
  Point<World> leaving_from_;
  Vector<World> inward_;  // the direction of pressing
  double wanted_N_ = 0;
  double settled_s_ = 0;
  double slid_mm_ = 0;
  Eigen::Quaterniond rotation_start_ = Eigen::Quaterniond::Identity();
  double felt_N_ = 0;          // low-passed, as a person feels it
  Vector<World> felt_normal_;  // likewise

  // tremor: three sinusoids between 8 and 12 Hz a axis
  struct Wave {
    double amplitude_mm, omega, phase;
  };
  std::array<std::array<Wave, 3>, 3> tremor_{};
};

}  // namespace palpate
