#include <algorithm>
#include <cmath>

#include "report/html.h"
#include "report/page_sections.h"

namespace palpate::report {
namespace {

std::string removal_row(const std::string& heading, double volume_mm3, const std::string& part,
                        double first_s, double last_s, const std::string& depth) {
  return "<tr><th scope=\"row\">" + heading + "</th>" + cell(three_digits(volume_mm3)) + cell(part) +
         cell(number(first_s, 2)) + cell(number(last_s, 2)) + cell(depth) + "</tr>\n";
}

std::string removal_table(const Run& run) {
  std::string html =
      "<div class=\"scroll\"><table><thead><tr><th scope=\"col\">Structure</th><th scope=\"col\">Volume "
      "<span "
      "class=\"unit\">mm\u00b3</span></th><th scope=\"col\">Part of the structure <span class=\"unit\">%"
      "</span></th><th scope=\"col\">First cut <span class=\"unit\">s</span></th><th scope=\"col\">Last cut "
      "<span class=\"unit\">s</span></th><th scope=\"col\">Greatest depth <span "
      "class=\"unit\">mm</span></th></tr></thead><tbody>\n";
  double first_s = run.removal.structures.front().first_s, last_s = 0;
  for (const StructureRemoval& structure : run.removal.structures) {
    html += removal_row(swatch(run.colour(structure.label)) + escape(run.name(structure.label)),
                        structure.volume_mm3, three_digits(100 * structure.fraction), structure.first_s,
                        structure.last_s, number(structure.depth_mm, 2));
    first_s = std::min(first_s, structure.first_s);
    last_s = std::max(last_s, structure.last_s);
  }
  html += removal_row("All", run.removal.volume_mm3(), "", first_s, last_s, "") + "</tbody></table></div>\n";
  return html + "<p class=\"hint\">Depth: how far the " + cutter_name(run.model) +
         "'s far side reached below the initial surface of the structure while cutting it. Tissue counts as "
         "removed from the tick in which contact no longer includes it, some 10 to 40 ms after it was cut." +
         std::string(
             run.removal.undone > 0
                 ? " Times and depths include everything that was cut, volumes exclude undone strokes."
                 : "") +
         "</p>\n";
}

std::string spared_table(const Run& run) {
  const std::string cutter = cutter_name(run.model);
  std::string html =
      "<div class=\"scroll\"><table><thead><tr><th scope=\"col\">To be spared</th><th scope=\"col\">Nearest "
      "<span class=\"unit\">mm</span></th><th scope=\"col\">Removed <span "
      "class=\"unit\">mm\u00b3</span></th><th "
      "scope=\"col\">Protection</th></tr></thead><tbody>\n";
  bool all_near = true;
  for (const SparedStructure& spared : run.removal.spared) {
    double removed_mm3 = 0;
    for (const StructureRemoval& structure : run.removal.structures)
      if (structure.label == spared.label) removed_mm3 = structure.volume_mm3;
    all_near = all_near && !std::isnan(spared.nearest_mm);
    html += "<tr><th scope=\"row\">" + swatch(run.colour(spared.label)) + escape(run.name(spared.label)) +
            "</th>" + cell(number(spared.nearest_mm, 2)) + cell(three_digits(removed_mm3)) +
            cell(spared.is_protected ? "kept from the " + cutter : "cut like others") + "</tr>\n";
  }
  html += "</tbody></table></div>\n<p class=\"hint\">Nearest: from the " + cutter +
          " to the initial surface of the structure while it was running, whether it cut or not; undone "
          "strokes included.";
  return html + (all_near ? "" : " No figure: the " + cutter + " was never near.") + "</p>\n";
}

}  // namespace

std::string removal_html(const Run& run) {
  const RemovalFigures& removal = run.removal;
  if (removal.structures.empty() && removal.motor_s == 0) return "";
  std::string html =
      "<section class=\"card\" aria-labelledby=\"removal-title\"><h2 id=\"removal-title\">What was "
      "removed</h2>\n<dl class=\"provenance\">\n";
  for (int d = 0; d < run.devices; ++d)
    if (const Tool& tool = run.model.tool_of(static_cast<std::size_t>(d)); tool.burr)
      html +=
          entry(run.devices > 1 ? "Tool of device " + std::to_string(d + 1) : "Tool", burr_description(tool));
  html += entry("Motor switched on", number(removal.motor_s, 2) + " s");
  if (removal.undone > 0)
    html += entry("Strokes", std::to_string(removal.strokes) + ", of which " +
                                 std::to_string(removal.undone) + " undone");
  html += "</dl>\n";
  const std::string spared = removal.spared.empty() ? "" : spared_table(run);
  if (removal.structures.empty())
    return html + "<p class=\"empty\">The " + cutter_name(run.model) + " removed nothing.</p>" + spared +
           "</section>\n";
  return html + removal_table(run) + spared +
         "<div class=\"plot\"><h3 id=\"removed-title\">Removed <span class=\"unit\">mm\u00b3</span></h3><div "
         "class=\"canvas\" id=\"plot-removed\" role=\"img\" aria-label=\"Volume removed of each structure "
         "over " +
         number(run.duration_s, 1) + " s; " + three_digits(removal.volume_mm3()) +
         " cubic millimetres in all\"></div></div>\n</section>\n";
}

}  // namespace palpate::report
