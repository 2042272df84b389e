#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "palpate/base/heartbeat.h"
#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/device/device.h"

/// What a hand really holds with a device: measured with somebody's hand at it, by forces of 1 N at most.
namespace palpate {

struct HeldHandSettings {
  double rate_hz = 1000;        ///< of devices without a clock of their own; 250 ... 10000
  double most_force_N = 1;      ///< > 0, 1 at most
  double first_N_per_mm = 0.1;  ///< the spring begins so stiff
  double max_N_per_mm = 5;      ///< and becomes no stiffer; 5 at most
  double growth = 1.15;         ///< from one spring to the next
  bool realtime = true;         ///< ask for SCHED_FIFO
  /// Where another process watches (supervisor.h); outlives the call. nullptr: none does.
  Heartbeat* heartbeat = nullptr;
};

struct HeldHandFigures {
  std::string device;                     ///< its name, printable (printable_name())
  double rate_hz = 0;                     ///< updates a second
  double delay_s = 0;                     ///< from a command to its force, as far as the tip's way tells
  double held_N_per_mm = 0;               ///< the stiffest spring with which the tip came to rest
  std::optional<double> swings_N_per_mm;  ///< the first with which it did not; empty: none was that stiff
  /// kStiffnessMargin of where it swings, or of the stiffest that was tried.
  double advised_N_per_mm = 0;
};

/// Half a second at rest, two of light pushes to and fro along the device's first axis, a rest, and then a
/// spring to where the tip was, which becomes stiffer each 0.4 s, knocked each time; the end is the first
/// spring with which the tip goes on swinging. Opens the driver and runs it, in a thread with a watchdog.
///
/// **Limits** whatever the figures: 1 N; nothing for a state that is older than 10 ms, a fault or what is no
/// number; the end where the tip goes 15 mm away from where it rested first or in this spring, faster than
/// 0.5 m/s over 8 ms, a tick is 9 ms late, or times go back. It begins within 2 s or not at all: whoever
/// armed it still holds still then. A trial that is ended leaves the driver halted.
///
/// The delay is that of the force that explains the way best: of a mass on spring, damper and dry friction,
/// for each window of half a second, integrated twice (no noise is differentiated).
/// Errors: those of open(); kUnavailable for what ended it, where the softest spring swung already, and where
/// no delay explains the way clearly better than others, with what to do; kInterrupted.
Result<HeldHandFigures> try_held_hand(DeviceDriver& driver, const HeldHandSettings& settings,
                                      const Progress& progress = {});

/// By the device's name (DeviceInfo::name), as printable_name() writes it.
using HeldHands = std::map<std::string, HeldHandFigures>;

/// A line for each device, `rate_hz delay_s held_N_per_mm swings_N_per_mm|- NAME`; others that begin with #.
std::string held_hands_text(const HeldHands& hands);
/// Lines may end as in Windows. Errors: kBadInput, naming the line: what is no such line, a figure that no
/// trial finds (225 ... 20,000 updates a second, 0 ... 20 ms, 0.001 ... 5 N/mm, held more than what swings),
/// a name that is not printable, a device twice.
Result<HeldHands> parse_held_hands(std::string_view text, const std::string& where);

/// The driver, whose devices say what was measured of them: the delay, or their own where that is more,
/// and as stiffness what is advised, or the maker's own where that is less. What was measured at more updates
/// a second than the session makes says nothing, and neither does anything of a simulated device.
std::unique_ptr<DeviceDriver> with_held_hands(std::unique_ptr<DeviceDriver> driver, HeldHands hands,
                                              double rate_hz);

}  // namespace palpate
