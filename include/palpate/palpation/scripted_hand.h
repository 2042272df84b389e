#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/device/device.h"
#include "palpate/device/simulated_device.h"
#include "palpate/device/telemetry.h"
#include "palpate/palpation/free_path.h"
#include "palpate/palpation/palpation.h"
#include "palpate/palpation/run_setup.h"
#include "palpate/palpation/touch_place.h"

namespace palpate {

/// What the person commands besides moving the hand.
struct HandCommands {
  Eigen::Quaterniond rotation_target = Eigen::Quaterniond::Identity();  ///< as it was commanded last
  std::optional<ForceMethod> method;                                    ///< to be felt from now on
  std::optional<bool> motor;                                            ///< on or off from now on
  std::optional<TissueLaw> law;                                         ///< of soft tissue, from now on
  std::optional<StrokeAction> stroke;
  /// Told to it: the model's version to which what it asked of a stroke last has led; 0: there was no such
  /// stroke. Empty: that is not known yet.
  std::optional<std::uint32_t> stroke_led_to = {};
  /// Likewise of the law that it asked for last; 0: it cannot be.
  std::optional<std::uint32_t> law_led_to = {};
  /// What the second hand's scope is to look at from now on; and, told to it, whether it does.
  std::optional<ScopeStep> scope = {};
  bool scope_is_there = false;
};

/// The person: follows a palpation script by moving where the hand intends the tip to be, feeling what
/// a person feels (the force sent and where the tip is), with a person's slowness and tremor.
///
/// It goes where nothing felt is in the way, and never on into tissue. What it meets on the way, another
/// structure than asked, a force that it does not get, a tip deeper than the force explains: it gives up and
/// goes back the way it came. An approach is then tried at other places; when these are used up, and after
/// any other step, the step has failed, and what follows is skipped until the next approach.
class ScriptedHand {
 public:
  /// Finds places for every approach of the script. Error with the script's line for a device or hand that
  /// there is not, and for a structure that is absent, ambiguous or not felt. What cannot be reached is no
  /// error but a step that will fail.
  static Result<ScriptedHand> create(const Model& model, const Script& script);

  /// Where the tip rests before the first step: in the air before the patient.
  Point<World> start() const { return start_; }
  /// The next intention after a tick, `dt_s` later; nullopt when the script is done. May change the commands.
  std::optional<Point<World>> next(const TickRecord& felt, double dt_s, HandCommands& commands);
  /// Runs the script once more from its first step, from where the hand and the object are now.
  void begin_again() { step_ = 0; }
  /// 0 ... 1, by steps.
  double progress() const { return static_cast<double>(step_) / static_cast<double>(steps_.size()); }
  /// Steps that failed, a sentence each with the script's line.
  const std::vector<std::string>& trouble() const { return trouble_; }
  /// Where the approaches touched, as far as they have.
  const std::vector<TouchFigure>& touches() const { return touches_; }
  /// What the script asks for, by structure, in the order of the approaches.
  std::vector<HoldAsked> asked() const;

 private:
  struct PlannedStep {
    ScriptStep action;
    int line = 0;
    LabelId structure = 0;  // of the last approach
    TouchPlaces places;     // of an approach
  };
  enum class Approach : std::uint8_t { kPlan, kWalk, kTouch };
  ScriptedHand(const Model& model, const Script& script, const PlantDevice& device, const PlantHand& hand);
  Result<PlannedStep> planned(const ScriptStep& action, int line, LabelId before, const std::string& where);

  // ---- steps: one tick, true when done
  bool run_step(const PlannedStep& step, const TickRecord& felt, double dt_s, HandCommands& commands);
  bool approach(const PlannedStep& step, const TickRecord& felt, double dt_s);
  double touch_of_approach() const;
  bool plan(const PlannedStep& step, const TickRecord& felt);
  void go(const PlannedStep& step, const TickRecord& felt, double dt_s);
  bool touch(const PlannedStep& step, const TickRecord& felt, double dt_s);
  bool press(const PlannedStep& step, const TickRecord& felt, double dt_s);
  bool hold(const PlannedStep& step, const TickRecord& felt, double dt_s);
  bool slide(const PlannedStep& step, const TickRecord& felt, double dt_s);
  bool rotate(const PlannedStep& step, const TickRecord& felt, double dt_s, Eigen::Quaterniond& target);
  bool change_stroke(const PlannedStep& step, const TickRecord& felt, double dt_s, HandCommands& commands);
  bool lead_scope(const PlannedStep& step, const TickRecord& felt, double dt_s, HandCommands& commands);
  bool change_law(const PlannedStep& step, const TickRecord& felt, double dt_s, HandCommands& commands);
  bool switch_motor(const MotorStep& motor, const TickRecord& felt, double dt_s, HandCommands& commands);
  bool change_method(const MethodStep& change, const TickRecord& felt, double dt_s, HandCommands& commands);
  bool leave(const PlannedStep& step, const TickRecord& felt, double dt_s);

