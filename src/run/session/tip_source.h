#pragma once

#include <memory>
#include <string>
#include <vector>

#include "palpate/device/pointer_driver.h"
#include "palpate/palpation/run_setup.h"
#include "palpate/session/explore.h"
#include "session/hand_thread.h"

namespace palpate {

/// Source of a session's tip motion, with the driver of the device concerned.
class TipSource {
 public:
  virtual ~TipSource() = default;
  virtual DeviceDriver& driver() = 0;
  /// "script", "pointer", "ros2" or "device"; of several sources "pointer" if there is one
  virtual const char* name() const = 0;
  /// Names of the devices for a recording: "premium-1.5, pointer"
  virtual std::string devices() const = 0;
  /// Threads in addition to the loop's.
  virtual std::vector<TickingThread> followers() const { return {}; }

  /// Structures whose holds are measured.
  virtual std::vector<HoldRequest> hold_requests() const = 0;
  /// Driver of a viewer's pointer; null if there is none.
  virtual PointerDriver* pointer() { return nullptr; }

  /// Called when the loop runs.
  /// @param log  log of the commands to the loop, such as a script's; outlives the tip source
  /// Errors: those of HandThread::begin().
  virtual Result<void> begin(ServoLoop& loop, EventLog& log, ScriptEdits edits) = 0;
  virtual bool done() const = 0;
  virtual double progress() const = 0;
  /// Ends the source's threads; the tip stays where it is.
  virtual void end() = 0;
  /// Failed steps, one sentence each; valid after end().
  virtual std::vector<std::string> problems() const = 0;
  /// Figures of touches; valid after end().
  virtual std::vector<TouchFigure> touches() const = 0;
};

/// Creates the devices of a session and opens those that are physical: a single source, or several combined.
/// @param setup    receives each device's limits; conservative bounds among them are added to its problems
/// @param warning  receives these bounds again, one per line
/// Errors: those of check_devices(), of ScriptedHand::create() and of opening a driver.
Result<std::unique_ptr<TipSource>> tip_source_for(RunSetup& setup, const ExploreOptions& options,
                                                  const Progress& progress, std::string& warning);

}  // namespace palpate
