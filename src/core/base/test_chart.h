#pragma once

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace palpate::test {

/// SVG line chart over a common horizontal axis: tests draw the figures of the documentation.
class Chart {
 public:
  /// @param first, last        range of the horizontal axis
  /// @param largest, smallest  range of the vertical axis
  Chart(const std::string& title, const std::string& across, const std::string& up, double first, double last,
        double largest, double smallest = 0)
      : first_(first), last_(last), most_(largest), least_(smallest) {
    svg_ << "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"760\" height=\"340\" viewBox=\"0 0 760 340\" "
            "role=\"img\">\n<title>"
         << title
         << "</title>\n<style>\n"
            "text{font-family:Helvetica,Arial,sans-serif;font-size:13px;fill:#222}\n"
            ".name{font-size:18px;font-weight:bold}.middle{text-anchor:middle}.end{text-anchor:end}\n"
            ".page{fill:#fff}.frame{fill:none;stroke:#555}.tick{fill:none;stroke:#ccc}\n"
            "path{fill:none;stroke-width:1.5;stroke-linejoin:round}.before{stroke:#b12a90}.after{stroke:#"
            "1b6ca8}\n"
            ".second{stroke-dasharray:7 3}.third{stroke-dasharray:2 3}\n"
            "</style>\n<rect class=\"page\" width=\"760\" height=\"340\"/>\n"
         << "<text class=\"name\" x=\"16\" y=\"26\">" << title << "</text>\n<text class=\"middle\" x=\""
         << 0.5 * (kLeft + kRight) << "\" y=\"" << kBottom + 38 << "\">" << across
         << "</text>\n<text x=\"16\" y=\"50\">" << up << "</text>\n<rect class=\"frame\" x=\"" << kLeft
         << "\" y=\"" << kTop << "\" width=\"" << kRight - kLeft << "\" height=\"" << kBottom - kTop
         << "\"/>\n";
  }
  void tick_across(double value) {
    svg_ << "<path class=\"tick\" d=\"M" << x(value) << " " << kTop << "V" << kBottom
         << "\"/><text class=\"middle\" x=\"" << x(value) << "\" y=\"" << kBottom + 17 << "\">" << value
         << "</text>\n";
  }
  void tick_up(double value) {
    svg_ << "<path class=\"tick\" d=\"M" << kLeft << " " << y(value) << "H" << kRight
         << "\"/><text class=\"end\" x=\"" << kLeft - 6 << "\" y=\"" << y(value) + 4 << "\">" << value
         << "</text>\n";
  }
  void line(const std::string& kind, const std::string& name,
            const std::vector<std::array<double, 2>>& points) {
    svg_ << "<path class=\"" << kind << "\" d=\"";
    for (std::size_t n = 0; n < points.size(); ++n)
      svg_ << (n == 0 ? "M" : "L") << x(points[n][0]) << " " << y(points[n][1]);
    const double at = kTop + 14 + 22 * named_++;
    svg_ << "\"/>\n<path class=\"" << kind << "\" d=\"M" << kRight + 12 << " " << at << "h28\"/><text x=\""
         << kRight + 46 << "\" y=\"" << at + 4 << "\">" << name << "</text>\n";
  }
  void write(const std::filesystem::path& file) { std::ofstream(file) << svg_.str() << "</svg>\n"; }

 private:
  static constexpr double kLeft = 56, kRight = 560, kTop = 64, kBottom = 280;
  double x(double value) const {
    return std::round(10 * (kLeft + (kRight - kLeft) * (value - first_) / (last_ - first_))) / 10;
  }
  double y(double value) const {
    return std::round(10 * (kBottom - (kBottom - kTop) * (value - least_) / (most_ - least_))) / 10;
  }

  std::ostringstream svg_;
  double first_, last_, most_, least_;
  int named_ = 0;
};

}  // namespace palpate::test
