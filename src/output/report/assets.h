#pragma once

#include "palpate/base/embedded_file.h"

namespace palpate {

/// Embedded files of the pages: page.css and page.js of this folder (cohort.css and cohort.js for the cohort
/// page, data.css for the data page, lint.css for the page of lint) and uPlot from third_party.
const std::vector<EmbeddedFile>& page_assets();

}  // namespace palpate
