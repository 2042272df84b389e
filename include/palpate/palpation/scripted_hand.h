#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/device/device.h"
#include "palpate/device/model_change.h"
#include "palpate/device/simulated_device.h"
#include "palpate/device/telemetry.h"
#include "palpate/palpation/free_path.h"
#include "palpate/palpation/palpation.h"
#include "palpate/palpation/run_setup.h"
#include "palpate/palpation/touch_site.h"

namespace palpate {

/// Commands of the simulated person other than hand motion.
struct HandCommands {
  /// Last commanded rotation of the object
  Eigen::Quaterniond rotation_target = Eigen::Quaterniond::Identity();
  std::optional<ForceMethod> method;  ///< Method to be used from now on
  std::optional<bool> motor;          ///< Motor switch from now on
  std::optional<TissueLaw> law;       ///< Law of soft tissue from now on
  std::optional<StrokeAction> stroke;
  /// Input: model version produced by the last stroke request; 0: there was no such stroke. Empty: not known
  /// yet.
  std::optional<std::uint32_t> stroke_version = {};
  /// Input: the same for the last law request; 0: the law is not possible.
  std::optional<std::uint32_t> law_version = {};
  /// Target of the second hand's scope from now on. scope_is_there is an input: whether the scope has reached
  /// it.
  std::optional<ScopeStep> scope = {};
  bool scope_is_there = false;
};

/// Simulated person who follows a palpation script by moving the intended tip position, given what a person
/// perceives (the commanded force and the tip's position), with a person's reaction time and tremor.
///
/// Motion is planned through free space and never continues into tissue. On an unexpected event (contact with
/// another structure than requested, a force that is not reached, a tip deeper than the force explains) the
/// hand retreats along its path. An approach is then tried at other places; when these are exhausted, and
/// after a failure of any other step, the step has failed and the following steps are skipped until the next
/// approach.
class ScriptedHand {
 public:
  /// Finds places for every approach of the script. Error with the script's line for an unknown device or
  /// hand, and for a structure that is absent, ambiguous or without contact. An unreachable place is not an
  /// error; its step will fail.
  static Result<ScriptedHand> create(const Model& model, const Script& script);

  /// Rest position of the tip before the first step: in the air in front of the patient.
  Point<World> start() const { return start_; }
  /// Next intended position after a tick, `dt_s` later; empty when the script is done. May change the
  /// commands.
  std::optional<Point<World>> next(const TickRecord& tick, double dt_s, HandCommands& commands);
  /// Restarts the script at its first step, from the current position of hand and object.
  void begin_again() { step_ = 0; }
  /// Progress in steps, 0 ... 1.
  double progress() const { return static_cast<double>(step_) / static_cast<double>(steps_.size()); }
  /// Failed steps, one sentence each with the script's line.
  const std::vector<std::string>& problems() const { return problems_; }
  /// Contact points of the approaches so far.
  const std::vector<TouchFigure>& touches() const { return touches_; }
  /// Requested holds by structure, in the order of the approaches.
  std::vector<HoldRequest> requested() const;

 private:
  struct PlannedStep {
    ScriptStep action;
    int line = 0;
    LabelId structure = 0;  // structure of the last approach
    TouchSites sites;       // candidates of an approach
  };
  enum class Approach : std::uint8_t { kPlan, kFollowPath, kTouch };
  ScriptedHand(const Model& model, const Script& script, const PlantDevice& device, const PlantHand& hand);
  Result<PlannedStep> planned(const ScriptStep& action, int line, LabelId before, const std::string& where);

  // ---- steps: each call is one tick and returns true when the step is done
  bool run_step(const PlannedStep& step, const TickRecord& tick, double dt_s, HandCommands& commands);
  bool approach(const PlannedStep& step, const TickRecord& tick, double dt_s);
  double touch_of_approach() const;
  bool plan(const PlannedStep& step, const TickRecord& tick);
  void follow_path_to_site(const PlannedStep& step, const TickRecord& tick, double dt_s);
  bool touch(const PlannedStep& step, const TickRecord& tick, double dt_s);
  bool press(const PlannedStep& step, const TickRecord& tick, double dt_s);
  bool hold(const PlannedStep& step, const TickRecord& tick, double dt_s);
  bool slide(const PlannedStep& step, const TickRecord& tick, double dt_s);
  bool mill(const PlannedStep& step, const TickRecord& tick, double dt_s);
  bool rotate(const PlannedStep& step, const TickRecord& tick, double dt_s, Eigen::Quaterniond& target);
  bool change_stroke(const PlannedStep& step, const TickRecord& tick, double dt_s, HandCommands& commands);
  bool lead_scope(const PlannedStep& step, const TickRecord& tick, double dt_s, HandCommands& commands);
  bool change_law(const PlannedStep& step, const TickRecord& tick, double dt_s, HandCommands& commands);
  bool switch_motor(const MotorStep& motor, const TickRecord& tick, double dt_s, HandCommands& commands);
  bool change_method(const MethodStep& change, const TickRecord& tick, double dt_s, HandCommands& commands);
  bool withdraw_from_contact(const PlannedStep& step, const TickRecord& tick, double dt_s);

