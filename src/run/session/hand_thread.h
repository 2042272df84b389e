#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "palpate/device/model_change.h"
#include "palpate/device/simulated_device.h"
#include "palpate/palpation/scripted_hand.h"
#include "palpate/recording/event_log.h"
#include "palpate/servo/servo_loop.h"

namespace palpate {

/// Edits of the model by a script; called on the hand's thread.
struct ScriptEdits {
  std::function<void(StrokeAction)> change_stroke;
  /// HandCommands::stroke_version of the last change.
  std::function<std::optional<std::uint32_t>()> stroke_version;
  std::function<void(TissueLaw)> change_law;
  /// HandCommands::law_version of the last change.
  std::function<std::optional<std::uint32_t>()> law_version;
};

/// Scripted hand on a thread of its own, with a person's reaction time: it reads the latest tick and commands
/// a position for a short time later. It rests while the force is off or ramping in, as a person would, and
/// does not catch up on time in which its thread did not run. After an emergency stop it withdraws from
/// contact, because the force can be re-armed only without contact, and returns once the force is on.
class HandThread {
 public:
  /// @param log     log of the script's commands to the loop; outlives the hand
  /// @param repeat  begin again when the script has ended
  HandThread(ScriptedHand hand, const WorkspaceSettings& workspace, SimulatedDriver& driver, ServoLoop& loop,
             EventLog& log, ScriptEdits edits, bool repeat);
  ~HandThread() { end(); }
  HandThread(const HandThread&) = delete;
  HandThread& operator=(const HandThread&) = delete;

  /// Error kUnavailable if the system cannot create a thread.
  Result<void> begin();
  /// Ends the thread; the hand stays at its last commanded position.
  void end();

  // ---- any thread
  bool done() const { return done_.load(); }
  double progress() const { return progress_.load(); }
  /// After end().
  const std::vector<std::string>& problems() const { return hand_.problems(); }
  const std::vector<TouchFigure>& touches() const { return hand_.touches(); }

 private:
  void run();
  void move(double dt_s);
  void withdraw(const DeviceTick& device, double dt_s);
  bool return_to_path(double dt_s);
  void intend(const Point<World>& target);

  ScriptedHand hand_;
  const WorkspaceMapping mapping_;
  SimulatedDriver& driver_;
  ServoLoop& loop_;
  EventLog& log_;
  const ScriptEdits edits_;
  const bool repeat_;
  // position by the script; position while withdrawn; unit direction out of the contact
  std::optional<Point<World>> script_target_, withdrawn_target_;
  Vector<World> outward_{0, 0, 1};
  double clear_mm_ = 0;  // distance covered without contact
  std::atomic<bool> end_{false}, done_{false};
  std::atomic<double> progress_{0};
  std::thread thread_;
};

}  // namespace palpate
