#pragma once

#include <memory>
#include <string>
#include <vector>

#include "palpate/device/pointer_driver.h"
#include "palpate/palpation/run_setup.h"
#include "palpate/session/explore.h"
#include "session/explore_hand.h"

namespace palpate {

/// Who moves the tip of a session, and the device whose tip it is.
class TipSource {
 public:
  virtual ~TipSource() = default;
  virtual DeviceDriver& driver() = 0;
  /// "script", "pointer" or "device"; of several the pointer's, where there is one
  virtual const char* name() const = 0;
  /// What each device is, for a recording: "premium-1.5, pointer"
  virtual std::string devices() const = 0;
  /// Threads beside the loop's.
  virtual std::vector<TickingThread> followers() const { return {}; }

  /// Whose holds are measured.
  virtual std::vector<HoldAsked> asked() const = 0;
  /// Where a viewer moves it; else null.
  virtual PointerDriver* pointer() { return nullptr; }

  /// The loop runs. @param told  what it is told, by a script for example; outlives the tip
  /// Errors: those of HandThread::begin().
  virtual Result<void> begin(ServoLoop& loop, EventLog& told, ScriptEdits edits) = 0;
  virtual bool done() const = 0;
  virtual double progress() const = 0;
  /// The tip stays where it is.
  virtual void end() = 0;
  /// After end(): steps that failed, a sentence each.
  virtual std::vector<std::string> trouble() const = 0;
  /// After end().
  virtual std::vector<TouchFigure> touches() const = 0;
};

/// The devices of a session, made and, where they are physical, opened: one alone, or several as one.
/// @param setup  gets what each may be made to feel, and in its trouble what is careful there
/// @param told   gets that again, a line each
/// Errors: those of check_devices(), of ScriptedHand::create() and of opening a driver.
Result<std::unique_ptr<TipSource>> tip_source_for(RunSetup& setup, const ExploreOptions& options,
                                                  const Progress& progress, std::string& told);

}  // namespace palpate
