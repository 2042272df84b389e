#include <algorithm>
#include <cmath>
#include <numeric>

#include "palpate/rendering/rendering.h"
#include "report/html.h"
#include "report/page_sections.h"

namespace palpate::report {
namespace {

constexpr std::size_t kMaxPlottedApproaches = 8;

std::string heading_cell(const std::string& text, const std::string& unit = "") {
  return "<th scope=\"col\">" + text + (unit.empty() ? "" : " <span class=\"unit\">" + unit + "</span>") +
         "</th>";
}
std::string table_begin(const std::string& cells) {
  return "<div class=\"scroll\"><table><thead><tr>" + cells + "</tr></thead><tbody>\n";
}
constexpr const char* kTableEnd = "</tbody></table></div>\n";

std::string verdict_text(bool is_requested, bool is_met) {
  return !is_requested ? "" : is_met ? "kept" : "<strong>not kept</strong>";
}
/// Tolerance and verdict: "at most 2.00, kept"
std::string requested_text(const ToleratedValue& figure) {
  return !figure.allowed
             ? ""
             : "at most " + number(*figure.allowed, 2) + ", " + verdict_text(true, figure.is_within_limit());
}

std::string figure_row(const std::string& name, const std::string& unit, const ToleratedValue& figure,
                       const std::string& more) {
  return "<tr><th scope=\"row\">" + name + " <span class=\"unit\">" + unit + "</span></th>" +
         cell(number(figure.value, 2)) + cell(requested_text(figure)) + "<td>" + more + "</td></tr>\n";
}

std::string at_time(const RunPoint& point) {
  return "at " + number(point.time_s, 3) + " s, tick " + std::to_string(point.tick);
}

std::string entry_text(const TrajectoryResult& done) {
  switch (done.entry_kind) {
    case EntryKind::kPassed:
      return "passed the surface " + at_time(done.entry);
    case EntryKind::kTouched:
      return "touched without passing " + at_time(done.entry);
    case EntryKind::kNearest:
      return "nearest point of the path " + at_time(done.entry);
    case EntryKind::kNone:
      break;
  }
  return "its structures were not reached";
}

std::string target_text(const TrajectoryResult& done) {
  if (std::isnan(done.target_error_mm.value)) return "";
  return number(done.lateral_mm, 2) + " mm across the trajectory, " + number(std::abs(done.along_mm), 2) +
         " mm " + (done.along_mm > 0 ? "beyond" : "before") + " the target, " + at_time(done.nearest);
}

std::string trajectory_table(const PlanTrajectory& planned, const TrajectoryResult& done) {
  std::string html = table_begin(heading_cell("Metric") + heading_cell("Value") + heading_cell("Allowed") +
                                 heading_cell("Details"));
  html += figure_row("Entry error", "mm", done.entry_error_mm, entry_text(done));
  html += figure_row("Target error", "mm", done.target_error_mm, target_text(done));
  html += figure_row("Angle", "degrees", done.angle_deg,
                     std::isnan(done.line_rms_mm)
                         ? ""
                         : "the path lies " + number(done.line_rms_mm, 2) + " mm off its own line");
  html += figure_row("Depth error", "mm", done.depth_error_mm,
                     std::isnan(done.depth_mm) ? ""
                                               : number(done.depth_mm, 2) + " mm deep, planned " +
                                                     number(planned.length_mm(), 2) + " mm");
  if (!std::isnan(done.shaft_deg))
    html += figure_row("Shaft", "degrees", {done.shaft_deg, {}}, "at the deepest place");
  return html + kTableEnd;
}

/// Two perpendicular sections through the trajectory, with the trajectory and the tip's path.
std::string trajectory_sections(const Run& run, const PlanTrajectory& planned, const TrajectoryResult& done,
                                const std::vector<Point<Patient>>& path, const SectionStyle& style) {
  constexpr double kMinWidth_mm = 40, kMargin = 1.5;
  const Point<Patient> centre = planned.entry + (planned.target - planned.entry) * 0.5;
  SectionPlane plane =
      oblique_section(centre, planned.axis(), ObliqueView::kAlong,
                      std::max(kMinWidth_mm, kMargin * planned.length_mm()), kSection_px, kSection_px);
  SectionMarks marks;
  marks.contact = std::isnan(done.target_error_mm.value) ? planned.target : done.nearest.at;
  marks.side = run.side();
  marks.oriented = run.model.oriented;
  marks.doubts = markup::doubt_marks(run.model);
  marks.paths = {{false, path}};
  marks.planned = {planned.entry, planned.target};
  std::string html = "<div class=\"sections\">\n";
  for (const std::string name : {"Along the trajectory", "Along the trajectory, turned by 90 degrees"}) {
    html += "<figure class=\"section\"><div class=\"picture\">" + section_layers(run.model, plane, style) +
            section_svg(plane, marks, name + ": " + planned.name + ", with the path of the tip") +
            "</div><figcaption><span>" + name + "</span></figcaption></figure>\n";
    plane.right = plane.right.cross(plane.down);
  }
  return html + "</div>\n";
}

std::string volume_cells(const VolumeResult& volume) {
  return cell(number(volume.planned_mm3, 1)) + cell(number(volume.removed_mm3, 1)) +
         cell(number(volume.remaining_mm3(), 1));
}

std::string volume_tables(const Run& run, const RehearsedPlan& rehearsed) {
  const PlanComparison& comparison = rehearsed.comparison;
  const std::string columns = heading_cell("Planned", "mm\u00b3") + heading_cell("Taken", "mm\u00b3") +
                              heading_cell("Left", "mm\u00b3");
  std::string html;
  if (!comparison.regions.empty()) {
    html += table_begin(heading_cell("Volumes to remove") + columns);
    for (std::size_t n = 0; n < comparison.regions.size(); ++n)
      html += "<tr><th scope=\"row\">" + escape(rehearsed.plan.file.regions[n].name) + "</th>" +
              volume_cells(comparison.regions[n]) + "</tr>\n";
    html += kTableEnd;
  }
  if (!comparison.volumes.empty()) {
    html += table_begin(heading_cell("Structure") + columns + heading_cell("Outside the plan", "mm\u00b3"));
    for (const StructureVolume& volume : comparison.volumes)
      html += "<tr><th scope=\"row\">" + swatch(run.colour(volume.label)) + escape(run.name(volume.label)) +
              "</th>" + volume_cells(volume.in_plan) + cell(number(volume.outside_mm3, 1)) + "</tr>\n";
    html += kTableEnd;
  }
  return html;
}

std::string distance_tables(const Run& run, const PlanComparison& comparison) {
  std::string html = table_begin(heading_cell("Structure") + heading_cell("Nearest", "mm") +
                                 heading_cell("Keep away", "mm") + heading_cell("Closer than allowed", "s") +
                                 heading_cell("") + heading_cell("When"));
  for (const StructureClearance& approach : comparison.approaches)
    html += "<tr><th scope=\"row\">" + swatch(run.colour(approach.label)) + escape(run.name(approach.label)) +
            "</th>" + cell(number(approach.nearest_mm, 2)) +
            cell(approach.requested_mm ? number(*approach.requested_mm, 2) : "") +
            cell(approach.requested_mm ? number(approach.below_s, 3) : "") +
            cell(verdict_text(approach.requested_mm.has_value(), approach.is_within_limit())) + "<td>" +
            (std::isnan(approach.nearest_mm) ? "" : at_time(approach.nearest)) + "</td></tr>\n";
  html += kTableEnd;
  if (comparison.violations.empty()) return html;
  constexpr std::size_t kMaxShownViolations = 50;
  html += table_begin(heading_cell("Not kept") + heading_cell("Nearest", "mm") + heading_cell("Ticks") +
                      heading_cell("Time of the closest approach"));
  for (std::size_t n = 0; n < std::min(comparison.violations.size(), kMaxShownViolations); ++n) {
    const ClearanceViolation& violation = comparison.violations[n];
    html += "<tr><th scope=\"row\">" + swatch(run.colour(violation.label)) +
            escape(run.name(violation.label)) + "</th>" + cell(number(violation.nearest_mm, 2)) +
            cell(std::to_string(violation.begin.tick) + " to " + std::to_string(violation.last_tick)) +
            "<td>" + at_time(violation.nearest) + "</td></tr>\n";
  }
  html += kTableEnd;
  const std::uint64_t more = comparison.omitted_violations + comparison.violations.size() -
                             std::min(comparison.violations.size(), kMaxShownViolations);
  return more == 0 ? html : html + "<p class=\"hint\">And " + grouped(more) + " more.</p>\n";
}

}  // namespace

std::vector<std::size_t> plotted_clearances(const PlanComparison& comparison) {
  std::vector<std::size_t> order(comparison.approaches.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, {}, [&](std::size_t n) {
    const StructureClearance& approach = comparison.approaches[n];
    return std::pair(!approach.requested_mm, approach.nearest_mm);
  });
  order.resize(std::min(order.size(), kMaxPlottedApproaches));
  return order;
}

std::vector<double> clearance_at(const PlanComparison& comparison, std::size_t structure, double begin_s,
                                 const std::vector<double>& times_s) {
  std::vector<double> values;
  std::size_t interval = 0;
  for (const double time_s : times_s) {
    while (interval + 1 < comparison.times_s.size() && comparison.times_s[interval + 1] <= time_s - begin_s)
      ++interval;
    values.push_back(comparison.approaches[structure].over_time_mm[interval]);
  }
  return values;
}

Result<std::string> plan_html(const Run& run, const RehearsedPlan& rehearsed, const Progress& progress) {
  const PlanFile& plan = rehearsed.plan.file;
  const PlanComparison& comparison = rehearsed.comparison;
  std::string html =
      "<section class=\"card\" aria-labelledby=\"plan-title\"><h2 id=\"plan-title\">Plan and result</h2>\n"
      "<p class=\"hint\">" +
      escape(plan.title) + ": " +
      (comparison.is_within_limit() ? "all requirements of the plan were kept."
                                    : "a requirement of the plan was not kept.") +
      (comparison.cut_short ? " The recording was cut short." : "") +
      (comparison.missing_s > 0 ? " " + number(comparison.missing_s, 3) + " s are missing." : "") + "</p>\n";
  const SectionStyle style = section_style(run.model);
  for (std::size_t n = 0; n < comparison.trajectories.size(); ++n) {
    if (progress.stopped()) return Progress::interrupted();
    html += "<h3>" + escape(plan.trajectories[n].name) + "</h3>\n" +
            trajectory_table(plan.trajectories[n], comparison.trajectories[n]);
    if (run.model.labels != nullptr)
      html +=
          trajectory_sections(run, plan.trajectories[n], comparison.trajectories[n], comparison.path, style);
  }
  if (!comparison.trajectories.empty())
    html +=
        "<p class=\"hint\">Green: the trajectory, with a bar at its entry and a ring around its target. "
        "White: the path of the tip within " +
        number(kPathReach_mm, 0) + " mm of the plane. Ring with a dot: where it was nearest to the target. " +
        std::string(run.model.has_burr() ? "Structures are shown before cutting." : "") + "</p>\n";
  html += volume_tables(run, rehearsed) + distance_tables(run, comparison);
  return html +
         "<div class=\"plot\"><h3 id=\"clearance-title\">Distance from structures <span class=\"unit\">mm"
         "</span></h3><div class=\"canvas\" id=\"plot-clearance\" role=\"img\" aria-label=\"Least distance "
         "of "
         "the tool from structures over " +
         number(comparison.time_s, 1) + " s\"></div></div>\n</section>\n";
}

}  // namespace palpate::report