  // ---- failures
  std::optional<std::string> update_excess_depth(const TickRecord& tick, double dt_s);
  std::optional<std::string> update_contact_loss(const PlannedStep& step, const TickRecord& tick,
                                                 double dt_s);
  std::optional<std::string> force_deviation(double time_s) const;
  void try_next_site(const TickRecord& tick, const std::string& why);
  bool fail(const PlannedStep& step, const TickRecord& tick, const std::string& why);
  std::string named(const PlannedStep& step) const;
  std::string skipped() const;
  std::string wrong_contact(const TickRecord& tick) const;

  // ---- motion
  void update_perception(const TickRecord& tick, double dt_s);
  bool follow_path(double speed_mm_s, const TickRecord& tick, double dt_s);
  void regulate_force(const TickRecord& tick, double dt_s);
  void regulate_contact(const TickRecord& tick, double dt_s);
  void begin_withdrawal(const TickRecord& tick);
  bool withdraw(double speed_mm_s, const TickRecord& tick, double dt_s);
  bool begin_step_back(const TickRecord& tick);
  double tracking_tolerance_mm(const TickRecord& tick) const;
  double careful_speed_mm_s(LabelId structure, const TickRecord& tick) const;
  double stiffness_N_per_mm(LabelId structure, const TickRecord& tick) const;
  double deformable_stiffness_N_per_mm(const ElasticConstants& constants) const;
  Transform<World, Patient> X_WorldPatient(const TickRecord& tick) const;
  Vector<World> tremor() const;

  const Model* model_;
  PlantDevice device_;
  PlantHand hand_;
  TissueLaw law_;  // initially the scene's, then the script's
  FreeSpace free_space_;
  double tool_reach_mm_ = 0, clear_of_object_mm_ = 0;
  std::vector<PlannedStep> steps_;
  bool cutting_ = false;  ///< Whether the motor runs: tissue is removed at any pressing force
  std::vector<std::string> problems_;
  std::vector<TouchFigure> touches_;
  Point<World> start_;

  // state of the script
  std::size_t step_ = 0;
  // time since the step began, 0 in its first tick; time since the script began
  double step_time_s_ = 0, time_s_ = 0;
  Point<World> commanded_;
  bool touching_ = false;             // an approach has made contact and nothing has failed since
  bool withdrawing_ = false;          // retreating after a failure
  std::vector<Point<Patient>> path_;  // remaining corners of the path, the last one first
  std::vector<Point<Patient>>
      approach_path_;  // corners of the last approach and of subsequent slides, in order
  // state of an approach
  Approach phase_ = Approach::kPlan;
  std::size_t site_index_ = 0;
  std::string refusal_;           // reason for abandoning the last place
  bool tries_next_site_ = false;  // whether the next place is tried after retreating
  double phase_time_s_ = 0, contact_s_ = 0;
  // state of a contact
  Vector<World> inward_;    // pressing direction
  double requested_N_ = 0;  // force of the last press; 0: contact only
  double target_N_ = 0;
  double touch_N_ = 0;  ///< Force that ends the approach (touch_of_approach)
  double deviation_s_ = 0, over_s_ = 0, stuck_s_ = 0;
  double settled_s_ = 0, longest_s_ = 0, sum_Ns_ = 0;
  double slid_mm_ = 0;      // distance covered by a slide; length of a milled line
  Point<Patient> contact_;  // contact point of a slide in the previous tick
  Point<World> retreat_start_;
  // withdrawal: time since the end of the retreat path was reached; time spent in contact
  double at_path_end_s_ = 0, in_contact_s_ = 0;
  bool turning_ = false;
  double turned_s_ = 0;
  Eigen::Quaterniond rotation_start_ = Eigen::Quaterniond::Identity();
  std::optional<Transform<World, Patient>> last_X_WorldPatient_;  // pose of the patient in the previous tick
  double filtered_N_ = 0;                                         // perceived force, low-pass filtered
  Vector<World> filtered_normal_;                                 // perceived normal, low-pass filtered

  // tremor: three sinusoids between 8 and 12 Hz per axis
  struct Wave {
    double amplitude_mm, omega, phase;
  };
  std::array<std::array<Wave, 3>, 3> tremor_{};
};

}  // namespace palpate
