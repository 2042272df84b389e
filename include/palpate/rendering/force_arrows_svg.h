#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "palpate/rendering/force_arrows.h"
#include "palpate/rendering/markup.h"

/// SVG elements. Numbers use a decimal point in any locale.
namespace palpate::force_arrows {

using markup::base64, markup::css_colour, markup::escape;

/// Two decimals, without trailing zeros.
std::string number(double value);
/// "1.23 4.56"
std::string pair(const Pixel& p);

/// Text element; `content` is escaped.
std::string text(std::string_view css_class, const Pixel& at, std::string_view content);
std::string path(std::string_view css_class, std::string_view data, std::string_view attributes = "");
std::string rectangle(std::string_view css_class, const Pixel& corner, double width, double height,
                      std::string_view attributes = "");
std::string picture(const Image& image, const Pixel& corner);

}  // namespace palpate::force_arrows
