#pragma once

#include <memory>
#include <string>
#include <vector>

#include "palpate/device/pointer_driver.h"
#include "palpate/palpation/run_setup.h"
#include "session/explore_hand.h"

namespace palpate {

/// Who moves the tip of a session, and the device whose tip it is.
class TipSource {
 public:
  virtual ~TipSource() = default;
  virtual DeviceDriver& driver() = 0;
  /// "script" or "pointer"
  virtual const char* name() const = 0;
  /// Whose holds are measured.
  virtual std::vector<HoldAsked> asked() const = 0;
  /// Where a viewer moves it; else null.
  virtual PointerDriver* pointer() { return nullptr; }

  /// The loop runs. @param told  what it is told, by a script for example; outlives the tip
  /// Errors: those of HandThread::begin().
  virtual Result<void> begin(ServoLoop& loop, EventLog& told, ScriptStrokes strokes) = 0;
  virtual bool done() const = 0;
  virtual double progress() const = 0;
  /// The tip stays where it is.
  virtual void end() = 0;
  /// After end(): steps that failed, a sentence each.
  virtual std::vector<std::string> trouble() const = 0;
  /// After end().
  virtual std::vector<TouchFigure> touches() const = 0;
};

/// The simulated hand that follows a script, with a simulated device. Errors: those of
/// ScriptedHand::create().
Result<std::unique_ptr<TipSource>> script_source(const RunSetup& setup, bool repeat);
/// A viewer's pointer. Until it is moved the tip rests above the volume.
std::unique_ptr<TipSource> pointer_source(const RunSetup& setup);

}  // namespace palpate
