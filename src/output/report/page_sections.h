#pragma once

#include <span>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/report/report.h"
#include "report/run.h"

/// Sections of the report page, top to bottom. All text from files is escaped here.
namespace palpate::report {

/// Checks that a recording was made with this model; otherwise an error that names the right one.
Result<void> check_model(const RecordingHeader& header, const Model& model);

/// Title and origin of the run; key figures.
std::string header_html(const Run& run);
std::string tiles_html(const Run& run);
/// Warnings about goals that the simulated hand did not reach; empty if there are none.
std::string problems_html(const Run& run);

/// Volume renderings. Empty if nothing was touched or the model has no labels.
struct VolumePictures {
  std::string html;  ///< All shown contacts and the path, from the side on which most contacts are visible
  std::vector<std::string> of_contact;  ///< Close-up for each of Run::shown
};
/// Errors: kInterrupted.
Result<VolumePictures> volume_pictures(const Run& run, const Progress& progress);

/// Largest of 1, 2, 5, 10, ... mm per newton with which an arrow at the force limit fits into a section.
double arrow_mm_per_N(double limit_N);
/// Tabs, one per structure, each with three sections through its contact. Errors: kInterrupted.
/// @param pictures  one image per tab, or none
Result<std::string> contacts_html(const Run& run, std::span<const std::string> pictures,
                                  const Progress& progress);

/// Drawing style of sections through a run's model, and the image layers of one section, without the SVG
/// overlay.
SectionStyle section_style(const Model& model);
std::string section_layers(const Model& model, const SectionPlane& plane, const SectionStyle& style);
/// Width and height of a section's picture.
inline constexpr int kSection_px = 400;

/// Score of a run: metrics with their bands, steps, events.
std::string task_html(const ScoredTask& scored);

/// Comparison with the plan: deviations, sections along each trajectory, volumes, clearances. Errors:
/// kInterrupted.
Result<std::string> plan_html(const Run& run, const RehearsedPlan& rehearsed, const Progress& progress);
/// For the clearance plot: indices of the plotted structures, those with a required clearance first, and the
/// clearance of one of them resampled at the times of the plots.
std::vector<std::size_t> plotted_clearances(const PlanComparison& comparison);
std::vector<double> clearance_at(const PlanComparison& comparison, std::size_t structure, double begin_s,
                                 const std::vector<double>& times_s);

/// Containers of the plots, and their data as a JSON block that page.js reads.
/// @param rehearsed  null: there was no plan
std::string plots_html(const Run& run, const RehearsedPlan* rehearsed);

std::string structure_table_html(const Run& run);
/// Tissue removed by a burr; empty if none was used. The data of its plot are in plots_html().
std::string removal_html(const Run& run);
std::string safety_table_html(const Run& run);
/// Timing of the loop; empty for a run on the virtual clock. The data of its plot are in plots_html().
std::string loop_html(const Run& run);
/// @param names_from  ReportParts::names_from
std::string provenance_html(const Run& run, const std::string& names_from);

}  // namespace palpate::report
