#include "report/html.h"
#include "report/parts.h"

namespace palpate::report {
namespace {

std::string cell(const std::string& value) {
  return "<td>" + value + "</td>";
}

std::string safety_row(const Run& run, const std::string& name, std::uint64_t count,
                       const std::string& meaning) {
  const double ticks = static_cast<double>(run.recording.ticks.size());
  const double percent = ticks > 0 ? 100 * static_cast<double>(count) / ticks : 0;
  return "<tr" + std::string(count == 0 ? " class=\"none\"" : "") + "><th scope=\"row\">" + name + "</th>" +
         cell(grouped(count)) + cell(number(percent, percent > 0 && percent < 1 ? 2 : 1) + " %") +
         "<td class=\"text\">" + meaning + "</td></tr>\n";
}

std::string entry(const std::string& term, const std::string& value, bool code = false) {
  if (value.empty()) return "";
  const std::string content = code ? "<code>" + escape(value) + "</code>" : escape(value);
  return "<div><dt>" + term + "</dt><dd>" + content + "</dd></div>\n";
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
            "</th>" + cell(figure.contacts > 0 ? std::to_string(figure.contacts) : "brief") +
            cell(number(figure.contact_s, 2)) + cell(number(figure.mean_force_N, 2)) +
            cell(number(figure.peak_force_N, 2)) + cell(number(figure.max_depth_mm, 2)) +
            cell(number(figure.mean_speed_mm_s, 1)) + "</tr>\n";
  }
  return html +
         "</tbody></table></div>\n<p class=\"hint\">Contacts last at least 50 ms; times and means include "
         "briefer touches.</p></section>\n";
}

std::string safety_table_html(const Run& run) {
  std::string html =
      "<section class=\"card\" aria-labelledby=\"safety-title\"><h2 id=\"safety-title\">Safety stage</h2>\n"
      "<div class=\"scroll\"><table><thead><tr><th scope=\"col\">What happened</th><th scope=\"col\">Ticks"
      "</th><th scope=\"col\">Share</th><th scope=\"col\" class=\"text\">What it means</th></tr></thead>"
      "<tbody>\n";
  html +=
      safety_row(run, "Clamped", run.safety.clamped,
                 "The computed force was larger than the limit; the limit was sent, in the same direction.");
  html += safety_row(run, "Not finite", run.safety.not_finite,
                     "A position or a force was not a number; no force was sent.");
  html += safety_row(run, "Outside", run.safety.outside,
                     "The tip was outside the volume, where there is nothing to feel.");
  html += safety_row(run, "Paused", run.safety.paused, "The session was paused; no force was sent.");
  return html + "</tbody></table></div></section>\n";
}

std::string provenance_html(const Run& run) {
  const RecordingHeader& header = run.recording.header;
  std::string html =
      "<section class=\"card\" aria-labelledby=\"provenance-title\"><h2 id=\"provenance-title\">Where it "
      "comes from</h2>\n<dl class=\"provenance\">\n";
  html += entry("palpate", header.palpate_version) + entry("Commit", header.commit, true);
  html += entry("Build", header.build_type) + entry("Compiler", header.compiler) +
          entry("SIMD", header.simd_target);
  html += entry("Started (UTC)", header.started_utc) + entry("Data set", header.data_set);
  html += entry("Device", header.device + (header.simulated ? " (simulated)" : ""));
  html += entry("Hand", header.hand.empty() ? "" : header.hand + (header.simulated ? " (simulated)" : ""));
  html += entry("Rate", json_number(header.rate_hz, 1) + " Hz") + entry("Seed", std::to_string(header.seed));
  html += entry("Model", hex(header.model_hash), true);
  html +=
      entry("Run", run.recording.summary ? hex(run.recording.summary->run_hash) : "none: cut short", true);
  html += "</dl>\n";
  if (!header.script_text.empty()) {
    html +=
        "<details><summary>Script as run</summary><pre>" + escape(header.script_text) + "</pre></details>\n";
  }
  return html + "</section>\n";
}

}  // namespace palpate::report