  // ---- what goes wrong
  std::optional<std::string> overreach(const TickRecord& felt, double dt_s);
  std::optional<std::string> lost(const PlannedStep& step, const TickRecord& felt, double dt_s);
  std::optional<std::string> kept_badly(double time_s) const;
  void try_elsewhere(const TickRecord& felt, const std::string& why);
  bool fail(const PlannedStep& step, const TickRecord& felt, const std::string& why);
  std::string named(const PlannedStep& step) const;
  std::string skipped() const;
  std::string touched_instead(const TickRecord& felt) const;

  // ---- how it moves
  void feel(const TickRecord& felt, double dt_s);
  bool walk(double speed_mm_s, const TickRecord& felt, double dt_s);
  void keep_force(const TickRecord& felt, double dt_s);
  void keep_contact(const TickRecord& felt, double dt_s);
  void begin_withdrawal(const TickRecord& felt);
  bool withdraw(double speed_mm_s, const TickRecord& felt, double dt_s);
  bool begin_step_back(const TickRecord& felt);
  double leash_mm(const TickRecord& felt) const;
  double careful_mm_s(LabelId structure, const TickRecord& felt) const;
  double stiffness_N_per_mm(LabelId structure, const TickRecord& felt) const;
  double yielding_N_per_mm(const ElasticConstants& constants) const;
  Transform<World, Patient> X_WorldPatient(const TickRecord& felt) const;
  Vector<World> tremor() const;

  const Model* model_;
  PlantDevice device_;
  PlantHand hand_;
  TissueLaw law_;  // the scene's, then the script's
  FreeSpace free_space_;
  double tool_reach_mm_ = 0, clear_of_object_mm_ = 0;
  std::vector<PlannedStep> steps_;
  bool cutting_ = false;  ///< the motor runs: what is touched gives way, whatever it is pressed with
  std::vector<std::string> trouble_;
  std::vector<TouchFigure> touches_;
  Point<World> start_;

  // where it is
  std::size_t step_ = 0;
  double step_time_s_ = 0, time_s_ = 0;  // in the step; 0 in its first tick
  Point<World> intention_;
  bool touching_ = false;               // an approach has touched and nothing has failed since
  bool withdrawing_ = false;            // after a failure
  std::vector<Point<Patient>> way_;     // corners still to walk, last one first
  std::vector<Point<Patient>> way_in_;  // corners of the last approach and of slides since, in order
  // of an approach
  Approach phase_ = Approach::kPlan;
  std::size_t place_ = 0;
  std::string refusal_;     // why the last place was given up
  bool elsewhere_ = false;  // after withdrawing it is tried at the next place
  double phase_time_s_ = 0, met_s_ = 0;
  // of a contact
  Vector<World> inward_;  // the direction of pressing
  double asked_N_ = 0;    // by the last press; 0: only a touch
  double wanted_N_ = 0;
  double touch_N_ = 0;  ///< that ends the approach (touch_of_approach)
  double off_s_ = 0, over_s_ = 0, stuck_s_ = 0;
  double settled_s_ = 0, longest_s_ = 0, slid_mm_ = 0, sum_Ns_ = 0;
  Point<Patient> contact_;  // of a slide, in the tick before
  Point<World> leaving_from_;
  double left_s_ = 0, pressed_s_ = 0;  // since the way out was walked; while it let go of what it pressed
  bool turning_ = false;
  double turned_s_ = 0;
  Eigen::Quaterniond rotation_start_ = Eigen::Quaterniond::Identity();
  std::optional<Transform<World, Patient>> lay_;  // where the patient lay in the tick before
  double felt_N_ = 0;                             // low-passed, as a person feels it
  Vector<World> felt_normal_;                     // likewise

  // tremor: three sinusoids between 8 and 12 Hz a axis
  struct Wave {
    double amplitude_mm, omega, phase;
  };
  std::array<std::array<Wave, 3>, 3> tremor_{};
};

}  // namespace palpate
