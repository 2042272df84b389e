#include <array>
#include <cmath>

#include "report/html.h"
#include "report/page_sections.h"

namespace palpate::report {
namespace {

/// Condition for showing a row.
enum class RowCondition {
  kAlways,
  kOnRealClock,  ///< On the real clock, otherwise if not zero
  kWhenMet,
  kOfHand,     ///< Same as kOnRealClock, for devices held by a hand
  kOfPointer,  ///< Always for a viewer's pointer, otherwise never
};

struct Row {
  const char* name;
  std::uint64_t RecordingSummary::*count;
  RowCondition condition;
  const char* meaning;
};

constexpr std::array kInterventions{
    Row{"Clamped", &RecordingSummary::clamped, RowCondition::kAlways,
        "The computed force was larger than the limit; the limit was sent, in the same direction."},
    Row{"Not finite", &RecordingSummary::not_finite, RowCondition::kAlways,
        "A position or a force was not a number; no force was sent."},
    Row{"Rotation ignored", &RecordingSummary::rotation_ignored, RowCondition::kAlways,
        "The commanded rotation of the object was invalid; the last valid one was kept."},
    Row{"Thermal limit", &RecordingSummary::thermal, RowCondition::kWhenMet,
        "The motors had warmed up; the limit was lowered towards their continuous force."},
    Row{"Slewed", &RecordingSummary::slewed, RowCondition::kWhenMet,
        "The force would have changed by more than the device may change it in one tick; it took longer."},
    Row{"Stale", &RecordingSummary::stale, RowCondition::kOfHand,
        "The device's position was more than 5 ms old; the force decayed, and was off when it was 10 ms "
        "old."},
    Row{"Jumped", &RecordingSummary::jumped, RowCondition::kWhenMet,
        "The tip moved farther in one tick than a hand can; no force was sent, and it came back slowly."},
    Row{"Device fault", &RecordingSummary::device_faults, RowCondition::kWhenMet,
        "The device disabled forces by itself, for example by its brake or after a lost connection; none was "
        "sent."},
    Row{"Halted", &RecordingSummary::halted, RowCondition::kOnRealClock,
        "The watchdog had stopped the device because the loop did not answer; no force was sent."},
    Row{"Emergency stop", &RecordingSummary::emergency_stopped, RowCondition::kOnRealClock,
        "The emergency stop was pressed; no force was sent."},
};

constexpr std::array kOthers{
    Row{"Outside", &RecordingSummary::outside, RowCondition::kAlways,
        "The tip was outside the scanned volume. Up to a voxel beyond its border it may still touch the face "
        "where the scan is cut off; farther out there is no contact."},
    Row{"Paused", &RecordingSummary::paused, RowCondition::kAlways,
        "The session was paused; the force faded out and stayed off."},
    Row{"Pointer at rest", &RecordingSummary::stale, RowCondition::kOfPointer,
        "The viewer's pointer was not pressed, or was lost; the force faded out and stayed off."},
    Row{"Clutched", &RecordingSummary::clutched, RowCondition::kWhenMet,
        "The clutch was pressed, so that the hand could move without the tip; the force faded out and stayed "
        "off."},
    Row{"Faded", &RecordingSummary::ramped, RowCondition::kWhenMet,
        "The force was fading in, over half a second at the start and after every interruption, or fading "
        "out."},
    Row{"Blended", &RecordingSummary::blended, RowCondition::kWhenMet,
        "The model, the method or a switch had changed; the force blended into the new one over a tenth of a "
        "second."},
    Row{"Inside", &RecordingSummary::inside, RowCondition::kWhenMet,
        "The tip was inside a structure when contact was re-established (start, clutch, pause), so its side "
        "of the surface was unknown; no force until it was free."},
    Row{"Wedged", &RecordingSummary::wedged, RowCondition::kWhenMet,
        "The tool was wider than the gap that it was in; its position was held."},
    Row{"Ruptured", &RecordingSummary::ruptured, RowCondition::kWhenMet,
        "The tool punctured a structure's surface at its puncture force."},
    Row{"Damped", &RecordingSummary::passivated, RowCondition::kWhenMet,
        "The force would have given the hand more energy than the hand had put in; damping removed the "
        "excess."},
    Row{"Turn held", &RecordingSummary::rotation_limited, RowCondition::kWhenMet,
        "The object turned slower than commanded, to limit its power on the hand to 5 mW."},
    Row{"Method missing", &RecordingSummary::method_missing, RowCondition::kWhenMet,
        "The model was not prepared for the chosen force method; the trilinear one was used."},
};

std::string row_html(const Run& run, const Row& row) {
  const std::uint64_t count = run.summary.*row.count;
  if (row.condition == (run.by_pointer() ? RowCondition::kOfHand : RowCondition::kOfPointer)) return "";
  const bool live = row.condition == RowCondition::kOnRealClock || row.condition == RowCondition::kOfHand;
  const bool expected = row.condition == RowCondition::kAlways || row.condition == RowCondition::kOfPointer ||
                        (live && run.real_clock());
  if (count == 0 && !expected) return "";
  const double ticks = static_cast<double>(run.recording.ticks);
  const double percent = ticks > 0 ? 100 * static_cast<double>(count) / ticks : 0;
  return "<tr" + std::string(count == 0 ? " class=\"none\"" : "") + "><th scope=\"row\">" + row.name +
         "</th>" + cell(grouped(count)) + cell(number(percent, percent > 0 && percent < 1 ? 2 : 1) + " %") +
         "<td class=\"text\">" + row.meaning + "</td></tr>\n";
}

template <std::size_t N>
std::string group_html(const Run& run, const char* css_class, const char* title,
                       const std::array<Row, N>& rows) {
  std::string html = std::string("<tbody class=\"") + css_class +
                     "\"><tr class=\"group\"><th scope=\"rowgroup\" colspan=\"4\">" + title + "</th></tr>\n";
  for (const Row& row : rows) html += row_html(run, row);
  return html + "</tbody>";
}

/// Text such as "8.50 N", or "not known".
std::string newtons(double force_N) {
  return std::isfinite(force_N) ? number(force_N, 2) + " N" : "not known";
}

/// Limits of the force: the limit in effect, each device's rating, the thermal load.
std::string limits_html(const Run& run) {
  if (run.recording.ticks == 0) return "";
  const ForceExtremes& forces = run.forces;
  std::string limit = number(forces.highest_limit_N, 2) + " N";
  if (forces.lowest_limit_N < forces.highest_limit_N)
    limit = number(forces.lowest_limit_N, 2) + " to " + limit;
  std::string html = "<dl class=\"provenance limits\">\n" + entry("Limit in effect", limit);
  bool thermal = false;
  for (int d = 0; d < run.devices; ++d) {
    const DeviceTick& device = run.first.device[static_cast<std::size_t>(d)];
    const std::string which = run.devices > 1 ? "Device " + std::to_string(d + 1) : "The device";
    html += entry(which + " gives at most", newtons(device.peak_force_N));
    html += entry(which + ": continuous force", newtons(device.continuous_force_N));
    thermal = thermal || std::isfinite(device.continuous_force_N);
  }
  html +=
      entry("Thermal budget, maximum used", thermal ? number(100 * forces.max_heat, 0) + " %" : "none kept");
  return html + "</dl>\n";
}

}  // namespace

std::string safety_table_html(const Run& run) {
  return "<section class=\"card\" aria-labelledby=\"safety-title\"><h2 id=\"safety-title\">Safety "
         "stage</h2>\n"
         "<div class=\"scroll\"><table><thead><tr><th scope=\"col\">Event</th><th "
         "scope=\"col\">Ticks</th><th scope=\"col\">Share</th><th scope=\"col\" "
         "class=\"text\">Meaning</th></tr></thead>\n" +
         group_html(run, "interventions", "Interventions", kInterventions) +
         group_html(run, "others", "Not an intervention", kOthers) + "</table></div>\n" + limits_html(run) +
         "</section>\n";
}

}  // namespace palpate::report
