#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "palpate/device/simulated_device.h"
#include "palpate/palpation/scripted_hand.h"
#include "palpate/recording/recording.h"
#include "palpate/servo/servo_loop.h"

namespace palpate {

/// How a script changes the model; on the hand's thread.
struct ScriptEdits {
  std::function<void(StrokeAction)> change_stroke;
  /// HandCommands::stroke_led_to, of the last change.
  std::function<std::optional<std::uint32_t>()> stroke_led_to;
  std::function<void(TissueLaw)> change_law;
  /// HandCommands::law_led_to, of the last change.
  std::function<std::optional<std::uint32_t>()> law_led_to;
};

/// A scripted hand on a thread of its own, as slow as a person beside the servo: it feels the latest tick and
/// says where it wants to be a little later. It rests while the force is off or still coming in, as somebody
/// does who feels it go, and does not catch up on time in which its thread did not run. Of an emergency stop
/// it leaves what it touches, since only a free hand gets its force back, and comes back when it has it.
class HandThread {
 public:
  /// @param told  what the loop is told by the script; outlives the hand
  /// @param repeat  begin again when the script has ended
  HandThread(ScriptedHand hand, const WorkspaceSettings& workspace, SimulatedDriver& driver, ServoLoop& loop,
             EventLog& told, ScriptEdits edits, bool repeat);
  ~HandThread() { end(); }
  HandThread(const HandThread&) = delete;
  HandThread& operator=(const HandThread&) = delete;

  /// Error kUnavailable where the system gives no thread.
  Result<void> begin();
  /// The hand stays where it wants to be.
  void end();

  // ---- any thread
  bool done() const { return done_.load(); }
  double progress() const { return progress_.load(); }
  /// After end().
  const std::vector<std::string>& trouble() const { return hand_.trouble(); }
  const std::vector<TouchFigure>& touches() const { return hand_.touches(); }

 private:
  void run();
  void move(double dt_s);
  void withdraw(const DeviceTick& felt, double dt_s);
  bool come_back(double dt_s);
  void intend(const Point<World>& target);

  ScriptedHand hand_;
  const WorkspaceMapping mapping_;
  SimulatedDriver& driver_;
  ServoLoop& loop_;
  EventLog& told_;
  const ScriptEdits edits_;
  const bool repeat_;
  // where the script wants it, where it is led, and the way out of what it touches
  std::optional<Point<World>> wanted_, led_;
  Vector<World> outward_{0, 0, 1};
  double clear_mm_ = 0;  // that it has gone without touching anything
  std::atomic<bool> end_{false}, done_{false};
  std::atomic<double> progress_{0};
  std::thread thread_;
};

}  // namespace palpate
