#include "report/page_head.h"

#include "palpate/base/check.h"
#include "report/assets.h"
#include "report/html.h"

namespace palpate::report {

const EmbeddedFile& page_asset(std::string_view name) {
  const EmbeddedFile* file = find_file(page_assets(), name);
  PALPATE_CHECK(file != nullptr);
  return *file;
}

std::string page_head_html(const std::string& title, std::initializer_list<std::string_view> styles,
                           std::initializer_list<std::string_view> scripts) {
  std::string html =
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; base-uri 'none'; "
      "form-action 'none'; img-src data:; style-src";
  for (const std::string_view style : styles) html += " " + csp_hash(page_asset(style).sha256);
  if (scripts.size() > 0) html += "; script-src";
  for (const std::string_view script : scripts) html += " " + csp_hash(page_asset(script).sha256);
  html +=
      "\">\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<meta name=\"color-scheme\" content=\"light dark\">\n<meta name=\"referrer\" "
      "content=\"no-referrer\">\n"
      "<link rel=\"icon\" href=\"data:,\">\n<title>" +
      escape(title) + "</title>\n";
  for (const std::string_view style : styles)
    html.append("<style>").append(page_asset(style).text).append("</style>\n");
  return html + "</head>\n";
}

}  // namespace palpate::report
