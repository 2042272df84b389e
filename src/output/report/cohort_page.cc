#include "palpate/report/cohort_page.h"

#include <algorithm>
#include <cmath>

#include "report/html.h"
#include "report/page_head.h"

namespace palpate::report {
namespace {

std::string cohort_tile(const std::string& term, const std::string& value, const std::string& kind = "") {
  return "<div class=\"tile" + kind + "\"><dt>" + term + "</dt><dd>" + value + "</dd></div>\n";
}

std::vector<std::string> groups_of(const CohortPage& page) {
  std::vector<std::string> groups;
  for (const CohortPage::Column& column : page.columns)
    if (!column.group.empty() && std::ranges::find(groups, column.group) == groups.end())
      groups.push_back(column.group);
  return groups;
}

/// HTML attribute with the group number of a structure's cells, by which the script shows and hides them.
std::string group_attribute(const std::vector<std::string>& groups, const std::string& group) {
  if (group.empty()) return "";
  const auto n = std::ranges::find(groups, group) - groups.begin();
  return " data-group=\"" + std::to_string(n) + "\"";
}

std::string header_row_html(const CohortPage& page, const std::vector<std::string>& groups) {
  std::string html =
      "<thead><tr><th class=\"pick\" scope=\"col\"><span class=\"unseen\">compare</span></th><th "
      "scope=\"col\" "
      "aria-sort=\"ascending\"><button data-sort=\"name\">case</button></th><th "
      "scope=\"col\"><button data-sort=\"state\">state</button></th>";
  for (std::size_t c = 0; c < page.columns.size(); ++c) {
    const CohortPage::Column& column = page.columns[c];
    html += "<th scope=\"col\"" + group_attribute(groups, column.group) + "><button data-sort=\"" +
            std::to_string(c) + "\">" + escape(column.title);
    if (!column.unit.empty()) html += " <span class=\"unit\">" + escape(column.unit) + "</span>";
    html += "</button></th>";
  }
  return html + "</tr></thead>\n";
}

std::string row_html(const CohortPage& page, const std::vector<std::string>& groups,
                     const CohortPage::Row& row, std::size_t position) {
  const std::string name = escape(row.name);
  std::string html = "<tr class=\"" + std::string(row.state == "done" ? "done" : "not-done") +
                     "\" data-number=\"" + std::to_string(position) +
                     "\"><td class=\"pick\"><input type=\"checkbox\" aria-label=\"compare " + name +
                     "\"></td><th scope=\"row\">";
  if (!row.picture_png.empty())
    html += "<img alt=\"\" src=\"data:image/png;base64," + markup::base64(row.picture_png) + "\">";
  html += "<span>" + name + "</span></th><td class=\"state\"><strong>" + escape(row.state) + "</strong>";
  if (!row.fault.empty()) html += "<span class=\"fault\">" + escape(row.fault) + "</span>";
  if (!row.notes.empty()) {
    html += "<details><summary>" + std::to_string(row.notes.size()) +
            (row.notes.size() == 1 ? " note" : " notes") + "</summary><ul>";
    for (const std::string& note : row.notes) html += "<li>" + escape(note) + "</li>";
    html += "</ul></details>";
  }
  html += "</td>";
  for (std::size_t c = 0; c < page.columns.size(); ++c) {
    const double value = c < row.values.size() ? row.values[c] : std::nan("");
    html += "<td" + group_attribute(groups, page.columns[c].group) + ">" +
            (std::isfinite(value) ? number(value, page.columns[c].decimals) : std::string()) + "</td>";
  }
  return html + "</tr>\n";
}

}  // namespace
}  // namespace palpate::report

namespace palpate {

std::string cohort_html(const CohortPage& page) {
  using namespace report;
  const auto groups = groups_of(page);
  const auto count = [&](const std::string& state) {
    return std::to_string(std::ranges::count(page.rows, state, &CohortPage::Row::state));
  };
  std::string html =
      page_head_html("Cohort", {"page.css", "cohort.css"}, {"cohort.js"}) +
      "<body>\n<div class=\"banner\" role=\"note\"><strong>Research and education - not for clinical "
      "use</strong><span class=\"badge\">Simulated hand</span></div>\n<main class=\"cohort\">\n"
      "<header><p class=\"kicker\">Cohort</p><h1>" +
      std::to_string(page.rows.size()) + (page.rows.size() == 1 ? " case" : " cases") +
      "</h1></header>\n<dl class=\"tiles\">\n" + cohort_tile("done", count("done")) +
      cohort_tile("failed", count("failed"), count("failed") == "0" ? "" : " alert") +
      cohort_tile("not done", count("not done"), count("not done") == "0" ? "" : " notice") + "</dl>\n";
  html +=
      "<section class=\"card compare\" id=\"compare\" aria-labelledby=\"compare-title\" hidden><h2 "
      "id=\"compare-title\">Compared</h2><div id=\"compared\"></div></section>\n"
      "<section class=\"card\" aria-labelledby=\"cases-title\"><h2 id=\"cases-title\">Cases</h2>\n"
      "<div class=\"controls\"><label>Find <input type=\"search\" id=\"find\"></label><label>Structure "
      "<select "
      "id=\"structure\"><option value=\"\">all together</option>";
  for (std::size_t n = 0; n < groups.size(); ++n)
    html += "<option value=\"" + std::to_string(n) + "\">" + escape(groups[n]) + "</option>";
  html +=
      "</select></label><span class=\"hint\">A heading sorts; tick cases to compare them.</span></div>\n<div "
      "class=\"scroll\"><table class=\"cases\">\n" +
      header_row_html(page, groups) + "<tbody>\n";
  for (std::size_t n = 0; n < page.rows.size(); ++n) html += row_html(page, groups, page.rows[n], n);
  html += "</tbody></table></div>\n<p class=\"hint\">palpate " + escape(page.program) +
          ". Parts: components of voxels that share a face. Gaps: places where a point may slip through. "
          "Thinnest place: along the medial surface of a structure, without its ends "
          "(docs/guide/cohort.md).</p></section>\n"
          "</main>\n";
  html.append("<script>").append(page_asset("cohort.js").text);
  return html + "</script>\n</body>\n</html>\n";
}

}  // namespace palpate
