#pragma once

#include <string_view>
#include <vector>

#include "palpate/base/embedded_file.h"

namespace palpate {

/// The viewer's page, or where it was not built, one that says so. Written by cmake/embed.cmake.
const std::vector<EmbeddedFile>& viewer_page();

}  // namespace palpate

namespace palpate::link {

/// The Content-Type of a file by the ending of its name.
std::string_view content_type_of(std::string_view name);

}  // namespace palpate::link
