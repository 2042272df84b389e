#pragma once

#include "palpate/base/embedded_file.h"

namespace palpate {

/// The files that are part of every page: page.css and page.js of this folder (cohort.css and cohort.js of
/// the page about many cases, data.css of that about data sets), uPlot's from third_party.
const std::vector<EmbeddedFile>& page_assets();

}  // namespace palpate
