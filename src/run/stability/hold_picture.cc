#include <algorithm>
#include <cmath>
#include <cstdio>

#include "palpate/base/file.h"
#include "palpate/geometry/decompositions.h"
#include "palpate/rendering/force_arrows_svg.h"
#include "palpate/stability/hold.h"

namespace palpate {
namespace {

using force_arrows::number, force_arrows::pair, force_arrows::path, force_arrows::rectangle,
    force_arrows::text;

constexpr double kWidth_px = 760, kLeft_px = 66, kPlot_px = 480, kTop_px = 76, kPanel_px = 92, kApart_px = 14;
constexpr double kFigures_px = kLeft_px + kPlot_px + 16;
// minimum range of the axis in encoder steps, so that a quiet tip's steps are visible
constexpr double kMinSteps = 4;

constexpr const char* kStyle =
    "<style>\n"
    "text{font-family:Helvetica,Arial,sans-serif;font-size:13px;fill:#222}\n"
    ".name{font-size:18px;font-weight:bold}.method{font-size:14px;font-weight:bold}.small{font-size:12px}\n"
    ".end{text-anchor:end;font-size:12px}.middle{text-anchor:middle;font-size:12px}\n"
    ".page{fill:#fff}.frame{fill:none;stroke:#555}.judged{fill:#f0f0f0}.band{fill:#9cc9e8}\n"
    ".tick{fill:none;stroke:#555}.way{fill:none;stroke:#b12a90;stroke-width:1;stroke-linejoin:round}\n"
    "</style>\n";

template <class... Values>
std::string format(const char* pattern, Values... values) {
  char buffer[200];
  std::snprintf(buffer, sizeof buffer, pattern, values...);
  return buffer;
}

/// Displacement of a tip along a line, mm relative to the middle of its range in the last second.
struct Trace {
  const HoldResult* result;
  std::vector<double> distance_mm;
};

// first principal axis of the positions of the tip with the largest motion
Vector<Patient> direction_of_most(std::span<const HoldResult> tips) {
  const HoldResult& most =
      *std::max_element(tips.begin(), tips.end(), [](const HoldResult& a, const HoldResult& b) {
        return a.buzz.peak_to_peak_um < b.buzz.peak_to_peak_um;
      });
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Point<Patient>& tip : most.tip) mean += tip.eigen() / static_cast<double>(most.tip.size());
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const Point<Patient>& tip : most.tip) {
    const Eigen::Vector3d off = tip.eigen() - mean;
    spread += off * off.transpose();
  }
  Eigen::Vector3d axis = symmetric_eigen(spread).vectors.col(2);
  Eigen::Index largest = 0;
  axis.cwiseAbs().maxCoeff(&largest);
  return Vector<Patient>(axis[largest] < 0 ? Eigen::Vector3d(-axis) : axis);
}

Trace trace_of(const HoldResult& result, const Vector<Patient>& along) {
  Trace trace{&result, {}};
  for (const Point<Patient>& tip : result.tip) trace.distance_mm.push_back(along.eigen().dot(tip.eigen()));
  const auto second = trace.distance_mm.end() - static_cast<std::ptrdiff_t>(std::lround(result.rate_hz)) - 1;
  const auto [low, high] = std::minmax_element(second, trace.distance_mm.end());
  const double middle_mm = 0.5 * (*low + *high);
  for (double& distance_mm : trace.distance_mm) distance_mm -= middle_mm;
  return trace;
}

// smallest of 1, 2 and 5 times a power of ten that is not less
double round_up(double value) {
  const double power = std::pow(10, std::floor(std::log10(value)));
  for (const double factor : {1.0, 2.0, 5.0})
    if (factor * power >= value) return factor * power;
  return 10 * power;
}

double scale_of(std::span<const Trace> traces) {
  double max_mm = kMinSteps * 1e-3 * traces.front().result->encoder_step_um;
  for (const Trace& trace : traces)
    for (const double distance_mm : trace.distance_mm) max_mm = std::max(max_mm, std::abs(distance_mm));
  return round_up(max_mm);
}

std::string length_text(double length_mm) {
  return std::abs(length_mm) < 1 ? format("%g \u00b5m", std::round(1e6 * length_mm) / 1e3)
                                 : format("%g mm", length_mm);
}

// minimum and maximum per half pixel column, which looks the same as the full polyline
std::string line_of(const Trace& trace, double top_px, double scale_mm) {
  constexpr int kColumns = 2 * static_cast<int>(kPlot_px);
  const auto count = trace.distance_mm.size();
  const double middle_px = top_px + 0.5 * kPanel_px;
  std::string data;
  for (int column = 0; column < kColumns; ++column) {
    const std::size_t begin = count * static_cast<std::size_t>(column) / kColumns;
    const std::size_t end = std::max(begin + 1, count * static_cast<std::size_t>(column + 1) / kColumns);
    const auto [low, high] =
        std::minmax_element(trace.distance_mm.begin() + static_cast<std::ptrdiff_t>(begin),
                            trace.distance_mm.begin() + static_cast<std::ptrdiff_t>(end));
    const double x = kLeft_px + 0.5 * column;
    const auto y = [&](double distance_mm) { return middle_px - 0.5 * kPanel_px * distance_mm / scale_mm; };
    data += (data.empty() ? "M" : "L") + pair({x, y(*low)});
    if (*low != *high) data += "L" + pair({x, y(*high)});
  }
  return path("way", data);
}

