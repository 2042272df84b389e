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

/// Measures the stiffness at which a device is stable in the user's hand, with forces of at most 1 N.
namespace palpate {

struct GripTrialSettings {
  double rate_hz = 1000;        ///< For devices without their own clock; 250 ... 10000
  double max_force_N = 1;       ///< Force limit; in 0 ... 1, 0 excluded
  double first_N_per_mm = 0.1;  ///< Initial stiffness of the spring
  double max_N_per_mm = 5;      ///< Maximum stiffness; at most 5
  double growth = 1.15;         ///< Ratio of successive stiffnesses
  bool realtime = true;         ///< Whether SCHED_FIFO is requested
  /// Heartbeat of a supervising process (supervisor.h); has to outlive the call. nullptr: none.
  Heartbeat* heartbeat = nullptr;
};

struct GripTrialFigures {
  std::string device;  ///< Name, printable (printable_name())
  double rate_hz = 0;  ///< Update rate
  /// Latency from a command to its force, estimated from the tip's motion
  double delay_s = 0;
  double stable_N_per_mm = 0;  ///< Highest stiffness at which the tip came to rest
  /// Lowest stiffness at which it oscillated; empty: none up to the maximum
  std::optional<double> oscillating_N_per_mm;
  /// kStiffnessMargin times the stiffness of oscillation, or times the highest stiffness tried.
  double recommended_N_per_mm = 0;
};

/// Trial: half a second at rest, two seconds of light pushes in alternating directions along the device's
/// first axis, a pause, then a spring to the tip's rest position with a stiffness that increases every 0.4 s,
/// excited by a short impulse each time. It ends at the first stiffness at which the oscillation persists.
/// Opens the driver and runs it in a thread with a watchdog.
///
/// **Limits**, whatever the figures: 1 N; no force for a state older than 10 ms, a fault or a non-finite
/// value; the trial ends if the tip moves more than 15 mm from its initial rest position or that of the
/// current spring, moves faster than 0.5 m/s over 8 ms, a tick is 9 ms late, or time stamps decrease. It
/// starts within 2 s or not at all, so that the user who armed the device still holds it. An aborted trial
/// leaves the driver halted.
///
/// The latency is identified by the best fit of a mass with spring, damper and dry friction to the motion,
/// with the equation of motion integrated twice over windows of half a second (no noise is differentiated).
///
/// Errors: those of open(); kUnavailable, with a remedy, for the reason of an abort, if even the softest
/// spring oscillated, or if no latency fits clearly better than others; kInterrupted.
Result<GripTrialFigures> run_grip_trial(DeviceDriver& driver, const GripTrialSettings& settings,
                                        const Progress& progress = {});

/// Keyed by the device's name (DeviceInfo::name) in the spelling of printable_name().
using GripFiguresByDevice = std::map<std::string, GripTrialFigures>;

/// One line per device, `rate_hz delay_s stable_N_per_mm oscillating_N_per_mm|- NAME`; comment lines begin
/// with #.
std::string grip_figures_text(const GripFiguresByDevice& hands);
/// Parses grip_figures_text; CRLF line ends are accepted. Errors: kBadInput with the line: invalid syntax, a
/// figure outside a trial's range (225 ... 20,000 updates a second, 0 ... 20 ms, 0.001 ... 5 N/mm, held above
/// the oscillating stiffness), a name that is not printable, a duplicate device.
Result<GripFiguresByDevice> parse_grip_figures(std::string_view text, const std::string& where);

/// Wraps a driver so that its devices report the measured limits: the latency is the larger of the measured
/// and the declared one, the stiffness the smaller of the recommended one and the vendor's. Measurements
/// at a higher update rate than the session's are ignored, and so are those of a simulated device.
std::unique_ptr<DeviceDriver> with_grip_figures(std::unique_ptr<DeviceDriver> driver,
                                                GripFiguresByDevice hands, double rate_hz);

}  // namespace palpate
