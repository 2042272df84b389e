#pragma once

#include <initializer_list>
#include <string>
#include <string_view>

#include "palpate/base/embedded_file.h"

namespace palpate::report {

/// A file that is part of pages (assets.h).
const EmbeddedFile& page_asset(std::string_view name);

/// From the doctype to </head>: what is in `styles` stands in it, what is in `scripts` may stand in the page,
/// and nothing else is loaded or run. @param title  text
std::string page_head_html(const std::string& title, std::initializer_list<std::string_view> styles,
                           std::initializer_list<std::string_view> scripts);

}  // namespace palpate::report