std::string panel(const Trace& trace, double top_px, double scale_mm) {
  const HoldResult& result = *trace.result;
  const Buzz& buzz = result.buzz;
  const double middle_px = top_px + 0.5 * kPanel_px;
  const double band_px = std::max(1.0, kPanel_px * 1e-3 * result.encoder_step_um / scale_mm);
  std::string svg = rectangle("judged", {kLeft_px + 0.5 * kPlot_px, top_px}, 0.5 * kPlot_px, kPanel_px) +
                    rectangle("band", {kLeft_px, middle_px - 0.5 * band_px}, kPlot_px, band_px) +
                    line_of(trace, top_px, scale_mm) +
                    rectangle("frame", {kLeft_px, top_px}, kPlot_px, kPanel_px);
  for (const double part : {1.0, 0.0, -1.0}) {
    const double y = middle_px - 0.5 * kPanel_px * part;
    const double label_y = std::clamp(y + 4, top_px + 10, top_px + kPanel_px);
    svg += path("tick", "M" + pair({kLeft_px - 4, y}) + "h4") +
           text("end", {kLeft_px - 7, label_y}, (part > 0 ? "+" : "") + length_text(part * scale_mm));
  }
  const char* state = result.quiet() ? "quiet" : "not quiet";
  const std::string rest = result.inside ? "begun inside: uncoupled" : result.wedged ? "wedged" : "";
  svg += text("method", {kFigures_px, top_px + 13}, name_of(result.method)) +
         text("small", {kFigures_px, top_px + 30}, format("%s: %.0f \u00b5m", state, buzz.peak_to_peak_um)) +
         text("small", {kFigures_px, top_px + 46}, format("20\u2013500 Hz: %.1f \u00b5m RMS", buzz.rms_um)) +
         text("small", {kFigures_px, top_px + 62},
              (buzz.dominant_Hz > 0 ? format("mostly %.0f Hz, ", buzz.dominant_Hz) : "") +
                  format("%.2f N", buzz.force_N)) +
         text("small", {kFigures_px, top_px + 78}, format("%.3g mJ given out", buzz.energy_mJ));
  if (!rest.empty()) svg += text("small", {kFigures_px, top_px + 92}, rest);
  return svg;
}

std::string time_axis(double top_px) {
  std::string svg;
  for (const double time_s : {0.0, 0.5, 1.0, 1.5, 2.0}) {
    const double x = kLeft_px + kPlot_px * time_s / kHoldDuration_s;
    svg += path("tick", "M" + pair({x, top_px}) + "v4") +
           text("middle", {x, top_px + 17}, format("%g s", time_s));
  }
  return svg;
}

}  // namespace

Result<void> write_hold_picture(const std::filesystem::path& file, std::span<const HoldResult> tips,
                                const std::string& heading) {
  PALPATE_CHECK(!tips.empty());
  const Vector<Patient> along = direction_of_most(tips);
  std::vector<Trace> traces;
  for (const HoldResult& result : tips) traces.push_back(trace_of(result, along));
  const double scale_mm = scale_of(traces);
  const double below_px = kTop_px + static_cast<double>(tips.size()) * (kPanel_px + kApart_px) - kApart_px;
  const double height_px = below_px + 66;

  std::string svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" + number(kWidth_px) +
                    "\" height=\"" + number(height_px) + "\" viewBox=\"0 0 " + number(kWidth_px) + " " +
                    number(height_px) + "\" role=\"img\">\n<title>A held tip's motion</title>\n" + kStyle +
                    rectangle("page", {0, 0}, kWidth_px, height_px) +
                    text("name", {16, 26}, "The tip while the hand rests") +
                    text("plain", {16, 46}, heading) +
                    text("plain", {16, 64},
                         format("motion along %.2f, %.2f, %.2f (LPS); blue: two encoder steps, %g \u00b5m",
                                along.x(), along.y(), along.z(), 2 * tips.front().encoder_step_um));
  for (std::size_t n = 0; n < traces.size(); ++n)
    svg += panel(traces[n], kTop_px + static_cast<double>(n) * (kPanel_px + kApart_px), scale_mm);
  svg += time_axis(below_px) +
         text("small", {16, below_px + 38},
              "Figures are of the last second (grey). Quiet: peak-to-peak, the farthest along an axis, "
              "within the "
              "blue band's width.") +
         text("small", {16, below_px + 56}, "Research and education \u2014 not for clinical use") +
         "</svg>\n";
  return write_file(file, svg);
}

}  // namespace palpate
