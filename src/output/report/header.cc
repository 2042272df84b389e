#include <algorithm>

#include "palpate/tissue/soft_tissue_solver.h"
#include "report/html.h"
#include "report/overlay.h"
#include "report/page_sections.h"

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

std::string ticks_text(std::uint64_t count) {
  return grouped(count) + (count == 1 ? " tick" : " ticks");
}

std::string callout(const std::string& kind, const std::string& what, const std::string& meaning) {
  return "<p class=\"callout " + kind + "\" role=\"note\"><strong>" + what + "</strong> " + meaning +
         "</p>\n";
}

std::string side_badge(const Run& run) {
  const std::string side = markup::side_text(run.side());
  if (side.empty()) return "";
  const bool inferred = run.model.side_from_anatomy && run.side() != Side::kUnknown;
  return "<span class=\"badge side\">" + side + (inferred ? ", from the fibula" : "") + "</span>";
}

/// Force methods used in the run, in the order of their first tick.
std::string methods_text(const RecordingHead& recording) {
  std::string text;
  for (const RecordingHead::AppliedMethod& used : recording.methods)
    text += (text.empty() ? "" : ", ") + (used.method < kForceMethods.size()
                                              ? std::string(kForceMethods[used.method].name)
                                              : "number " + std::to_string(used.method));
  return text;
}

/// Warnings at the top of the page.
std::string callouts(const Run& run) {
  std::string html;
  if (!run.model.oriented) {
    html +=
        callout("notice", "Orientation unknown.",
                "The files do not state the orientation of the volume in the patient: left and right, front "
                "and back, head and feet are unknown, and the sections have no orientation letters.");
  }
  for (const Caveat& caveat : run.model.caveats)
    html += callout("notice", "Limitation of the model:", escape(caveat.text) + ".");
  if (run.is_deformable())
    html += callout("notice", "Resolution of soft tissue:",
                    "its forces were solved on cells of " + number(solver_cell_mm(run.model), 1) +
                        " mm. A nodule of less than " +
                        number(kResolvedNoduleCells * solver_cell_mm(run.model), 1) +
                        " mm is rendered with a fraction of its contrast.");
  if (!run.recording.summary) {
    html += callout("notice", "This recording was cut short.",
                    "It ends without a summary: everything below describes the part that was written, and "
                    "there is no run hash to verify a replay.");
  }
  if (run.summary.dropped > 0) {
    html += callout("notice", "Ticks are missing.",
                    ticks_text(run.summary.dropped) + (run.summary.dropped == 1 ? " was" : " were") +
                        " computed but not recorded, because the recorder did not keep up. The figures below "
                        "describe the recorded ticks, and no replay can reproduce the run.");
  }
  if (run.forces.above_limit > 0) {
    html += callout("alert", "Force above the limit.",
                    "In " + ticks_text(run.forces.above_limit) +
                        " the recorded force is larger than the limit recorded for the same tick. palpate "
                        "never sends such a force: the file was damaged or changed after the run.");
  }
  return html;
}

std::string force_tile(const Run& run) {
  const ForceExtremes& forces = run.forces;
  const double limit = forces.highest_limit_N;
  const std::string limits = forces.lowest_limit_N < limit
                                 ? number(forces.lowest_limit_N, 2) + " to " + number(limit, 2)
                                 : number(limit, 2);
  // bar: used fraction of the limit
  const double part = limit > 0 ? std::clamp(forces.peak_N / limit, 0.0, 1.0) : 0;
  const std::string bar =
      "<svg class=\"meter\" viewBox=\"0 0 100 4\" preserveAspectRatio=\"none\" aria-hidden=\"true\">"
      "<rect class=\"track\" width=\"100\" height=\"4\"/><rect class=\"value\" width=\"" +
      number(100 * part, 1) + "\" height=\"4\"/></svg>";
  const bool above = forces.above_limit > 0;
  return tile("Largest force sent", unit(number(forces.peak_N, 2), "N") + bar,
              "limit " + limits + " N" + (above ? ", exceeded in " + ticks_text(forces.above_limit) : ""),
              above ? "alert" : "");
}

