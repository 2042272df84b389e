#include "palpate/report/report.h"

#include "palpate/base/file.h"
#include "report/assets.h"
#include "report/html.h"
#include "report/page_sections.h"

namespace palpate::report {
namespace {

const EmbeddedFile& asset(std::string_view name) {
  const EmbeddedFile* file = find_file(page_assets(), name);
  PALPATE_CHECK(file != nullptr);
  return *file;
}

/// Policy that allows only the styles and scripts embedded in the page.
std::string content_security_policy() {
  return "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:; style-src " +
         csp_hash(asset("uPlot.min.css").sha256) + " " + csp_hash(asset("page.css").sha256) +
         "; script-src " + csp_hash(asset("uPlot.iife.min.js").sha256) + " " +
         csp_hash(asset("page.js").sha256);
}

std::string head_html(const RecordingHeader& header) {
  const std::string title =
      header.scene_title.empty() ? "Palpation report" : "Palpation report: " + escape(header.scene_title);
  std::string html =
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"" +
      content_security_policy() + "\">\n";
  html +=
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<meta name=\"color-scheme\" content=\"light dark\">\n<meta name=\"referrer\" "
      "content=\"no-referrer\">\n"
      "<link rel=\"icon\" href=\"data:,\">\n<title>" +
      title + "</title>\n";
  html.append("<style>")
      .append(asset("uPlot.min.css").text)
      .append("</style>\n<style>")
      .append(asset("page.css").text);
  return html + "</style>\n</head>\n";
}

std::string banner_html(const Run& run) {
  return std::string(
             "<div class=\"banner\" role=\"note\"><strong>Research and education - not for clinical "
             "use</strong>") +
         (run.recording.header.simulated ? "<span class=\"badge\">Simulated hand</span>" : "") +
         (run.model.oriented ? "" : "<span class=\"badge\">Orientation unknown</span>") + "</div>\n";
}

}  // namespace

Result<void> check_model(const RecordingHeader& header, const Model& model) {
  if (header.model_hash != model.content_hash) {
    return Error{ErrorKind::kBadInput,
                 "the recording was made with a different model (" + hex(header.model_hash) +
                     ") from the one given (" + hex(model.content_hash) + ")",
                 "", "give the unchanged scene file or data set with which it was recorded"};
  }
  return {};
}

namespace {

Result<std::string> page_html(const RecordingSource& recording, const Model& model, const Progress& progress,
                              const ReportParts& parts) {
  const RecordingHeader& header = recording.head().header;
  if (auto same = check_model(header, model); !same) return same.error();
  const auto read = read_run(recording, model, progress);
  if (!read) return read.error();
  const Run& run = *read;
  const auto volume = volume_pictures(run, progress);
  if (!volume.ok()) return volume.error();
  const auto planned =
      parts.rehearsed != nullptr ? plan_html(run, *parts.rehearsed, progress) : Result<std::string>("");
  if (!planned.ok()) return planned.error();
  const auto contacts = contacts_html(run, volume->of_contact, progress);
  if (!contacts.ok()) return contacts.error();

  std::string html = head_html(header) + "<body>\n" + banner_html(run) + "<main>\n";
  html += header_html(run) + tiles_html(run) + problems_html(run) +
          (parts.scored != nullptr ? task_html(*parts.scored) : "") + volume->html + *planned + *contacts +
          plots_html(run, parts.rehearsed) + structure_table_html(run) + removal_html(run) +
          safety_table_html(run) + loop_html(run) + provenance_html(run, parts.names_from) + "</main>\n";
  html.append("<script>")
      .append(asset("uPlot.iife.min.js").text)
      .append("</script>\n<script>")
      .append(asset("page.js").text);
  progress.report("sections", 1);
  return html + "</script>\n</body>\n</html>\n";
}

}  // namespace
}  // namespace palpate::report

namespace palpate {

Result<std::string> report_html(const RecordingSource& recording, const Model& model,
                                const Progress& progress, const ReportParts& parts) {
  return report::page_html(recording, model, progress, parts);
}

Result<void> write_report(const std::filesystem::path& file, const RecordingSource& recording,
                          const Model& model, const Progress& progress, const ReportParts& parts) {
  const auto html = report_html(recording, model, progress, parts);
  if (!html.ok()) return html.error();
  return write_file(file, *html);
}

}  // namespace palpate
