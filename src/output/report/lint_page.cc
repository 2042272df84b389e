#include "palpate/report/lint_page.h"

#include <algorithm>

#include "report/html.h"
#include "report/page_head.h"

namespace palpate {
namespace {

std::string lint_tile(const std::string& term, const std::string& value, const char* kind) {
  return "<div class=\"tile" + std::string(kind) + "\"><dt>" + term + "</dt><dd>" + value + "</dd></div>\n";
}

std::string lint_number_cell(const std::string& text) {
  return "<td class=\"number\">" + text + "</td>";
}

std::string lint_structure_row(const LintPage::Structure& one) {
  const auto count = [](int n) { return lint_number_cell(n == 0 ? "" : std::to_string(n)); };
  return "<tr><th scope=\"row\"><svg class=\"swatch\" viewBox=\"0 0 11 11\" aria-hidden=\"true\"><rect "
         "width=\"11\" height=\"11\" fill=\"" +
         report::css_colour(one.colour) + "\"/></svg>" + report::escape(one.name) +
         "</th><td><span class=\"grade " + report::escape(one.grade) + "\">" + report::escape(one.grade) +
         "</span></td>" + lint_number_cell(report::grouped(one.voxels)) +
         lint_number_cell(report::number(one.volume_mm3 / 1000, 1)) + count(one.faults) +
         count(one.warnings) + count(one.undecided) + "</tr>\n";
}

std::string lint_finding_html(const LintPage::Finding& finding) {
  const std::string severity = report::escape(finding.severity);
  std::string html = "<article class=\"finding " +
                     std::string(finding.severity == "fault"     ? "fault"
                                 : finding.severity == "warning" ? "warning"
                                                                 : "untold") +
                     "\"><div class=\"text\"><h3>" + report::escape(finding.title) +
                     " <span class=\"badge\">" + severity + "</span></h3><p>" +
                     report::escape(finding.sentence) + ".</p>";
  if (finding.severity != "cannot tell")
    html += "<p class=\"hint\">In touch: " + report::escape(finding.effect) +
            ".</p><p class=\"hint\">Remedy: " + report::escape(finding.remedy) + ".</p>";
  if (!finding.position.empty()) html += "<p class=\"hint\">At " + report::escape(finding.position) + "</p>";
  html += "</div>";
  if (!finding.picture_png.empty())
    html += "<img loading=\"lazy\" alt=\"Axial, coronal and sagittal section through " +
            report::escape(finding.sentence) + "\" src=\"data:image/png;base64," +
            report::base64(finding.picture_png) + "\">";
  return html + "</article>\n";
}

}  // namespace

std::string lint_html(const LintPage& page) {
  const auto count = [&](const char* severity) {
    return std::to_string(std::ranges::count(page.findings, severity, &LintPage::Finding::severity));
  };
  const std::string faults = count("fault"), warnings = count("warning");
  std::string html =
      report::page_head_html("Labels examined", {"page.css", "lint.css"}, {}) +
      "<body>\n<div class=\"banner\" role=\"note\"><strong>Research and education - not for clinical "
      "use</strong></div>\n<main class=\"lint\">\n<header><p class=\"kicker\">palpate lint</p><h1>Fit for "
      "touch: grade " +
      report::escape(page.grade) + "</h1></header>\n<dl class=\"tiles\">\n" +
      lint_tile("structures", std::to_string(page.structures.size()), "") +
      lint_tile("faults", faults, faults == "0" ? "" : " alert") +
      lint_tile("warnings", warnings, warnings == "0" ? "" : " notice") +
      lint_tile("cannot tell", count("cannot tell"), "") +
      lint_tile("tool", report::number(2 * page.tool_radius_mm, 1) + " mm", "") +
      "</dl>\n<section class=\"card\" aria-labelledby=\"structures-title\"><h2 "
      "id=\"structures-title\">Structures</h2>\n<div class=\"scroll\"><table "
      "class=\"structures\"><thead><tr><th "
      "scope=\"col\">structure</th><th scope=\"col\">grade</th><th scope=\"col\" "
      "class=\"number\">voxels</th><th "
      "scope=\"col\" class=\"number\">volume <span class=\"unit\">ml</span></th><th scope=\"col\" "
      "class=\"number\">faults</th><th "
      "scope=\"col\" class=\"number\">warnings</th><th scope=\"col\" class=\"number\">cannot "
      "tell</th></tr></thead><tbody>\n";
  for (const LintPage::Structure& one : page.structures) html += lint_structure_row(one);
  html +=
      "</tbody></table></div>\n"
      "<p class=\"hint\">A: nothing found. B: warnings. C: faults of one kind. D: faults of several kinds. "
      "The grade of the map is the one that nine of ten structures reach.</p></section>\n"
      "<section class=\"card\" aria-labelledby=\"findings-title\"><h2 id=\"findings-title\">Findings</h2>\n";
  if (page.findings.empty()) html += "<p class=\"empty\">Nothing was found.</p>\n";
  const bool has_pictures = std::ranges::any_of(
      page.findings, [](const LintPage::Finding& finding) { return !finding.picture_png.empty(); });
  if (has_pictures)
    html +=
        "<p class=\"hint\">Pictures: axial, coronal and sagittal section through the ringed place; the "
        "patient's left is on the right, anterior on the left of the sagittal section. The first structure "
        "of a finding is orange, its other structures are blue, all others grey. Only the first findings of "
        "each kind have a picture.</p>\n";
  for (const LintPage::Finding& finding : page.findings) html += lint_finding_html(finding);
  html +=
      "</section>\n"
      "<section class=\"card\" aria-labelledby=\"kinds-title\"><h2 id=\"kinds-title\">Kinds of "
      "findings</h2>\n"
      "<dl class=\"kinds\">\n";
  for (const LintPage::Kind& kind : page.kinds)
    html += "<dt>" + report::escape(kind.title) + "</dt><dd>" + report::escape(kind.definition) + "</dd>\n";
  return html + "</dl></section>\n<p class=\"hint\">palpate " + report::escape(page.program) +
         "</p>\n</main>\n</body>\n</html>\n";
}

}  // namespace palpate
