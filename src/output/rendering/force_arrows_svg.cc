#include "palpate/rendering/force_arrows_svg.h"

#include <charconv>
#include <cmath>

namespace palpate::force_arrows {
namespace {

std::string attribute(std::string_view name, std::string_view value) {
  return " " + std::string(name) + "=\"" + std::string(value) + "\"";
}

std::string extra(std::string_view attributes) {
  return attributes.empty() ? "" : " " + std::string(attributes);
}

std::string start_of(std::string_view element, std::string_view css_class) {
  return "<" + std::string(element) + attribute("class", css_class);
}

std::string size_attributes(const Pixel& corner, double width, double height) {
  return attribute("x", number(corner[0])) + attribute("y", number(corner[1])) +
         attribute("width", number(width)) + attribute("height", number(height));
}

}  // namespace

std::string number(double value) {
  // rounded to hundredths, so that the shortest representation has at most two decimals
  const double rounded = std::round(value * 100) / 100;
  char buffer[400];
  const auto end =
      std::to_chars(buffer, buffer + sizeof buffer, rounded == 0 ? 0.0 : rounded, std::chars_format::fixed);
  return {buffer, end.ptr};
}

std::string pair(const Pixel& p) {
  return number(p[0]) + " " + number(p[1]);
}

std::string text(std::string_view css_class, const Pixel& at, std::string_view content) {
  return start_of("text", css_class) + attribute("x", number(at[0])) + attribute("y", number(at[1])) + ">" +
         escape(content) + "</text>\n";
}

std::string path(std::string_view css_class, std::string_view data, std::string_view attributes) {
  return start_of("path", css_class) + extra(attributes) + attribute("d", data) + "/>\n";
}

std::string rectangle(std::string_view css_class, const Pixel& corner, double width, double height,
                      std::string_view attributes) {
  return start_of("rect", css_class) + extra(attributes) + size_attributes(corner, width, height) + "/>\n";
}

std::string picture(const Image& image, const Pixel& corner) {
  return start_of("image", "section") + size_attributes(corner, image.width, image.height) +
         attribute("href", "data:image/png;base64," + base64(encode_png(image))) + "/>\n";
}

}  // namespace palpate::force_arrows
