#include "palpate/report/data_page.h"

#include "report/html.h"
#include "report/page_head.h"

namespace palpate {
namespace {

std::string data_set_html(const DataPage::Set& set) {
  const std::string name = report::escape(set.name);
  std::string html = "<article class=\"card set\">";
  if (set.picture_png.empty()) {
    html += "<div class=\"none hint\">no picture</div>";
  } else {
    html += "<img alt=\"The structures of " + name + " in three dimensions\" src=\"data:image/png;base64," +
            report::base64(set.picture_png) + "\">";
  }
  html += "<h2>" + name + "</h2><p>" + report::escape(set.summary) + "</p>";
  if (!set.fault.empty()) html += "<p class=\"fault\">" + report::escape(set.fault) + "</p>";
  return html + "<p class=\"hint\">" + report::escape(set.state) +
         "</p><p class=\"hint\">Licence: " + report::escape(set.licence) + "</p></article>\n";
}

}  // namespace

std::string data_html(const DataPage& page) {
  std::string html =
      report::page_head_html("Data sets", {"page.css", "data.css"}, {}) +
      "<body>\n<div class=\"banner\" role=\"note\"><strong>Research and education - not for clinical "
      "use</strong></div>\n<main>\n<header><p class=\"kicker\">palpate data list</p><h1>" +
      std::to_string(page.sets.size()) + (page.sets.size() == 1 ? " data set" : " data sets") +
      "</h1></header>\n<div class=\"sets\">\n";
  for (const DataPage::Set& set : page.sets) html += data_set_html(set);
  return html + "</div>\n<p class=\"hint\">palpate " + report::escape(page.program) +
         "</p>\n</main>\n</body>\n</html>\n";
}

}  // namespace palpate
