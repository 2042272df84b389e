#include <cmath>

#include "report/html.h"
#include "report/page_sections.h"

namespace palpate::report {
namespace {

std::string spread_row(const std::string& name, const Spread& spread, const std::string& meaning) {
  std::string html = "<tr><th scope=\"row\">" + name + "</th>";
  for (const double value_s : {spread.p50_s, spread.p99_s, spread.p999_s, spread.max_s})
    html += cell(number(1e6 * value_s, 1));
  return html + "<td class=\"text\">" + meaning + "</td></tr>\n";
}

/// Text such as "1 000.2 Hz of 1 000 Hz"
std::string rate_text(const Run& run) {
  return number(run.rate.rate_hz(), 1) + " Hz of " + json_number(run.recording.header.rate_hz, 1) + " Hz";
}

std::string count_text(const Run& run, std::uint64_t count) {
  const double computed = static_cast<double>(run.recording.ticks + run.summary.dropped);
  const double percent = computed > 0 ? 100 * static_cast<double>(count) / computed : 0;
  return grouped(count) + (count > 0 ? " (" + number(percent, percent < 1 ? 3 : 1) + " %)" : "");
}

}  // namespace

std::string loop_html(const Run& run) {
  if (!run.real_clock() || run.recording.ticks == 0) return "";
  const Spread lateness = run.lateness.spread();
  const Spread compute = run.compute.spread();
  std::string html =
      "<section class=\"card\" aria-labelledby=\"loop-title\"><h2 id=\"loop-title\">Loop</h2>\n"
      "<dl class=\"provenance\">\n";
  html += entry("Scheduler", run.recording.header.scheduler) + entry("Rate, measured", rate_text(run));
  html += entry("Missed ticks",
                run.recording.summary ? count_text(run, run.summary.skipped) : "unknown: cut short");
  html += entry("Ticks not recorded", count_text(run, run.summary.dropped)) + "</dl>\n";
  html +=
      "<div class=\"scroll\"><table><thead><tr><th scope=\"col\">Time <span "
      "class=\"unit\">\u00b5s</span></th><th scope=\"col\">Median</th><th scope=\"col\">99th "
      "percentile</th><th scope=\"col\">99.9th percentile</th><th scope=\"col\">Maximum</th><th "
      "scope=\"col\" class=\"text\">Meaning</th></tr></thead><tbody>\n";
  html += spread_row("Lateness", lateness, "Delay of the start of a tick after its scheduled time.");
  html += spread_row("Computing", compute, "Time from reading the device to the command.");
  html += "</tbody></table></div>\n";
  return html +
         "<div class=\"plot\"><h3 id=\"lateness-title\">Lateness <span "
         "class=\"unit\">\u00b5s</span></h3><div "
         "class=\"canvas\" id=\"plot-lateness\" role=\"img\" aria-label=\"Lateness of each tick over " +
         number(run.duration_s, 1) + " s; most " + number(1e6 * lateness.max_s, 1) +
         " microseconds\"></div></div>\n</section>\n";
}

}  // namespace palpate::report
