#pragma once

#include <span>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/report/report.h"
#include "report/run.h"

/// The parts of the page, top to bottom. Everything that comes from a file is escaped in them.
namespace palpate::report {

/// That a recording was made with the model at hand, or an error that says which one is wanted.
Result<void> check_model(const RecordingHeader& header, const Model& model);

/// Title, who and when, the figures that a person looks at first.
std::string header_html(const Run& run);
std::string tiles_html(const Run& run);
/// What the simulated hand did not reach; empty when it reached everything.
std::string trouble_html(const Run& run);

/// Pictures in three dimensions. Empty where nothing was touched, and where the model has no labels.
struct VolumePictures {
  std::string html;  ///< all places that are shown and the path, from the side whence most of them are seen
  std::vector<std::string> of_contact;  ///< an image for each of Run::shown, from near by
};
/// Error kInterrupted.
Result<VolumePictures> volume_pictures(const Run& run, const Progress& progress);

/// The largest of 1, 2, 5, 10, ... mm per newton with which an arrow at the limit stays in a section.
double arrow_mm_per_N(double limit_N);
/// Tabs, one a structure, each with three sections through its contact. Error kInterrupted.
/// @param pictures  an image for each, or none
Result<std::string> contacts_html(const Run& run, std::span<const std::string> pictures,
                                  const Progress& progress);

/// How sections of a run's model are drawn, and the layers of one as images, the overlay's SVG not among
/// them.
SectionStyle section_style(const Model& model);
std::string section_layers(const Model& model, const SectionPlane& plane, const SectionStyle& style);
/// Width and height of a section's picture.
inline constexpr int kSection_px = 400;

/// What a run was scored as: figures against their bands, steps, events.
std::string task_html(const ScoredTask& scored);

/// Plan against done: figures, sections along each trajectory, volumes, distances. Error kInterrupted.
Result<std::string> plan_html(const Run& run, const RehearsedPlan& rehearsed, const Progress& progress);
/// Of its plot: the structures that it shows, those to keep away from first, and of each the distance on the
/// plots' times.
std::vector<std::size_t> plotted_approaches(const PlanComparison& made);
std::vector<double> approach_at(const PlanComparison& made, std::size_t approach, double begin_s,
                                const std::vector<double>& times_s);

/// The plots' places, and their data as a JSON block that page.js reads.
/// @param rehearsed  null: there was no plan
std::string plots_html(const Run& run, const RehearsedPlan* rehearsed);

std::string structure_table_html(const Run& run);
/// What a burr took away; empty where none was at work. Its plot's data stand in plots_html().
std::string removal_html(const Run& run);
std::string safety_table_html(const Run& run);
/// How the loop kept time; empty for a run on the virtual clock. Its plot's data stand in plots_html().
std::string loop_html(const Run& run);
/// @param names_from  ReportParts::names_from
std::string provenance_html(const Run& run, const std::string& names_from);

}  // namespace palpate::report
