#pragma once

#include <initializer_list>
#include <string>
#include <string_view>

#include "palpate/base/embedded_file.h"

namespace palpate::report {

/// An embedded file of the pages (assets.h).
const EmbeddedFile& page_asset(std::string_view name);

/// From the doctype to </head>. The files of `styles` are included; the content-security policy allows those
/// of `scripts` and nothing else.
/// @param title  text
std::string page_head_html(const std::string& title, std::initializer_list<std::string_view> styles,
                           std::initializer_list<std::string_view> scripts);

}  // namespace palpate::report