std::string safety_tile(const Run& run) {
  // a tick may count in several categories
  const std::uint64_t ticks = run.interventions.ticks, other = run.other.ticks;
  return tile("Safety interventions", unit(grouped(ticks), ticks == 1 ? "tick" : "ticks"),
              grouped(run.summary.clamped) + " clamped, " + grouped(run.invalid.ticks) + " invalid" +
                  (other > 0 ? ", " + grouped(other) + " other" : ""),
              ticks > 0 ? "notice" : "");
}

std::string hash_tile(const Run& run) {
  const std::string& data_set = run.recording.header.data_set;
  const std::string model = data_set.empty() ? "its scene file" : escape(data_set);
  if (!run.recording.summary) return tile("Run hash", "None", "the run was cut short", "notice");
  return tile("Run hash", "<code>" + hex(run.recording.summary->run_hash) + "</code>",
              run.summary.dropped > 0 ? "as recorded; ticks are missing, so no replay can verify it"
                                      : "as recorded; a replay with " + model + " verifies it",
              "hash");
}

std::string structures_tile(const Run& run) {
  const auto passing = std::count_if(run.structures.begin(), run.structures.end(),
                                     [](const StructureFigures& figure) { return figure.in_passing(); });
  const auto touched = static_cast<std::ptrdiff_t>(run.structures.size()) - passing;
  return tile("Structures touched", std::to_string(touched),
              "for " + number(kPassing_s, 1) + " s or longer" +
                  (passing > 0 ? ", " + std::to_string(passing) + " more in passing" : ""));
}

}  // namespace

std::string header_html(const Run& run) {
  const RecordingHeader& header = run.recording.header;
  std::string html = "<header class=\"title\"><p class=\"kicker\">Palpation report</p>\n<h1>" +
                     escape(header.scene_title.empty() ? "Untitled scene" : header.scene_title) +
                     "</h1>\n<p class=\"meta\">";
  html += side_badge(run);
  if (!header.data_set.empty()) html += "<span>Data set " + escape(header.data_set) + "</span>";
  if (!header.device.empty()) html += "<span>Device " + escape(header.device) + "</span>";
  if (!header.hand.empty()) html += "<span>Hand " + escape(header.hand) + "</span>";
  if (run.recording.ticks > 0) html += "<span>Force method " + methods_text(run.recording) + "</span>";
  if (!header.started_utc.empty()) html += "<span>Recorded " + escape(header.started_utc) + "</span>";
  return html + "</p></header>\n" + callouts(run);
}

std::string tiles_html(const Run& run) {
  std::string html = "<dl class=\"tiles\">\n";
  html +=
      tile("Duration", unit(number(run.duration_s, 1), "s"),
           ticks_text(run.recording.ticks) + " at " + json_number(run.recording.header.rate_hz, 1) + " Hz");
  html += force_tile(run) + structures_tile(run) + safety_tile(run) + hash_tile(run);
  return html + "</dl>\n";
}

std::string problems_html(const Run& run) {
  if (!run.recording.summary || run.recording.summary->problems.empty()) return "";
  std::string html =
      "<section class=\"card notice\" aria-labelledby=\"trouble-title\"><h2 id=\"trouble-title\">Script "
      "steps that failed</h2>\n"
      "<p class=\"hint\">A press succeeds when the force stays within 10 % of the requested force; a hold "
      "when it stays within 20 % for the requested time, on the structure approached and without "
      "interruption. After a failed step the hand withdrew.</p>\n"
      "<ul class=\"trouble\">\n";
  for (const std::string& sentence : run.recording.summary->problems) {
    html += "<li>" + escape(sentence) + "</li>\n";
  }
  return html + "</ul></section>\n";
}

}  // namespace palpate::report
