#pragma once

#include <string>

#include "palpate/base/progress.h"
#include "report/run.h"

/// The parts of the page, top to bottom. Everything that comes from a file is escaped in them.
namespace palpate::report {

/// Title, who and when, the figures that a person looks at first.
std::string header_html(const Run& run);
std::string tiles_html(const Run& run);
/// What the simulated hand did not reach; empty when it reached everything.
std::string trouble_html(const Run& run);

/// The structures in three dimensions, with all places that are shown and the path, from the side whence most
/// of them are seen. Empty where nothing was touched, and where the model has no labels. Error kInterrupted.
Result<std::string> volume_html(const Run& run, const Progress& progress);

/// The largest of 1, 2, 5, 10, ... mm per newton with which an arrow at the limit stays in a section.
double arrow_mm_per_N(double limit_N);
/// Tabs, one a structure, each with three sections through its contact. Error kInterrupted.
Result<std::string> contacts_html(const Run& run, const Progress& progress);

/// The plots' places, and their data as a JSON block that page.js reads.
std::string plots_html(const Run& run);

std::string structure_table_html(const Run& run);
/// What a burr took away; empty where none was at work. Its plot's data stand in plots_html().
std::string removal_html(const Run& run);
std::string safety_table_html(const Run& run);
/// How the loop kept time; empty for a run on the virtual clock. Its plot's data stand in plots_html().
std::string loop_html(const Run& run);
std::string provenance_html(const Run& run);

}  // namespace palpate::report
