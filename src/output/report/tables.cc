#include <cmath>

#include "palpate/base/hash.h"
#include "report/html.h"
#include "report/page_sections.h"

namespace palpate::report {
namespace {

std::string note(const std::string& text) {
  return "<span class=\"note\">" + text + "</span>";
}

/// Largest measured depth with remarks.
std::string depth_cell(const StructureFigures& figure) {
  std::string depth = number(figure.max_depth_mm, 2);
  if (depth.front() == '-' && std::isfinite(figure.max_depth_mm)) depth += note("in front of the surface");
  if (!figure.deeper_than_measured) return cell(depth);
  return cell(std::isnan(figure.max_depth_mm) ? note("deeper than measured")
                                              : depth + note("and deeper than measured"));
}

/// Table of structures beneath the touched ones; empty if there are none.
std::string beneath_table(const Run& run) {
  if (run.beneath.empty()) return "";
  std::string html =
      "<h3>Contributions of other structures</h3>\n"
      "<div class=\"scroll\"><table><thead><tr><th scope=\"col\">Structure</th><th scope=\"col\">Time <span "
      "class=\"unit\">s</span></th><th scope=\"col\">Largest contribution to the force <span "
      "class=\"unit\">N</span></th><th scope=\"col\">Longest path inside <span "
      "class=\"unit\">mm</span></th></tr></thead><tbody>\n";
  for (const DeepFigures& figure : run.beneath)
    html += "<tr><th scope=\"row\">" + swatch(run.colour(figure.label)) + escape(run.name(figure.label)) +
            "</th>" + cell(number(figure.time_s, 2)) + cell(number(figure.peak_force_N, 2)) +
            cell(number(figure.max_depth_mm, 2)) + "</tr>\n";
  return html +
         "</tbody></table></div>\n"
         "<p class=\"hint\">The force is the stiffness integrated along the tip's path inside. This table "
         "lists structures that contributed while another one was touched: structures beneath, and "
         "neighbours at a seam.</p>";
}

}  // namespace

std::string structure_table_html(const Run& run) {
  std::string html =
      "<section class=\"card\" aria-labelledby=\"structures-title\"><h2 id=\"structures-title\">"
      "Contact per structure</h2>\n";
  if (run.structures.empty()) return html + "<p class=\"empty\">Nothing was touched.</p></section>\n";
  html +=
      "<div class=\"scroll\"><table><thead><tr><th scope=\"col\">Structure</th><th "
      "scope=\"col\">Contacts</th>"
      "<th scope=\"col\">Time <span class=\"unit\">s</span></th><th scope=\"col\">Mean force <span "
      "class=\"unit\">N"
      "</span></th><th scope=\"col\">Largest force <span class=\"unit\">N</span></th><th "
      "scope=\"col\">Largest "
      "depth <span class=\"unit\">mm</span></th><th scope=\"col\">Mean speed <span "
      "class=\"unit\">mm/s</span></th>"
      "</tr></thead><tbody>\n";
  for (const StructureFigures& figure : run.structures) {
    html += "<tr><th scope=\"row\">" + swatch(run.colour(figure.label)) + escape(run.name(figure.label)) +
            (figure.in_passing() ? note("in passing") : "") + "</th>" +
            cell(figure.contacts > 0 ? std::to_string(figure.contacts) : "brief") +
            cell(number(figure.contact_s, 2)) + cell(number(figure.mean_force_N, 2)) +
            cell(number(figure.peak_force_N, 2)) + depth_cell(figure) +
            cell(number(figure.mean_speed_mm_s, 1)) + "</tr>\n";
  }
  html +=
      "</tbody></table></div>\n<p class=\"hint\">Contacts last at least 50 ms; times and means include "
      "briefer touches. In passing: less than " +
      number(kPassing_s, 1) + " s in all.";
  if (run.touched_in_front())
    html += " A negative depth lies in front of the segmented surface, in its smoothed rim.";
  if (run.deeper_than_measured())
    html += " Deeper than measured: inside the structure, and no surface of it was within reach.";
  return html + "</p>\n" + beneath_table(run) + "</section>\n";
}

std::string provenance_html(const Run& run, const std::string& names_from) {
  const RecordingHeader& header = run.recording.header;
  std::string html =
      "<section class=\"card\" aria-labelledby=\"provenance-title\"><h2 "
      "id=\"provenance-title\">Provenance</h2>\n"
      "<dl class=\"provenance\">\n";
  html += entry("palpate", header.palpate_version) + entry("Commit", header.commit, true);
  html += entry("Build", header.build_type) + entry("Compiler", header.compiler) +
          entry("SIMD", header.simd_target);
  html += entry("Started (UTC)", header.started_utc) + entry("Data set", header.data_set);
  html += entry("Device", header.device + (header.simulated ? " (simulated)" : ""));
  html += entry("Hand", header.hand.empty() ? "" : header.hand + (header.simulated ? " (simulated)" : ""));
  html += entry("Rate", json_number(header.rate_hz, 1) + " Hz, " + header.clock + " clock") +
          entry("Seed", std::to_string(header.seed));
  html += entry("Names of structures", names_from);
  html += entry("Model", hex(header.model_hash), true);
  if (!header.haptic_settings.empty()) {
    std::uint64_t hash = kHashSeed;
    hash_bytes(hash, header.haptic_settings.data(), header.haptic_settings.size());
    html += entry("Contact settings", hex(hash_finish(hash)), true);
  }
  html +=
      entry("Run", run.recording.summary ? hex(run.recording.summary->run_hash) : "none: cut short", true);
  html += "</dl>\n";
  if (run.recording.summary) {
    html += run.summary.dropped > 0 ? "<p class=\"hint\">The run hash is taken from the recording. Ticks are "
                                      "missing, so it cannot be verified.</p>\n"
                                    : "<p class=\"hint\">The run hash is taken from the recording; "
                                      "<code>palpate replay</code> recomputes the run and verifies it.</p>\n";
  }
  html +=
      "<p class=\"hint\"><code>palpate replay RECORDING --view</code> shows it in a browser, at any time and "
      "speed.</p>\n";
  if (!header.script_text.empty()) {
    html +=
        "<details><summary>Script as run</summary><pre>" + escape(header.script_text) + "</pre></details>\n";
  }
  return html + "</section>\n";
}

}  // namespace palpate::report
