#include <algorithm>

#include "report/html.h"
#include "report/overlay.h"
#include "report/parts.h"

namespace palpate::report {
namespace {

std::string tile(const std::string& label, const std::string& value, const std::string& detail,
                 const std::string& css_class = "") {
  return "<div class=\"tile" + (css_class.empty() ? "" : " " + css_class) + "\"><dt>" + label + "</dt><dd>" +
         value + "</dd><dd class=\"detail\">" + detail + "</dd></div>\n";
}

std::string unit(const std::string& value, const std::string& unit_text) {
  return value + " <span class=\"unit\">" + unit_text + "</span>";
}

std::string force_tile(const Run& run) {
  const ForceExtremes& forces = run.forces;
  const double limit = forces.highest_limit_N;
  const std::string limits = forces.lowest_limit_N < limit
                                 ? number(forces.lowest_limit_N, 2) + " to " + number(limit, 2)
                                 : number(limit, 2);
  // a bar: how much of the limit was used
  const double part = limit > 0 ? std::clamp(forces.peak_N / limit, 0.0, 1.0) : 0;
  const std::string bar =
      "<svg class=\"meter\" viewBox=\"0 0 100 4\" preserveAspectRatio=\"none\" aria-hidden=\"true\">"
      "<rect class=\"track\" width=\"100\" height=\"4\"/><rect class=\"value\" width=\"" +
      number(100 * part, 1) + "\" height=\"4\"/></svg>";
  // rounding of the clamp is not a breach
  const bool above = forces.peak_N > limit * (1 + 1e-9);
  return tile("Largest force sent", unit(number(forces.peak_N, 2), "N") + bar,
              (above ? "above the limit of " : "limit ") + limits + " N", above ? "alert" : "");
}

std::string safety_tile(const Run& run) {
  const SafetyCounts& safety = run.safety;
  const std::uint64_t interventions = safety.clamped + safety.not_finite;
  return tile("Safety stage", unit(grouped(interventions), interventions == 1 ? "tick" : "ticks"),
              grouped(safety.clamped) + " clamped, " + grouped(safety.not_finite) + " invalid",
              interventions > 0 ? "notice" : "");
}

std::string hash_tile(const Run& run) {
  const std::string& data_set = run.recording.header.data_set;
  const std::string replay =
      data_set.empty() ? "replays with its scene file" : "replays with " + escape(data_set);
  if (!run.recording.summary) return tile("Run hash", "None", "the run was cut short", "notice");
  return tile("Run hash", "<code>" + hex(run.recording.summary->run_hash) + "</code>", replay, "hash");
}

}  // namespace

std::string header_html(const Run& run) {
  const RecordingHeader& header = run.recording.header;
  std::string html = "<header class=\"title\"><p class=\"kicker\">Palpation report</p>\n<h1>" +
                     escape(header.scene_title.empty() ? "Untitled scene" : header.scene_title) +
                     "</h1>\n<p class=\"meta\">";
  html += "<span class=\"badge side\">" + side_text(run.model.side) + "</span>";
  if (!header.data_set.empty()) html += "<span>Data set " + escape(header.data_set) + "</span>";
  if (!header.device.empty()) html += "<span>Device " + escape(header.device) + "</span>";
  if (!header.hand.empty()) html += "<span>Hand " + escape(header.hand) + "</span>";
  if (!header.started_utc.empty()) html += "<span>Recorded " + escape(header.started_utc) + "</span>";
  html += "</p></header>\n";
  if (!run.recording.summary) {
    html +=
        "<p class=\"callout\" role=\"note\"><strong>This recording was cut short.</strong> It ends without a "
        "summary: everything below describes the part that was written, and there is no run hash to compare "
        "a replay with.</p>\n";
  }
  return html;
}

std::string tiles_html(const Run& run) {
  const std::size_t ticks = run.recording.ticks.size(), contacts = run.contacts.size();
  std::string html = "<dl class=\"tiles\">\n";
  html += tile("Duration", unit(number(run.duration_s(), 1), "s"),
               grouped(ticks) + " ticks at " + json_number(run.recording.header.rate_hz, 1) + " Hz");
  html += force_tile(run);
  html += tile("Structures touched", std::to_string(run.structures.size()),
               std::to_string(contacts) + (contacts == 1 ? " contact" : " contacts") + " of 50 ms or more");
  html += safety_tile(run) + hash_tile(run);
  return html + "</dl>\n";
}

}  // namespace palpate::report
